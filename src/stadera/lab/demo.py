"""The demo: the same walk twice, in parallel, without and with identification.

HyQ crawls, and a heavy box is dropped onto a corner of its back. Both runs have the same controller, planner, sensors,
errors and box. In one of them a supervisor has the load weighed, and passes the estimated trunk to controller and
planner: while walking or, as in the paper, at rest.
"""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from stadera.errors import StaderaError
from stadera.inertia import InertialParameters
from stadera.lab.experiments.loaded_walk import LoadedWalk, LoadedWalkCase, LoadedWalkOutcome, WalkOutcome, box_at
from stadera.lab.supervise.supervisor import NonstopSupervisor, StoppingSupervisor
from stadera.results import finite_or_none
from stadera.robot import load_robot
from stadera.trunk.load import plain
from stadera.types import Array, Bools

NAMES = ("without identification", "with identification")
"""Names of the two runs."""


@dataclass(frozen=True, eq=False)
class Film:
    """k frames; world axes and metres, unless stated otherwise."""

    time: Array  # (k,) [s]
    trunk: Array  # (k, 7), position of the trunk's origin, and its orientation as a quaternion xyzw
    joints: Array  # (k, n) [rad], in the tree's order
    box: Array  # (k, 7), the same for the box; NaN while there is none
    feet: Array  # (k, 4, 3), centres of the feet
    force: Array  # (k, 4, 3) [N], of the ground on them
    down: Bools  # (k, 4) bool, feet of the support polygon
    limited: Bools  # (k, n) bool, joints whose torque is at its limit
    com: Array  # (k, 3), true centre of mass of the whole robot with its load
    model: Array  # (k, 3), that used by controller and planner
    margin: Array  # (k,), of the true centre of mass inside the support polygon; NaN on fewer than three feet
    mass: Array  # (k, 3) [kg], of the trunk with its load: true, used by controller and planner, and estimated
    trunk_com: Array  # (k, 3, 2), the same of its centre of mass in x and y, trunk frame
    std: Array  # (k, 3), of the estimates of mass [kg], x and y. NaN for quantities without a present estimate.


class Camera:
    """Records a frame of a walk every `periods`."""

    periods = 40  # of 1 ms: 25 frames a second

    def __init__(self) -> None:
        self._looks, self._frames = -1, list[dict[str, Any]]()

    def look(self, walk: LoadedWalk) -> None:
        """Records a frame, if it is due."""
        self._looks += 1
        if self._looks % self.periods == 0:
            self._frames.append(self._frame(walk))

    def film(self) -> Film:
        return Film(**{name: np.array([frame[name] for frame in self._frames]) for name in self._frames[0]})

    def _frame(self, walk: LoadedWalk) -> dict[str, Any]:
        plant, controller = walk.bed.plant, walk.crawl.controller
        estimate = None if walk.supervisor is None else walk.supervisor.estimate
        state, truth, trunk = plant.state, plant.truth(), controller.trunk.model
        com, R, p = walk.monitor.com(), state.rotation, state.position
        # the legs' contribution is the same in both, so the two differ by the trunk's
        moment = (truth.mass + controller.legs.leg_mass) * (R.T @ (com - p)) - truth.first_moment
        modelled = p + R @ ((moment + trunk.mass * trunk.com_trunk) / (trunk.mass + controller.legs.leg_mass))
        unknown = np.full(3, np.nan)
        weighed, std = (unknown, unknown) if estimate is None else (estimate.value[:3], estimate.std[:3])
        return {
            "time": state.time,
            "trunk": [*p, *state.orientation],
            "joints": state.joint_position,
            "box": plant.box_pose,
            "feet": state.foot_position,
            "force": state.foot_force,
            "down": walk.monitor.carrying(),
            "limited": walk.monitor.at_limit(),
            "com": com,
            "model": modelled,
            "margin": walk.monitor.margin(),
            "mass": [truth.mass, trunk.mass, weighed[0]],
            "trunk_com": [truth.com[:2], trunk.com_trunk[:2], weighed[1:]],
            "std": std,
        }


@dataclass(frozen=True)
class DemoSettings:
    """Settings of the demo."""

    mass: float = 30.0  # of the box [kg]
    corner: str = "LF"  # of the back, onto which it is dropped
    size: tuple[float, float, float] = (0.14, 0.14, 0.2)  # of the box [m]
    height: float = 0.02  # above the back, from which it is dropped [m]
    load_at: float = 3.5  # time of the drop [s]; by default while the right-hind leg swings
    seconds: float | None = None  # of each run; None for 10, or 14 if the robot stops to weigh
    after_fall: float = 1.5  # time for which a fallen robot is recorded, with its drives braking [s]
    speed: float = 0.12  # [m/s]
    seed: int = 0  # of the sensors' errors
    classic: bool = False  # stop and weigh at rest, as in the paper, instead of weighing while walking

    @property
    def duration(self) -> float:
        """Duration of each run [s]."""
        return self.seconds or (14.0 if self.classic else 10.0)


