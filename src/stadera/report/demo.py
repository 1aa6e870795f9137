"""The demo in the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.demo import DemoResult, DemoRun
from stadera.experiments.loaded_walk import LoadedWalkOutcome
from stadera.inertia import InertialParameters
from stadera.report.numbers import number, with_std
from stadera.report.terminal import titled_table
from stadera.report.weighed import place, plain
from stadera.robot import load_robot
from stadera.supervise import State

_CM = 100.0


def demo_json(result: DemoResult) -> dict[str, Any]:
    """Both runs as plain values: SI units, trunk frame, null for what was not observed.

    Keys: robot, seed, load, runs (by name: survived, fall, least_margin, outside, way, noticed_after, state, trunk,
    truth, payload, transitions, checks, steps, steps_lost, taken_over_after, known_after), units.
    """
    settings, load = result.settings, true_load(result.identified.outcome)
    return {
        "robot": settings.robot,
        "seed": settings.seed,
        "load": {"mass": load.mass, "com": plain(load.com), "time": settings.load_at},
        "runs": {run.name: _run(run) for run in result.runs},
        "units": {"time": "s", "mass": "kg", "com": "m", "margin": "m", "way": "m"},
    }


def _run(run: DemoRun) -> dict[str, Any]:
    outcome = run.outcome
    payload, believed = outcome.payload, outcome.believed
    return {
        "survived": outcome.survived,
        "fall": None if outcome.fall is None else {"time": outcome.fall.time, "how": outcome.fall.how},
        "least_margin": plain(np.array([outcome.least_margin]))[0],
        "outside": outcome.outside,
        "way": outcome.way,
        "noticed_after": plain(np.array([outcome.noticed_after]))[0],
        "state": str(outcome.state),
        "trunk": {"mass": believed.mass, "com": plain(believed.com_trunk)},
        "truth": {"mass": outcome.truth.mass, "com": plain(outcome.truth.com)},
        "payload": None
        if payload is None
        else {
            "mass": {"value": payload.mass, "std": payload.mass_std},
            "com": {"value": plain(payload.com), "std": plain(payload.com_std)},
            "com_covariance": [plain(row) for row in payload.covariance],
        },
        "transitions": [transition.to_dict() for transition in outcome.transitions],
        "checks": [
            {"time": c.time, "mass": c.mass, "expected": c.expected, "threshold": c.threshold, "changed": c.changed}
            for c in outcome.checks
        ],
        "steps": list(outcome.steps),
        "steps_lost": outcome.steps_lost,
        "taken_over_after": outcome.taken_over_after,
        "known_after": known_after(run),
    }


def demo_tables(result: DemoResult) -> Iterator[RenderableType]:
    """How both runs went, what was weighed, and what the supervisor did."""
    yield Text(headline(result), style="bold")
    yield _comparison(result)
    identified = result.identified.outcome
    if identified.payload is not None:
        yield _weighed(identified)
    if identified.transitions:
        yield _log(identified)


def headline(result: DemoResult) -> str:
    """What happened, in one sentence."""
    failed, went = verdict(result.without.outcome), verdict(result.identified.outcome)
    how = "Weighed on the way" if result.settings.nonstop else "With it"
    return f"Without identification {failed}. {how}, {went}."


def verdict(outcome: LoadedWalkOutcome) -> str:
    """How a run went, in half a sentence."""
    if outcome.fall is not None:
        return f"the robot fell after {outcome.fall.time - outcome.loaded_at:.1f} s ({outcome.fall.how})"
    if outcome.state in (State.STANDING, State.SITTING):
        return f"the robot is left {outcome.state}: {outcome.transitions[-1].reason}"
    if outcome.least_margin < 0.0:
        return (
            f"the robot's centre of mass left the support polygon by {-_CM * outcome.least_margin:.1f} cm, for "
            f"{outcome.outside:.1f} s in all"
        )
    return f"its centre of mass stayed {_CM * outcome.least_margin:.1f} cm and more inside the support polygon"


KNOWN = (0.01, 0.005)
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


def comparison_rows(result: DemoResult) -> Iterator[tuple[str, str, str]]:
    """What was seen in both runs: a name, then a text for each run."""

    def each(name: str, told: Any) -> tuple[str, str, str]:
        return name, told(result.without.outcome), told(result.identified.outcome)

    yield each("fell", lambda o: "no" if o.fall is None else f"at {o.fall.time:.1f} s")
    yield each("least margin of the true centre of mass [cm]", lambda o: f"{_CM * o.least_margin:.1f}")
    yield each("time outside the support polygon [s]", lambda o: f"{o.outside:.2f}")
    yield each("way walked since the load [m]", lambda o: f"{o.way:.2f}")
    yield each("steps lost", lambda o: "–" if o.fall else str(o.steps_lost))
    yield each("error of the trunk's believed mass [kg]", lambda o: f"{o.believed.mass - o.truth.mass:+.2f}")
    yield each(
        "error of its believed centre of mass, x-y [cm]",
        lambda o: f"{_CM * float(np.linalg.norm((o.believed.com_trunk - o.truth.com)[:2])):.2f}",
    )


def weighed_rows(outcome: LoadedWalkOutcome) -> Iterator[tuple[str, ...]]:
    """Name, mass and centre of mass of the payload as weighed, and as it is."""
    payload, load = outcome.payload, true_load(outcome)
    if payload is not None:
        mass = with_std(payload.mass, payload.mass_std)
        yield "payload as weighed", mass, *place(payload.com, payload.com_std)
    yield "truth", number(load.mass), *(number(round(c, 5)) for c in load.com.tolist())


def _comparison(result: DemoResult) -> Table:
    table = titled_table("The same walk twice", ("since the load came on", *(run.name for run in result.runs)))
    for row in comparison_rows(result):
        table.add_row(*map(Text, row))
    return table


def _weighed(outcome: LoadedWalkOutcome) -> Table:
    table = titled_table("The load, trunk frame", ("", "mass [kg]", "com x [m]", "com y [m]", "com z [m]"))
    for row in weighed_rows(outcome):
        table.add_row(*map(Text, row))
    return table


def _log(outcome: LoadedWalkOutcome) -> Table:
    table = titled_table("What the supervisor did", ("time [s]", "state", "because"), "rll", fold=True)
    for t in outcome.transitions:
        table.add_row(f"{t.time:.2f}", str(t.after), Text(t.reason))
    return table


__all__ = ["DemoRun", "comparison_rows", "demo_json", "demo_tables", "headline", "true_load", "verdict", "weighed_rows"]
