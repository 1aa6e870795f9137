"""Figures of an identification, and its page: verdict, next steps, drives, evidence, each leg, and processing."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from stadera.identify.result import MODELS, Identification, LegIdentification, TorqueTrace
from stadera.report.figures import Axis, Bars, Figure, Guide, Panel, Series, line, stacked
from stadera.report.identify import tables as words
from stadera.report.identify.tables import MODEL_NAMES, tables
from stadera.report.look import ROLES
from stadera.report.numbers import compared, number
from stadera.report.page import render
from stadera.report.table import TableData
from stadera.report.trust import LEVELS, marked, trust_reasons
from stadera.trust import Trust
from stadera.types import Array

__all__ = ["figures", "html", "tables"]

_METHODS = {
    "consistent": "physically consistent (maximum a posteriori, CAD as prior)",
    "null-space": "least squares, CAD where the data say nothing (null-space projection)",
}


def next_steps(result: Identification, enough: float = 0.6) -> Iterator[str]:
    """Yields next steps for this result, the most urgent first: sentences, with commands between backquotes.

    Args:
        enough: share of the directions that rich motion determines, below which another motion is recommended.
    """
    robot = result.robot.argument
    if result.trust.verdict == "bad":
        yield (
            "Do not use these figures: the model does not explain the torques, and the likeliest cause is named below. "
            "Mend the log or the model file and identify again."
        )
        return
    if words.is_untested(result):
        yield "This fit is untested: hold back a part, `--split 0.5`, or give another log, `--validate LOG`."
    shares = {leg.estimate.observability.rank / leg.structural_rank: leg for leg in result.legs if leg.rmse}
    if shares and min(shares) < enough:
        poor = shares[min(shares)]
        rank = poor.estimate.observability.rank
        yield (
            f"Play a richer motion: {poor.leg.name} showed {rank} of {poor.structural_rank} directions. "
            f"`stadera excite --robot {robot} --leg {poor.leg.name} --out motion.csv` designs one."
        )
    if result.is_physical and not any("" in leg.worse for leg in result.legs):
        yield (
            f"Weigh with these legs: `stadera identify LOG --robot {robot} --json legs.json`, then, for "
            f"a walk that was not fitted here, `stadera weigh WALK --robot {robot} --legs legs.json`."
        )
        yield f"Write them into the model file: `stadera identify LOG --robot {robot} --export identified.urdf`."


def html(result: Identification) -> str:
    """The complete, self-contained page."""
    part, said = words.evaluated_part(result), words.remarks(result)
    drives = words.drives_table(result)
    return render(
        "identify.html.j2",
        title=f"Leg identification: {result.robot.name}",
        headline=words.answer(result),
        level=LEVELS[result.trust.verdict],
        word=f"Trust: {result.trust.verdict}",
        why=f"{trust_reasons(result.trust)} {words.HEADLINES[words.level(result)]}.",
        next=tuple(next_steps(result)),
        problems=[remark for remark in said if remark.level == "bad"],
        remarks=[remark for remark in said if remark.level != "bad"],
        cards=_cards(words.overall_rmse(result, part)),
        at_a_glance=words.leg_table(result),
        drives=marked(drives, result.trust) if drives.groups else None,
        trunk=None if result.trunk is None else marked(words.trunk_table(result), result.trust),
        where=f"motion not used for fitting: {result.validated_on}" if part == "validation" else "the TRAINING data",
        errors=words.rmse_table(result) if words.has_errors(result) else None,
        error_bars=rmse_figure(result.legs, part),
        legs=[_leg(leg, part, result.trust) for leg in result.legs],
        facts=_facts(result),
        notes=result.notes,
    )


def _facts(result: Identification) -> dict[str, str]:
    model = "made in memory" if result.robot.source is None else result.robot.source.name
    traces = [trace for trace in result.legs[0].traces if len(trace.time)]  # of the same times for all legs
    spans = [f"{trace.time[-1] - trace.time[0]:.1f} s {trace.part}" for trace in traces]
    return {
        "Robot": f"{result.robot.name}, {number(result.robot.mass)} kg (model {model})",
        "Log": result.source,
        "Moving": ", ".join(spans) or "not kept",
        "Legs": ", ".join(leg.leg.name for leg in result.legs),
        "Method": _METHODS.get(result.method, result.method),
        "Validated on": result.validated_on or "nothing",
        "Torque lag": f"{1000.0 * result.torque_lag:.1f} ms",
        "Physically possible": "yes, every link and joint" if result.is_physical else "NO",
    }


def _cards(errors: dict[str, float]) -> list[dict[str, str]]:
    """Overall errors of the models, best first, as arguments of the macro `card`."""
    changes = {m: f"identified is {compared(errors['identified'], errors[m])}" for m in errors if m != "identified"}
    return [
        {"label": f"{name}, all joints", "figure": number(errors[m], 3), "css": m, "change": changes.get(m, "")}
        for m, name in MODEL_NAMES.items()
        if m in errors
    ]


def _leg(leg: LegIdentification, part: str, trust: Trust) -> dict[str, object]:
    seen = leg.estimate.observability
    drawn = (torque_figure(leg), error_figure(leg), spread_figure(leg, part))
    could = f"Rich motion without noise could determine {leg.structural_rank}." if leg.rmse else ""
    return {
        "name": leg.leg.name,
        "lead": f"The log determines {seen.rank} of {len(seen.columns)} directions better than CAD does. {could}",
        "links": [marked(table, trust) for table in words.link_tables(leg)],
        "combinations": marked(words.combination_table(leg), trust) if leg.combinations else None,
        "plots": [figure for figure in drawn if not figure.is_empty],
    }


_WIDTHS = {"measured": 2.2, "identified": 1.4}  # px; 1.2 for others


def figures(result: Identification) -> dict[str, Figure | TableData]:
    """All figures by name, the most informative first; names of a leg's figures end in the leg's name."""
    part, found = words.evaluated_part(result), dict[str, Figure | TableData]()
    for leg in result.legs:
        end = f"-{leg.leg.name}" if len(result.legs) > 1 else ""
        found |= {f"torques{end}": torque_figure(leg), f"observability{end}": words.link_table(leg)}
        found |= {f"errors{end}": error_figure(leg), f"spread{end}": spread_figure(leg, part)}
    found["rmse"] = rmse_figure(result.legs, part)
    return {name: figure for name, figure in found.items() if isinstance(figure, TableData) or not figure.is_empty}


def torque_figure(leg: LegIdentification) -> Figure:
    """Measured torque of each joint over time, and each model's prediction."""
    note = "Measured and predicted; validation is shaded. Drag to zoom, double-click to go back."
    roles = ("prior", "prior_friction", "measured", "identified")
    return _over_time(leg, "Torques", "torque [N·m]", note, roles)


