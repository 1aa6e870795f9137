"""Prints pages as PDF with an installed Chromium or Chrome."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from stadera.errors import StaderaError

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
