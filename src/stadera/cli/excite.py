"""`stadera excite`: the most informative motion of a leg, or of a standing robot's trunk, for a controller."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli.options import Feet, LimitValues, ModelOptions, RobotName, flag, grouped, limits_of, option
from stadera.cli.outputs import ResultFiles, check_table
from stadera.cli.terminal import progress, show

if TYPE_CHECKING:
    from stadera.robot import Robot


class Player(StrEnum):
    """What `--out` is for."""

    csv = "csv"
    unitree = "unitree"
    spot = "spot"
    ros2 = "ros2"


@grouped
def excite(
    robot: RobotName,
    leg: Annotated[str | None, option("LEG", "A leg in the air, by its name in any case.")] = None,
    trunk: Annotated[bool, flag("The trunk of a standing robot, to weigh its payload.", "--trunk")] = False,
    out: Annotated[Path | None, option("FILE", "Write the motion as a table, .csv or .parquet, or a script.")] = None,
    player: Annotated[Player, typer.Option("--for", help="With --trunk, what plays --out.")] = Player.csv,
    seconds: Annotated[float, option("S", "Duration of --trunk from rest to rest [s].")] = 5.0,
    duration: Annotated[float, option("S", "Duration of --leg from rest to rest [s].")] = 180.0,
    rate: Annotated[float, option("HZ", "Sampling rate of the table and of the log [Hz].")] = 500.0,
    seed: Annotated[int, option("N", "The same seed gives the same motion.")] = 0,
    random: Annotated[bool, flag("The paper's random sinusoids instead of the optimum.", "--random")] = False,
    leg_only: Annotated[
        bool, flag("Only this leg's joints in the table, without the others at rest.", "--leg-only")
    ] = False,
    stand_height: Annotated[
        float | None, option("M", "Height of the trunk's origin above level ground to avoid [m].")
    ] = None,
    feet: Feet = None,
    limit: LimitValues = None,
    *,
    files: ResultFiles,
) -> None:
    """Design the most informative motion of one leg in the air, or of a standing robot's trunk.

    --leg: the trunk is on a stand. --trunk: the robot stands, its feet in place, and does the motion without and with
    the load, which is weighed best by it: --for unitree, spot or ros2 writes a script that plays it.

    Optimised within the joints' position, velocity and torque limits, avoiding trunk, other legs and ground as far as
    the model has shapes; and compared with the paper's random sinusoids. Starts and ends at rest in the stance.
    """
    if trunk == (leg is not None):
        raise typer.BadParameter("one of --leg LEG and --trunk is needed", param_hint="--leg")

    model = ModelOptions(feet).load(robot, limits_of(limit))
    if trunk:
        _trunk(model, out, player, seconds, rate, seed, files)
        return
    assert leg is not None
    from stadera.excite.design import ExciteSettings, motion_table
    from stadera.excite.design import excite as design
    from stadera.logs import write_table
    from stadera.report.excite.leg import excitation_tables

    settings = ExciteSettings(duration, rate, seed, random, stand_height=stand_height)
    files.check(out)
    if out is not None:
        check_table(out)
    with progress() as watch:
        result = design(model, leg, settings, watch)

    def table(draft: Path) -> None:
        reference = result.chosen.motion.sample(settings.rate)
        write_table(motion_table(result.experiment.bounds.robot, reference, whole=not leg_only), draft)

    files.write_result(result, (out, table))
    show(*excitation_tables(result))


def _trunk(
    robot: "Robot", out: Path | None, player: Player, seconds: float, rate: float, seed: int, files: ResultFiles
) -> None:
    from stadera.excite.trunk.design import RoutineSettings, weighing_routine
    from stadera.excite.trunk.planted import AXES
    from stadera.excite.trunk.result import interface_named
    from stadera.report.excite.trunk import routine_tables

    taken = AXES if player is Player.csv else interface_named(player.value).axes
    axes = tuple(axis for axis in RoutineSettings.axes if axis in taken)
    settings = RoutineSettings(seconds, rate, seed, axes)
    files.check(out)
    if out is not None and player is Player.csv:
        check_table(out)
    with progress() as watch:
        result = weighing_routine(robot, settings, watch)

    def written(draft: Path) -> None:
        if player is Player.csv:
            result.save_table(draft)
        else:
            result.save_player(draft, player.value)

    files.write_result(result, (out, written))
    show(*routine_tables(result))
