"""`stadera replay`: drives models with a log's torques in MuJoCo, and compares the joints' paths with the recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stadera.cli import parse
from stadera.cli.options import Force, LogOptions, argument, grouped, option
from stadera.cli.outputs import ResultFiles
from stadera.cli.terminal import progress, show


@grouped
def replay(
    log: Annotated[Path, argument("LOG", "A log of legs in the air.")],
    robot: Annotated[str, option("IDENTIFIED", "The model to test, or the JSON of `identify`.", "--robot")],
    against: Annotated[str, option("CAD", "The model to compare it with, into which a JSON is put.", "--against")],
    gains: Annotated[
        str | None,
        option("KP,KD", "Torques are commands of a controller with these gains, which is replayed [default: of --pd]."),
    ] = None,
    skip: Annotated[
        float, option("SHARE", "Share of LOG left out at its beginning, which was fitted.", "--skip", min=0.0, max=0.99)
    ] = 0.5,
    torque_lag: Annotated[
        str, option("SECONDS|auto", "Delay of the torques relative to their stamps; 'auto': of the JSON, else none.")
    ] = "auto",
    force: Force = False,
    *,
    options: LogOptions,
    files: ResultFiles,
) -> None:
    """Replay a log in MuJoCo: do the identified values predict the robot's motion better?

    The recorded torques, or the controller that made them, drive each model from the recorded state, for up to a second
    at a time. Prints the root mean square error of the joints' paths over 0.25, 0.5 and 1 s. The trunk is held.
    """
    lag = parse.torque_lag(torque_lag)

    from stadera.errors import RecordingError
    from stadera.lab import require_lab
    from stadera.logs.topics import PdGains
    from stadera.report.terminal import rich_table

    require_lab("replaying a log")
    from stadera.lab.replay import ReplaySettings
    from stadera.lab.replay import replay as replay_log
    from stadera.lab.replayed import replayed_models

    try:
        commanded = options.reading.pd if gains is None else PdGains.parse(gains)
    except RecordingError as error:
        raise typer.BadParameter(str(error), param_hint="--gains") from None
    files.check()
    models, stated = replayed_models(robot, against, force=force, limits=options.reading.limits)
    settings = ReplaySettings(skip=skip)
    with progress() as watch:
        found = stated or 0.0 if lag is None else lag
        result = replay_log(
            options.log(log), models, lag=found, gains=commanded, settings=settings, fix=options.fix, force=force,
            progress=watch,
        )  # fmt: skip
    files.write_result(result)
    show(*map(rich_table, result.to_tables()[:1]))
