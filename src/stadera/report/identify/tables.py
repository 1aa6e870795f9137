"""Verdict on an identification, remarks for the reader, and tables for terminal, page and paper."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, nan, sqrt

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from stadera.constants import NOTHING, SAME
from stadera.identify.observability import Identifiability
from stadera.identify.result import MODELS, Identification, LegIdentification, Quantity
from stadera.identify.varying import VARYING_UNITS
from stadera.inertia import ORDER
from stadera.report.numbers import compared, counted, listed, number, with_std
from stadera.report.table import Cell, TableData, legend, rich_table
from stadera.report.trust import LEVELS, STYLES, Level, marked, trust_text

_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w])")
HEADLINES: dict[Level, str] = {
    "bad": "Do not use these numbers as they are",
    "warning": "Read the warnings below before using the numbers",
    "note": "Nothing stands against using the numbers",
}


@dataclass(frozen=True)
class Remark:
    """A sentence and its severity."""

    level: Level
    text: str


def evaluated_part(result: Identification) -> str:
    """The part used to evaluate errors: "validation" if there is one, else "training"."""
    return "validation" if any("validation" in leg.rmse for leg in result.legs) else "training"


def is_untested(result: Identification) -> bool:
    """True if torques were predicted on the training data only."""
    return evaluated_part(result) == "training" and has_errors(result)


def has_errors(result: Identification) -> bool:
    """False for a robot on its feet: torques of its legs carry its weight too."""
    return any(leg.rmse for leg in result.legs)


def overall_rmse(result: Identification, part: str, legs: tuple[str, ...] | None = None) -> dict[str, float]:
    """By model, root of the mean over joints of the squared torque RMSE [N·m] on a part; None for all legs."""
    chosen = [leg.rmse.get(part, {}) for leg in result.legs if legs is None or leg.leg.name in legs]
    errors = {model: [rmse for leg in chosen for rmse in leg.get(model, {}).values()] for model in MODELS}
    return {model: _rms(found) for model, found in errors.items() if found}


def torque_rms(leg: LegIdentification, part: str) -> dict[str, float]:
    """By joint, the root mean square of the measured torque [N·m], from the leg's traces; empty without them."""
    for trace in leg.traces:
        if trace.part == part and len(trace.time):
            rms = np.sqrt(np.mean(np.asarray(trace.measured) ** 2, axis=0))
            return dict(zip(leg.leg.joints, rms.tolist(), strict=True))
    return {}


def answer(result: Identification) -> str:
    """One sentence with the legs and the accuracy of their predicted torques."""
    part = evaluated_part(result)
    names, errors = ", ".join(leg.leg.name for leg in result.legs), overall_rmse(result, part)
    where = "motion not used for fitting" if part == "validation" else "the training data"
    if not errors.get("identified"):
        terms = [joint for leg in result.legs for joint in leg.joint_terms.values()]
        of = {"armature": "rotor inertia", "viscous": "viscous friction", "coulomb": "Coulomb friction"}
        measured = {name: sum(not joint[term].is_held for joint in terms if term in joint) for term, name in of.items()}
        said = listed([f"{name} of {count}" for name, count in measured.items()])
        return f"Drives of {names} by a robot on its feet: {said} of {counted(len(terms), 'joint')} measured."
    said = f"Torques of {names} are predicted to {number(errors['identified'], 3)} N·m RMSE on {where}"
    torques = [rms for leg in result.legs for rms in torque_rms(leg, part).values()]
    if any(torques):
        said += f", {100.0 * errors['identified'] / _rms(torques):.0f} % of the measured torque"
    if errors.get("prior_friction"):
        said += f" and {compared(errors['identified'], errors['prior_friction'], ('below', 'above', 'the same as'))}"
        said += " CAD with fitted friction"
    return f"{said}."


def level(result: Identification) -> Level:
    """Level of the whole result: that of its worst remark."""
    found = remarks(result)
    return found[0].level if found else "note"


