"""Makes self-contained pages from jinja2 templates, with style, script library and figures included.

A template extends `page.html.j2` and uses the macros of `parts.html.j2`. Other packages, such as the laboratory, keep
their templates in a folder `templates`.

Chromium or Chrome, if one is installed, prints a page as PDF.
"""

import os
import re
import shutil
import subprocess
import tempfile
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

import stadera
from stadera.errors import StaderaError
from stadera.report.figures import plotly
from stadera.report.look import style_variables
from stadera.report.numbers import number, with_std
from stadera.report.table import MARKS


def render(template: str, package: str = "stadera.report", **values: Any) -> str:
    """Renders a page from a template in the folder `templates` of a package, or of this one; text is escaped."""
    return _environment(package).get_template(template).render(values)


def script_data(json: str) -> Markup:
    """JSON as the text of a script element, which it cannot terminate."""
    return Markup(json.replace("</", "<\\/"))


@cache
def _environment(package: str) -> Environment:
    folders = dict.fromkeys((package, "stadera.report"))
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(folder) for folder in folders]),
        autoescape=select_autoescape(("html.j2",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        "version": stadera.__version__,
        "marks": MARKS,
        "style_variables": lambda: Markup(style_variables()),
        "asset": partial(_asset, package=package),
        "plotly": plotly,
    }
    environment.filters |= {"number": number, "with_std": with_std, "commands": commands, "unbroken": unbroken}
    return environment


def _asset(name: str, package: str, folder: str = "templates") -> Markup:
    return Markup((resources.files(package) / folder / name).read_text(encoding="utf-8"))


def unbroken(sentence: str) -> str:
    """A sentence whose figures stay on one line with their bars and units."""
    return re.sub(r" (?=±|%|(?:kg|mm|m|s|N·m)\b)|(?<=±) ", "\N{NO-BREAK SPACE}", sentence)


def commands(sentence: str) -> Markup:
    """A sentence with the parts between backquotes as code."""
    parts = (Markup("<code>{}</code>" if k % 2 else "{}").format(part) for k, part in enumerate(sentence.split("`")))
    return Markup("").join(parts)


BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "msedge",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)
_OPTIONS = (
    "--headless",
    "--disable-gpu",
    "--disable-background-networking",
    "--no-first-run",
    "--no-pdf-header-footer",
    "--virtual-time-budget=10000",  # ms, for drawing the plots
)


def find_browser(path: str | Path) -> str:
    """Finds a browser for printing to `path`; StaderaError if there is none."""
    found = next((place for name in BROWSERS if (place := shutil.which(name))), None)
    if found is None:
        raise StaderaError(
            f"{path}: a PDF is printed by Chromium or Chrome, and none is installed; write a report .html and print it "
            "from any browser"
        )
    return found


def write_pdf(page: str, path: str | Path, longest: float = 120.0) -> None:
    """Prints a page to a file within `longest` [s]; StaderaError without a browser, or if printing failed."""
    browser = find_browser(path)
    with tempfile.TemporaryDirectory(prefix="stadera-") as folder:
        source, printed = Path(folder) / "page.html", Path(folder) / "page.pdf"
        source.write_text(page, encoding="utf-8")
        root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # Chromium's own rule
        places = [f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}", source.as_uri()]
        try:
            done = subprocess.run(
                [browser, *_OPTIONS, *root, *places], capture_output=True, text=True, timeout=longest, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise StaderaError(f"{path}: {browser} did not print the report: {error}") from None
        if not printed.is_file():
            said = (done.stderr.strip().splitlines() or ["nothing was said"])[-1]
            raise StaderaError(f"{path}: {browser} did not print the report: {said}")
        Path(path).write_bytes(printed.read_bytes())
