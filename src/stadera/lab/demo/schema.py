"""The demo's result as plain values, and what is derived for them."""

from __future__ import annotations

from typing import Any

import numpy as np

from stadera.inertia import InertialParameters
from stadera.lab.demo.run import DemoResult, DemoRun
from stadera.lab.experiments.moving.loaded_walk import LoadedWalkOutcome
from stadera.robot import load_robot
from stadera.supervise import State
from stadera.weigh.schema import plain


def demo_dict(result: DemoResult) -> dict[str, Any]:
    """Both runs as plain values: SI units, trunk frame, null for what was not observed.

    Keys: robot, seed, load, without and with (each run in brief), runs (by name: survived, fall, least_margin, outside,
    way, noticed_after, state, trunk, truth, payload, transitions, checks, steps, steps_lost, taken_over_after,
    known_after), units.
    """
    settings, load = result.settings, true_load(result.identified.outcome)
    return {
        "robot": settings.robot,
        "seed": settings.seed,
        "load": {"mass": load.mass, "com": plain(load.com), "time": settings.load_at},
        "without": _brief(result.without.outcome),
        "with": _brief(result.identified.outcome) | _reaction(result.identified.outcome),
        "runs": {run.name: _run(run) for run in result.runs},
        "units": {"time": "s", "mass": "kg", "com": "m", "margin": "m", "way": "m"},
    }


def _brief(outcome: LoadedWalkOutcome) -> dict[str, Any]:
    """What became of a run: how it ended, how far it got, and what controller and planner lack of the truth."""
    stuck = outcome.state in (State.STANDING, State.SITTING)
    return {
        "outcome": "fell" if outcome.fall else "stuck" if stuck else "walked",
        "distance": outcome.way,
        "least_margin": plain(np.array([outcome.least_margin]))[0],
        "mass_error": outcome.model.mass - outcome.truth.mass,
        "com_error": float(np.linalg.norm((outcome.model.com_trunk - outcome.truth.com)[:2])),
    }


def _reaction(outcome: LoadedWalkOutcome) -> dict[str, Any]:
    """When the load was noticed and the controller updated [s from the load], and the payload weighed."""
    return {
        "noticed_after": plain(np.array([outcome.noticed_after]))[0],
        "updated_after": outcome.updated_after,
        "payload": _payload(outcome),
    }


def _payload(outcome: LoadedWalkOutcome) -> dict[str, Any] | None:
    payload = outcome.payload
    if payload is None:
        return None
    return {
        "mass": {"value": payload.mass, "std": payload.mass_std},
        "com": {"value": plain(payload.com), "std": plain(payload.com_std)},
        "com_covariance": [plain(row) for row in payload.com_covariance],
    }


def _run(run: DemoRun) -> dict[str, Any]:
    outcome, model = run.outcome, run.outcome.model
    return {
        "survived": outcome.survived,
        "fall": None if outcome.fall is None else {"time": outcome.fall.time, "how": outcome.fall.how},
        "least_margin": plain(np.array([outcome.least_margin]))[0],
        "outside": outcome.outside,
        "way": outcome.way,
        "noticed_after": plain(np.array([outcome.noticed_after]))[0],
        "state": str(outcome.state),
        "trunk": {"mass": model.mass, "com": plain(model.com_trunk)},
        "truth": {"mass": outcome.truth.mass, "com": plain(outcome.truth.com)},
        "payload": _payload(outcome),
        "transitions": [transition.to_dict() for transition in outcome.transitions],
        "checks": [
            {"time": c.time, "mass": c.mass, "expected": c.expected, "threshold": c.threshold, "changed": c.changed}
            for c in outcome.checks
        ],
        "steps": list(outcome.steps),
        "steps_lost": outcome.steps_lost,
        "taken_over_after": outcome.updated_after,
        "known_after": known_after(run),
    }


KNOWN = (0.1, 0.03)
"""What the trunk counts as known to: two standard deviations of its mass, as a share of the robot's, and of its centre
of mass in x and y [m]."""


def known_after(run: DemoRun) -> float | None:
    """Time from the load until the trunk was known to `KNOWN` on the way, and stayed so [s]; None if it never was."""
    outcome, film = run.outcome, run.film
    share, length = KNOWN
    known = (2.0 * film.std <= np.array([share * load_robot(outcome.case.robot).mass, length, length])).all(axis=1)
    unknown = np.flatnonzero(~known & (film.time >= outcome.loaded_at))
    first = int(np.searchsorted(film.time, outcome.loaded_at)) if not len(unknown) else int(unknown[-1]) + 1
    return float(film.time[first] - outcome.loaded_at) if first < len(film) else None


def true_load(outcome: LoadedWalkOutcome) -> InertialParameters:
    """What lies on the trunk at the end, trunk frame."""
    return outcome.truth - outcome.bare
