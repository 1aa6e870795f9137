"""Terminal output for a running robot: one screen updated in place, or a line for each event."""

from collections.abc import Iterator
from math import isfinite

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from stadera.live.state import BODY, LiveState
from stadera.report.numbers import number, with_scale, with_std
from stadera.report.table import SHOWN
from stadera.report.trust import trust_text

_COLOURS = {"good": "green", "doubtful": "yellow", "bad": "bold red"}


def live_screen(state: LiveState, below: str = "") -> RenderableType:
    """All estimates: masses, centres of mass, trust, changes, message rates, and missing input; `below` them a line."""
    colour = _COLOURS[state.trust.verdict]
    parts: list[RenderableType] = [_bodies(state), Text(f"trust: {trust_text(state.trust)}", style=colour)]
    parts += [Text(f"waiting for {lacking}", style="yellow") for lacking in state.waiting_for]
    if state.changes:
        parts.append(_changes(state))
    parts += [_health(state), *(Text(f"note: {note}", style="dim") for note in state.notes)]
    time = "" if state.time != state.time else f" at {state.since(state.time):.2f} s"
    return Panel(
        Group(*parts),
        title=f"{state.robot}{time}, {state.status}",
        title_align="left",
        border_style=colour,
        subtitle=below or None,
        subtitle_align="left",
    )


def live_lines(state: LiveState, before: LiveState | None) -> Iterator[str]:
    """Yields a line for each difference from the previous state: missing input, trust, tare and changes."""
    at = "" if state.time != state.time else f"{state.since(state.time):.2f} s: "
    waited = () if before is None else before.waiting_for
    if tuple(waited) != tuple(state.waiting_for):
        yield from (f"{at}waiting for {lacking}" for lacking in state.waiting_for)
    if waited and not state.waiting_for:
        yield f"{at}samples arrive"
    if before is None or before.trust.verdict != state.trust.verdict:
        yield f"{at}trust: {trust_text(state.trust)}"
    if state.payload is not None and (before is None or before.payload is None):
        yield f"{state.since(state.tared_at):.2f} s: tared"
    known = {change.noticed for change in (before.changes if before else ())}
    for change in state.changes:
        if change.noticed not in known:
            mass = with_std(change.mass, change.mass_std)
            yield f"{at}load {change.kind} at {state.since(change.time):.2f} s, {mass} kg so far{state.mark}"


def live_summary(state: LiveState) -> str:
    """Final summary in one line."""
    trunk, payload = state.trunk, state.payload
    text = f"trunk {with_scale(trunk.inertial.mass, trunk.mass_std, trunk.mass_std_without_scale)}{state.mark}"
    if payload is not None:
        mass = with_scale(payload.mass, payload.mass_std, payload.mass_std_without_scale)
        text += f"; payload {mass}{state.mark}{payload.at and f' at {payload.at}'}"
    lost = _lost(state)
    return f"{text}; trust: {trust_text(state.trust)}{lost and f'; lost messages: {lost}'}"


def _table(*head: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for heading in head:
        table.add_column(Text(heading), justify="right" if heading else "left")
    return table


def _bodies(state: LiveState) -> Table:
    table, style = _table("", *BODY), "bold" if state.is_trusted else "red strike"
    for name, texts in state.bodies().items():
        table.add_row(Text(name), *(Text(text, style=style) for text in texts))
    if state.payload is None:
        table.add_row("payload", "no tare yet")
    return table


def _changes(state: LiveState) -> Table:
    table = _table("load", "at [s]", "noticed after [s]", "change [kg]")
    for change in reversed(state.changes[-SHOWN.changes :]):
        after = f"{change.noticed - change.time:.2f}"
        mass = with_std(change.mass, change.mass_std) + state.mark
        table.add_row(change.kind, f"{state.since(change.time):.2f}", after, mass)
    return table


def _health(state: LiveState) -> Text:
    rates = ", ".join(f"{topic} {rate:.0f} Hz" for topic, rate in state.rates.items()) or "no messages"
    lost = _lost(state) or "none"
    lag = f"; lag {number(1e3 * state.lag[0], 2)} ms" if isfinite(state.lag[0]) else ""
    spikes = f"; outliers replaced: {state.spikes}" if state.spikes else ""
    impacts = f"; left out for impacts: {state.impacts:.2f} s" if state.impacts else ""
    return Text(f"{rates}; lost: {lost}{spikes}{impacts}{lag}", style="dim")


def _lost(state: LiveState) -> str:
    """Numbers of lost messages by reason; empty if none was lost."""
    return ", ".join(f"{count} {where}" for where, count in state.lost.items() if count)
