"""`stadera weigh`: mass and centre of mass of a robot's trunk and of its payload."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from stadera.cli import options as opt
from stadera.cli import parse
from stadera.cli.options import argument, grouped, option
from stadera.cli.outputs import ResultFiles
from stadera.cli.terminal import progress, show
from stadera.files import write_text
from stadera.results import json_text

if TYPE_CHECKING:
    from stadera.limits import Limits
    from stadera.robot import Robot
    from stadera.trunk.memory import Memory
    from stadera.weigh.settings import Watch


@grouped
def weigh(
    log: Annotated[Path, argument("LOG", "Log of a robot on its feet, walking or standing.")],
    robot: opt.RobotOfLog = None,
    method: opt.Method = None,
    tare: opt.Tare = None,
    weight: opt.Weight = None,
    known: opt.Known = None,
    memory: opt.MemoryFile = None,
    at: opt.At = None,
    stiffness: opt.Stiffness = None,
    legs: opt.LegsFile = None,
    force: opt.Force = False,
    imu_frame: opt.ImuFrame = None,
    truth: Annotated[
        Path | None, option("F.truth.json", "Ground truth of a simulated log, shown with the result.")
    ] = None,
    export: Annotated[
        Path | None, option("F.urdf", "Write the weighed model (URDF, MJCF), with the payload as a link.")
    ] = None,
    view: opt.View = False,
    rrd: opt.RrdFile = None,
    *,
    options: opt.LogOptions,
    files: ResultFiles,
) -> None:
    """Weigh a robot from its log: trunk with payload, centre of mass, and changes of the load.

    In motion every instant is used, standing included. At rest the mass follows from the upward contact force (eq. 7),
    and times in motion are ignored. --tare gives the payload as the difference, and where it is: on the trunk, or at
    the end of a limb. A result on which model and log
    contradict each other is refused (exit code 1) unless --force is given.
    """
    springs = None if stiffness is None else parse.point(stiffness)
    chosen_tare = None if tare is None else parse.tare(tare)
    on_scale = None if weight is None else parse.weight(weight)
    test = None if known is None else parse.known(known)

    from stadera.lab.truth import read_truth
    from stadera.report.weigh.tables import weighing_tables
    from stadera.weigh.settings import check_choice
    from stadera.weigh.weigh import weigh as weigh_log

    check_choice(method, springs)
    model = robot_with_legs(options.robot(robot, log), legs, options.reading.limits, force)
    files.check(export, memory)
    if export is not None:
        from stadera.robot.export import check_export

        check_export(model, export)
    remembered = None if memory is None else read_memory(memory, model)
    true = None if truth is None else read_truth(truth)
    with watching(model, view, rrd) as watch, progress() as bar:
        unloaded = options.log(chosen_tare) if isinstance(chosen_tare, Path) else chosen_tare
        result = weigh_log(
            model,
            options.log(log),
            unloaded,
            method,
            imu_frame=imu_frame,
            stiffness=springs,
            force=force,
            fix=options.fix,
            progress=bar,
            watch=watch,
            weight=on_scale,
            known=test,
            memory=remembered,
            at=at,
        )
    files.write(
        (export, result.save_urdf),
        (memory if result.memory else None, lambda draft: save_memory(result.memory, draft)),
        values=result.to_dict,
        page=lambda: result.to_html(true),
        latex=result.to_latex,
        figures=lambda: result.to_figures(true),
    )
    since = None if true is None else true.since(result.begin)
    show(*weighing_tables(result.since_beginning(), since))


def read_memory(path: Path, robot: Robot) -> Memory:
    """The memory in a file, a new one if there is no such file. Raises IdentificationError: it holds none of the
    robot's.
    """
    from stadera.errors import IdentificationError
    from stadera.trunk.memory import Memory

    if not path.exists():
        return Memory.none(robot)
    try:
        return Memory.from_dict(json.loads(path.read_text(encoding="utf-8"))).check(robot)
    except (ValueError, IdentificationError) as error:
        raise IdentificationError(f"--memory {path}: {error}") from None


def save_memory(memory: Memory | None, path: Path) -> None:
    """Writes it, if there is one."""
    if memory is not None:
        write_text(path, json_text(memory.to_dict()))


def robot_with_legs(name: str, legs: Path | None, limits: Limits, force: bool = False) -> Robot:
    """Loads the robot, with identified legs if given; with `force` also if these are not to be trusted."""
    from stadera.robot import load_robot

    robot = load_robot(name, limits)
    if legs is None:
        return robot
    from stadera.identify.schema import with_identified_legs

    return with_identified_legs(robot, legs, force)


@contextmanager
def watching(robot: Robot, view: bool, save: Path | None) -> Iterator[Watch | None]:
    """Yields a viewer's `watch`, None if none was requested; the file is complete when the block ends without an
    error.
    """
    if not view and save is None:
        yield None
        return
    from stadera.files import written_together
    from stadera.live.view import Viewer

    with (
        written_together([] if save is None else [save]) as drafts,
        Viewer(robot, spawn=view, save=drafts[0] if drafts else None) as viewer,
    ):
        yield viewer.watch
