"""Terminal output for a running robot: one screen updated in place, or a line for each event."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from stadera.live.state import LiveState
from stadera.report.numbers import number, with_scale, with_std
from stadera.report.table import SHOWN
from stadera.report.trust import trust_text
from stadera.types import Array

_COLOURS = {"good": "green", "doubtful": "yellow", "bad": "bold red"}
_PLACE = ("com x [m]", "com y [m]", "com z [m]")


def live_screen(state: LiveState) -> RenderableType:
    """All estimates: masses, centres of mass, trust, changes, message rates, and missing input."""
    colour = _COLOURS[state.trust.verdict]
    parts: list[RenderableType] = [_bodies(state), Text(f"trust: {trust_text(state.trust)}", style=colour)]
    parts += [Text(f"waiting for {lacking}", style="yellow") for lacking in state.waiting_for]
    if state.changes:
        parts.append(_changes(state))
    parts += [_health(state), *(Text(f"note: {note}", style="dim") for note in state.notes)]
    time = "" if state.time != state.time else f" at {state.since(state.time):.2f} s"
    return Panel(Group(*parts), title=f"{state.robot}{time}, {state.status}", title_align="left", border_style=colour)


def live_lines(state: LiveState, before: LiveState | None) -> Iterator[str]:
    """Yields a line for each difference from the previous state: missing input, trust, tare and changes."""
    at = "" if state.time != state.time else f"{state.since(state.time):.2f} s: "
    old = _Seen() if before is None else _Seen.of(before)
    new = _Seen.of(state)
    if old.waiting_for != new.waiting_for:
        yield from (f"{at}waiting for {lacking}" for lacking in new.waiting_for)
    if old.waiting_for and not new.waiting_for:
        yield f"{at}samples arrive"
    if old.verdict != new.verdict:
        yield f"{at}trust: {trust_text(state.trust)}"
    if new.tared and not old.tared:
        yield f"{at}tared"
    for change in state.changes:
        if change.noticed not in old.changes:
            mass = with_std(change.mass, change.mass_std)
            yield f"{at}load {change.kind} at {state.since(change.time):.2f} s, {mass} kg so far{_mark(state)}"


@dataclass(frozen=True)
class _Seen:
    """Parts of a state whose changes are reported."""

    waiting_for: tuple[str, ...] = ()
    verdict: str = ""
    tared: bool = False
    changes: frozenset[float] = frozenset()

    @classmethod
    def of(cls, state: LiveState) -> _Seen:
        noticed = frozenset(change.noticed for change in state.changes)
        return cls(tuple(state.waiting_for), state.trust.verdict, state.payload is not None, noticed)


def live_summary(state: LiveState) -> str:
    """Final summary in one line."""
    trunk, payload = state.trunk, state.payload
    text = f"trunk {with_scale(trunk.inertial.mass, trunk.mass_std, trunk.mass_std_without_scale)}{_mark(state)}"
    if payload is not None:
        mass = with_scale(payload.mass, payload.mass_std, payload.mass_std_without_scale)
        text += f"; payload {mass}{_mark(state)}{payload.at and f' at {payload.at}'}"
    return f"{text}; trust: {trust_text(state.trust)}"


def _mark(state: LiveState) -> str:
    return "" if state.is_trusted else " (not to be trusted)"


def _bodies(state: LiveState) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for heading in ("", "mass [kg]", *_PLACE):
        table.add_column(Text(heading), justify="left" if not heading else "right")
    trunk, payload = state.trunk, state.payload
    table.add_row(*_body("trunk", trunk.inertial.mass, trunk.mass_std, trunk.com, trunk.com_std, state))
    if payload is None:
        table.add_row("payload", "no tare yet")
    else:
        table.add_row(*_body("payload", payload.mass, payload.mass_std, payload.com, payload.com_std, state))
    return table


def _body(name: str, mass: float, mass_std: float, com: Array, com_std: Array, state: LiveState) -> Iterator[Text]:
    style = "bold" if state.is_trusted else "red strike"
    yield Text(name)
    yield Text(with_std(mass, mass_std), style=style)
    for value, std in zip(com, com_std, strict=True):
        yield Text(with_std(value, std), style=style)


def _changes(state: LiveState) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for heading in ("load", "at [s]", "noticed after [s]", "change [kg]"):
        table.add_column(Text(heading), justify="right")
    for change in reversed(state.changes[-SHOWN.changes :]):
        after = f"{change.noticed - change.time:.2f}"
        mass = with_std(change.mass, change.mass_std) + _mark(state)
        table.add_row(change.kind, f"{state.since(change.time):.2f}", after, mass)
    return table


def _health(state: LiveState) -> Text:
    rates = ", ".join(f"{topic} {rate:.0f} Hz" for topic, rate in state.rates.items()) or "no messages"
    lost = ", ".join(f"{count} {where}" for where, count in state.lost.items() if count) or "none"
    lag = f"; lag {number(1e3 * state.lag.processing, 2)} ms" if isfinite(state.lag.processing) else ""
    spikes = f"; outliers replaced: {state.spikes}" if state.spikes else ""
    impacts = f"; left out for impacts: {state.impacts:.2f} s" if state.impacts else ""
    return Text(f"{rates}; lost: {lost}{spikes}{impacts}{lag}", style="dim")
