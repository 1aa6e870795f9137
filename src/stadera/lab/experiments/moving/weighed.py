"""A robot in motion to which a load is added, and each method's estimate of it.

The controllers use the walking estimator's estimate when it can be trusted, and the model file's trunk before. The
estimators' prior is wrong: 10 % too light, with a centre of mass off by 15 % of the hips' half spacing. The only
information on the load is that the last instant before it is the tare.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from stadera.inertia import InertialParameters
from stadera.lab.baselines import ALL_METHODS
from stadera.lab.control import Trot, TrunkController
from stadera.lab.control.crawl.crawl import Crawl
from stadera.lab.control.crawl.run import WalkMonitor, walk
from stadera.lab.control.stand import Controller
from stadera.lab.experiments.moving.motion import Gait, RobotInMotion, fastest_trot, sway, walk_on
from stadera.lab.plant import RigidMass
from stadera.lab.plant.payload import Tray
from stadera.robot import Robot, load_robot
from stadera.trunk import Estimator, Measurement, TrunkEstimator, TrunkModel, make_estimator
from stadera.trunk.registry import Setup

PLACES = ("middle", "left front", "right front", "left hind", "right hind")
"""Positions of a load on the back: the tray's middle, or three quarters of the way to a corner."""

WALKING = "walking"

_TOWARDS = dict(zip(PLACES, ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True))


@dataclass(frozen=True)
class WalkSettings:
    """Settings of a run."""

    still: float = 0.3  # time before it moves [s]
    # by gait, time in motion before the load [s]
    before: Mapping[Gait, float] = field(default_factory=lambda: {"crawl": 6.0, "trot": 3.0, "shake": 3.0})
    soon: float = 1.0  # time after the load at which results are evaluated [s]
    late: float = 3.0  # likewise
    slower: int = 10  # periods between two samples of the other methods: 100 Hz
    out: float = 0.75  # position of a load towards a corner, as a share of the tray's half size [1]
    edge: float = 0.04  # of a box of 1 kg [m]; proportional to the cube root of the mass


_HOW = WalkSettings()


@dataclass(frozen=True)
class WalkingCase:
    """Settings of one run."""

    robot: str
    gait: Gait  # crawl, trot or shake
    share: float  # of the load in the robot's mass; 0 for none
    place: str  # one of `PLACES`
    errors: str  # of the sensors, a named set
    seed: int  # of sensors and commands
    others: tuple[str, ...] = ()  # additional methods, by their registry's names, on the same measurements


def weigh_in_motion(case: WalkingCase) -> dict[str, Any]:
    """Results of the run.

    `fell`: None, or a description. `robot_mass`: [kg]. `noticed`: [s] from the load to its detection, None if it was
    not detected. `false_alarms`: number of false changes. `share_of_time`: the estimator's processor time divided by
    the simulated time. `methods`: errors by method, see `compared`; for the walking estimator also its error bars.
    """
    robot = load_robot(case.robot)
    run = _WeighedRun(case, robot)
    fall = run.until_loaded()
    if fall is None:
        fall = run.after_load()
    methods = {WALKING: run.figures} | {name: _other(name, run) for name in case.others}
    return {
        "fell": fall,
        "robot_mass": robot.mass,
        "noticed": run.noticed,
        "false_alarms": run.false_alarms,
        "share_of_time": run.motion.cost / max(run.bed.plant.time, 1e-3),
        "methods": methods,
    }


class _WeighedRun:
    """The robot in motion, with the walking estimator."""

    def __init__(self, case: WalkingCase, robot: Robot) -> None:
        self.case, self.robot = case, robot
        draw = zlib.crc32(repr(replace(case, others=())).encode())  # no two cases share a draw
        self.motion = RobotInMotion(robot, case.gait, case.errors, draw)
        self.model, self.start = self.motion.model, self.motion.start
        self.inner, self.controller, self.bed = self.motion.inner, self.motion.controller, self.motion.bed
        self.bed.estimator = _Remembering(self.motion.trusted, self)
        self._commands = np.random.default_rng(draw)
        self.kept: list[Measurement] = []
        self.figures: dict[str, Any] = {}
        self.loaded_at = np.inf
        self.bare, self.loaded = self.bed.plant.truth(), self.bed.plant.truth()

    # -- running --------------------------------------------------------------------------------------------------
    def until_loaded(self) -> str | None:
        """Stands, sets out, and walks until the load; returns a description of a fall, or None."""
        monitor = WalkMonitor(self.bed.plant)
        walk(self.bed, _HOW.still, monitor)
        _set_out(self.controller, self._commands)
        walk(self.bed, _HOW.before[self.case.gait], monitor)
        if monitor.fall is None:
            self.figures |= _absolute(self.inner, self.bare, "bare")
        return None if monitor.fall is None else monitor.fall.how

    def after_load(self) -> str | None:
        """Adds the load and walks on; returns a description of a fall, or None."""
        plant = self.bed.plant
        self.inner.tare()
        self.loaded_at = plant.time
        if self.case.share > 0:
            plant.apply_payload(payload_of(self.case, self.robot))
        self.loaded = plant.truth()
        monitor = WalkMonitor(plant)
        for end, name in ((_HOW.soon, "soon"), (_HOW.late, "late")):
            fall = walk(self.bed, self.loaded_at + end - plant.time, monitor)
            if fall is not None:
                return fall.how
            self.figures |= self._payload_figures(name)
        self.figures |= _absolute(self.inner, self.loaded, "loaded")
        return None

    # -- found ----------------------------------------------------------------------------------------------------
    def _payload_figures(self, when: str) -> dict[str, Any]:
        found = self.inner.payload
        if found is None or found.parameters is None:
            return {}
        now = self.inner.parameters()
        tare = InertialParameters(now.inertial.vector - found.parameters.vector)
        figures = compared(tare, now.inertial, self.bare, self.loaded, when)
        if not now.observed[3]:
            figures[f"{when}.com_z"] = None
        error = np.array([found.mass - (self.loaded.mass - self.bare.mass)])
        figures[f"{when}.payload_mass_sigmas"] = float(error[0] / found.mass_std)
        return figures

    @property
    def noticed(self) -> float | None:
        """Time from the load to the first change detected after it [s]."""
        after = [change.noticed - self.loaded_at for change in self.inner.changes if change.noticed > self.loaded_at]
        return after[0] if after and self.case.share > 0 else None

    @property
    def false_alarms(self) -> int:
        """Number of changes detected before the load, and of all but one after it."""
        before = sum(change.noticed <= self.loaded_at for change in self.inner.changes)
        after = len(self.inner.changes) - before
        return before + max(after - (self.case.share > 0), 0)