def error_figure(leg: LegIdentification) -> Figure:
    """Measured minus predicted torque of each joint over time."""
    note = "Measured minus predicted. CAD alone is hidden: click it in the legend."
    hidden = ("prior",) if any("prior_friction" in t.predicted for t in leg.traces) else ()
    return _over_time(leg, "Torque errors", "error [N·m]", note, MODELS, hidden)


def _over_time(
    leg: LegIdentification, title: str, quantity: str, note: str, roles: Sequence[str], hidden: Sequence[str] = ()
) -> Figure:
    """A curve of each role's torques, or of their errors without the role "measured", in a panel of each joint."""
    traces, panels = plotted_traces(leg.traces), []

    def values(trace: TorqueTrace, role: str) -> Array | None:
        known = trace.measured if role == "measured" else trace.predicted.get(role)
        return known if known is None or "measured" in roles else trace.measured - known

    shaded = [t for t in traces if t.part == "validation" and len(traces) > 1]
    guides = tuple(Guide(float(t.time[0]), float(t.time[-1]), colour="blue") for t in shaded)
    for k, joint in enumerate(leg.leg.joints):
        marks = []
        for role in roles:
            known = [(t.time, v[:, k]) for t in traces if (v := values(t, role)) is not None]
            if known:
                time, torque = map(np.concatenate, zip(*known, strict=True))
                look = {"width": _WIDTHS.get(role, 1.2), "hidden": role in hidden}
                marks.append(line(time, torque, MODEL_NAMES.get(role, role), ROLES[role], **look))
        panels.append(Panel(Axis("time [s]"), Axis(quantity), tuple(marks), guides, joint))
    return stacked(f"{title} of {leg.leg.name}", panels, note)


def spread_figure(leg: LegIdentification, part: str) -> Figure:
    """Histogram of the errors, joint by joint."""
    chosen = [trace for trace in leg.traces if trace.part == part]
    errors = {
        model: np.concatenate([t.measured - t.predicted[model] for t in chosen if model in t.predicted])
        for model in ("prior_friction", "identified")
        if any(model in t.predicted for t in chosen)
    }
    row = []
    for k, joint in enumerate(leg.leg.joints):
        edge = max((float(np.quantile(np.abs(e[:, k]), 0.995)) for e in errors.values()), default=0.0) or 1.0
        marks = tuple(_histogram(values[:, k], edge, model) for model, values in errors.items())
        row.append(Panel(Axis("error [N·m]"), Axis("samples [%]", zero=True), marks, title=joint))
    return Figure(f"Spread of the torque errors of {leg.leg.name}", (tuple(row),), f"On {part}.", 240.0)


def _histogram(values: Array, edge: float, model: str) -> Series:
    count, edges = np.histogram(values, np.linspace(-edge, edge, 61))
    middle, share = 0.5 * (edges[1:] + edges[:-1]), 100.0 * count / len(values)
    return Series(middle, share, MODEL_NAMES[model], ROLES[model], 1.5, stairs="bins", fill="zero")


def rmse_figure(legs: Sequence[LegIdentification], part: str) -> Figure:
    """RMSE of each joint under each model, as bars."""
    joints, marks = tuple(joint for leg in legs for joint in leg.leg.joints), []
    for model, name in MODEL_NAMES.items():
        errors = {j: e for leg in legs for j, e in leg.rmse.get(part, {}).get(model, {}).items()}
        if errors:
            marks.append(Bars(np.array([errors.get(joint, np.nan) for joint in joints]), name, ROLES[model]))
    panel = Panel(Axis(f"torque RMSE on {part} [N·m]", zero=True), Axis(labels=joints), tuple(marks))
    return Figure("Torque RMSE of each joint under each model", ((panel,),))


def plotted_traces(traces: Sequence[TorqueTrace]) -> list[TorqueTrace]:
    """Traces that share one time axis: all, or only those of the validation if their times overlap."""
    filled = sorted((t for t in traces if len(t.time)), key=lambda t: float(t.time[0]))
    overlap = any(a.time[-1] >= b.time[0] for a, b in pairwise(filled))
    if overlap and any(t.part == "validation" for t in filled):
        return [t for t in filled if t.part == "validation"]
    return filled
