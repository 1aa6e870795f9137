"""`stadera identify`: identifies links, friction and rotor inertia of legs, and the trunk, from any logs of a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from stadera.cli import options as opt
from stadera.cli import parse
from stadera.cli.options import argument, flag, grouped, option, remembered
from stadera.cli.outputs import ResultFiles, check_table
from stadera.cli.terminal import progress, show
from stadera.errors import UntrustedError

if TYPE_CHECKING:
    from stadera.identify.result import Identification
    from stadera.identify.settings import IdentifySettings
    from stadera.robot import Robot


@dataclass(frozen=True)
class FitOptions:
    """Options for what is fitted, and to which signals."""

    legs: Annotated[str | None, option("RH,...", "Legs to identify [default: all]. LF, RF, LH, RH in any case.")] = None
    method: Annotated[Literal["consistent", "null-space"], flag("Physically consistent, or CAD in the null space.")] = (
        "consistent"
    )
    friction: Annotated[
        str, option("TERMS", "Joint terms to fit: some of armature,viscous,coulomb,offset; or 'none'.")
    ] = "armature,viscous,coulomb,offset"
    cutoff: Annotated[str, option("HZ|auto|none", "Low-pass cut-off; 'auto' chooses it from the motion.")] = "auto"
    torque_lag: Annotated[
        str, option("SECONDS|auto", "Delay of the torques relative to their stamps; 'auto' estimates it.")
    ] = "auto"
    up: Annotated[str, option("X,Y,Z|auto", "The vertical in trunk axes; 'auto': from the IMU, else level.")] = "auto"

    def settings(self, split: float) -> IdentifySettings:
        """Settings for these options, fitting a share of each log. Raises BadParameter."""
        legs, terms, cutoff_hz = parse.names(self.legs), parse.terms(self.friction), parse.cutoff(self.cutoff)
        lag, up = parse.torque_lag(self.torque_lag), parse.direction(self.up)

        from stadera.body.friction import FrictionModel
        from stadera.identify.settings import IdentifySettings

        return IdentifySettings(legs, self.method, FrictionModel(terms), cutoff_hz, torque_lag=lag, up=up, split=split)


@grouped
def identify(
    logs: Annotated[list[Path], argument("LOG...", "Logs to fit; several are merged.")],
    robot: opt.RobotOfLog = None,
    validate: Annotated[
        list[Path] | None, option("LOG", "Validate on this log instead of a part of LOG; repeatable.")
    ] = None,
    split: Annotated[str | None, option("SHARE", "Share of each LOG to fit [default: 0.5]; 'none': fit all.")] = None,
    export: Annotated[
        Path | None,
        option(
            "F.urdf|F.yaml",
            "Write the model file as identified; .yaml: its drives for Isaac Lab, mjlab; .usda, .usd: as USD.",
        ),
    ] = None,
    draws: Annotated[
        str | None,
        option("[N=]F.csv", "Write N robots drawn from the posterior [1000], a row each; .csv or .parquet.", "--draws"),
    ] = None,
    memory: opt.MemoryFile = None,
    force: opt.Force = False,
    *,
    fit: FitOptions,
    options: opt.LogOptions,
    shape: opt.ModelOptions,
    files: ResultFiles,
) -> None:
    """Identify legs, drives and trunk from logs: legs in the air, or a robot on its feet, in any mix.

    Estimates mass, centre of mass and inertia of each link as far as the motion determines them, and each joint's rotor
    inertia, friction and torque offset. Reports which parameters are not determined, and how well torques are
    predicted. A log that the model does not explain is refused (exit code 1) unless --force is given.
    """
    if validate and split is not None:
        raise typer.BadParameter("give --validate or --split, not both", param_hint="--split")
    settings = fit.settings(1.0 if validate else parse.split(split or "0.5"))
    count, table = parse.counted(draws, "--draws")

    from stadera.identify.legs import identify as identify_legs
    from stadera.report.identify.tables import identification_tables
    from stadera.report.table import notes

    model = shape.load(options.robot(robot, logs[0]), options.reading.limits)
    files.check(export, table, memory)
    known = remembered(memory, model)
    check_table(table)
    save_model = _checked_export(model, export)
    training = [options.log(path) for path in logs]
    validation = [options.log(path) for path in validate or ()]
    with progress() as watch:
        result = identify_legs(
            model, training, settings, validation or None, watch, fix=options.fix, force=force, memory=known
        )
    _require_trust(result, force, export)
    drawn = (table, lambda draft: result.save_draws(draft, count))
    kept = [] if result.memory is None else [(memory, result.memory.save_json)]
    files.write_result(result, (export, partial(save_model, result)), drawn, *kept)
    show(*identification_tables(result), *notes(note for note in result.notes if "the robot's memory" in note))
    if export is not None and export.suffix.lower() == ".urdf":
        show("note: a URDF has no place for rotor inertia; MJCF (.xml) and the drives (.yaml) have, as --json has all")


def _checked_export(robot: Robot, path: Path | None) -> Callable[[Identification, Path], None]:
    """The method that writes a result as what the path's suffix says. Raises as `check_export` and `require_usd`."""
    from stadera.identify.result import Identification
    from stadera.robot.export import check_export
    from stadera.robot.usd import require_usd

    if path is None:
        return Identification.save_urdf
    if path.suffix.lower() in (".yaml", ".yml"):
        return Identification.save_actuators
    if path.suffix.lower() in (".usd", ".usda"):
        require_usd()
        return Identification.save_usd
    check_export(robot, path)
    return Identification.save_urdf


def _require_trust(result: Identification, force: bool, export: Path | None) -> None:
    if force:
        return
    if not result.rank and result.trunk is None:
        raise UntrustedError(f"{result.source}: the log determines nothing: it is too short, or the legs hardly move")
    if export is not None and not result.is_physical:
        raise UntrustedError(
            f"{export}: not written, since some link is a body that cannot be, as null-space solutions may be; "
            "--method consistent finds one that can, --force writes it all the same"
        )
    if result.trust.verdict == "bad":
        raise UntrustedError(
            f"{result.source}: the model does not explain the torques, misfit {result.trust.misfit:.3g} (1 is right): "
            f"{'; '.join(result.trust.reasons)}; --force gives the figures all the same"
        )
