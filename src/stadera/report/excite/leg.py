"""Report of an excitation of a leg: tables, figures, terminal and page."""

from collections.abc import Iterator

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from stadera.excite.design import Excitation
from stadera.report.figures import Axis, Figure, Guide, Panel, Series, line
from stadera.report.numbers import number
from stadera.report.table import TableData, notes, rich_table


def limits_table(result: Excitation) -> TableData:
    """Extremes of each joint's motion, and its bounds with margins subtracted."""
    bounds = result.experiment.bounds
    rows = (
        (
            joint,
            f"{number(low, 3)} to {number(high, 3)} of {number(bounds.lower[k], 3)} to {number(bounds.upper[k], 3)}",
            f"{number(velocity, 3)} of {number(bounds.velocity[k], 3, 'no limit')}",
            number(acceleration, 3),
            f"{number(torque, 3)} of {number(bounds.effort[k], 3, 'no limit')}",
        )
        for k, (joint, low, high, velocity, acceleration, torque) in enumerate(
            zip(bounds.joints, *result.extremes.values(), strict=True)
        )
    )
    head = ("joint", "position [rad]", "velocity [rad/s]", "acceleration [rad/s²]", "torque [N·m]")
    return TableData.of(f"{bounds.leg}: extremes, of what is allowed", head, rows)


def worth_table(result: Excitation) -> TableData:
    """Information and rank of the motion and of the random draws, one row for each."""
    rows = (
        (
            name,
            f"{a.gain:.1f}",
            str(a.rank),
            str(a.rigid_rank),
            number(100.0 * float(np.median(a.std)), 2),
            number(100.0 * float(a.std.max()), 2),
        )
        for name, a in result.motions.items()
    )
    head = (
        "motion",
        "information gain [nat]",
        f"combinations known, of {len(result.combinations)}",
        f"of links, joint terms given, of {result.rigid_rank}",
        "median std [% of prior's]",
        "worst std [% of prior's]",
    )
    return TableData.of("Expected information in a log of this motion", head, rows)


def verdict(result: Excitation) -> str:
    """One sentence on how much better the motion is than the paper's random draws."""
    if result.gained is None or result.ratios is None:
        return "This is a random draw; the optimised motion was not asked for."
    worse = int(np.sum(result.ratios < 1.0))
    tail = f", {worse} of {len(result.ratios)} known less well" if worse else ""
    return (
        f"Against the median of {len(result.draws)} random draws: {result.gained:+.1f} nat of information; standard "
        f"deviations {result.median_ratio:.1f} times smaller in the median, {result.ratios.max():.1f} at best{tail}."
    )


def tables(result: Excitation) -> list[TableData]:
    """Extremes of the motion, and its expected information."""
    return [limits_table(result), worth_table(result)]


def figures(result: Excitation) -> dict[str, Figure]:
    """All figures by name."""
    return {"information": std_figure(result), "motion": motion_figure(result)}


def std_figure(result: Excitation) -> Figure:
    """Standard deviation of each identifiable combination as a share of the prior's, for the motion and the draws."""
    names = tuple(str(combination).replace(" - ", " − ") for combination in result.combinations)
    at, marks = np.arange(float(len(names))), []
    if result.draws:
        spread = 100.0 * np.array([draw.std for draw in result.draws])
        name = f"random draws, median and range of {len(result.draws)}"
        ends = spread.min(axis=0), spread.max(axis=0)
        marks.append(Series(np.median(spread, axis=0), at, name, "steel", 0.0, marker="diamond", x_range=ends))
    name = "optimised" if result.draws else "random draw"
    marks.append(Series(100.0 * result.chosen.std, at, name, "blue", 0.0, marker="dot", size=10.0))
    x = Axis("standard deviation, share of the prior's [%]", log=True)
    nothing = Guide(100.0, colour="red", name="the log adds nothing")
    panel = Panel(x, Axis(labels=names), tuple(marks), (nothing,))
    return Figure("Standard deviation of each identifiable combination of parameters", ((panel,),))


