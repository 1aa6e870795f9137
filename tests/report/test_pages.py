"""Pages: small, offline, the answer first, readable on a phone, in the dark and on paper."""

from __future__ import annotations

import html as markup
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stadera
from browser import DESK, PHONE, SCREEN, brightness, measure, needs_browser
from stadera.errors import StaderaError
from stadera.excite.design import ExciteSettings
from stadera.report import page as pdf
from stadera.report.page import commands
from stadera.report.weigh.page import next_steps
from stadera.report.weigh.plots import payload_figure
from stadera.trust import Trust

ROOT = Path(__file__).resolve().parents[2]
VENDOR = ROOT / "src" / "stadera" / "report" / "vendor"


@pytest.fixture(scope="module")
def pages(result, weighed, rested) -> dict[str, str]:
    drawn = stadera.excite("hyq", "RH", ExciteSettings(duration=10.0, random=True))
    return {
        "identify": result.to_html(),
        "weigh": weighed.to_html(),
        "rest": rested.to_html(),
        "excite": drawn.to_html(),
    }


@pytest.mark.parametrize(("name", "most"), [("identify", 3.0), ("weigh", 1.5), ("rest", 1.5), ("excite", 1.5)])
def test_size(pages, name: str, most: float) -> None:
    assert len(pages[name].encode()) < most * 1e6


def test_nothing_is_loaded(pages) -> None:
    for page in pages.values():
        assert not re.search(r"<(script|img|link|iframe|source|object|embed)\b[^>]*\b(src|href|data)\s*=", page)
        style = re.search(r"<style>(.*?)</style>", page, re.DOTALL)
        assert style is not None
        assert not re.search(r"url\(|@import", style.group(1))


def test_the_library_is_there_once(pages) -> None:
    assert all(page.count("plotly.js (basic") == page.count("<noscript>") == 1 for page in pages.values())


def test_the_bundled_library_is_the_one_that_is_named() -> None:
    version = re.search(
        r"plotly\.js \(basic - minified\) v([\d.]+)", (VENDOR / "plotly-basic.min.js").read_text()[:200]
    )
    assert version is not None
    assert f"version {version.group(1)}" in (VENDOR / "README.md").read_text()
    assert "MIT" in (VENDOR / "plotly-basic.LICENSE").read_text()


@pytest.mark.parametrize("name", ["identify", "weigh", "rest", "excite"])
def test_the_answer_comes_first_then_what_to_do_next(pages, name: str) -> None:
    page = pages[name]
    header = page[page.index("<header") : page.index("</header>")]
    assert header.index('class="answer"') < header.index('class="badge"') < header.index("What to do next")
    assert re.search(r'class="badge">[✓!✗] ', header)
    assert "stadera " in header[header.index("What to do next") :]


def test_the_weighing_s_sentence(pages) -> None:
    said = re.search(r'class="answer">([^<]+)<', pages["weigh"])
    assert said is not None
    assert markup.unescape(said.group(1)).replace("\xa0", " ").startswith("Payload 8.00 ± 0.10 kg.")
    assert "Trust: doubtful" in pages["weigh"]
    assert "walk <1>" not in pages["weigh"]


def test_a_load_in_a_hand_is_not_said_to_be_written_into_a_model_file(weighed) -> None:
    weighed = replace(weighed, trust=replace(weighed.trust, verdict="good", reasons=()))
    held = replace(weighed, payload=replace(weighed.payload, at="lf_lowerleg"))
    assert any("--export" in step for step in next_steps(weighed))
    assert not any(
        "--export" in step for step in next_steps(replace(weighed, trust=Trust("doubtful", 1.0, {}, ("why",))))
    )
    assert not any("--export" in step for step in next_steps(held))
    assert any("link lf_lowerleg" in step for step in next_steps(held))


def test_axes_over_time_show_values_and_the_last_error_bar(weighed) -> None:
    """A bar of the first rows after a change, twenty times the payload, does not set the scale."""
    payload = weighed.timeline.payload.copy()
    payload[np.flatnonzero(np.isfinite(payload[:, 0]))[0], 1] = 160.0
    wide = replace(weighed, timeline=replace(weighed.timeline, payload=payload))
    low, high = payload_figure(wide).panels[0].y.limits
    assert low < 0.0 < 8.0 + 3.0 * 0.1 <= high < 12.0


def test_inertia_has_unit_frame_and_point_of_reference(pages, weighed, rested) -> None:
    assert "inertia [kg·m²]" in pages["weigh"]
    assert "about the frame&#39;s origin" in pages["weigh"]
    assert "payload, about its own centre of mass" in pages["weigh"]
    assert "Inertia not observed: the trunk&#39;s" in pages["rest"]
    found = weighed.to_dict()
    assert (found["trunk"]["frame"], found["trunk"]["inertia_about"]) == ("trunk", "frame origin")
    assert found["payload"]["inertia"]["xx"] == pytest.approx(0.3)
    assert found["payload"]["inertia_std"]["xx"] > 0.02  # of Ixx alone, and the centre's besides
    assert found["units"]["inertia"] == "kg·m²"


