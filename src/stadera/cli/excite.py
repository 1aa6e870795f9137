"""`stadera excite`: the most informative motion of one leg, as a table for a controller."""

from pathlib import Path
from typing import Annotated

from stadera.cli.options import LimitValues, RobotName, flag, grouped, limits_of, option
from stadera.cli.outputs import ResultFiles, check_table
from stadera.cli.terminal import progress, show


@grouped
def excite(
    robot: RobotName,
    leg: Annotated[str, option("RH", "LF, RF, LH or RH, in any case.")],
    out: Annotated[Path | None, option("FILE", "Write the motion as a table, .csv or .parquet.")] = None,
    duration: Annotated[float, option("S", "Duration from rest to rest [s].")] = 180.0,
    rate: Annotated[float, option("HZ", "Sampling rate of the table and of the log [Hz].")] = 500.0,
    seed: Annotated[int, option("N", "The same seed gives the same motion.")] = 0,
    random: Annotated[bool, flag("The paper's random sinusoids instead of the optimum.", "--random")] = False,
    leg_only: Annotated[
        bool, flag("Only this leg's joints in the table, without the others at rest.", "--leg-only")
    ] = False,
    stand_height: Annotated[
        float | None, option("M", "Height of the trunk's origin above level ground to avoid [m].")
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

    files.write_result(result, (out, table))
    show(*excitation_tables(result))
