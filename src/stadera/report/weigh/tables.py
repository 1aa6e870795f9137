"""A weighing in words and tables: how heavy, where, how sure; and terminal output."""

from collections.abc import Iterable, Iterator
from math import isfinite

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from stadera.inertia import ORDER
from stadera.report.numbers import counted, fixed, listed, number, with_scale, with_std
from stadera.report.table import SHOWN, Cell, Row, TableData, notes, rich_table
from stadera.report.trust import LEVELS, STYLES, UNTRUSTED, trust_reasons, trust_text
from stadera.trunk.load import scale_of
from stadera.types import Array
from stadera.weigh.next_steps import NextStep
from stadera.weigh.result import Weighing


def place(com: Array, std: Array) -> tuple[str, str, str]:
    """A centre of mass (3,) with its standard deviations."""
    x, y, z = (with_std(float(value), float(s)) for value, s in zip(com, std, strict=True))
    return x, y, z


def processing(result: Weighing) -> dict[str, str]:
    """What was found and corrected in the log, by subject."""
    found = {}
    if result.torque_lag is not None:
        lag, std = result.torque_lag
        how = "lag" if lag > 0.0 else "lead"  # commands lead what joints do
        found["Torques"] = f"torques {how} the motion by {with_std(1e3 * abs(lag), 1e3 * std)} ms, which is allowed for"
    if result.spikes:
        found["Outliers"] = f"single wild values in {counted(result.spikes, 'sample')}, which were replaced"
    if result.impacts:
        found["Impacts"] = f"{result.impacts:.2f} s left out: impacts that the log's rate does not resolve"
    return found


def bodies_table(result: Weighing) -> TableData:
    """Mass and centre of mass of the model file's trunk, the estimated trunk, the payload, and the truth."""
    prior, payload = result.robot.inertias[result.robot.trunk], result.payload
    found = np.array([result.mass, *result.com]), np.array([result.mass_std, *result.com_std])
    rows: list[Row] = [("trunk, CAD", number(prior.mass), *_exact(prior.com))]
    rows.append(("trunk with all on it", *_cells(result, *found)))
    if payload is not None:
        found = np.array([payload.mass, *payload.com]), np.array([payload.mass_std, *payload.com_std])
        elsewhere = payload.at and f", at and in the frame of {payload.at}"
        rows.append((f"payload since the tare{elsewhere}", *_cells(result, *found)))
    if result.truth is not None:
        moment = result.truth.at(result.time)
        rows.append(("truth: trunk with all on it", number(moment.mass), *_exact(moment.com)))
        if moment.payload_com is not None:
            rows.append(("truth: payload", number(moment.payload_mass), *_exact(moment.payload_com)))
    head = ("trunk frame", "mass [kg]", "com x [m]", "com y [m]", "com z [m]")
    return TableData.of(f"Weighed by the method {result.method!r}", head, rows)


def inertia_table(result: Weighing) -> TableData | None:
    """Inertia of trunk and payload, each with its own reference point; None if neither was observed."""
    found, prior, payload = result.trunk, result.robot.inertias[result.robot.trunk], result.payload
    rows: dict[str, list[Row]] = {}
    if found.observed[4:].all():
        rows[f"trunk with all on it, frame {result.robot.trunk!r}, about the frame's origin, its axes"] = [
            ("CAD", *map(number, prior.vector[4:].tolist())),
            ("found", *_cells(result, found.inertial.vector[4:], found.inertia_std)),
        ]
    if payload is not None and payload.inertia is not None and payload.inertia_std is not None:
        tensor = payload.inertia[np.triu_indices(3)]  # in the order of `stadera.inertia.ORDER`
        about = f"payload, about its own centre of mass, axes of {payload.at or result.robot.trunk!r}"
        rows[about] = [("found", *_cells(result, tensor, payload.inertia_std))]
    return TableData.of("Inertia", ("inertia [kg·m²]", *ORDER[4:]), rows) if rows else None


def inertia_missing(result: Weighing) -> str:
    """One sentence on the inertias that were not observed; empty if all were."""
    missing = [] if result.trunk.observed[4:].all() else ["the trunk's"]
    if result.payload is not None and result.payload.inertia is None:
        missing.append("the payload's")
    if not missing:
        return ""
    kept = "; a model file that is written keeps CAD's for the trunk" if "the trunk's" in missing else ""
    return f"Inertia not observed: {' and '.join(missing)}{kept}. Turning and swaying the trunk shows it."


