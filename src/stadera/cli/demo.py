"""`stadera demo`: a load is added to a walking robot, with and without identification."""

from pathlib import Path
from typing import Annotated

import typer

from stadera.cli.options import JsonFile, flag, option
from stadera.cli.outputs import check_outputs, check_report, json_of, page_of, write_outputs
from stadera.cli.terminal import progress, show

_REPORT = Path("out") / "demo.html"


def demo(
    report: Annotated[Path, option("F.html", "Write an HTML report.")] = _REPORT,
    json: JsonFile = None,
    seed: Annotated[int, option("N", "Seed of the sensor errors.", min=0)] = 0,
    classic: Annotated[
        bool, flag("Stop and weigh at rest, as in the paper, instead of while walking.", "--classic")
    ] = False,
    nonstop: Annotated[bool, typer.Option("--nonstop", hidden=True)] = False,  # the default now; once an option
) -> None:
    """HyQ crawls, and a 30 kg box lands on a corner of its back: without identification it falls.

    With identification it weighs the box while walking and walks on. Takes half a minute on two cores. The report shows
    both walks as animations.
    """
    from stadera.lab import require_lab

    require_lab("stadera demo")
    from stadera.lab.demo import DemoSettings, run_demo
    from stadera.lab.report.demo.page import demo_html
    from stadera.lab.report.demo.terminal import demo_tables

    if report == _REPORT:
        report.parent.mkdir(exist_ok=True)
    check_outputs((report, json))
    check_report(report)
    with progress() as watch:

        def follow(run: str, done: float, doing: str) -> None:
            if watch:
                watch(run, round(100 * done), 100, doing)

        result = run_demo(DemoSettings(seed=seed, classic=classic and not nonstop), follow)
    write_outputs((report, page_of(lambda: demo_html(result))), (json, json_of(result.to_dict)))
    show(*demo_tables(result))