def motion_figure(result: Excitation, shown: float = 30.0, rate: float = 100.0) -> Figure:
    """Position, velocity and predicted torque of the joints over the first `shown` [s] at `rate` [Hz], with bounds."""
    bounds = result.experiment.bounds
    sampled = result.chosen.motion.sample(rate)
    until = sampled.time <= shown
    quantities = (
        ("position [rad]", sampled.position, bounds.lower, bounds.upper),
        ("velocity [rad/s]", sampled.velocity, -bounds.velocity, bounds.velocity),
        ("torque [N·m]", bounds.torque(sampled), -bounds.effort, bounds.effort),
    )
    rows = []
    for r, (label, values, low, high) in enumerate(quantities):
        panels = []
        for k, joint in enumerate(bounds.joints):
            near = 3.0 * np.abs(values[:, k]).max()
            ends = [b for b in (low[k], high[k]) if np.isfinite(b) and (r == 0 or abs(b) < near)]
            guides = tuple(Guide(float(b), of="y", colour="red", name="limit") for b in ends)
            curve = line(sampled.time[until], values[until, k], "", width=1.3)
            panels.append(
                Panel(Axis("time [s]" if r == 2 else ""), Axis(label), (curve,), guides, joint if r == 0 else "")
            )
        rows.append(tuple(panels))
    return Figure("The motion of the joints", tuple(rows), row_height=210.0)


def excitation_tables(result: Excitation) -> Iterator[RenderableType]:
    """The motion's extremes by joint, its expected information, and the comparison with random draws."""
    yield from map(rich_table, tables(result))
    yield from notes(result.experiment.bounds.clearance.notes)
    yield Text(verdict(result))


def html(result: Excitation) -> str:
    """The complete, self-contained page."""
    from stadera.report.page import render

    bounds, settings = result.experiment.bounds, result.settings
    shown, median = min(30.0, settings.duration), number(100.0 * float(np.median(result.chosen.std)), 2)
    return render(
        "excite.html.j2",
        title=f"Excitation: {bounds.robot.name} {bounds.leg}",
        headline=f"{settings.duration:g} s of this motion of {bounds.leg} determine {result.chosen.rank} of "
        f"{len(result.combinations)} combinations of its parameters better than CAD does.",
        level="note",
        word="Within the limits",
        why=verdict(result),
        next=_next_steps(result),
        cards=[
            {"label": "Information gain", "figure": f"{result.chosen.gain:.1f}", "unit": "nat"},
            {"label": "Combinations known", "figure": result.chosen.rank, "unit": f"of {len(result.combinations)}"},
            {"label": "Standard deviation, median", "figure": median, "unit": "% of the prior's"},
        ],
        worth=worth_table(result),
        stds=std_figure(result),
        limits=limits_table(result),
        seconds=shown,
        motion=motion_figure(result, shown),
        facts=_facts(result),
        notes=bounds.clearance.notes,
    )


def _next_steps(result: Excitation) -> tuple[str, ...]:
    robot, leg = result.experiment.bounds.robot.argument, result.experiment.bounds.leg
    play = f"`stadera excite --robot {robot} --leg {leg} --out motion.csv`"
    optimum = ("Leave `--random` out for the optimum of the same length.",) if result.settings.random else ()
    return (
        *optimum,
        f"Write the table that a controller plays, {play}, first slowly, with the trunk on a stand and the leg free.",
        f"Record joint positions and torques, and identify: `stadera identify LOG --robot {robot} --legs {leg}`.",
    )


def _facts(result: Excitation) -> dict[str, str]:
    settings, height = result.settings, result.settings.stand_height
    distance = result.least_distance
    near = f"{number(distance, 2)} m" if distance < 0.1 else "0.1 m or more"
    noise = ", ".join(number(value, 3) for value in result.experiment.noise.tolist())
    return {
        "Robot": result.experiment.bounds.robot.name,
        "Leg": f"{result.experiment.bounds.leg}, trunk held level",
        "Motion": "the paper's random draw" if settings.random else "Fourier series, optimised",
        "Duration": f"{settings.duration:g} s, from rest to rest",
        "Table": f"{settings.rate:g} Hz",
        "Torque noise": f"{noise} N·m for one sample",
        "Ground": "not given" if height is None else f"{height:g} m below the trunk's origin",
        "Least distance": near if np.isfinite(distance) else "the model has no shapes",
        "Seed": str(settings.seed),
    }