def remarks(result: Identification) -> tuple[Remark, ...]:
    """All remarks, the most serious first. Sentences that apply to several legs are merged."""
    found = [Remark(LEVELS[result.trust.verdict], reason) for reason in result.trust.reasons]
    if is_untested(result):
        untested = "nothing was held out: the errors shown are on the training data and say little of the model"
        found.append(Remark("warning", untested))
    found += [Remark("note", text) for text in _on_masses(result)]
    found += [Remark("warning", text) for text in (*result.warnings, *_on_legs(result))]
    return tuple(sorted(dict.fromkeys(found), key=lambda remark: list(HEADLINES).index(remark.level)))


def _on_legs(result: Identification) -> Iterator[str]:
    """Yields the warnings on legs, each once, with the legs' names unless it names a joint or link."""
    parts = tuple(name for leg in result.legs for name in (*leg.leg.joints, *leg.leg.links))
    legs: dict[str, list[str]] = {}
    sentences: dict[str, list[str]] = {}
    for leg in result.legs:
        for sentence in leg.warnings:
            alike = sentence if sentence.startswith(parts) else _NUMBER.sub("#", sentence)
            legs.setdefault(alike, []).append(leg.leg.name)
            sentences.setdefault(alike, []).append(sentence)
    for alike, names in legs.items():
        sentence = _ranged(sentences[alike])
        yield sentence if sentence.startswith(parts) else f"{', '.join(names)}: {sentence}"


def _ranged(sentences: Sequence[str]) -> str:
    """Sentences that differ in their numbers alone as one, with the range of each number."""
    numbers = zip(*(_NUMBER.findall(sentence) for sentence in sentences), strict=True)
    spans = ((min(found, key=float), max(found, key=float)) for found in numbers)
    texts = iter([low if low == high else f"{low} to {high}" for low, high in spans])
    return _NUMBER.sub(lambda _: next(texts), sentences[0])


def _on_masses(result: Identification) -> Iterator[str]:
    masses = {link: leg.parameters[f"{link}.m"].verdict for leg in result.legs for link in leg.leg.links}
    unknown = [link for link, verdict in masses.items() if verdict is not Identifiability.OBSERVABLE]
    if unknown:
        which = "no link's mass was" if len(unknown) == len(masses) else f"the masses of {', '.join(unknown)} were not"
        yield (
            f"{which} measured: this motion moves no torque with mass alone, so the masses are CAD's, "
            "and centres of mass hold for these masses"
        )


def _rms(values: Iterable[float]) -> float:
    return sqrt(float(np.mean(np.square(list(values)))))


NOT_MEASURED = "not measured"

MODEL_NAMES: dict[str, str] = {"identified": "identified", "prior_friction": "CAD + friction", "prior": "CAD"}
"""Names of the compared models, best first."""

LINK_FRAMES = "in each link's own frame and axes, inertia about that frame's origin"
"""Frames of the links' centres of mass and inertias."""


def shown(quantity: Quantity, prior: str = "CAD") -> str:
    """The value as text, without its unit.

    A value that was not measured is marked as such: it is the prior's, or in brackets if the prior or physical
    consistency changed it along with measured values.
    """
    if not quantity.is_held and quantity.std is not None:
        return with_std(quantity.value, quantity.std)
    if abs(quantity.value - quantity.prior) <= SAME * abs(quantity.prior):
        return f"{prior}, {NOT_MEASURED}"
    return f"{NOT_MEASURED} ({number(quantity.value, 3)})"


def _prior(quantity: Quantity) -> str:
    return number(quantity.prior if abs(quantity.prior) > NOTHING else 0.0, 3)


def _drive(quantity: Quantity | None) -> Cell | str:
    """Value and prior in one cell, without the number of a value that was not measured, or a prior of zero."""
    if quantity is None:
        return ""
    if quantity.is_held:
        return Cell(NOT_MEASURED, quantity.verdict, muted=True)
    prior = f"[{_prior(quantity)}]" if abs(quantity.prior) > NOTHING else ""
    return Cell(shown(quantity), quantity.verdict, note=prior)


