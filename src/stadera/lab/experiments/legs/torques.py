"""Torques and their errors over time, and tables of their RMSE, for Figs. 4 and 5."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from stadera.errors import IdentificationError
from stadera.identify.result import MODELS, Identification, LegIdentification, TorqueTrace
from stadera.lab.experiments.paper import Paper
from stadera.lab.experiments.result import Record
from stadera.report.figures import Axis, Figure, Panel, line, stacked
from stadera.report.look import ROLES
from stadera.report.table import Cell, TableData

NAMES = {"identified": "identified", "prior_friction": "CAD with friction", "prior": "CAD"}
PART = "validation"


def torque_figure(leg: LegIdentification, title: str, note: str, models: tuple[str, ...]) -> Figure:
    """Three panels of torques, then the errors of the first joint, as in Figs. 4 and 5; later models are on top."""
    trace = validation_trace(leg)
    panels = []
    for k, joint in enumerate(leg.leg.joints):
        lines = [line(trace.time, trace.measured[:, k], "measured", "ink", width=2.4)]
        lines += [line(trace.time, trace.predicted[m][:, k], NAMES[m], ROLES[m], width=1.3) for m in models]
        panels.append(Panel(Axis("time [s]"), Axis("torque [N·m]"), tuple(lines), title=joint))
    errors = tuple(
        line(trace.time, (trace.measured - trace.predicted[m])[:, 0], NAMES[m], ROLES[m], width=1.3) for m in models
    )
    panels.append(Panel(Axis("time [s]"), Axis("error [N·m]"), errors, title=f"{leg.leg.joints[0]}: errors"))
    return stacked(title, panels, note)


def validation_trace(leg: LegIdentification) -> TorqueTrace:
    """The trace of motion that was not used for fitting."""
    for trace in leg.traces:
        if trace.part == PART:
            return trace
    raise IdentificationError(f"leg {leg.leg.name}: nothing was held out to validate on")


def rmse_table(result: Identification, title: str, note: str, models: tuple[str, ...]) -> TableData:
    """Torque RMSE on validation, one row per joint, one column per model (the reference first, identified last)."""
    head = ("joint", "torque RMS [N·m]", *(f"{NAMES[m]} [N·m]" for m in models), f"against {NAMES[models[-2]]}")
    groups = {}
    for leg in result.legs:
        rms, rows = np.sqrt(np.mean(validation_trace(leg).measured ** 2, axis=0)), []
        for k, joint in enumerate(leg.leg.joints):
            *others, identified = (leg.rmse[PART][m][joint] for m in models)
            change = 100.0 * (identified / others[-1] - 1.0) if others[-1] else 0.0
            last = Cell(_figure(identified), strong=True), Cell(f"{change:+.1f} %", good=change <= 0.0)
            rows.append((joint, f"{rms[k]:.3f}", *map(_figure, others), *last))
        groups[leg.leg.name] = rows
    return TableData.of(title, head, groups, note)


def rmse_records(
    paper: Paper,
    case: Mapping[str, str | float],
    leg: LegIdentification,
    against: str,
    models: tuple[str, ...] = MODELS,
) -> Iterator[Record]:
    """RMSE of each joint and model; the identified one is bounded by that of the model `against`."""
    for joint in leg.leg.joints:
        errors = {m: leg.rmse[PART][m][joint] for m in models}
        where = {**case, "leg": leg.leg.name, "joint": joint}
        for model, error in errors.items():
            bound = errors[against] if model == "identified" else None
            yield paper.record(where, f"torque RMSE, {NAMES[model]}", "N·m", error, bound=bound)


def _figure(value: float) -> str:
    return f"{value:.4f}" if value >= 1e-4 or value == 0.0 else f"{value:.1e}"
