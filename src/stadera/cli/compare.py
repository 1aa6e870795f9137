"""`stadera compare`: several methods on several logs, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from stadera.cli import options as opt
from stadera.cli import parse
from stadera.cli.options import argument, grouped, option
from stadera.cli.outputs import ResultFiles
from stadera.cli.terminal import progress, show


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
    options: opt.LogOptions,
    files: ResultFiles,
) -> None:
    """Weigh logs by several methods: a table, curves over time over each other with their bands, LaTeX, JSON.

    What a method refuses is listed with the reason. --tare is a range of each log's time.
    """
    chosen = parse.names(methods) or ()
    unloaded = None if tare is None else parse.tare_range(tare)
    on_scale = None if weight is None else parse.weight(weight)

    from stadera.report.terminal import notes, rich_table
    from stadera.report.weigh.compared import reasons
    from stadera.robot import load_robot
    from stadera.weigh.compare import compare as compare_logs

    files.check()
    model = load_robot(options.robot(robot, logs[0]), options.reading.limits)
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
