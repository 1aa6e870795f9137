"""Result of `identify` as plain values, from which tables, reports, JSON and URDF are made."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from stadera.body import FRICTION_UNITS
from stadera.files import save_text, written_together
from stadera.identify.agreement import Agreement
from stadera.identify.observability import Combination, Identifiability, gradients_of
from stadera.identify.solutions import Estimate
from stadera.identify.varying import VARYING_UNITS, VaryingFriction
from stadera.inertia import ORDER, UNITS, InertialParameters
from stadera.information import Information
from stadera.results import Result
from stadera.robot.model import JointDynamics, Leg, Robot
from stadera.trunk.memory import Memory
from stadera.trunk.result import TrunkParameters
from stadera.trust import Trust
from stadera.types import Array

MODELS: tuple[str, ...] = ("prior", "prior_friction", "identified")
"""Models to compare: the robot's own, the same with its joint terms fitted, and the identified one."""


@dataclass(frozen=True)
class Quantity:
    """One parameter: prior, estimate, standard deviation, and observability.

    `std` is None for parameters on which the data carry no information, and for masses that were fixed at the prior.
    """

    prior: float
    value: float
    std: float | None
    verdict: Identifiability
    unit: str

    @property
    def is_held(self) -> bool:
        """True if the data do not determine the value, so that it has no standard deviation."""
        if self.std is None or self.verdict is Identifiability.UNOBSERVABLE:
            return True
        return self.verdict is Identifiability.PARTIAL and self.std <= 1e-12 * abs(self.prior)


@dataclass(frozen=True)
class KnownCombination(Quantity):
    """An identifiable combination of parameters, as text.

    The verdict holds for this log: richer motion may determine more combinations.
    """

    text: str = ""


@dataclass(frozen=True, eq=False)
class TorqueTrace:
    """Measured and predicted torques over time, thinned out for plots."""

    part: str  # "training" or "validation"
    time: Array  # (samples,) [s]
    measured: Array  # (samples, joints) [N·m]
    predicted: Mapping[str, Array]  # by model, (samples, joints) [N·m]