@dataclass(frozen=True, eq=False)
class DemoRun:
    """One of the two runs: its outcome and its frames."""

    outcome: LoadedWalkOutcome
    film: Film


@dataclass(frozen=True, eq=False)
class DemoResult:
    """Both runs, in the order of `NAMES`."""

    settings: DemoSettings
    without: DemoRun
    identified: DemoRun

    @property
    def runs(self) -> tuple[DemoRun, DemoRun]:
        return self.without, self.identified

    def to_dict(self) -> dict[str, Any]:
        """Both runs as plain values: SI units, trunk frame, times relative to the drop of the box, null for unobserved
        quantities.

        Keys: robot, seed, load, without, with, units. Of each run: outcome (walked, stuck or fell), reasons,
        fell_after, distance (ahead since the load), commanded, steps_lost (null after a fall), least_margin (of the
        true centre of mass in the support polygon), mass_error and com_error (of the trunk as controller and planner
        have it at the end, its centre of mass in x and y), trunk, truth; of the one with identification also
        noticed_after, updated_after, payload and transitions.
        """
        settings, load = self.settings, true_load(self.identified.outcome)
        return {
            "robot": self.without.outcome.case.robot,
            "seed": settings.seed,
            "load": {"mass": load.mass, "com": plain(load.com), "corner": settings.corner, "time": settings.load_at},
            "without": _outcome(self.without.outcome),
            "with": _outcome(self.identified.outcome) | _reaction(self.identified.outcome),
            "units": {"time": "s", "mass": "kg", "com": "m", "margin": "m", "distance": "m"},
        }


def run_demo(settings: DemoSettings | None = None) -> DemoResult:
    """Makes both runs in parallel, in spawned processes: a script needs the usual `if __name__ == "__main__"`."""
    settings = settings or DemoSettings()
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        runs = list(pool.map(_run, (settings, settings), (False, True)))
    for run in runs:
        if isinstance(run, str):
            raise StaderaError(run)
    return DemoResult(settings, *runs)  # type: ignore[arg-type]


def _run(settings: DemoSettings, identified: bool) -> DemoRun | str:
    """Makes the run; returns an error as text, since not every exception can be passed between processes."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # two runs, two cores
        try:
            return one_run(settings, identified)
        except StaderaError as error:
            return str(error)


def one_run(settings: DemoSettings, identified: bool) -> DemoRun:
    """Makes one of the two runs in this process."""
    with_it = StoppingSupervisor if settings.classic else NonstopSupervisor
    case = LoadedWalkCase(
        payload=box_at(
            load_robot(LoadedWalkCase.robot), settings.corner, settings.mass, settings.size, settings.height
        ),
        load_at=settings.load_at,
        supervisor=with_it if identified else None,
        seconds=settings.duration,
        speed=settings.speed,
        seed=settings.seed,
    )
    walk, camera = LoadedWalk(case), Camera()
    outcome = walk.run(camera.look)
    if outcome.trace.outcome is WalkOutcome.FELL:
        walk.give_up("it has fallen")
        for _ in range(round(settings.after_fall / walk.bed.plant.timestep)):
            walk.step()
            camera.look(walk)
    return DemoRun(outcome, camera.film())


def _outcome(outcome: LoadedWalkOutcome) -> dict[str, Any]:
    trace, model, truth = outcome.trace, outcome.model, outcome.truth
    return {
        "outcome": str(trace.outcome),
        "reasons": list(trace.reasons),
        "fell_after": None if trace.fall is None else trace.fall.time - trace.loaded_at,
        "distance": trace.distance,
        "commanded": trace.commanded,
        "steps_lost": trace.steps_lost if trace.fall is None else None,
        "least_margin": finite_or_none(trace.least_margin),
        "mass_error": model.mass - truth.mass,
        "com_error": outcome.com_error,
        "trunk": {"mass": model.mass, "com": plain(model.com_trunk)},
        "truth": {"mass": truth.mass, "com": plain(truth.com)},
    }


def _reaction(outcome: LoadedWalkOutcome) -> dict[str, Any]:
    payload, trunk = outcome.payload, load_robot(outcome.case.robot).trunk
    return {
        "noticed_after": outcome.noticed_after,
        "updated_after": outcome.updated_after,
        "payload": None if payload is None else payload.to_dict(trunk, {}),
        "transitions": [
            {"time": t.time, "from": str(t.before), "to": str(t.after), "reason": t.reason} for t in outcome.transitions
        ],
    }


def true_load(outcome: LoadedWalkOutcome) -> InertialParameters:
    """The load on the trunk at the end, trunk frame."""
    return outcome.truth - outcome.bare