def tables(result: Weighing) -> list[TableData]:
    """Tables for a paper: trunk and payload, inertia where it was observed, changes of the load."""
    result = result.since_beginning()
    found = [bodies_table(result), inertia_table(result), changes_table(result) if result.changes else None]
    return [table for table in found if table is not None]


def drives_table(result: Weighing) -> TableData | None:
    """Rotor inertia, friction and offset by joint where the motion determines them; None where it determines none."""
    drives = result.drives
    if drives is None or not drives.observed.any():
        return None
    rows: list[Row] = []
    for j, joint in enumerate(drives.joints):
        std = np.where(drives.observed[j], drives.std[j], np.nan)
        rows.append((joint, *_cells(result, drives.value[j], std)))
    head = ("joint", "rotor inertia [kg·m²]", "viscous [N·m·s/rad]", "Coulomb [N·m]", "torque offset [N·m]")
    return TableData.of("Drives, as far as the motion determines them", head, rows)


def drives_text(result: Weighing) -> str:
    """How many drives the motion determines; empty if none."""
    if result.drives is None or not result.drives.observed.any():
        return ""
    rotors, _, frictions, _ = result.drives.observed.sum(axis=0).tolist()
    return (
        f"drives: rotor inertia of {rotors} and Coulomb friction of {frictions} of {len(result.drives.joints)} joints "
        "are known from the motion: in --json, which --legs takes for the next log"
    )


def changes_table(result: Weighing, most: int | None = None) -> TableData:
    """The changes of the load, the first `most` of them."""
    rows: list[Row] = []
    for c in result.changes[:most]:
        kind, mass = c.kind + (c.at and f", {c.at}"), _cells(result, np.array([c.mass]), np.array([c.mass_std]))
        rows.append((f"{c.time:.2f}", f"{c.noticed:.2f}", kind, *mass))
    return TableData.of("Changes of the load", ("about [s]", "noticed [s]", "kind", "mass [kg]"), rows, sides="rrlr")


def refusals_table(result: Weighing, most: int) -> TableData:
    """The first `most` periods that were not used, and why."""
    rows = ((f"{r.begin:.2f} to {r.end:.2f} s", r.reason) for r in result.refusals[:most])
    return TableData.of("Times not used", ("time", "because"), rows, sides="lw")


def _cells(result: Weighing, values: Array, std: Array) -> list[Cell]:
    """Values with their standard deviations, marked if the result cannot be trusted."""
    texts = map(with_std, values.tolist(), std.tolist())
    return [Cell(text) if result.is_trusted else Cell(text, good=False, note=UNTRUSTED) for text in texts]


def _exact(com: Iterable[float]) -> tuple[str, str, str]:
    x, y, z = (fixed(float(value), 4) for value in com)
    return x, y, z


def weighing_tables(result: Weighing) -> Iterator[RenderableType]:
    """Trunk and payload, changes of the load, notes, times without estimate; the answer and its trust last."""
    result = result.since_beginning()
    used = result.end - result.begin - result.refused
    span = f"estimated from {used:.1f} of {result.end - result.begin:.1f} s, as known at {result.time:.2f} s"
    yield Text(f"{result.robot.name}, {result.source}: {span}; {result.status}", style="bold")
    yield rich_table(bodies_table(result))
    if (inertia := inertia_table(result)) is not None:
        yield rich_table(inertia)
    if result.changes:
        yield rich_table(changes_table(result))
    said = (inertia_missing(result), *processing(result).values(), drives_text(result))
    yield from (Text(text, style="dim") for text in said if text)
    yield from notes(result.notes)
    longest = sorted(result.refusals, key=lambda r: r.begin - r.end)[: SHOWN.reasons]
    for refusal in sorted(longest, key=lambda r: r.begin):
        yield Text(f"not used: {refusal.begin:.2f} to {refusal.end:.2f} s: {refusal.reason}", style="yellow")
    if (more := len(result.refusals) - len(longest)) > 0:
        yield Text(f"and {counted(more, 'shorter time')}", style="yellow")
    yield from (Text(step_text(step), style="yellow") for step in result.next)
    yield Text(
        f"{headline(result)}; trust: {trust_text(result.trust)}",
        style="bold" if result.trust.verdict == "good" else STYLES[LEVELS[result.trust.verdict]],
    )


