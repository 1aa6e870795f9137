"""`stadera inspect`: shows the content of a robot model or a log."""

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from stadera.cli.options import LogOptions, ModelOptions, argument, grouped, limits_of, option, refuse
from stadera.cli.outputs import GatedCommand
from stadera.cli.terminal import progress, show
from stadera.errors import ModelError, StaderaError, UntrustedError
from stadera.report.numbers import counted

if TYPE_CHECKING:
    from stadera.limits import Limits
    from stadera.logs import LogFile
    from stadera.logs.topics import ReadOptions
    from stadera.robot import Robot


TEMPLATE = "-"
"""Value of `--columns` if none is given: write a map of the columns."""


class ColumnsMayStandAlone(GatedCommand):
    """A command whose option `--columns` needs no value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Replaces `--columns` without a value by `--columns -`."""
        given: list[str] = []
        for word, follower in zip(args, [*args[1:], "--"], strict=True):
            given += [word, TEMPLATE] if word == "--columns" and follower.startswith("-") else [word]
        return super().parse_args(ctx, given)


@grouped
def inspect(
    target: Annotated[str, argument("LOG|ROBOT", "A log, a robot's name, or a URDF or MJCF.")],
    other: Annotated[str | None, argument("[ROBOT]", "Another model, to compare the first with.")] = None,
    robot: Annotated[
        str | None, option("R", "Check the log against this robot, standing or walking.", "--robot")
    ] = None,
    *,
    options: LogOptions,
    shape: ModelOptions,
) -> None:
    """Show the content of a log or a robot model.

    For a robot: legs, links with masses, joints with limits, assumptions of the loader. For a log: joints, duration,
    rate, gaps, ranges, and matching robots; with --robot, faults found in it, and whether `weigh` would accept it.
    For two robots: where their masses, drives and limits differ; exit code 1 if they do.
    `--columns` without a value writes a map of a table's columns, filled in as far as they are recognised.
    """
    if options.columns == TEMPLATE:
        from stadera.logs.foreign.template import template

        reading = LogOptions(units=options.units, limit=options.limit).reading
        if robot is not None:
            reading = _named(reading, shape.load(robot, limits_of(options.limit)))
        print(template(Path(target), reading), end="")
        return
    given = {f"--{one.name.replace('_', '-')}": getattr(options, one.name) for one in fields(options)}
    of_model = other is not None or _is_robot(target)
    if of_model:
        refuse("is for a log", {"--robot": robot, **given, "--limit": None})
    elif robot is None:
        refuse("needs --robot", {"--fix": options.fix})
    if other is not None:
        _compare(target, other, limits_of(options.limit), shape)
        return
    if of_model:
        from stadera.report.inspect import robot_contents

        show(*robot_contents(shape.load(target, limits_of(options.limit))))
        return
    from stadera.logs.reader import stream
    from stadera.logs.summary import summarize
    from stadera.report.inspect import log_contents

    log = options.log(Path(target))
    if robot is None:
        summary = summarize(stream(log))
        show(*log_contents(summary, _fitting(summary.head.joints, log)))
        return
    from stadera.weigh.weigh import inspected

    model = shape.load(robot, limits_of(options.limit))
    summary = summarize(stream(replace(log, reading=_named(log.reading, model))))
    with progress() as watch:
        found = inspected(model, log, fix=options.fix, progress=watch)
    show(*log_contents(summary, [model.name], found))


def _named(reading: "ReadOptions", robot: "Robot") -> "ReadOptions":
    """The same, by which columns that name the robot's joints are known."""
    return replace(reading, others=robot.tree.joints)


def _compare(first: str, second: str, limits: "Limits", shape: ModelOptions) -> None:
    from stadera.report.inspect import comparison
    from stadera.robot.values import differences

    for target in (first, second):
        if not _is_robot(target):
            raise ModelError(f"{target}: a log; two robots' models are compared")
    one, other = (shape.load(target, limits) for target in (first, second))
    found = list(differences(one, other))
    show(*comparison(one, other, found))
    if found:
        raise UntrustedError(f"{first} and {second} differ in {counted(len(found), 'value')}")


def _is_robot(target: str) -> bool:
    """True for a robot's name or an XML file; other files are logs. Raises StaderaError: neither a name nor a file."""
    from stadera.logs.topics import EXAMPLES
    from stadera.robot.catalog import CATALOG

    if target.lower() in CATALOG:
        return True
    path = Path(target)
    if not path.exists() and target not in EXAMPLES:
        raise StaderaError(
            f"{target}: neither a file nor a robot's name; robots: {', '.join(CATALOG)}; "
            f"logs that come with stadera: {', '.join(EXAMPLES)}"
        )
    if path.suffix.lower() in (".urdf", ".xml", ".mjcf", ".xacro"):
        return True
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(64).lstrip().startswith(b"<")


def _fitting(joints: tuple[str, ...], log: "LogFile") -> list[str]:
    """Robots known by name that the log fits, with its legs where they are not all. Those that the log's feet carry
    come first, since robots of one family have joints of the same names.
    """
    from stadera.checks.other_robot import carriers
    from stadera.logs.reader import read_head
    from stadera.robot import load_robot
    from stadera.robot.load import fitting

    with progress() as watch:
        found = fitting(joints, watch)
    head = read_head(log, joints)
    near = carriers(head, (load_robot(name) for name, legs in found.items() if len(legs) == 4))
    if not near:
        return [name if len(legs) == 4 else f"{name} ({', '.join(legs)})" for name, legs in found.items()]
    others = [name for name in found if name not in [robot.name for robot, _ in near]]
    said = [f"{robot.name} (its feet carry {kg:.3g} kg, it has {robot.mass:.3g})" for robot, kg in near]
    return said + ([f"by the joints' names alone {', '.join(others)}"] if others else [])