def test_tables_are_named_for_screen_readers(pages) -> None:
    for page in pages.values():
        tables = page.count("<table")
        assert tables == page.count("<caption") == page.count('role="region" tabindex="0"')
        assert not re.search(r'<caption class="unseen">\s*</caption>', page)
        assert page.count('class="plot" role="img" aria-label="') == page.count('class="plot"')


def test_commands_in_sentences_are_code_and_escaped() -> None:
    assert commands("run `a <b>` & go") == "run <code>a &lt;b&gt;</code> &amp; go"


# -- in a browser -----------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def measured(pages, weighed, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """By page and width, what a browser makes of it; `unix` is the weighing with times of a computer's clock."""
    late = replace(weighed.since_beginning(), begin=1.76e9, end=weighed.end - weighed.begin + 1.76e9)
    line, changes = late.timeline, late.changes
    late = replace(
        late,
        time=late.time + 1.76e9,
        timeline=replace(line, time=line.time + 1.76e9),
        changes=tuple(replace(c, time=c.time + 1.76e9, noticed=c.noticed + 1.76e9) for c in changes),
        refusals=(),
    )
    assert "1.76" not in repr(late)
    return measure({**pages, "unix": late.to_html()}, tmp_path_factory.mktemp("pages"))


@needs_browser
@pytest.mark.parametrize("name", ["identify", "weigh", "rest", "excite"])
@pytest.mark.parametrize("width", [DESK, PHONE])
def test_no_page_scrolls_sideways(measured, name: str, width: int) -> None:
    seen = measured[f"{name}-{width}"]
    assert seen["width"] >= width - 20  # a scroll bar's
    assert seen["scroll"] <= seen["width"]
    assert seen["wide"] == []
    assert seen["boxes"] == 0, "no table scrolls inside of its box either"


@needs_browser
@pytest.mark.parametrize("name", ["identify", "weigh", "rest", "excite"])
def test_answer_and_trust_are_on_the_first_screen(measured, name: str) -> None:
    seen = measured[f"{name}-{DESK}"]
    assert 0 < seen["answer"] < seen["badge"] < SCREEN


@needs_browser
@pytest.mark.parametrize("name", ["identify", "weigh", "rest"])
@pytest.mark.parametrize("width", [DESK, PHONE])
def test_the_first_screen_answers(measured, name: str, width: int) -> None:
    """How heavy, where, how sure, may I use it, what next; of an identification how well torques are predicted."""
    seen = measured[f"{name}-{width}"]
    assert 0 < seen["answer"] < seen["badge"] < seen["next"] < SCREEN


@needs_browser
def test_pages_are_dark_where_the_reader_s_screen_is(pages, measured, tmp_path: Path) -> None:
    dark = measure({"weigh": pages["weigh"]}, tmp_path, dark=True, widths=(DESK,))[f"weigh-{DESK}"]
    light = measured[f"weigh-{DESK}"]
    assert brightness(dark["ink"]) - brightness(dark["paper"]) > 150.0
    assert brightness(light["paper"]) - brightness(light["ink"]) > 150.0


@needs_browser
def test_figures_are_drawn(pages, measured) -> None:
    for name, page in pages.items():
        for width in (DESK, PHONE):
            assert measured[f"{name}-{width}"]["plots"] >= page.count('class="plot"')


@needs_browser
def test_curves_of_a_log_with_unix_time_are_as_wide_as_those_from_zero(measured) -> None:
    """Drawn in 32 bits, in which 1.76e9 s is good to two minutes."""
    assert measured[f"unix-{DESK}"]["curve"] > 0.5


# -- as PDF -----------------------------------------------------------------------------------------------------------
@needs_browser
def test_a_report_is_printed(pages, tmp_path: Path) -> None:
    pdf.write_pdf(pages["excite"], tmp_path / "r.pdf")
    assert (tmp_path / "r.pdf").read_bytes().startswith(b"%PDF")


def test_without_a_browser_a_pdf_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pdf, "BROWSERS", ("no-such-browser",))
    with pytest.raises(StaderaError, match=r"r\.pdf: a PDF is printed by Chromium or Chrome, and none is installed"):
        pdf.write_pdf("<p>", tmp_path / "r.pdf")


def test_a_browser_that_prints_nothing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pdf, "BROWSERS", ("false",))
    with pytest.raises(StaderaError, match=r"r\.pdf: .*false did not print the report: nothing was said"):
        pdf.write_pdf("<p>", tmp_path / "r.pdf")
