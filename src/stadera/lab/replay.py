"""Replays a log in MuJoCo: the recorded torques, or the controller that made them, drive models of the robot, and the
joints' paths are compared with the recorded ones.

The trunk is held, as in logs of legs in the air. A rollout begins at the recorded positions and velocities, and is not
corrected after that. What is recorded as torque acts `lag` after its stamp, in all models alike. Where it is the
command of a controller at the joint, kp (q_des - q) + kd (0 - q̇), the controller is part of the rollout: with the
recorded torque and motion the desired position drops out,

    τ(t) = τ_rec(t - lag) + kp (q_rec - q)(t - lag) + kd (q̇_rec - q̇)(t - lag).

Friction that varies (`stadera.identify.varying`) is computed at each step, as no format of MuJoCo holds it: the largest
dry friction τ_c(q) of the joint's constraint, and in place of the constraint the torque τ_c(q) z of presliding, whose
state z is that of the recorded path at the beginning.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from stadera.body.friction import FRICTION_TERMS, presliding
from stadera.boundary import foreign
from stadera.checks import Guard
from stadera.errors import ModelError, RecordingError, StaderaError, require_positive
from stadera.identify.job import carried_shares, vertical_of
from stadera.identify.log import chunks
from stadera.identify.schema import with_identified_legs
from stadera.lab.plant.model import build_model, joint_offsets
from stadera.logs.filters import highest_cutoff
from stadera.logs.processing import Preprocessing, Processed, preprocess
from stadera.logs.reader import Log, as_log, read_head
from stadera.logs.recording import concatenate
from stadera.logs.topics import PdGains
from stadera.results import Result, data_frame
from stadera.robot.load import load_robot
from stadera.robot.model import JointDynamics, Robot
from stadera.types import Array, Progress


@dataclass(frozen=True)
class ReplaySettings:
    """Settings of a replay."""

    windows: tuple[float, ...] = (0.25, 0.5, 1.0)  # lengths over which errors are taken, the longest is simulated [s]
    every: float = 0.25  # between the beginnings of two rollouts [s]
    skip: float = 0.5  # share of the log that is left out at its beginning: what was fitted [1]
    timestep: float = 1e-3  # [s]
    cutoff_hz: float = 25.0  # of the low-pass filter over all signals, as in identification [Hz]
    most_carried: float = 0.1  # share of the robot's weight on a foot above which the log is refused [1]

    def __post_init__(self) -> None:
        require_positive("replay setting", self, ("every", "timestep", "cutoff_hz", "most_carried"))
        if not 0.0 <= self.skip < 1.0 or not self.windows or min(self.windows) <= 0.0:
            raise StaderaError(
                f"a replay skips a share below 1 and has windows above 0 s, got {self.skip}, {self.windows}"
            )


@dataclass(frozen=True)
class JointLaw:
    """Friction of one joint besides a constant: a, b and μ with their centres, and the travel of presliding [rad]."""

    cos: tuple[float, float] = (0.0, 0.0)  # value [N·m] and centre [1]
    sin: tuple[float, float] = (0.0, 0.0)  # value [N·m] and centre [1]
    load: tuple[float, float] = (0.0, 0.0)  # value [1] and centre [N·m]
    travel: float = 0.0  # [rad], zero for friction at once


@dataclass(frozen=True, eq=False)
class Drive:
    """What is compared: a name, a robot, and the laws of joints whose friction varies."""

    name: str
    robot: Robot
    laws: Mapping[str, JointLaw] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Replay(Result):
    """Result of `replay`."""

    source: str  # the log
    joints: tuple[str, ...]  # their names
    windows: tuple[float, ...]  # [s]
    begins: Array  # (rollouts,) [s], from the log's beginning
    time: Array  # (samples,) [s], from a rollout's beginning
    recorded: Array  # paths (rollouts, samples, joints) [rad]
    paths: Mapping[str, Array]  # likewise by model, the first is the one that is tested
    lag: float  # of the torques [s]
    gains: PdGains | None  # of the controller; None for torques alone

    report = "stadera.lab.report.replay"

    def rmse(self, model: str, window: float) -> Array:
        """Root mean square error over all rollouts of this length [s], (joints,) [rad]."""
        within = self.time <= window + 1e-9
        return np.asarray(np.sqrt(np.mean((self.paths[model] - self.recorded)[:, within] ** 2, axis=(0, 1))))

    def overall(self, model: str, window: float) -> float:
        """The same over all joints [rad]."""
        return float(np.sqrt(np.mean(self.rmse(model, window) ** 2)))

    def to_dict(self) -> dict[str, Any]:
        """Log, settings, and RMSE by window, model and joint [rad]."""
        rmse = {
            f"{window:g}": {
                model: {"all": self.overall(model, window)}
                | dict(zip(self.joints, self.rmse(model, window).tolist(), strict=True))
                for model in self.paths
            }
            for window in self.windows
        }
        return {
            "source": self.source,
            "models": list(self.paths),
            "rollouts": len(self.begins),
            "torque_lag": self.lag,
            "kp": self.gains and list(self.gains.kp),
            "kd": self.gains and list(self.gains.kd),
            "rmse": rmse,
            "units": {"rmse": "rad", "torque_lag": "s", "kp": "N·m/rad", "kd": "N·m·s/rad", "windows": "s"},
        }

    def to_dataframe(self) -> Any:
        """One row for each window, model and joint. Raises MissingExtraError: pandas is not installed."""
        rows = [
            (window, model, joint, error)
            for window in self.windows
            for model in self.paths
            for joint, error in zip(self.joints, self.rmse(model, window).tolist(), strict=True)
        ]
        return data_frame(dict(zip(("window", "model", "joint", "rmse"), zip(*rows, strict=True), strict=True)))


def replay(
    log: Log,
    models: Sequence[Drive],
    *,
    lag: float = 0.0,
    gains: PdGains | None = None,
    settings: ReplaySettings | None = None,
    fix: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> Replay:
    """Rolls models out along a log of legs in the air.

    Args:
        models: of the same joints, the one to test first.
        lag: how much later than its stamp a torque acts [s]; not below zero with a controller, which would have to know
            the motion to come.
        gains: if the torques are the commands of a controller at the joints; one pair for all, or one each along a leg.
        fix: correct units and signs of the log that are certainly wrong.
        force: replay a log whose units or signs are wrong.

    Raises:
        RecordingError: no torques, a foot that carries load, a log that is too short, or a controller with such a lag.
        UntrustedError: units or signs of the log are wrong, and `force` is false.
        ModelError: a model that MuJoCo cannot simulate.
    """
    asked, source = settings or ReplaySettings(), as_log(log)
    robot = models[0].robot
    if gains is not None and round(lag / asked.timestep) < 0:
        raise RecordingError(
            f"{source.source}: a controller's torque acts at its stamp or later, got a lag of {lag:g} s"
        )
    head = read_head(source)
    joints = tuple(j for leg in robot.legs if set(leg.joints) <= set(head.joints) for j in leg.joints)
    if not joints:
        raise RecordingError(f"{source.source}: no leg of {robot.name} is recorded with all of its joints")
    source = Guard(robot, joints, on_feet=False).admitted(source, fix=fix, force=force)
    whole = concatenate(list(chunks(source, joints)))
    up = vertical_of(whole, robot, None).up
    shares = carried_shares(whole, robot, None)
    if any(share > asked.most_carried for share in shares.values()):
        raise RecordingError(f"{source.source}: feet carry a share of the robot's weight; legs in the air are replayed")
    cutoff = min(asked.cutoff_hz, 0.98 * highest_cutoff(whole))
    driven = preprocess(whole, Preprocessing(cutoff, effort_delay=lag), joints)
    begins = _begins(driven, asked)
    watch, paths = progress or (lambda *_: None), {}
    time = np.asarray(asked.timestep * np.arange(round(max(asked.windows) / asked.timestep) + 1), dtype=float)
    kept = slice(None, None, max(1, round(0.005 / asked.timestep)))
    for done, model in enumerate(models):
        simulated = _Simulated(model, joints, up, asked.timestep, gains)
        rolled = [simulated.rollout(driven, begin, time, lag) for begin in begins]
        paths[model.name] = np.array(rolled)[:, kept]
        watch("rolling models out", done + 1, len(models))
    recorded = np.array([_at(driven.time, driven.position, begin + time[kept]) for begin in begins])
    first = float(whole.time[0])
    return Replay(source.source, joints, asked.windows, begins - first, time[kept], recorded, paths, lag, gains)


def _begins(driven: Processed, settings: ReplaySettings) -> Array:
    first, last = float(driven.time[0]), float(driven.time[-1])
    begin, end = first + settings.skip * (last - first), last - max(settings.windows)
    if end <= begin:
        raise RecordingError(
            f"{driven.source}: {last - begin:.3g} s are left for rollouts of {max(settings.windows):g} s; too short"
        )
    return np.asarray(np.arange(begin, end, settings.every), dtype=float)


def _at(time: Array, values: Array, when: Array) -> Array:
    """Values (samples, n) at other times, (times, n)."""
    return np.column_stack([np.interp(when, time, column) for column in values.T])


class _Simulated:
    def __init__(
        self, drive: Drive, joints: tuple[str, ...], up: Array, timestep: float, gains: PdGains | None
    ) -> None:
        robot, tree = drive.robot, drive.robot.tree.restricted(joints)
        self.order = [joints.index(joint) for joint in tree.joints]
        self.model = build_model(robot, tree, timestep=timestep)
        self.model.opt.gravity[:] = -np.linalg.norm(self.model.opt.gravity) * up / np.linalg.norm(up)
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.data = mujoco.MjData(self.model)
        self.offsets = joint_offsets(robot, tree)
        self.coulomb = np.array([robot.dynamics[joint].coulomb for joint in tree.joints])
        laws = [drive.laws.get(joint, JointLaw()) for joint in tree.joints]
        self.terms = np.array([(*law.cos, *law.sin, *law.load) for law in laws]).T
        self.travel = np.array([law.travel for law in laws])
        pairs = ((0.0,), (0.0,)) if gains is None else (gains.kp, gains.kd)
        self.kp, self.kd = (np.resize(each, len(joints))[self.order] for each in pairs)  # joints are leg by leg

    def rollout(self, driven: Processed, begin: float, time: Array, lag: float) -> Array:
        """The path (samples, joints) [rad] from the recorded state at `begin`."""
        model, data, order = self.model, self.data, self.order
        assert driven.effort is not None
        torque = _at(driven.time, driven.effort[:, order], begin + time)
        behind = max(round(lag / model.opt.timestep), 0)  # with a lag below zero there is no controller
        position = _at(driven.time, driven.position[:, order], begin + time - lag)
        rate = _at(driven.time, driven.velocity[:, order], begin + time - lag)
        mujoco.mj_resetData(model, data)
        data.qpos[:] = _at(driven.time, driven.position[:, order], begin + time[:1])[0]
        data.qvel[:] = _at(driven.time, driven.velocity[:, order], begin + time[:1])[0]
        mujoco.mj_forward(model, data)  # friction asks for the load of this state
        slow = self.travel > 0.0
        state = self._state(driven, begin)
        path, speeds = np.empty((2, len(time), len(order)))
        for k in range(len(time)):
            path[k], speeds[k] = data.qpos, data.qvel
            data.ctrl[:] = torque[k]
            if k >= behind:
                data.ctrl[:] += self.kp * (position[k] - path[k - behind]) + self.kd * (rate[k] - speeds[k - behind])
            friction = self._friction()
            model.dof_frictionloss[:] = np.where(slow, 0.0, friction)
            data.qfrc_applied[:] = -self.offsets - np.where(slow, friction * state, 0.0)
            mujoco.mj_step(model, data)
            for j in np.flatnonzero(slow):
                step = data.qpos[j] - path[k, j]
                sign = np.sign(step)
                state[j] = sign + (state[j] - sign) * exp(-abs(step) / self.travel[j])
        out = np.empty_like(path)
        out[:, order] = path
        return out

    def _state(self, driven: Processed, begin: float) -> Array:
        before = driven.time <= begin
        columns = driven.position[:, self.order][before].T
        return np.array([presliding(q, x)[-1] if x else 0.0 for q, x in zip(columns, self.travel, strict=True)])

    def _friction(self) -> Array:
        """Largest dry friction of each joint now [N·m]; the load is that of gravity and speed."""
        cos, cos_mean, sin, sin_mean, load, load_mean = self.terms
        q, carried = self.data.qpos, np.abs(self.data.qfrc_bias)
        varying = cos * (np.cos(q) - cos_mean) + sin * (np.sin(q) - sin_mean) + load * (carried - load_mean)
        return np.asarray(np.maximum(self.coulomb + varying, 0.0))


def replayed_models(
    tested: str, against: str, *, force: bool = False, load: Callable[[str], Robot] = load_robot
) -> tuple[tuple[Drive, ...], float | None]:
    """The models by name, the tested one first, and the torques' lag [s] that the tested one states, if it does.

    Args:
        tested: a model file, a robot's name, or the JSON of `identify --json`, whose values are put into `against`. Of
            a JSON there are also what its exported file says (constant friction), and the other model with the friction
            that was fitted to it.
        against: a model file or a robot's name.
        force: take an identification that is not to be trusted.
        load: reads the model of a name or file.

    Raises:
        ModelError: no such file, or no model. UntrustedError: a bad identification, without `force`; and as `load`.
    """
    cad = load(against)
    if Path(tested).suffix.lower() != ".json":
        return (Drive("identified", load(tested)), Drive("CAD", cad)), None
    identified = with_identified_legs(cad, tested, force)
    with foreign(Path(tested), "not the JSON of an identification (--json)", ModelError):
        value = json.loads(Path(tested).read_text(encoding="utf-8"))
        laws = {joint: law for joint, entry in value["joints"].items() if (law := _law(entry)) != JointLaw()}
        constant = {
            joint: replace(identified.dynamics[joint], coulomb=_mean_friction(value["joints"][joint])) for joint in laws
        }
        fitted = {joint: _with_friction(cad, joint, terms) for joint, terms in value["cad_friction"].items()}
        lag = float(value["torque_lag"])
    exported = (Drive("identified, constant friction", identified.with_dynamics(constant)),) if laws else ()
    return (
        Drive("identified", identified, laws),
        *exported,
        Drive("CAD with friction", cad.with_dynamics(fitted)),
        Drive("CAD", cad),
    ), lag


def _law(entry: dict[str, Any]) -> JointLaw:
    def term(name: str) -> tuple[float, float]:
        found = entry.get(name)
        return (float(found["value"]), float(found["centre"])) if found else (0.0, 0.0)

    travel = float(entry["presliding"]["value"]) if "presliding" in entry else 0.0
    return JointLaw(term("coulomb_cos"), term("coulomb_sin"), term("coulomb_load"), travel)


def _mean_friction(entry: dict[str, Any]) -> float:
    """Coulomb friction with what load adds on average, as exported."""
    load = entry.get("coulomb_load", {})
    return max(
        float(entry["coulomb"]["value"]) + float(load.get("value", 0.0)) * float(load.get("mean_load", 0.0)), 0.0
    )


def _with_friction(robot: Robot, joint: str, terms: dict[str, float]) -> JointDynamics:
    known = {
        name: value if name == "offset" else max(value, 0.0) for name, value in terms.items() if name in FRICTION_TERMS
    }
    return replace(robot.dynamics[joint], **known)
