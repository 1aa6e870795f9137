"""The manual as a site: it builds, every link of every page leads somewhere, and pages fit a desk and a phone."""

from __future__ import annotations

import html
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from browser import CHROMIUM, DESK, PHONE, SCREEN

ROOT = Path(__file__).resolve().parent.parent
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it; what the build warns of is an error."""
    pytest.importorskip("mkdocs", reason="needs pip install 'stadera[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_site_is_whole(site: Path) -> None:
    named = re.findall(r"\b([\w/-]+)\.md", (ROOT / "mkdocs.yml").read_text())
    assert not [name for name in named if not (site / f"{name}.html").exists()]
    assert "TrunkEstimator" in (site / "reference" / "python.html").read_text()
    assert "--tare" in (site / "reference" / "cli.html").read_text()
    assert not [target for _, target, _ in links(site) if "unpkg.com" in target or "googleapis" in target]
    _links_lead_somewhere(site)
    _pictures_have_no_background(site)
    if CHROMIUM is not None:
        _pages_fit(site, dark=False)
        _pages_fit(site, dark=True)
        _search_works_from_a_folder(site)


def links(site: Path) -> Iterator[tuple[Path, str, str]]:
    """Each page's targets of href and src: page, target, what it was in."""
    for page in sorted(site.rglob("*.html")):
        for kind, target in re.findall(r"<[^>]+\b(href|src)=[\"']?([^\"'\s>]+)", page.read_text(encoding="utf-8")):
            yield page, html.unescape(target), kind


@cache
def anchors(page: Path) -> frozenset[str]:
    return frozenset(re.findall(r"\b(?:id|name)=[\"']?([^\"'\s>]+)", page.read_text(encoding="utf-8")))


def _has(page: Path, fragment: str) -> bool:
    return not fragment or page.suffix != ".html" or fragment in anchors(page)


def _links_lead_somewhere(site: Path) -> None:
    missing, examples = [], set()
    for page, target, _ in links(site):
        parts = urlsplit(target)
        if parts.scheme or parts.netloc or page.name == "404.html":
            continue
        found = (page.parent / unquote(parts.path)).resolve() if parts.path else page
        if not (found.is_file() and found.is_relative_to(site) and _has(found, unquote(parts.fragment))):
            missing.append((page.name, target))
        examples |= {found.name} if "/examples/" in target else set()
    assert not missing
    assert {"online.py", "own_estimator.py", "live_client.py", "weigh_a_log.ipynb"} <= examples


def _pictures_have_no_background(site: Path) -> None:
    drawn = [path for path in (site / "figures").glob("*.svg") if path.stem != "live_terminal"]  # a dark terminal
    assert len(drawn) >= 30
    assert not [path.name for path in drawn if re.search(r"fill: ?(#ffffff|white)", path.read_text(encoding="utf-8"))]


def opened(address: str, *flags: str) -> str:
    """A page's elements after its scripts ran."""
    command = [str(CHROMIUM), *FLAGS, *flags, "--dump-dom", address]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout


def _pages_fit(site: Path, *, dark: bool) -> None:
    """Nothing but a table or code is wider than any page, at a desk and on a phone, and ink stands out from paper.

    Colours move nothing: dark pages are opened at one width.
    """
    names = [page.relative_to(site).as_posix() for page in sorted(site.rglob("*.html")) if page.name != "404.html"]
    frames = "".join(
        f'<iframe id="{name}-{width}" src="{name}" style="width:{width}px;height:{SCREEN}px"></iframe>'
        for name in names
        for width in ((PHONE,) if dark else (DESK, PHONE))
    )
    script = """<script>addEventListener("load", () => setTimeout(() => {
      document.title = [...document.querySelectorAll("iframe")].filter((frame) => {
        const root = frame.contentDocument.documentElement, body = frame.contentDocument.body;
        const parts = (colour) => (colour.match(/[\\d.]+/g) || [0]).slice(0, 3);
        const light = (colour) => parts(colour).reduce((sum, part) => sum + +part / 3, 0);
        const paper = light(getComputedStyle(body).backgroundColor), dark = matchMedia("(prefers-color-scheme: dark)");
        return root.scrollWidth > root.clientWidth + 1 || !frame.contentDocument.querySelector("h1") ||
          (paper < 128) !== dark.matches || Math.abs(paper - light(getComputedStyle(body).color)) < 100;
      }).map((frame) => frame.id).join(" ") || "all fit";
    }, 1500));</script>"""
    page = site / "frames.html"
    page.write_text(f"<!DOCTYPE html><title>?</title>{frames}{script}", encoding="utf-8")
    profile = f"--user-data-dir={site}/profile"
    found = re.search(
        r"<title>(.*?)</title>",
        opened(
            page.as_uri(),
            profile,
            "--allow-file-access-from-files",
            "--virtual-time-budget=20000",
            f"--blink-settings=preferredColorScheme={0 if dark else 1}",
        ),
    )
    page.unlink()
    assert found is not None
    assert found[1] == "all fit"


def _search_works_from_a_folder(site: Path) -> None:
    address = f"{(site / 'guides' / 'go2.html').as_uri()}?q=payload"
    seen = opened(address, f"--user-data-dir={site}/search-profile", "--timeout=8000")
    found = re.search(r"(\d+) matching documents", seen)
    assert found is not None
    assert int(found[1]) > 10
