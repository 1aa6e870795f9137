"""Page of an identification: verdict, next steps, drives, evidence, each leg, and processing of the log."""

from __future__ import annotations

from collections.abc import Iterator

from stadera.identify.result import Identification, LegIdentification
from stadera.report.identify import plots, tables
from stadera.report.identify.remarks import answer, badge, evaluated_part, headline, is_alarming, overall_rmse, remarks
from stadera.report.numbers import compared, number
from stadera.report.page import render
from stadera.report.trust import marked, trust_reasons
from stadera.trust import Trust

_METHODS = {
    "consistent": "physically consistent (maximum a posteriori, CAD as prior)",
    "null-space": "least squares, CAD where the data say nothing (null-space projection)",
}


def next_steps(result: Identification, enough: float = 0.6) -> Iterator[str]:
    """Yields next steps for this result, the most urgent first: sentences, with commands between backquotes.

    Args:
        enough: share of the directions that rich motion determines, below which another motion is recommended.
    """
    robot = result.robot.name
    if result.trust.verdict == "bad":
        yield (
            "Do not use these figures: the model does not explain the torques, and the likeliest cause is named below. "
            "Mend the log or the model file and identify again."
        )
        return
    if evaluated_part(result) == "training":
        yield "This fit is untested: hold back a part, `--split 0.5`, or give another log, `--validate LOG`."
    poor = min(result.legs, key=lambda leg: leg.estimate.observability.rank / leg.structural_rank)
    if (rank := poor.estimate.observability.rank) < enough * poor.structural_rank:
        yield (
            f"Play a richer motion: {poor.leg.name} showed {rank} of {poor.structural_rank} directions. "
            f"`stadera excite --robot {robot} --leg {poor.leg.name} --out motion.csv` designs one."
        )
    if not is_alarming(result):
        yield (
            f"Weigh with these legs: `stadera identify LOG --robot {robot} --json legs.json`, then "
            f"`stadera weigh WALK --robot {robot} --legs legs.json`."
        )
        yield f"Write them into the model file: `stadera identify LOG --robot {robot} --export identified.urdf`."


def identification_html(result: Identification) -> str:
    """The complete, self-contained page."""
    part, (how, word), said = evaluated_part(result), badge(result), remarks(result)
    drives = tables.drives_table(result)
    return render(
        "identify.html.j2",
        title=f"Leg identification: {result.robot.name}",
        headline=answer(result),
        level=how,
        word=word,
        why=f"{trust_reasons(result.trust)} {headline(result)}.",
        next=tuple(next_steps(result)),
        problems=[remark for remark in said if remark.level == "bad"],
        remarks=[remark for remark in said if remark.level != "bad"],
        cards=list(_cards(overall_rmse(result, part))),
        at_a_glance=tables.leg_table(result),
        drives=marked(drives, result.trust) if drives.groups else None,
        where=f"motion not used for fitting: {result.validated_on}" if part == "validation" else "the TRAINING data",
        errors=tables.rmse_table(result),
        error_bars=plots.rmse_figure(result.legs, part),
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


def _cards(overall: dict[str, float]) -> Iterator[dict[str, str]]:
    """Overall errors of the models, best first, as arguments of the macro `card`."""
    for model, name in tables.MODEL_NAMES.items():
        if model in overall:
            other = model != "identified" and "identified" in overall
            change = f"identified is {compared(overall['identified'], overall[model])}" if other else ""
            yield {"label": f"{name}, all joints", "figure": number(overall[model], 3), "css": model, "change": change}


def _leg(leg: LegIdentification, part: str, trust: Trust) -> dict[str, object]:
    """The template's values for a leg."""
    seen = leg.estimate.observability
    drawn = (plots.torque_figure(leg), plots.error_figure(leg), plots.spread_figure(leg, part))
    return {
        "name": leg.leg.name,
        "lead": f"The log determines {seen.rank} of {len(seen.columns)} directions better than CAD does. "
        f"Rich motion without noise could determine {leg.structural_rank}.",
        "links": [marked(table, trust) for table in tables.link_tables(leg)],
        "combinations": marked(tables.combination_table(leg), trust) if leg.combinations else None,
        "plots": [figure for figure in drawn if not figure.is_empty],
    }
