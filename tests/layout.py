"""Places of the model errors of a robot with four legs of three joints, which most tests use."""

from stadera.trunk.error_model import ErrorLayout

LAYOUT = ErrorLayout(joints=12, links=12, contacts=4, legs=(3, 3, 3, 3))
PLACES, ERRORS, LEARNT, JOINTS = LAYOUT.places, LAYOUT.count, LAYOUT.learnt, LAYOUT.by_swing