@dataclass(frozen=True, eq=False)
class LegIdentification:
    """Result for one leg."""

    leg: Leg  # names of the leg, its links and joints
    model: Mapping[str, float]  # the robot model's values of all parameters, by name
    estimate: Estimate  # the requested solution
    # joint terms fitted with the rigid bodies at CAD, by parameter name
    friction_only: Mapping[str, float] = field(default_factory=dict)
    structure: tuple[Combination, ...] = ()  # combinations that motion on a held trunk can determine
    structural_rank: int = 0  # rank of the regressor for rich motion without noise; this log's rank is in the estimate
    # by joint, standard deviation of the torque residual [N·m]
    noise: Mapping[str, float] = field(default_factory=dict)
    # by part, model and joint [N·m]
    rmse: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    traces: tuple[TorqueTrace, ...] = ()  # for plots
    warnings: tuple[str, ...] = ()  # for the reader of the report, one sentence each
    information: Information | None = None  # of the training rows, in units of their noise; None if it was not kept
    varying: Mapping[str, VaryingFriction] = field(default_factory=dict)  # by joint with Coulomb friction
    # joints whose held-out torques CAD with friction predicts better by more than chance; "" for all together
    worse: tuple[str, ...] = ()

    @cached_property
    def parameters(self) -> Mapping[str, Quantity]:
        """The ten parameters of each link, and the joint terms, by name; `<joint>.presliding` is the travel over which
        friction builds up after a reversal, of those joints where it is seen.
        """
        names, values = self.estimate.columns, self.estimate.values
        priors = np.array([self.model[name] for name in names])
        found = self._quantities(np.eye(len(names)), [unit_of(n) for n in names], values, priors)
        held = {name: replace(q, std=None) for name, q in zip(names, found, strict=True) if name in self.estimate.held}
        travels = {
            f"{joint}.presliding": Quantity(0.0, law.travel, law.travel_std, Identifiability.OBSERVABLE, "rad")
            for joint, law in self.varying.items()
            if law.travel
        }
        return dict(zip(names, found, strict=True)) | held | travels

    @property
    def joint_terms(self) -> dict[str, dict[str, Quantity]]:
        """Those of `parameters` that are of joints, by joint and term."""
        found: dict[str, dict[str, Quantity]] = {}
        for name, quantity in self.parameters.items():
            owner, term = name.rsplit(".", 1)
            if owner in self.leg.joints:
                found.setdefault(owner, {})[term] = quantity
        return found

    @cached_property
    def combinations(self) -> tuple[KnownCombination, ...]:
        """Combinations that motion on a held trunk can determine, and how well this log determines them."""
        estimate, units = self.estimate, [unit_of(combination.terms[0][0]) for combination in self.structure]
        gradients = gradients_of(self.structure, estimate.columns)
        found = self._quantities(gradients, units, gradients @ estimate.values, gradients @ estimate.prior.values)
        return tuple(
            KnownCombination(**vars(q), text=str(combination))
            for q, combination in zip(found, self.structure, strict=True)
        )

    @cached_property
    def constant_friction(self) -> Mapping[str, Quantity]:
        """By joint with Coulomb friction, that friction for models that hold no other: the mean over the log, load
        included [N·m].
        """
        names, joints = self.estimate.columns, tuple(self.varying)
        gradients = np.zeros((len(joints), len(names)))
        for row, joint in zip(gradients, joints, strict=True):
            row[names.index(f"{joint}.coulomb")] = 1.0
            row[names.index(f"{joint}.coulomb_load")] = self.varying[joint].load
        values = np.maximum(gradients @ self.estimate.values, 0.0)
        priors = np.array([self.model[f"{joint}.coulomb"] for joint in joints])
        return dict(zip(joints, self._quantities(gradients, ["N·m"] * len(joints), values, priors), strict=True))

    @cached_property
    def coms(self) -> Mapping[str, tuple[Quantity, Quantity, Quantity]]:
        """Centre of mass of each link [m], link frame."""
        return {link: self._com(link) for link in self.leg.links}

    def _com(self, link: str) -> tuple[Quantity, Quantity, Quantity]:
        """c = h / m, whose gradient is (-c/m, 1/m)."""
        estimate = self.estimate
        mass_at = estimate.prior.block(link).start
        body = estimate.inertia(link)
        gradients = np.zeros((3, len(estimate.columns)))
        gradients[:, mass_at] = -body.com / body.mass
        gradients[range(3), range(mass_at + 1, mass_at + 4)] = 1.0 / body.mass
        prior = InertialParameters(np.array([self.model[f"{link}.{name}"] for name in ORDER]))
        x, y, z = self._quantities(gradients, ["m"] * 3, body.com, prior.com)
        return x, y, z

    def _quantities(self, gradients: Array, units: list[str], values: Array, priors: Array) -> list[Quantity]:
        estimate = self.estimate
        stds = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", gradients, estimate.covariance, gradients), 0.0))
        verdicts = estimate.observability.verdicts(gradients)
        return [
            Quantity(float(p), float(v), None if q is Identifiability.UNOBSERVABLE else float(s), q, unit)
            for p, v, s, q, unit in zip(priors, values, stds, verdicts, units, strict=True)
        ]


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """Result of identifying legs from logs.

    Attributes:
        robot: the prior model.
        source: the log.
        method: "consistent" or "null-space".
        legs: one entry each.
        torque_lag: delay of the recorded torques relative to their stamps [s].
        validated_on: description of the validation part; None if there is none.
        trust: how well the legs explain the torques.
        notes: processing steps applied to the log, in order.
        warnings: that concern the whole log.
        agreement: of the logs, or of the two parts of a single one; None if there is only one part.
        trunk: of a robot that stood or walked, payload included; None without such a log.
        memory: the robot's memory with these logs, if one was asked for and they do not contradict it.
    """

    robot: Robot
    source: str
    method: str
    legs: tuple[LegIdentification, ...]
    torque_lag: float
    validated_on: str | None
    trust: Trust
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    trunk: TrunkParameters | None = None
    agreement: Agreement | None = None
    memory: Memory | None = None

    report = "stadera.report.identify.page"

    @property
    def rank(self) -> int:
        """Number of directions that the data determine better than the prior, over all legs."""
        return sum(leg.estimate.observability.rank for leg in self.legs)

    @property
    def parameters(self) -> int:
        """Number of requested parameters, over all legs."""
        return sum(len(leg.estimate.columns) for leg in self.legs)

    @property
    def is_physical(self) -> bool:
        """True if all identified links and joints are physically possible."""
        return all(leg.estimate.is_physical for leg in self.legs)

    def __repr__(self) -> str:
        lines = [f"{self.robot.name} by {self.source}: {self.trust.verdict}, misfit {self.trust.misfit:.2g}"]
        for leg in self.legs:
            rank, errors = leg.estimate.observability.rank, leg.rmse.get("validation") or leg.rmse.get("training")
            rmse = errors and f"RMSE {np.sqrt(np.mean(np.square(list(errors['identified'].values())))):.3g} N·m, "
            misfit = self.trust.by_leg[leg.leg.name]
            lines.append(
                f"  {leg.leg.name}: {rank} of {len(leg.estimate.columns)} directions, {rmse or ''}misfit {misfit:.2g}"
            )
        if self.trunk is not None:
            lines.append(f"  trunk: {self.trunk!r}")
        return "\n".join([*lines, *self.trust.reasons[:1]])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; see `stadera.identify.schema`."""
        from stadera.identify.schema import identification_dict

        return identification_dict(self)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame, one row per parameter: leg, of, parameter, prior, value, std, observability, unit.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        from stadera.identify.schema import identification_frame

        return identification_frame(self)

    def save_urdf(self, path: str | PathLike[str]) -> None:
        """Writes the robot's model file with the identified values, in the original's format; ModelError for another
        suffix.
        """
        from stadera.robot.export import export_model

        with written_together([path]) as (draft,):
            export_model(self.simulated_robot(), draft, note="\n  ".join((*self.unmeasured(), *self.friction_notes())))

    def save_usd(self, path: str | PathLike[str]) -> None:
        """Writes the identified robot as USD, see `stadera.robot.usd`. MissingExtraError: usd-core is not installed."""
        from stadera.robot.usd import write_usd

        write_usd(self.simulated_robot(), path, (*self.unmeasured(), *self.friction_notes()))

    def save_actuators(self, path: str | PathLike[str]) -> None:
        """Writes the drives as YAML for Isaac Lab and mjlab, see `stadera.robot.actuators`."""
        from stadera.robot.actuators import actuators_yaml

        source, notes = Path(self.source).name, self.friction_notes()
        save_text(path, actuators_yaml(self.simulated_robot(), self.torque_lag, source, notes))

    def draws(self, count: int = 1000, seed: int = 0) -> dict[str, Array]:
        """Robots drawn from the posterior, see `stadera.identify.draws`: each of `LegIdentification.parameters` by its
        name, (count,). Raises IdentificationError: an impossible leg, or no positive number.
        """
        from stadera.identify.draws import drawn

        rng, out = np.random.default_rng(seed), dict[str, Array]()
        for leg in self.legs:
            out |= dict(zip(leg.estimate.columns, drawn(leg.estimate, count, rng).T, strict=True))
            for joint, law in leg.varying.items():
                if law.travel:  # the bar is of its logarithm
                    spread = law.travel_std / law.travel
                    out[f"{joint}.presliding"] = law.travel * np.exp(spread * rng.normal(size=count))
        return out

    def save_draws(self, path: str | PathLike[str], count: int = 1000, seed: int = 0) -> None:
        """Writes `draws` as a table, CSV or Parquet by the suffix, a row each. RecordingError for another suffix."""
        from stadera.logs.frames import write_columns

        write_columns(self.draws(count, seed), path)

    def friction_notes(self) -> tuple[str, ...]:
        """How friction varies by more than two standard deviations, which no format of models can hold; one sentence
        for each joint where it does.
        """
        found: dict[str, dict[str, Quantity]] = {joint: {} for leg in self.legs for joint in leg.varying}
        for name, q in (item for leg in self.legs for item in leg.parameters.items()):
            joint, _, term = name.rpartition(".")
            if term in _VARIES and q.std is not None and abs(q.value) > 2.0 * q.std:
                found[joint][term] = q
        notes = []
        for joint, terms in found.items():
            how = " and ".join(dict.fromkeys(_VARIES[term] for term in terms))
            values = ", ".join(f"{term} {q.value:.4g} +- {q.std:.2g} {q.unit}" for term, q in terms.items())
            notes += [f"Friction of {joint} {how}, for which this format has no place: {values}."] if terms else []
        return tuple(notes)

    def unmeasured(self) -> tuple[str, ...]:
        """Which values the logs do not measure, one sentence for each leg."""
        return tuple(filter(None, map(_unmeasured, self.legs)))

    def identified_robot(self) -> Robot:
        """The robot with the identified parameters of links and joints, and of the trunk as far as it was observed."""
        robot = robot_with_legs(self.robot, self.legs)
        return robot if self.trunk is None else robot.with_inertias({robot.trunk: self.trunk.inertial})

    def simulated_robot(self) -> Robot:
        """The identified robot for a simulator, whose friction does not vary: see `constant_friction`."""
        robot, found = self.identified_robot(), {j: q for leg in self.legs for j, q in leg.constant_friction.items()}
        std = {j: np.nan if q.is_held or q.std is None else q.std for j, q in found.items()}
        dynamics = {joint: replace(robot.dynamics[joint], coulomb=q.value) for joint, q in found.items()}
        known = {joint: replace(robot.dynamics_std[joint], coulomb=std[joint]) for joint in found}
        return robot.with_dynamics(dynamics, known)


def robot_with_legs(robot: Robot, legs: Iterable[LegIdentification]) -> Robot:
    """Returns the robot with the identified parameters of links and joints, and the joints' standard deviations."""
    inertias, dynamics, std = dict(robot.inertias), dict(robot.dynamics), dict(robot.dynamics_std)
    for leg in legs:
        found = leg.estimate.by_name()
        inertias |= {link: leg.estimate.inertia(link) for link in leg.leg.links}
        for joint in leg.leg.joints:
            terms = {t: found[f"{joint}.{t}"] for t in JointDynamics.__dataclass_fields__ if f"{joint}.{t}" in found}
            dynamics[joint] = replace(dynamics[joint], **terms)
            known = {t: leg.parameters.get(f"{joint}.{t}") for t in JointDynamics.__dataclass_fields__}
            stds = {t: np.nan if q is None or q.is_held or q.std is None else q.std for t, q in known.items()}
            std[joint] = JointDynamics(**stds)
    return replace(robot, inertias=inertias, dynamics=dynamics, dynamics_std=std)


def _unmeasured(leg: LegIdentification) -> str:
    held: dict[str, list[str]] = {}
    for owner, _, term in (name.rpartition(".") for name, quantity in leg.parameters.items() if quantity.is_held):
        if term not in VARYING_UNITS:  # which no format holds
            held.setdefault(owner, []).append(term)
    listed = "; ".join(f"{owner} {', '.join(terms)}" for owner, terms in held.items())
    why = "Not measured, the model's, or after the same joint of other legs, as far as physical consistency allows"
    return listed and f"{why}: {listed}."


_VARIES = dict.fromkeys(("coulomb_cos", "coulomb_sin"), "varies with position")
_VARIES |= {"coulomb_load": "grows with the load", "presliding": "builds up after a reversal"}
_UNITS = dict(zip(ORDER, UNITS, strict=True)) | FRICTION_UNITS | VARYING_UNITS


def unit_of(column: str) -> str:
    return _UNITS[column.rsplit(".", 1)[1]]
