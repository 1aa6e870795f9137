"""Page of an identification: verdict, next steps, evidence, each leg, processing of the log, and terms."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

from stadera.identify.result import MODELS, Identification, LegIdentification
from stadera.report.identify import plots, tables
from stadera.report.identify.remarks import answer, badge, evaluated_part, headline, is_alarming, overall_rmse, remarks
from stadera.report.identify.tables import MODEL_NAMES
from stadera.report.numbers import number, percent
from stadera.report.page import render
from stadera.report.table import Cell, TableData
from stadera.report.trust import marked, trust_reasons
from stadera.trust import Trust

TERMS: dict[str, str] = {
    "CAD": "The values of the robot's model file: the prior.",
    "prior": "Values and standard deviations before the log was seen. For links, CAD. For rotor inertia and friction, "
    "the model file's values, drawn towards those of the other legs' same joints where several legs are identified "
    "together.",
    "CAD + friction": "The model file's links, with rotor inertia, friction and torque offset of each joint fitted to "
    "the same data: the baseline that shows what the links' parameters bring on top of friction.",
    "identified": "Links and joints fitted together.",
    "RMSE": "Root of the mean squared difference between measured and predicted torque. Over all joints: the root of "
    "the mean of the joints' squares.",
    "torque RMS": "Root mean square of the measured torque over the samples that are drawn: what an error is to be "
    "compared with.",
    "validation": "Motion that the fit has not seen. Errors on the training data say how well a model bends, not how "
    "well it predicts.",
    "± std": "One standard deviation, from the torque noise seen in the residuals and the prior. It covers noise, not "
    "errors of the model itself, such as a friction law that does not fit.",
    "trust": "Good: the error bars hold. Doubtful: they are widened to the fit, or a reason is against them. Bad: the "
    "model does not explain the torques, and no figure is to be relied on.",
    "misfit": "Variance of the torque residuals over the stated one, 1 if model and noise are right.",
    "observable": "The data alone fix the value to within a tenth of what CAD leaves open.",
    "partial": "Data fix it only in combination with others. Predictions need the combination only; the value by "
    "itself leans on CAD.",
    "unobservable": "No torque of this motion changes with it beyond noise. It stays as CAD has it, or moves along "
    "with what was measured, as prior and physical consistency have it (the number in brackets; the export holds it).",
    "com": "Centre of mass in the link's frame. It is the first moment over the mass; where the mass is not measured "
    "it holds for CAD's mass, and its standard deviation leaves the mass's out.",
    "Ixx ... Izz": "Inertia about the origin of the link's frame, in the link's axes (not about the centre of mass).",
    "rank": "How many independent combinations of parameters the data know better than the prior.",
    "physically possible": "A non-negative mass density exists that has these moments, and no joint has negative rotor "
    "inertia or friction.",
    "torque lag": "How much later than the joint states the torques were stamped; found from the log, taken off.",
    "armature": "Rotor inertia times the gear ratio squared, as felt at the joint.",
}
"""By term, in the displayed order."""


_POOR = 0.6  # of the directions that rich motion determines; below this another motion is recommended


def next_steps(result: Identification) -> Iterator[str]:
    """Yields next steps for this result, the most urgent first: sentences, with commands between backquotes."""
    robot = result.robot.name
    if result.trust.verdict == "bad":
        yield (
            "Do not use these figures: the model does not explain the torques, and the likeliest cause is named below. "
            "Mend the log or the model file and identify again."
        )
        return
    if evaluated_part(result) == "training":
        yield "This fit is untested: hold back a part, `--split 0.5`, or give another log, `--validate LOG`."
    poor = [leg for leg in result.legs if leg.estimate.observability.rank < _POOR * leg.structural_rank]
    if poor:
        leg = min(poor, key=lambda leg: leg.estimate.observability.rank / leg.structural_rank)
        yield (
            f"Play a richer motion: {leg.leg.name} showed {leg.estimate.observability.rank} of {leg.structural_rank} "
            f"directions. `stadera excite --robot {robot} --leg {leg.leg.name} --out motion.csv` designs one."
        )
    if not is_alarming(result):
        yield (
            f"Weigh with these legs: `stadera identify LOG --robot {robot} --json legs.json`, then "
            f"`stadera weigh WALK --robot {robot} --legs legs.json`."
        )
        yield f"Write them into the model file: `stadera identify LOG --robot {robot} --export identified.urdf`."


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
        next=tuple(next_steps(result)),
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
    columns = ("directions determined", "torque RMSE [N·m]", "against CAD + friction", "misfit", "physically possible")
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