def leg_table(result: Identification) -> TableData:
    """One row for each leg: directions determined, torque error, misfit, and physical consistency."""
    part, rows = evaluated_part(result), []
    scored = has_errors(result)
    for leg in result.legs:
        name, seen = leg.leg.name, leg.estimate.observability
        errors = overall_rmse(result, part, (name,))
        found = number(errors["identified"], 3) if errors.get("identified") else "none"
        rows.append(
            (
                Cell(name, strong=True),
                f"{seen.rank} of {leg.structural_rank}" if scored else f"{seen.rank}",
                *((found, _against_cad(errors)) if scored else ()),
                number(result.trust.by_leg.get(name, nan), 3),
                "yes" if leg.estimate.is_physical else Cell("NO", good=False),
            )
        )
    errors_of = ("torque RMSE [N·m]", "against CAD + friction") if scored else ()
    head = ("leg", "directions determined", *errors_of, "misfit", "physically possible")
    return TableData.of("Legs at a glance", head, rows)


def link_table(leg: LegIdentification) -> TableData:
    """The leg's links side by side, as in the paper's Table I."""
    rank, links = leg.estimate.observability.rank, leg.leg.links
    by_link = [_link_quantities(leg, link) for link in links]
    rows = (
        [
            Cell(f"{name} [{q.unit}]"),
            *(Cell(shown(x[name], "prior"), x[name].verdict, note=f"[{_prior(x[name])}]") for x in by_link),
        ]
        for name, q in by_link[0].items()
    )
    title = f"{leg.leg.name}: rank {rank} of {len(leg.estimate.columns)} parameters"
    return TableData.of(title, ("parameter", *links), rows, LINK_FRAMES, "l" * (1 + len(links)))


def drives_table(result: Identification) -> TableData:
    """A row for each joint of all legs: rotor inertia, friction and torque offset, and of how friction varies what a
    joint shows by two standard deviations; no rows if none were fitted.
    """
    of_leg = {leg.leg.name: leg.joint_terms for leg in result.legs}
    every = [item for joints in of_leg.values() for terms in joints.values() for item in terms.items()]
    shown = {t for t, q in every if t not in VARYING_UNITS or abs(q.value) > 2.0 * (q.std or inf)}
    units = {t: q.unit for t, q in every if t in shown}
    body = {
        leg: [[joint, *(_drive(terms.get(term)) for term in units)] for joint, terms in joints.items()]
        for leg, joints in of_leg.items()
        if joints
    }
    head = ("joint", *(f"{term} [{unit}]" for term, unit in units.items()))
    return TableData.of("Drives: rotor inertia, friction, torque offset", head, body, sides="l" * len(head))


def tables(result: Identification) -> list[TableData]:
    """Tables for a paper: links of each leg, drives, then the torque errors."""
    drives = drives_table(result)
    trunk = [] if result.trunk is None else [trunk_table(result)]
    errors = [rmse_table(result)] if has_errors(result) else []
    return [*map(link_table, result.legs), *trunk, *([drives] if drives.groups else []), *errors]


def trunk_table(result: Identification) -> TableData:
    """The trunk of a robot on its feet, payload included, and the model's."""
    assert result.trunk is not None
    prior, found = result.robot.inertias[result.robot.trunk], result.trunk
    names = ("mass [kg]", "com x [m]", "com y [m]", "com z [m]")
    model, values = (prior.mass, *prior.com), (found.inertial.mass, *found.inertial.com)
    stds = (number(std, 2, "not observed") for std in (found.mass_std, *found.com_std))
    shown = ([number(v, digits) for v in column] for column, digits in ((model, 3), (values, 4)))
    rows = zip(names, *shown, stds, strict=True)
    return TableData.of(f"Trunk ({result.robot.trunk}), payload included", ("", "model", "value", "std"), rows)