_AXES = ("place along the trunk", "place across the trunk", "height")
_SIDES = (("ahead of", "behind"), ("left of", "right of"), ("above", "below"))


def headline(result: Weighing) -> str:
    """The answer: the payload if there was a tare, else the trunk."""
    if (payload := result.payload) is not None:
        if not result.determined()["payload"]:
            most = max(payload.mass, 0.0) + 2.0 * payload.mass_std
            return f"Payload not determined: below {number(most, 2)} kg (95 %)"
        mass = with_scale(payload.mass, payload.mass_std, payload.mass_std_without_scale)
        answer = f"Payload{payload.at and f' at {payload.at}'} {mass}"
    elif result.mass == result.mass:
        mass = with_scale(result.mass, result.mass_std, result.trunk.mass_std_without_scale)
        answer = f"Trunk with all that is on it {mass}"
    else:
        answer = "The trunk's mass was not observed"
    return answer if result.is_trusted else f"{answer}, {UNTRUSTED}"


def where(result: Weighing) -> str:
    """Where the centre of mass of the payload, or without a tare of the trunk, is, one sentence."""
    body, payload = result if result.payload is None else result.payload, result.payload
    com, std = (1e3 * values for values in (body.com, body.com_std))  # mm
    seen = [k for k in range(3) if isfinite(std[k])]
    if not seen:
        return f"At {payload.at}; its centre was not observed." if payload and payload.at else "Not observed."
    lacking = [("xyz" if payload and payload.at else _AXES)[k] for k in range(3) if k not in seen]
    hidden = f"; its {listed(lacking)} {'was' if len(lacking) == 1 else 'were'} not observed" if lacking else ""
    if payload is not None and payload.at:
        along = ", ".join(f"{'xyz'[k]} {with_std(float(com[k]), float(std[k]))}" for k in seen)
        return f"At {along} mm in the frame of {payload.at}{hidden}."
    said = [f"{with_std(abs(float(com[k])), float(std[k]))} mm {_SIDES[k][int(com[k] < 0.0)]}" for k in seen]
    return f"{listed(said)} the trunk's origin{hidden}."


def how_sure(result: Weighing) -> str:
    """How well the mass is known, and what most of its error bar is, in a sentence or two."""
    payload = result.payload
    mass, std = (result.mass, result.mass_std) if payload is None else (payload.mass, payload.mass_std)
    alone = result.trunk.mass_std_without_scale if payload is None else payload.mass_std_without_scale
    if not (isfinite(std) and mass):
        return "The mass is not known."
    low, high = (max(mass + sign * 2.0 * std, 0.0) for sign in (-1.0, 1.0))
    if std > 0.5 * abs(mass):
        return f"By 95 % it is between {number(low, 2)} and {number(high, 2)} kg, which tells next to nothing."
    between = f"By 95 % it is between {number(low, 3)} and {number(high, 3)} kg"
    if not std:
        return f"Good to 0 %. {between}."
    share = (scale_of(mass, std, alone) or 0.0) ** 2 / (std / mass) ** 2
    words = "hardly any" if share < 0.2 else "part" if share < 0.8 else "all"
    of = "" if alone is None else f", {words} of it the torques' scale"
    return f"Good to {number(100.0 * std / abs(mass), 2)} %{of}. {between}."


def may_be_used(result: Weighing) -> str:
    """Whether the figures may be used, and what the verdict rests on."""
    determined = result.determined()["trunk" if result.payload is None else "payload"]
    if result.trust.verdict == "good" and not determined:
        return f"Not yet: the figures are right, and too wide to act on. {trust_reasons(result.trust)}"
    said = {"good": "Yes.", "doubtful": "With care; the bars cover no fault.", "bad": "No."}
    return f"{said[result.trust.verdict]} {trust_reasons(result.trust)}"


def step_text(step: NextStep) -> str:
    """A next step, as a sentence."""
    std = step.payload_std if isfinite(step.payload_std) else step.trunk_std
    return f"{step.do[:1].upper()}{step.do[1:]}: then ± {number(std, 2)} kg."
