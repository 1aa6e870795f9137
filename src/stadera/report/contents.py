"""What is in a robot model or a log, as rich renderables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from stadera.report.numbers import number
from stadera.report.terminal import titled_table

if TYPE_CHECKING:
    from stadera.recording.summary import LogSummary
    from stadera.robot.model import JointDynamics, JointLimits, Robot
    from stadera.weigh.diagnosis import Finding

_MOST_GAPS = 5


def robot_contents(robot: Robot) -> Iterator[RenderableType]:
    """A robot's links with their masses, its joints with their limits, and what the loader had to assume."""
    yield Text(f"{robot.name}: {number(robot.mass)} kg, from {robot.source or 'memory'}", style="bold")
    yield _link_table(robot)
    yield _joint_table(robot)
    yield from (Text(f"note: {note}", style="dim") for note in robot.notes)


def _link_table(robot: Robot) -> Table:
    headings = ("leg", "link", "mass [kg]", "com x [m]", "com y [m]", "com z [m]", "possible")
    table = titled_table("Links (CAD)", headings, "llrrrrl")
    owners = [("trunk", (robot.trunk,)), *((leg.name, leg.links) for leg in robot.legs)]
    for owner, links in owners:
        for k, link in enumerate(links):
            body = robot.inertias[link]
            possible = Text("yes") if body.is_physical() else Text("NO", "bold red")
            values = (number(value) for value in (body.mass, *body.com.tolist()))
            table.add_row(owner if k == 0 else "", Text(link), *values, possible)
        table.add_section()
    return table


def _joint_table(robot: Robot) -> Table:
    figures = ("position [rad]", "velocity [rad/s]", "torque [N·m]", "rotor inertia [kg·m²]")
    table = titled_table("Joints", ("leg", "joint", *figures, "foot"), "llrrrrl")
    for leg in robot.legs:
        for k, joint in enumerate(leg.joints):
            foot = f"{leg.foot}, radius {number(leg.foot_radius, 3)} m" if k == 2 else ""
            values = _limits(robot.limits[joint], robot.dynamics[joint])
            table.add_row(leg.name if k == 0 else "", Text(joint), *values, Text(foot))
        table.add_section()
    return table


def _limits(limits: JointLimits, dynamics: JointDynamics) -> list[str]:
    span = f"{_bound(limits.lower)} to {_bound(limits.upper)}"
    return [span, _bound(limits.velocity), _bound(limits.effort), number(dynamics.armature, 3)]


def _bound(value: float) -> str:
    return number(value, 3) if isfinite(value) else "none"


def log_contents(
    summary: LogSummary, fits: Sequence[str], findings: Sequence[Finding] | None = None
) -> Iterator[RenderableType]:
    """A log's duration, rate, gaps and signals, the robots it fits, and what is wrong with it where looked for."""
    yield Text(f"{summary.source}: {summary.duration:.3f} s, {summary.samples} samples", style="bold")
    facts = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    facts.add_row("time", f"{summary.start:.3f} to {summary.end:.3f} s")
    facts.add_row(
        "rate", f"{1.0 / summary.period:.6g} Hz, {100.0 * summary.uneven:.2g} % of the steps off by over 10 %"
    )
    facts.add_row("gaps", _gaps(summary))
    facts.add_row("joints", Text(f"{len(summary.joints)}, with {', '.join(summary.channels)}"))
    frame = f", in frame {summary.imu_frame}" if summary.imu_frame else ""
    facts.add_row("imu", Text(f"yes{frame}" if summary.has_imu else "no"))
    facts.add_row("feet", Text(", ".join(summary.feet) or "none"))
    facts.add_row("fits", Text(", ".join(fits) or "no robot known by name"))
    yield facts
    table = titled_table("Ranges", ("column", "least", "largest", "unit"), "lrrl")
    for signal in summary.ranges:
        table.add_row(Text(signal.name), number(signal.low), number(signal.high), signal.unit)
    yield table
    yield from (Text(f"note: {note}", style="dim") for note in summary.notes)
    if findings is not None:
        yield from (Text(f"{f.cause.replace('_', ' ')}: {f.message}", style="bold red") for f in findings)
        if not findings:
            yield Text("nothing wrong was found")


def _gaps(summary: LogSummary) -> str:
    if not summary.gap_count:
        return "none"
    shown = ", ".join(f"{length:.3f} s at {start:.3f} s" for start, length in summary.gaps[:_MOST_GAPS])
    more = summary.gap_count - _MOST_GAPS
    return f"{summary.gap_count}: {shown}" + (f" and {more} more" if more > 0 else "")
