"""`stadera excite`: the most informative motion of a leg, or of a standing robot's trunk, for a controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stadera.cli.options import Feet, LimitValues, ModelOptions, RobotName, flag, grouped, limits_of, option, refuse
from stadera.cli.outputs import ResultFiles, check_table
from stadera.cli.terminal import progress, show
from stadera.errors import StaderaError

if TYPE_CHECKING:
    from stadera.robot import Robot


Player = Literal["csv", "unitree", "spot", "ros2"]


@grouped
def excite(
    robot: RobotName,
    leg: Annotated[str | None, option("LEG", "A leg in the air, by its name in any case.")] = None,
    trunk: Annotated[bool, flag("The trunk of a standing robot, to weigh its payload.", "--trunk")] = False,
    out: Annotated[Path | None, option("FILE", "Write the motion as a table, .csv or .parquet, or a script.")] = None,
    player: Annotated[
        Player | None, typer.Option("--for", help="With --trunk, what plays --out [default: csv].")
    ] = None,
    seconds: Annotated[float | None, option("S", "Duration of --trunk from rest to rest [s] [default: 5].")] = None,
    duration: Annotated[float | None, option("S", "Duration of --leg from rest to rest [s] [default: 180].")] = None,
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
        why = "give --leg LEG or --trunk, not both" if trunk else "one of --leg LEG and --trunk is needed"
        raise typer.BadParameter(why, param_hint="--leg")
    of_leg = {"--duration": duration, "--random": random, "--leg-only": leg_only, "--stand-height": stand_height}
    refuse("needs --leg" if trunk else "needs --trunk", of_leg if trunk else {"--for": player, "--seconds": seconds})
    model = ModelOptions(feet).load(robot, limits_of(limit))
    if leg is None:
        _trunk(model, out, player or "csv", seconds, rate, seed, files)
        return
    from stadera.excite.design import ExciteSettings, motion_table
    from stadera.excite.design import excite as design
    from stadera.logs import write_table
    from stadera.report.excite.leg import excitation_tables

    duration = ExciteSettings.duration if duration is None else duration
    settings = ExciteSettings(duration, rate, seed, random, stand_height=stand_height)
    files.check(out)
    check_table(out)
    with progress() as watch:
        result = design(model, leg, settings, watch)

    def table(draft: Path) -> None:
        reference = result.chosen.motion.sample(settings.rate)
        write_table(motion_table(result.experiment.bounds.robot, reference, whole=not leg_only), draft)

    files.write_result(result, (out, table))
    show(*excitation_tables(result))


def _trunk(
    robot: "Robot", out: Path | None, player: Player, seconds: float | None, rate: float, seed: int, files: ResultFiles
) -> None:
    from stadera.excite.trunk.design import RoutineSettings, weighing_routine
    from stadera.excite.trunk.planted import AXES
    from stadera.excite.trunk.result import interface_named
    from stadera.report.excite.trunk import routine_tables

    taken = AXES if player == "csv" else interface_named(player).axes
    axes = tuple(axis for axis in RoutineSettings.axes if axis in taken)
    settings = RoutineSettings(RoutineSettings.seconds if seconds is None else seconds, rate, seed, axes)
    files.check(out)
    if player == "csv":
        check_table(out)
    elif out is not None and out.suffix.lower() != ".py":
        raise StaderaError(f"{out}: the script for --for {player} is Python, written as .py")
    with progress() as watch:
        result = weighing_routine(robot, settings, watch)

    def written(draft: Path) -> None:
        if player == "csv":
            result.save_table(draft)
        else:
            result.save_player(draft, player)

    files.write_result(result, (out, written))
    show(*routine_tables(result))
