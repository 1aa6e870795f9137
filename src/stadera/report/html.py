"""The report of an identification: one self-contained page, the judgement before the numbers."""

from __future__ import annotations

from collections.abc import Iterator

from stadera.identify.result import MODELS, Identification, LegIdentification, Quantity
from stadera.inertia import ORDER
from stadera.report.findings import findings, is_alarming, judged_part, overall_rmse, torque_rms
from stadera.report.glossary import TERMS
from stadera.report.markup import Html, element, items, row, table, text
from stadera.report.numbers import number, percent
from stadera.report.page import figure_html, page_html
from stadera.report.plots import error_figure, rmse_figure, spread_figure, torque_figure
from stadera.report.quantities import MARKS, MODEL_NAMES, is_held, shown
from stadera.report.sections import facts, header, words

_LEVEL_WORDS = {"bad": "Problem", "warning": "Warning", "note": "Note"}
_METHODS = {
    "consistent": "physically consistent (maximum a posteriori, CAD as prior)",
    "null-space": "least squares, CAD in the null space (eq. 5)",
}


def identification_html(result: Identification) -> str:
    """A whole page, with plots and their script library inside; it loads nothing from anywhere.

    Order: what was measured, what to be wary of, how well torques are predicted, then each leg's links, joints,
    combinations and plots, then how to read the numbers.
    """
    title = f"Leg identification: {result.robot.name}"
    return page_html(
        title,
        _header(result, title),
        _findings(result),
        _errors(result),
        *(_leg(leg, result) for leg in result.legs),
        words(TERMS, id="how"),
    )


# -- the top ------------------------------------------------------------------------------------------------------
def _header(result: Identification, title: str) -> Html:
    model = "made in memory" if result.robot.source is None else result.robot.source.name
    names = ", ".join(leg.leg.name for leg in result.legs)
    about = {
        "Robot": f"{result.robot.name}, {number(result.robot.mass)} kg (model {model})",
        "Log": result.source,
        "Moving": _spans(result),
        "Legs": names,
        "Method": _METHODS.get(result.method, result.method),
        "Validated on": result.validated_on or "nothing",
        "Torque lag": f"{1000.0 * result.torque_lag:.1f} ms",
        "Physically possible": "yes, every link and joint" if result.is_physical else "NO",
    }
    links = [
        ("errors", "Torque errors"),
        *((leg.leg.name, leg.leg.name) for leg in result.legs),
        ("how", "How to read the numbers"),
    ]
    nav = (element("a", text(label), href=f"#{anchor}") for anchor, label in links)
    done = element("h3", text("What was done to the log"))
    return header(title, facts(about), done, items(result.notes, css="steps"), element("nav", *nav))


def _spans(result: Identification) -> str:
    """How much time the traces of each part span; every leg's are of the same log."""
    spans = {
        trace.part: f"{trace.time[-1] - trace.time[0]:.1f} s {trace.part}"
        for leg in result.legs[:1]
        for trace in leg.traces
        if len(trace.time)
    }
    return ", ".join(spans.values()) or "not kept"


def _findings(result: Identification) -> Html:
    found = findings(result)
    worst = "bad" if is_alarming(result) else found[0].level if found else "note"
    headline = {
        "bad": "Do not use these numbers as they are",
        "warning": "Worth knowing before using the numbers",
        "note": "Nothing stands against using the numbers",
    }[worst]
    listed = (
        element("li", element("strong", text(_LEVEL_WORDS[f.level])), " ", text(f.text), css=f.level) for f in found
    )
    return element("section", element("h2", text(headline)), element("ul", *listed), css=f"findings {worst}")


# -- errors -------------------------------------------------------------------------------------------------------
def _errors(result: Identification) -> Html:
    part = judged_part(result)
    where = f"on motion not used for fitting: {result.validated_on}" if part == "validation" else "on the TRAINING data"
    figure = rmse_figure(result.legs, part)
    return element(
        "section",
        element("h2", text("How well torques are predicted")),
        element("p", text(f"Root of the mean squared torque error, {where}."), css="lead"),
        element("div", *_cards(overall_rmse(result, part)), css="cards"),
        element(
            "div",
            element("div", _error_table(result, part), css="wide"),
            element("div", figure_html(figure, "Torque RMSE of each joint under each model"), css="wide"),
            css="beside",
        ),
        id="errors",
    )


def _cards(overall: dict[str, float]) -> Iterator[Html]:
    best = overall.get("identified")
    for model in MODELS[::-1]:
        if model not in overall:
            continue
        change = ""
        if model != "identified" and best is not None:
            change = f"identified against this: {percent(best, overall[model])}"
        yield element(
            "div",
            element("p", text(f"{MODEL_NAMES[model]}, all joints"), css="label"),
            element("p", text(number(overall[model], 3)), " ", element("small", text("N·m")), css="figure"),
            element("p", text(change), css="change"),
            css=f"card {model}",
        )


def _error_table(result: Identification, part: str) -> Html:
    head = [text("joint [N·m]"), text("torque RMS"), *(text(MODEL_NAMES[m]) for m in MODELS[::-1])]
    rows = []
    for leg in result.legs:
        models, rms = leg.rmse.get(part, {}), torque_rms(leg, part)
        for joint in leg.leg.joints:
            errors = {model: models[model][joint] for model in MODELS if joint in models.get(model, {})}
            rows.append(_error_row(joint, rms.get(joint), errors))
    return table([*head, text("against CAD + friction")], rows, css="numbers")


