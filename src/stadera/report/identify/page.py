"""Page of an identification: verdict, evidence, each leg, and processing of the log."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

from stadera.identify.result import MODELS, Identification, LegIdentification
from stadera.report.identify import plots, tables
from stadera.report.identify.advice import next_steps
from stadera.report.identify.glossary import TERMS
from stadera.report.identify.quantities import MODEL_NAMES
from stadera.report.identify.remarks import answer, badge, evaluated_part, headline, overall_rmse, remarks
from stadera.report.numbers import number, percent
from stadera.report.page import render
from stadera.report.table import Cell, TableData
from stadera.report.trust import marked, trust_reasons
from stadera.trust import Trust

_METHODS = {
    "consistent": "physically consistent (maximum a posteriori, CAD as prior)",
    "null-space": "least squares, CAD where the data say nothing (null-space projection)",
}


def identification_html(result: Identification) -> str:
    """The complete, self-contained page."""
    part, (how, word), said = evaluated_part(result), badge(result), remarks(result)
    return render(
        "identify.html.j2",
        title=f"Leg identification: {result.robot.name}",
        headline=answer(result),
        level=how,
        word=word,
        why=f"{trust_reasons(result.trust)} {headline(result)}.",
        next=next_steps(result),
        problems=[remark for remark in said if remark.level == "bad"],
        remarks=[remark for remark in said if remark.level != "bad"],
        cards=list(_cards(overall_rmse(result, part))),
        at_a_glance=leg_table(result),
        where=f"motion not used for fitting: {result.validated_on}" if part == "validation" else "the TRAINING data",
        errors=tables.rmse_table(result),
        error_bars=plots.rmse_figure(result.legs, part),
        legs=[_leg(leg, part, result.trust) for leg in result.legs],
        facts=_facts(result),
        notes=result.notes,
        terms=TERMS,
    )


def leg_table(result: Identification) -> TableData:
    """One row for each leg: directions determined, torque error, misfit, and physical consistency."""
    part, rows = evaluated_part(result), []
    for leg in result.legs:
        name, seen, physical = leg.leg.name, leg.estimate.observability, leg.estimate.is_physical
        errors = overall_rmse(result, part, (name,))
        rows.append(
            (
                Cell(name, strong=True),
                f"{seen.rank} of {leg.structural_rank}",
                number(errors["identified"], 3),
                percent(errors["identified"], errors["prior_friction"]) if "prior_friction" in errors else "",
                number(result.trust.by_leg.get(name, nan), 3),
                "yes" if physical else Cell("NO", good=False),
            )
        )
    columns = (
        "directions determined",
        "torque RMSE [N·m]",
        "against CAD + friction",
        "misfit",
        "physically possible",
    )
    return TableData.of("Legs at a glance", ("leg", *columns), rows)


def _facts(result: Identification) -> dict[str, str]:
    model = "made in memory" if result.robot.source is None else result.robot.source.name
    return {
        "Robot": f"{result.robot.name}, {number(result.robot.mass)} kg (model {model})",
        "Log": result.source,
        "Moving": _spans(result),
        "Legs": ", ".join(leg.leg.name for leg in result.legs),
        "Method": _METHODS.get(result.method, result.method),
        "Validated on": result.validated_on or "nothing",
        "Torque lag": f"{1000.0 * result.torque_lag:.1f} ms",
        "Physically possible": "yes, every link and joint" if result.is_physical else "NO",
    }


def _spans(result: Identification) -> str:
    """Duration of each part's traces, which are the same for all legs."""
    spans = {
        trace.part: f"{trace.time[-1] - trace.time[0]:.1f} s {trace.part}"
        for leg in result.legs[:1]
        for trace in leg.traces
        if len(trace.time)
    }
    return ", ".join(spans.values()) or "not kept"


def _cards(overall: dict[str, float]) -> Iterator[dict[str, str]]:
    """Overall errors of the models, best first, as arguments of the macro `card`."""
    best = overall.get("identified")
    for model in MODELS[::-1]:
        if model in overall:
            compared = model != "identified" and best is not None
            change = f"identified against this: {percent(best or 0.0, overall[model])}" if compared else ""
            figure = number(overall[model], 3)
            yield {"label": f"{MODEL_NAMES[model]}, all joints", "figure": figure, "css": model, "change": change}


def _leg(leg: LegIdentification, part: str, trust: Trust) -> dict[str, object]:
    """The template's values for a leg."""
    seen = leg.estimate.observability
    drawn = (plots.torque_figure(leg), plots.error_figure(leg), plots.spread_figure(leg, part))
    return {
        "name": leg.leg.name,
        "lead": f"The log determines {seen.rank} of {len(seen.columns)} directions better than CAD does. "
        f"Rich motion without noise could determine {leg.structural_rank}.",
        "links": [marked(table, trust) for table in tables.link_tables(leg)],
        "joints": [marked(table, trust) for table in tables.joint_tables(leg)],
        "combinations": marked(tables.combination_table(leg), trust) if leg.combinations else None,
        "plots": [figure for figure in drawn if not figure.is_empty],
    }