def rmse_table(result: Identification) -> TableData:
    """Torque errors of each joint under each model, and over all joints."""
    part = evaluated_part(result)
    where = result.validated_on if part == "validation" and result.validated_on else "the training data themselves"
    head = ("joint", "torque RMS", *MODEL_NAMES.values(), "against CAD + friction")
    legs: dict[str, list[list[Cell]]] = {}
    for leg in result.legs:
        errors, rms = leg.rmse.get(part, {}), torque_rms(leg, part)
        legs[leg.leg.name] = [
            _rmse_row(joint, {m: found[joint] for m, found in errors.items() if joint in found}, rms.get(joint))
            for joint in leg.leg.joints
        ]
    body = legs | {"all": [_rmse_row("all joints", overall_rmse(result, part))]}
    return TableData.of(f"Torque RMSE [N·m] on {where}", head, body)


def _rmse_row(joint: str, errors: dict[str, float], rms: float | None = None) -> list[Cell]:
    strong = joint == "all joints"
    cells = [Cell(number(errors[model], 3) if model in errors else "", strong=strong) for model in MODEL_NAMES]
    return [Cell(joint, strong=strong), Cell("" if rms is None else number(rms, 3)), *cells, _against_cad(errors)]


def _against_cad(errors: dict[str, float]) -> Cell:
    """How much smaller an error is than that of CAD with fitted friction."""
    if not {"identified", "prior_friction"} <= errors.keys():
        return Cell("")
    found, cad = errors["identified"], errors["prior_friction"]
    return Cell(compared(found, cad), good=found <= cad)


def link_tables(leg: LegIdentification) -> Iterator[TableData]:
    """What was measured of each link's mass, centre of mass and inertia, a table a link; its note names the rest."""
    for link in leg.leg.links:
        found = _link_quantities(leg, link)
        hidden = [name for name, quantity in found.items() if quantity.is_held]
        table = _quantity_table(link, found, "CAD", "parameter")
        yield replace(table, note=f"Not measured: {listed(hidden)}." if hidden else "")


def combination_table(leg: LegIdentification) -> TableData:
    """The measured ones of the combinations of parameters that this kind of motion can determine; its note counts the
    others.
    """
    hidden = sum(quantity.is_held for quantity in leg.combinations)
    found = {c.text: c for c in leg.combinations}
    table = _quantity_table("Identifiable combinations of parameters", found, "prior", "combination")
    return replace(table, note=f"{counted(hidden, 'more combination')} not measured." if hidden else "")


def _quantity_table(title: str, found: Mapping[str, Quantity], prior: str, name: str) -> TableData:
    rows = [
        (Cell(text, q.verdict, note=f"[{q.unit}]"), _prior(q), Cell(shown(q), strong=True))
        for text, q in found.items()
        if not q.is_held
    ]
    return TableData.of(title, (name, prior, "identified ± std"), rows)


def _link_quantities(leg: LegIdentification, link: str) -> dict[str, Quantity]:
    com = {f"com {axis}": quantity for axis, quantity in zip("xyz", leg.coms[link], strict=True)}
    return {"mass": leg.parameters[f"{link}.m"], **com, **{n: leg.parameters[f"{link}.{n}"] for n in ORDER[4:]}}


def identification_tables(result: Identification) -> Iterator[RenderableType]:
    """Links of each leg, drives, torque errors, then remarks and verdict.

    The verdict comes last, since a terminal shows the end of the output.
    """
    found = tables(result)
    errors = [found.pop()] if has_errors(result) else []
    yield from (rich_table(marked(table, result.trust)) for table in found)
    yield legend(f"({LINK_FRAMES}; in square brackets: the prior)")
    yield from map(rich_table, errors)
    for remark in reversed(remarks(result)):
        word = {"bad": "problem"}.get(remark.level, remark.level)
        yield Text(f"{word}: {remark.text}", style=STYLES[remark.level])
    said = f"Trust: {trust_text(result.trust, reasons=False)}. {answer(result)}"
    yield Text(said, style="bold" if result.trust.verdict == "good" else STYLES[level(result)])
