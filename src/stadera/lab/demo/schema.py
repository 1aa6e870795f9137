"""Plain values of the demo's result, and quantities derived from them."""

from __future__ import annotations

from typing import Any

import numpy as np

from stadera.inertia import InertialParameters
from stadera.lab.demo.run import DemoResult, DemoRun
from stadera.lab.experiments.loaded_walk import LoadedWalkOutcome, WalkOutcome
from stadera.results import finite_or_none
from stadera.robot import load_robot
from stadera.trunk.load import plain

KNOWN = (0.1, 0.03)
"""Accuracy at which the trunk counts as known: two standard deviations of its mass, as a share of the robot's, and of
its centre of mass in x and y [m].
"""


def demo_dict(result: DemoResult) -> dict[str, Any]:
    """Both runs as plain values: SI units, trunk frame, times relative to the drop of the box, null for unobserved
    quantities.

    Keys: robot, seed, load, without, with, runs, units. Of each run: outcome (walked, stuck or fell), reasons,
    fell_after, distance (ahead since the load), commanded, steps_lost (null after a fall), least_margin and outside (of
    the true centre of mass in the support polygon), mass_error and com_error (of the trunk as controller and planner
    have it at the end, its centre of mass in x and y), trunk, truth; of the one with identification also noticed_after,
    updated_after, known_after, payload and transitions. `runs` has both by the supervisor's name, each with all
    of these, survived (that it walked), fall, state and steps.
    """
    settings, load = result.settings, true_load(result.identified.outcome)
    return {
        "robot": settings.robot,
        "seed": settings.seed,
        "load": {"mass": load.mass, "com": plain(load.com), "corner": settings.corner, "time": settings.load_at},
        "without": _run(result.without.outcome),
        "with": _run(result.identified.outcome) | _reaction(result.identified),
        "runs": {run.name: _run(run.outcome) | _reaction(run) | _course(run.outcome) for run in result.runs},
        "units": {"time": "s", "mass": "kg", "com": "m", "margin": "m", "distance": "m"},
    }


def _run(outcome: LoadedWalkOutcome) -> dict[str, Any]:
    trace, model, truth = outcome.trace, outcome.model, outcome.truth
    return {
        "outcome": str(outcome.verdict.outcome),
        "reasons": list(outcome.verdict.reasons),
        "fell_after": None if trace.fall is None else trace.fall.time - trace.loaded_at,
        "distance": trace.distance,
        "commanded": trace.commanded,
        "steps_lost": trace.steps_lost if trace.fall is None else None,
        "least_margin": finite_or_none(outcome.least_margin_ever),
        "outside": outcome.outside,
        "mass_error": model.mass - truth.mass,
        "com_error": float(np.linalg.norm((model.com_trunk - truth.com)[:2])),
        "trunk": {"mass": model.mass, "com": plain(model.com_trunk)},
        "truth": {"mass": truth.mass, "com": plain(truth.com)},
    }


def _reaction(run: DemoRun) -> dict[str, Any]:
    outcome = run.outcome
    payload, trunk = outcome.payload, load_robot(outcome.case.robot).trunk
    return {
        "noticed_after": finite_or_none(outcome.noticed_after),
        "updated_after": outcome.updated_after,
        "known_after": known_after(run),
        "payload": None if payload is None else payload.to_dict(trunk, {}),
        "transitions": [transition.to_dict() for transition in outcome.transitions],
    }


def _course(outcome: LoadedWalkOutcome) -> dict[str, Any]:
    trace = outcome.trace
    return {
        "survived": outcome.verdict.outcome is WalkOutcome.WALKED,
        "fall": None if trace.fall is None else {"time": trace.fall.time, "how": trace.fall.how},
        "state": str(outcome.state),
        "steps": list(trace.steps),
    }


def known_after(run: DemoRun) -> float | None:
    """Time from the drop until the trunk was known to `KNOWN`, and stayed so [s]; None if it never was."""
    loaded_at, film = run.outcome.trace.loaded_at, run.film
    share, length = KNOWN
    limits = np.array([share * load_robot(run.outcome.case.robot).mass, length, length])
    known = (2.0 * film.std <= limits).all(axis=1)
    unknown = np.flatnonzero(~known & (film.time >= loaded_at))
    first = int(np.searchsorted(film.time, loaded_at)) if not len(unknown) else int(unknown[-1]) + 1
    return float(film.time[first] - loaded_at) if first < len(film) else None


def true_load(outcome: LoadedWalkOutcome) -> InertialParameters:
    """The load on the trunk at the end, trunk frame."""
    return outcome.truth - outcome.bare