class _Remembering:
    """An estimator that stores measurements at intervals, for the other methods."""

    def __init__(self, inner: Estimator, run: _WeighedRun) -> None:
        self.inner, self._run, self._count = inner, run, 0

    def update(self, measurement: Measurement) -> None:
        if self._count % _HOW.slower == 0 and self._run.case.others:
            self._run.kept.append(measurement)
        self._count += 1
        self.inner.update(measurement)

    def estimate(self) -> Any:
        return self.inner.estimate()


def payload_of(case: WalkingCase, robot: Robot) -> RigidMass:
    tray, mass = Tray.of(robot), case.share * robot.mass
    edge = _HOW.edge * mass ** (1.0 / 3.0)
    aside = _HOW.out * np.asarray(_TOWARDS[case.place]) * tray.half_size[:2]
    x, y = (tray.centre[:2] + aside).tolist()
    return RigidMass.box(mass, (edge, edge, edge), (x, y, tray.top + 0.5 * edge))


def compared(
    tare: InertialParameters, now: InertialParameters, bare: InertialParameters, loaded: InertialParameters, when: str
) -> dict[str, Any]:
    """Errors [kg], [m] of payload (mass, x-y, z) and trunk (shift in x-y, height); `bare`, `loaded` are true."""
    figures: dict[str, Any] = {f"{when}.payload_mass": float((now.mass - tare.mass) - (loaded.mass - bare.mass))}
    shift = (now.com - tare.com) - (loaded.com - bare.com)
    figures[f"{when}.shift_xy"] = float(np.linalg.norm(shift[:2]))
    figures[f"{when}.com_z"] = float(now.com[2] - loaded.com[2])
    put_on, found = loaded - bare, now - tare
    if put_on.mass > 0 and found.mass > 0.2 * put_on.mass:
        place = found.com - put_on.com
        figures[f"{when}.payload_xy"], figures[f"{when}.payload_z"] = (
            float(np.linalg.norm(place[:2])),
            float(place[2]),
        )
    return figures


def _absolute(estimator: TrunkEstimator, truth: InertialParameters, when: str) -> dict[str, Any]:
    """Errors of mass and centre of mass relative to their error bars: NEES over the observed ones, and the largest."""
    found = estimator.parameters()
    which = found.observed[:4]
    error = (np.array([found.inertial.mass, *found.inertial.com]) - [truth.mass, *truth.com])[which]
    covariance = found.covariance[np.ix_(which, which)]
    if not which.any():
        return {}
    return {
        f"{when}.nees": float(error @ np.linalg.solve(covariance, error)),
        f"{when}.observed": int(which.sum()),
        f"{when}.worst_sigmas": float(np.max(np.abs(error) / np.sqrt(np.diag(covariance)))),
        f"{when}.mass": float(error[0]) if which[0] else None,
    }


def _set_out(controller: Controller, rng: np.random.Generator) -> None:
    """Starts the motion: forwards, and slightly to one side, at random."""
    if isinstance(controller, Trot):
        walk_on(controller, rng.uniform(0.0, 1.0) * fastest_trot(controller), rng.uniform(-0.2, 0.2))
    elif isinstance(controller, Crawl):
        walk_on(controller, 0.12 * rng.uniform(0.3, 0.8), rng.uniform(-0.02, 0.02))
    elif isinstance(controller, TrunkController):
        sway(controller)


def _other(name: str, run: _WeighedRun) -> dict[str, Any]:
    """Results of a method on the run's measurements, as if fed at 100 Hz."""
    estimator = make_estimator(name, Setup(run.model, run.start), ALL_METHODS)
    figures: dict[str, Any] = {}
    marks = [("tare", run.loaded_at), ("soon", run.loaded_at + _HOW.soon), ("late", run.loaded_at + _HOW.late)]
    tare: InertialParameters | None = None
    for m in run.kept:
        while marks and m.time >= marks[0][1] - 1e-9:
            when, _ = marks.pop(0)
            now = _as_body(estimator.estimate().trunk)
            if when == "tare":
                tare = now
            elif tare is not None:
                figures |= compared(tare, now, run.bare, run.loaded, when)
        estimator.update(m)
    return figures


def _as_body(trunk: TrunkModel) -> InertialParameters:
    return InertialParameters.from_com(trunk.mass, trunk.com_trunk, np.zeros((3, 3)))