def _error_row(joint: str, rms: float | None, errors: dict[str, float]) -> Html:
    cells = [text(number(errors[m], 3)) if m in errors else text("") for m in MODELS[::-1]]
    verdict = text("")
    if {"identified", "prior_friction"} <= errors.keys():
        worse = errors["identified"] > errors["prior_friction"]
        change = percent(errors["identified"], errors["prior_friction"])
        verdict = element("td", text(f"{change} {'worse' if worse else 'better'}"), css="bad" if worse else "good")
    return row(text(joint), text("" if rms is None else number(rms, 3)), *cells, verdict)


# -- a leg --------------------------------------------------------------------------------------------------------
def _leg(leg: LegIdentification, result: Identification) -> Html:
    name, part = leg.leg.name, judged_part(result)
    seen = leg.estimate.observability
    lead = (
        f"The log tells {seen.rank} of {len(seen.columns)} directions better than CAD does. "
        f"Rich motion without noise could tell {leg.structural_rank}."
    )
    plots = (
        (
            "Torques",
            torque_figure(leg),
            "Measured and predicted; validation is shaded. Drag to zoom, double-click to go back.",
        ),
        ("Errors", error_figure(leg), "Measured minus predicted. CAD alone is hidden: click it in the legend."),
        ("Spread of the errors", spread_figure(leg, part), f"On {part}."),
    )
    return element(
        "section",
        element("h2", text(f"Leg {name}")),
        element("p", text(lead), css="lead"),
        _legend(),
        element("h3", text("Links")),
        element(
            "p",
            text("In the link's frame and axes; inertia about the frame's origin, not the centre of mass."),
            css="lead",
        ),
        element("div", *(_link_card(leg, link) for link in leg.leg.links), css="links"),
        *_joints(leg),
        *_combinations(leg),
        *(
            element(
                "div",
                element("h3", text(title)),
                element("p", text(note), css="lead"),
                figure_html(plot, title),
                css="block",
            )
            for title, plot, note in plots
            if plot.data
        ),
        id=name,
    )


def _legend() -> Html:
    meaning = {
        "observable": "the data alone fix it",
        "partial": "known only together with others; its own value leans on CAD",
        "unobservable": "the data say nothing: CAD's, or moved along with the rest",
    }
    marks = (
        element("span", element("b", text(f"{m.symbol} {m.word}")), text(f": {meaning[m.word]}"), css=f"key {m.word}")
        for m in MARKS.values()
    )
    return element("p", *marks, css="legend")


def _link_card(leg: LegIdentification, link: str) -> Html:
    found = leg.parameters
    rows = [_quantity_row("mass", found[f"{link}.m"])]
    rows += [_quantity_row(f"com {axis}", q) for axis, q in zip("xyz", leg.coms[link], strict=True)]
    rows += [_quantity_row(name, found[f"{link}.{name}"]) for name in ORDER[4:]]
    head = [text(title) for title in ("parameter", "CAD", "identified ± std")]
    return element("div", element("h4", text(link)), table(head, rows, css="quantities"), css="link")


def _quantity_row(name: str, quantity: Quantity, prior: str = "CAD") -> Html:
    mark = MARKS[quantity.verdict]
    seen = element("span", text(mark.symbol), css="seen", title=mark.word, role="img", **{"aria-label": mark.word})
    return row(
        Html(f"{seen} {text(name)} {element('span', text(quantity.unit), css='unit')}"),
        text(number(quantity.prior, 3)),
        element("td", text(shown(quantity, prior)), css="held" if is_held(quantity) else "value"),
        css=mark.word,
    )


def _joints(leg: LegIdentification) -> Iterator[Html]:
    terms: dict[str, list[Html]] = {}
    for name, quantity in leg.parameters.items():
        owner, term = name.rsplit(".", 1)
        if owner in leg.leg.joints:
            terms.setdefault(owner, []).append(_quantity_row(term, quantity, "prior"))
    if terms:
        head = [text(title) for title in ("parameter", "prior", "identified ± std")]
        cards = (
            element("div", element("h4", text(joint)), table(head, rows, css="quantities"), css="link")
            for joint, rows in terms.items()
        )
        yield element("h3", text("Joints: rotor inertia, friction, torque offset"))
        yield element("div", *cards, css="links")


def _combinations(leg: LegIdentification) -> Iterator[Html]:
    if not leg.combinations:
        return
    rows = [
        _quantity_row(c.text, Quantity(c.prior, c.value, c.std, c.verdict, c.unit), "prior") for c in leg.combinations
    ]
    head = [text(title) for title in ("combination", "prior", "identified ± std")]
    yield element("h3", text("What this kind of motion can tell: identifiable combinations"))
    yield element(
        "p",
        text(
            "Torque depends on the parameters through these alone. Rich motion would tell all of them; the marks say "
            "which ones this log told."
        ),
        css="lead",
    )
    yield table(head, rows, css="quantities combinations")
