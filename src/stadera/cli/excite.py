"""`stadera excite`: the most informative motion of one leg, as a table a controller can play."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stadera.cli.options import JsonFile, ReportFile, RobotName
from stadera.cli.outputs import check_outputs, check_report, check_table, json_of, text_of, write_outputs
from stadera.cli.terminal import progress, show

if TYPE_CHECKING:
    from stadera.excite.result import Excitation


def excite(
    robot: RobotName,
    leg: Annotated[str, typer.Option(metavar="RH", help="LF, RF, LH or RH in any case.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the motion as a table, .csv or .parquet.")
    ] = None,
    duration: Annotated[float, typer.Option(metavar="S", help="From rest to rest [s].")] = 180.0,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Of the table, and of the log to come [Hz].")] = 500.0,
    seed: Annotated[int, typer.Option(metavar="N", help="The same seed gives the same motion.")] = 0,
    random: Annotated[
        bool, typer.Option("--random", help="The paper's random sinusoids instead of the optimum.")
    ] = False,
    leg_only: Annotated[
        bool, typer.Option("--leg-only", help="A table of this leg's joints alone, without the others standing still.")
    ] = False,
    stand_height: Annotated[
        float | None, typer.Option(metavar="M", help="Trunk's origin over a level ground to stay clear of [m].")
    ] = None,
    report: ReportFile = None,
    json: JsonFile = None,
) -> None:
    """Design the motion of one leg in the air, trunk on a stand, that is most informative about its parameters.

    Optimised within the joints' position, velocity and torque limits, clear of trunk, other legs and ground as far
    as the model has shapes; and compared with the paper's random sinusoids. Starts and ends at rest in the stance.
    """
    from stadera.excite.design import ExciteSettings
    from stadera.excite.design import excite as design
    from stadera.report.excite.terminal import excitation_tables
    from stadera.robot import load_robot

    settings = ExciteSettings(duration, rate, seed, random, stand_height=stand_height)
    check_outputs((out, report, json))
    check_report(report)
    if out is not None:
        check_table(out)
    with progress() as watch:
        result = design(load_robot(robot), leg, settings, watch)
    _write(result, out, report, json, leg_only)
    show(*excitation_tables(result))


def _write(result: Excitation, out: Path | None, report: Path | None, json: Path | None, leg_only: bool) -> None:
    """All outputs or none."""
    from stadera.excite.design import motion_table
    from stadera.logs import write_table

    def table(draft: Path) -> None:
        reference = result.chosen.motion.sample(result.settings.rate)
        write_table(motion_table(result.experiment.bounds.robot, reference, whole=not leg_only), draft)

    def page() -> str:
        from stadera.report.excite.page import excitation_html

        return excitation_html(result)

    write_outputs(
        (out, table),
        (report, text_of(page)),
        (json, json_of(result.to_dict)),
    )
