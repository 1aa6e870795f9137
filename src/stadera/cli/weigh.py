"""`stadera weigh`: mass and centre of mass of a robot's trunk and of its payload; `compare`: by several methods."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from stadera.cli import options as opt
from stadera.cli import parse
from stadera.cli.options import ModelOptions, RobotOptions, argument, grouped, option, remembered
from stadera.cli.outputs import ResultFiles, write_outputs
from stadera.cli.terminal import progress, show
from stadera.errors import IdentificationError


@grouped
def weigh(
    log: Annotated[Path, argument("LOG", "Log of a robot on its feet, walking or standing.")],
    robot: opt.RobotOfLog = None,
    method: opt.Method = None,
    tare: opt.Tare = None,
    known: Annotated[
        str | None, option("KG@X,Y,Z", "The payload, if it is a test weight [kg, m]: it calibrates the torques.")
    ] = None,
    stiffness: opt.Stiffness = None,
    truth: Annotated[
        Path | None, option("F.truth.json", "Ground truth of a simulated log, shown with the result.")
    ] = None,
    export: Annotated[
        Path | None, option("F.urdf", "Write the weighed model (URDF, MJCF), with the payload as a link.")
    ] = None,
    *,
    weighed: RobotOptions,
    options: opt.LogOptions,
    files: ResultFiles,
) -> None:
    """Weigh a robot from its log: trunk with payload, centre of mass, and changes of the load.

    In motion every instant is used, standing included. At rest the mass follows from the upward contact force (eq. 7),
    and times in motion are ignored. --tare gives the payload as the difference, and where it is: on the trunk, or at
    the end of a limb. A result on which model and log contradict each other is refused (exit code 1) unless --force is
    given.
    """
    springs = None if stiffness is None else parse.point(stiffness)
    unloaded = options.tare(tare)
    on_scale = weighed.on_scale
    test = None if known is None else parse.known(known)

    from stadera.lab.truth import read_truth
    from stadera.report.weigh.tables import weighing_tables
    from stadera.robot.export import check_export
    from stadera.weigh.settings import check_choice
    from stadera.weigh.weigh import weigh as weigh_log

    check_choice(method, springs)
    model = weighed.model(options.robot(robot, log), options.reading.limits)
    files.check(export, weighed.memory)
    if export is not None:
        check_export(model, export)
    memory = remembered(weighed.memory, model)
    true = None if truth is None else read_truth(truth)
    with weighed.watching(model) as watch, progress() as bar:
        result = weigh_log(
            model, options.log(log), unloaded, method, imu_frame=weighed.imu_frame, stiffness=springs,
            force=weighed.force, fix=options.fix, progress=bar, watch=watch, weight=on_scale, known=test,
            memory=memory, at=weighed.at,
        )  # fmt: skip
    result = replace(result, truth=true)
    kept = [] if result.memory is None else [(weighed.memory, result.memory.save_json)]
    files.write_result(result, *kept)
    show(*weighing_tables(result))
    write_outputs((export, result.save_urdf))  # last: only a payload on the trunk goes into a model


@grouped
def compare(
    logs: Annotated[list[Path], argument("LOG", "Logs of one robot.")],
    robot: opt.RobotOfLog = None,
    methods: Annotated[
        str, option("A,B,...", "Methods of `weigh`, your own as FILE.py:NAME among them.")
    ] = "walking,contact,combined",
    tare: opt.Tare = None,
    weight: opt.Weight = None,
    imu_frame: opt.ImuFrame = None,
    *,
    shape: ModelOptions,
    options: opt.LogOptions,
    files: ResultFiles,
) -> None:
    """Weigh logs by several methods: a table, curves over time over each other with their bands, LaTeX, JSON.

    What a method refuses is listed with the reason; exit code 1 if all refuse all logs.
    """
    chosen = parse.names(methods) or ()
    unloaded = options.tare(tare)
    on_scale = None if weight is None else parse.weight(weight)

    from stadera.report.table import notes, rich_table
    from stadera.report.weigh.comparison import reasons
    from stadera.weigh.compare import compare as compare_logs

    files.check()
    model = shape.load(options.robot(robot, logs[0]), options.reading.limits)
    with progress() as bar:
        result = compare_logs(
            model,
            [options.log(log) for log in logs],
            chosen,
            unloaded,
            weight=on_scale,
            imu_frame=imu_frame,
            progress=bar,
        )
    files.write_result(result)
    show(*map(rich_table, result.to_tables()), *notes(reasons(result)))
    if all(each.weighing is None for each in result.entries):
        raise IdentificationError("no method gave a result")
