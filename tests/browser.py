"""What a browser makes of pages, at the width of a desk and of a phone."""

from __future__ import annotations

import html as markup
import json
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from stadera.report import page as pdf

CHROMIUM = next((found for name in pdf.BROWSERS if (found := shutil.which(name))), None)
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium or Chrome")
DESK, PHONE, SCREEN = 1400, 390, 900  # px

_MEASURE = """
<script>addEventListener("load", () => setTimeout(() => {
  const seen = {}, fits = (e) => e.scrollWidth <= e.clientWidth + 1;
  for (const frame of document.querySelectorAll("iframe")) {
    const inside = frame.contentDocument, root = inside.documentElement;
    const end = (css) => Math.round(inside.querySelector(css)?.getBoundingClientRect().bottom ?? NaN);
    const wide = [...inside.querySelectorAll("main *")].filter((e) => !e.closest(".scroll, svg, .plot") &&
      e.getBoundingClientRect().right > root.clientWidth + 1).map((e) => e.tagName + "." + e.className);
    seen[frame.id] = {width: root.clientWidth, scroll: root.scrollWidth, answer: end(".answer"), badge: end(".badge"),
      next: end(".next"),
      play: end("#play"), boxes: [...inside.querySelectorAll(".scroll")].filter((e) => !fits(e)).length, wide: wide,
      plots: inside.querySelectorAll(".plot .main-svg").length,
      curve: Math.max(0, ...[...inside.querySelectorAll(".plot path.js-line")].map((e) =>
        e.getBoundingClientRect().width / e.closest(".plot").clientWidth)),
      canvas: inside.querySelectorAll("canvas").length,
      ink: getComputedStyle(inside.body).color, paper: getComputedStyle(inside.body).backgroundColor};
  }
  document.querySelector("pre").textContent = JSON.stringify(seen);
}, 1500));</script>"""


def measure(
    pages: Mapping[str, str], folder: Path, *, dark: bool = False, widths: Sequence[int] = (DESK, PHONE)
) -> dict[str, dict[str, Any]]:
    """Places and colours of each page by `NAME-WIDTH`; nothing moves meanwhile."""
    frames = "".join(
        f'<iframe id="{name}-{width}" style="width:{width}px;height:{SCREEN}px;border:0" '
        f'srcdoc="{markup.escape(page)}"></iframe>'
        for name, page in pages.items()
        for width in widths
    )
    path = folder / "frames.html"
    path.write_text(f'<!DOCTYPE html><meta charset="utf-8"><pre></pre>{frames}{_MEASURE}', encoding="utf-8")
    options = ["--headless", "--no-sandbox", f"--user-data-dir={folder}/profile", "--force-prefers-reduced-motion"]
    options += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--dump-dom", "--virtual-time-budget=20000"]
    options += [f"--blink-settings=preferredColorScheme={0 if dark else 1}"]
    done = subprocess.run(
        [str(CHROMIUM), *options, path.as_uri()], capture_output=True, text=True, check=True, timeout=200
    )
    found = re.search(r"<pre>(.*?)</pre>", done.stdout, re.DOTALL)
    assert found is not None
    return dict(json.loads(markup.unescape(found.group(1))))


def brightness(colour: str) -> float:
    """Of `rgb(r, g, b)`, 0 to 255."""
    return sum(map(float, re.findall(r"[\d.]+", colour)[:3])) / 3.0
