"""Definitions of the terms used in a report."""

from __future__ import annotations

TERMS: dict[str, str] = {
    "CAD": "The values of the robot's model file: the prior.",
    "prior": "Values and standard deviations before the log was seen. For links, CAD. For rotor inertia and friction, "
    "the model file's values, drawn towards those of the other legs' same joints where several legs are identified "
    "together.",
    "CAD + friction": "The model file's links, with rotor inertia, friction and torque offset of each joint fitted to "
    "the same data: the baseline that shows what the links' parameters bring on top of friction.",
    "identified": "Links and joints fitted together.",
    "RMSE": "Root of the mean squared difference between measured and predicted torque. Over all joints: the root of "
    "the mean of the joints' squares.",
    "torque RMS": "Root mean square of the measured torque over the samples that are drawn: what an error is to be "
    "compared with.",
    "validation": "Motion that the fit has not seen. Errors on the training data say how well a model bends, not how "
    "well it predicts.",
    "± std": "One standard deviation, from the torque noise seen in the residuals and the prior. It covers noise, not "
    "errors of the model itself, such as a friction law that does not fit.",
    "trust": "Good: the error bars hold. Doubtful: they are widened to the fit, or a reason is against them. Bad: the "
    "model does not explain the torques, and no figure is to be relied on.",
    "misfit": "Variance of the torque residuals over the stated one, 1 if model and noise are right.",
    "observable": "The data alone fix the value to within a tenth of what CAD leaves open.",
    "partial": "Data fix it only in combination with others. Predictions need the combination only; the value by "
    "itself leans on CAD.",
    "unobservable": "No torque of this motion changes with it beyond noise. It stays as CAD has it, or moves along "
    "with what was measured, as prior and physical consistency have it (the number in brackets; the export holds it).",
    "com": "Centre of mass in the link's frame. It is the first moment over the mass; where the mass is not measured "
    "it holds for CAD's mass, and its standard deviation leaves the mass's out.",
    "Ixx ... Izz": "Inertia about the origin of the link's frame, in the link's axes (not about the centre of mass).",
    "rank": "How many independent combinations of parameters the data know better than the prior.",
    "physically possible": "A non-negative mass density exists that has these moments, and no joint has negative rotor "
    "inertia or friction.",
    "torque lag": "How much later than the joint states the torques were stamped; found from the log, taken off.",
    "armature": "Rotor inertia times the gear ratio squared, as felt at the joint.",
}
"""By term, in the displayed order."""
