"""Registers the commands. A new one is one module with a function, and one line here.

Command modules import their dependencies inside functions, so that help and usage errors appear immediately.
"""

from typing import Annotated

import typer

from stadera import __version__
from stadera.cli import DEBUG
from stadera.cli.excite import excite
from stadera.cli.fleet import fleet
from stadera.cli.identify import identify
from stadera.cli.inspect import ColumnsMayStandAlone, inspect
from stadera.cli.laboratory import demo, replay, reproduce, simulate
from stadera.cli.live import live
from stadera.cli.options import flag
from stadera.cli.outputs import GatedCommand
from stadera.cli.weigh import compare, weigh

app = typer.Typer(
    name="stadera",
    help="Weighs legged robots with their own legs.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _show_version(asked: bool) -> None:
    if asked:
        print(f"stadera {__version__}")
        raise typer.Exit


@app.callback()
def _stadera(
    version: Annotated[
        bool, flag("Show the version and exit.", "--version", callback=_show_version, is_eager=True)
    ] = False,
    debug: Annotated[bool, flag("Show the traceback of an error; so does STADERA_DEBUG=1.", DEBUG)] = False,
) -> None:
    pass


for _command in (identify, weigh, compare, live, inspect, excite, fleet, simulate, replay, demo, reproduce):
    app.command(cls=ColumnsMayStandAlone if _command is inspect else GatedCommand)(_command)
