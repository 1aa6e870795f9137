"""Terminal output of a robot model's or a log's content."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.errors import listed
from stadera.logs.columns import CHANNELS
from stadera.report.numbers import number
from stadera.report.table import SHOWN, Cell, Row, TableData, notes, rich_table

if TYPE_CHECKING:
    from stadera.logs.summary import LogSummary
    from stadera.robot.model import Robot
    from stadera.robot.values import Difference
    from stadera.weigh.weigh import Inspection


def robot_contents(robot: Robot) -> Iterator[RenderableType]:
    """A robot's links with their masses, its joints with their limits, and the loader's assumptions."""
    yield Text(f"{robot.name}: {number(robot.mass)} kg, from {robot.source or 'memory'}", style="bold")
    owners = {"trunk": (robot.trunk,), **{leg.name: leg.links for leg in robot.legs}}
    rows = {owner: [_link_row(robot, link) for link in links] for owner, links in owners.items()}
    head = ("link", "mass [kg]", "com x [m]", "com y [m]", "com z [m]", "possible")
    yield rich_table(TableData.of("Links (CAD)", head, rows, sides="lrrrrl"))
    yield rich_table(_joint_table(robot))
    yield from notes((*robot.notes, *_with_fixed(robot, robot.frames)))


def comparison(first: Robot, second: Robot, found: Sequence[Difference]) -> Iterator[RenderableType]:
    """The masses of two models, and each value in which they differ."""
    names = _apart(first, second)
    masses = (f"{name}: {number(robot.mass, 6)} kg" for name, robot in zip(names, (first, second), strict=True))
    yield Text("; ".join(masses), style="bold")
    if not found:
        yield Text("The same in every mass, centre, inertia, place, drive and limit, in feet and IMU.")
        return
    rows = [(d.of, d.value, *("none" if v is None else number(v, 6) for v in (d.first, d.second))) for d in found]
    yield rich_table(TableData.of("Differences", ("of", "value", *names), rows, sides="llrr"))
    for name, robot, other in zip(names, (first, second), (second, first), strict=True):
        own = [frame for frame in robot.frames if frame not in other.frames]
        yield from notes(f"{name}: {text}" for text in _with_fixed(robot, own))


def _apart(first: Robot, second: Robot) -> tuple[str, str]:
    """The robots' names, or their files' if they are of one name."""
    if first.name != second.name or first.source is None or second.source is None:
        return first.name, second.name
    files = first.source.name, second.source.name
    return files if files[0] != files[1] else (str(first.source), str(second.source))


def _with_fixed(robot: Robot, frames: Iterable[str]) -> Iterator[str]:
    """A note on those of these frames that are fixed to the trunk, whose masses are in the trunk's."""
    fixed = [name for name in frames if robot.frames[name].link == robot.trunk != name]
    if fixed:
        yield f"mass, centre and inertia of {robot.trunk} are with what is fixed to it: {listed(fixed, 8)}"


def _link_row(robot: Robot, link: str) -> list[str | Cell]:
    body = robot.inertias[link]
    possible = "yes" if body.is_physical() else Cell("NO", good=False)
    return [link, *(number(round(value, 9)) for value in (body.mass, *body.com.tolist())), possible]


def _joint_table(robot: Robot) -> TableData:
    head = ("joint", "position [rad]", "velocity [rad/s]", "torque [N·m]", "rotor inertia [kg·m²]", "foot")
    rows: dict[str, list[Row]] = {}
    for leg in robot.legs:
        foot = f"{leg.foot}, flat" if leg.contact == 6 else f"{leg.foot}, radius {number(leg.foot_radius, 3)} m"
        feet = (*[""] * (len(leg.joints) - 1), foot)
        rows[leg.name] = []
        for joint, foot in zip(leg.joints, feet, strict=True):
            limits, armature = robot.limits[joint], robot.dynamics[joint].armature
            span = f"{number(limits.lower, 3)} to {number(limits.upper, 3)}"
            sizes = (number(value, 3) for value in (limits.velocity, limits.effort, armature))
            rows[leg.name].append((joint, span, *sizes, foot))
    return TableData.of("Joints", head, rows, sides="lrrrrl")


def log_contents(
    summary: LogSummary, fits: Sequence[str], inspection: Inspection | None = None
) -> Iterator[RenderableType]:
    """A log's duration, rate, gaps and signals, matching robots, and faults if they were checked."""
    duration = summary.end - summary.head.time[0]
    yield Text(f"{summary.head.source}: {duration:.3f} s, {summary.samples} samples", style="bold")
    yield _facts(summary, fits)
    ranges = ((name, number(low), number(high), unit) for name, low, high, unit in summary.ranges)
    yield rich_table(TableData.of("Ranges", ("column", "least", "largest", "unit"), ranges, sides="lrrl"))
    yield from notes(summary.notes)
    if inspection is not None:
        yield from notes(inspection.notes)
        yield from _verdict(inspection, float(summary.head.time[0]))


def _verdict(inspection: Inspection, begin: float) -> Iterator[Text]:
    yield from (Text(f"{f.cause.replace('_', ' ')}: {f.said(begin)}", style="bold red") for f in inspection.findings)
    trust = inspection.trust
    if inspection.refusal and not any(f.message in inspection.refusal for f in inspection.findings):
        yield Text(f"weigh refuses it: {inspection.refusal}", style="bold red")
    if trust is not None and trust.verdict != "good":
        yield from (Text(f"weighed, but {trust.verdict}: {reason}", style="bold red") for reason in trust.reasons)
    if inspection.sound:
        yield Text("nothing wrong was found")


def _facts(summary: LogSummary, fits: Sequence[str]) -> Table:
    head = summary.head
    frame = f", in frame {head.imu.frame}" if head.imu is not None and head.imu.frame else ""
    channels = ", ".join(name for name in CHANNELS if getattr(head, name) is not None)
    shown = ", ".join(f"{length:.3f} s at {start:.3f} s" for start, length in summary.gaps[: SHOWN.gaps])
    left = f" and {summary.gap_count - SHOWN.gaps} more" if summary.gap_count > SHOWN.gaps else ""
    named = {
        "time": f"{head.time[0]:.3f} to {summary.end:.3f} s",
        "rate": f"{1.0 / summary.period:.6g} Hz, {100.0 * summary.uneven:.2g} % of the steps off by over 10 %",
        "gaps": f"{summary.gap_count}: {shown}{left}" if summary.gap_count else "none",
        "joints": f"{len(head.joints)}, with {channels}",
        "imu": f"yes{frame}" if head.imu is not None else "no",
        "feet": ", ".join(dict.fromkeys((*head.foot_force, *head.foot_contact))) or "none",
        "fits": ", ".join(fits) or "no robot known by name",
    }
    drawn = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, value in named.items():
        drawn.add_row(name, Text(value))
    return drawn
