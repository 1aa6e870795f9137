"""What the benchmarks on robots with `real` errors share: their options, logs simulated once, tables and JSON."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from stadera.files import write_text
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import simulate, stored
from stadera.lab.truth import Truth
from stadera.logs import Recording
from stadera.report.table import TableData, rich_table
from stadera.robot import Robot


def parser_of(text: str | None) -> argparse.ArgumentParser:
    """--seed, --keep and --json, the description being the first line of a module's docstring."""
    parser = argparse.ArgumentParser(description=(text or "").split("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where logs are stored")
    parser.add_argument("--json", type=Path, metavar="F", help="writes all results")
    return parser


def made_log(
    robot: Robot, scenario: str, settings: SimulateSettings, folder: Path | None, name: str
) -> tuple[Recording, Truth] | None:
    """A log and its truth, stored in a folder by name or simulated now; None for a robot that fell."""
    log, truth = stored(folder, name, lambda: simulate(robot, scenario, settings))
    return None if truth.fell else (log, truth)


def show(title: str, head: Sequence[str], rows: Sequence[Any], results: Any, path: Path | None) -> None:
    """Prints the table, and writes all results."""
    Console(width=120).print(rich_table(TableData.of(title, tuple(head), rows)))
    if path is not None:
        write_text(path, json.dumps(results, indent=1))
