"""`stadera excite`: the most informative motion of one leg, as a table for a controller."""

from pathlib import Path
from typing import Annotated

import typer

from stadera.cli.options import LimitValues, RobotName, grouped, limits_of
from stadera.cli.outputs import ResultFiles, check_table
from stadera.cli.terminal import progress, show


@grouped
def excite(
    robot: RobotName,
    leg: Annotated[str, typer.Option(metavar="RH", help="LF, RF, LH or RH, in any case.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the motion as a table, .csv or .parquet.")
    ] = None,
    duration: Annotated[float, typer.Option(metavar="S", help="Duration from rest to rest [s].")] = 180.0,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Sampling rate of the table and of the log [Hz].")] = 500.0,
    seed: Annotated[int, typer.Option(metavar="N", help="The same seed gives the same motion.")] = 0,
    random: Annotated[
        bool, typer.Option("--random", help="The paper's random sinusoids instead of the optimum.")
    ] = False,
    leg_only: Annotated[
        bool, typer.Option("--leg-only", help="Only this leg's joints in the table, without the others at rest.")
    ] = False,
    stand_height: Annotated[
        float | None, typer.Option(metavar="M", help="Height of the trunk's origin above level ground to avoid [m].")
    ] = None,
    limit: LimitValues = None,
    *,
    files: ResultFiles,
) -> None:
    """Design the most informative motion of one leg in the air, with the trunk on a stand.

    Optimised within the joints' position, velocity and torque limits, avoiding trunk, other legs and ground as far as
    the model has shapes; and compared with the paper's random sinusoids. Starts and ends at rest in the stance.
    """
    from stadera.excite.design import ExciteSettings, motion_table
    from stadera.excite.design import excite as design
    from stadera.logs import write_table
    from stadera.report.excite import excitation_tables
    from stadera.robot import load_robot

    settings = ExciteSettings(duration, rate, seed, random, stand_height=stand_height)
    files.check(out)
    if out is not None:
        check_table(out)
    with progress() as watch:
        result = design(load_robot(robot, limits_of(limit)), leg, settings, watch)

    def table(draft: Path) -> None:
        reference = result.chosen.motion.sample(settings.rate)
        write_table(motion_table(result.experiment.bounds.robot, reference, whole=not leg_only), draft)

    files.write(
        (out, table), values=result.to_dict, page=result.to_html, latex=result.to_latex, figures=result.to_figures
    )
    show(*excitation_tables(result))
