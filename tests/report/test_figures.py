"""Figures: what the drawings show is what they were given, whoever draws."""

from __future__ import annotations

import base64
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from stadera.errors import MissingExtraError, StaderaError, UnknownNameError
from stadera.report.figures import Axis, Bars, Figure, Guide, Panel, Series, band, line, plotly, stacked
from stadera.report.figures.paper import draw
from stadera.report.figures.scale import Scale
from stadera.report.figures.svg import NARROW, svg
from stadera.report.look import COLOURS


def figure(*marks: Series | Bars, x: Axis | None = None, y: Axis | None = None, **more: object) -> Figure:
    panel = Panel(x or Axis("time [s]"), y or Axis("mass [kg]"), marks, **more)  # type: ignore[arg-type]
    return Figure("one <panel>", ((panel,),))


def points(drawn: str) -> np.ndarray:
    """The vertices of the first curve [px]."""
    (way,) = re.findall(r'class="c" d="M([^"]+)"', drawn)[:1]
    return np.array([[float(v) for v in vertex.split()] for vertex in way.split("L")])


def ticks(drawn: str, css: str) -> dict[float, float]:
    """Values and pixels of an axis' ticks."""
    found = re.findall(rf'<text x="([-\d.]+)" y="([-\d.]+)" class="{css}">([−\d.]+)</text>', drawn)
    return {
        float(text.replace("−", "-")): float(x if css == "x" else y) - (0 if css == "x" else 4) for x, y, text in found
    }


def test_a_curve_lies_where_the_ticks_say() -> None:
    time, mass = np.linspace(0.0, 10.0, 21), np.linspace(-3.0, 7.0, 21) ** 2
    drawn = svg(figure(line(time, mass, "mass")))
    for css, values, pixels in zip("xy", (time, mass), points(drawn).T, strict=True):
        marked = ticks(drawn, css)
        assert len(marked) >= 4
        expected = np.interp(values, sorted(marked), [marked[v] for v in sorted(marked)], left=np.nan, right=np.nan)
        seen = np.isfinite(expected)
        assert seen.sum() > 10
        assert pixels[seen] == pytest.approx(expected[seen], abs=0.11)


def test_decades_are_equally_long() -> None:
    scale = Scale(1e-3, 1e2, 500.0, log=True, flipped=True)
    values, texts = scale.ticks(40.0)
    assert values == pytest.approx([1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0])
    assert scale(np.array(values)) == pytest.approx([500.0, 400.0, 300.0, 200.0, 100.0, 0.0])
    assert texts[-3:] == ["1", "10", "100"]
    assert np.isnan(scale(-1.0))


@pytest.mark.parametrize("low", [-4.2, 0.0, 1e-4, 997.3])
@pytest.mark.parametrize("span", [1e-5, 0.3, 7.0, 4e4])
def test_ticks_are_round_within_and_apart(low: float, span: float) -> None:
    scale = Scale(low, low + span, 300.0)
    values, texts = scale.ticks(34.0)
    assert 2 <= len(values) <= 10
    assert low - 1e-9 * span <= values[0] <= values[-1] <= low + span * (1 + 1e-9)
    assert len(set(texts)) == len(texts) or span / low < 1e-4
    assert np.diff(scale(np.array(values))).min() >= 34.0 * 0.99


def test_a_band_is_two_deviations_and_breaks_where_nothing_is_known() -> None:
    time, value = np.arange(10.0), np.full(10, 5.0)
    std = np.where((time == 4.0), np.nan, 0.5)
    drawn = band(time, value, std)
    assert set(drawn.y[np.isfinite(drawn.y)]) == {4.0, 6.0}
    assert np.isnan(drawn.x).sum() == 2
    area = 0.0
    for part in np.split(np.column_stack([drawn.x, drawn.y]), np.flatnonzero(np.isnan(drawn.x))):
        x, y = part[~np.isnan(part[:, 0])].T
        area += 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
    assert area == pytest.approx(2.0 * (3.0 + 4.0))
    gap = band(np.array([0.0, 1.0, 2.0, 9.0, 10.0]), np.zeros(5), np.ones(5))
    assert np.isnan(gap.x).sum() == 2


def test_long_curves_are_thinned_and_gaps_stay_gaps() -> None:
    time = np.arange(0.0, 100.0, 0.001)
    thin = line(np.where(time < 50.0, time, time + 30.0), np.sin(time), "sin")
    assert len(thin.x) <= 1001
    assert np.isnan(thin.y).sum() == 1
    jump = int(np.flatnonzero(np.isnan(thin.y))[0])
    assert (thin.x[jump - 1] < 50.0) & (thin.x[jump + 1] >= 80.0)


def test_bins_keep_their_area() -> None:
    edges = np.linspace(-2.0, 2.0, 9)
    share = np.array([1.0, 4.0, 9.0, 16.0, 12.0, 8.0, 3.0, 2.0])
    x, y = Series(0.5 * (edges[1:] + edges[:-1]), share, stairs="bins").path()
    assert np.trapezoid(y, x) == pytest.approx(0.5 * share.sum())
    assert (x[0], x[-1]) == pytest.approx((-2.0, 2.0))


def test_bars_are_as_long_as_their_values() -> None:
    drawn = svg(
        figure(Bars(np.array([1.0, np.nan, 3.0]), "a"), x=Axis("error [m]", zero=True), y=Axis(labels=("p", "q", "r")))
    )
    wide = [float(w) for w in re.findall(r'<rect x="0.0" y="[^"]+" width="([\d.]+)"', drawn)]
    assert wide[1] == pytest.approx(3.0 * wide[0], rel=1e-2)


def test_text_is_escaped_and_colours_are_the_page_s_own() -> None:
    drawn = svg(figure(line(np.arange(3.0), np.arange(3.0), "a"), title="<b>"))
    assert "<b>" not in drawn
    assert 'aria-label="one &lt;panel&gt;"' in drawn
    assert "var(--blue)" in drawn
    assert not re.search(r"#[0-9a-f]{3,6}\b", drawn)


def test_a_phone_s_drawing_has_its_panels_below_each_other() -> None:
    panel = figure(line(np.arange(3.0), np.arange(3.0), "a")).panels[0]
    three = Figure("three", ((panel, panel, panel),))
    high = [float(re.match(r'<svg viewBox="0 0 \d+ ([\d.]+)"', svg(three, w)).group(1)) for w in (1120.0, NARROW)]  # type: ignore[union-attr]
    assert high[1] == pytest.approx(3.0 * high[0], rel=0.01)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(StaderaError, match=r"curve 'a': x of shape \(3,\)"):
        Series(np.zeros(3), np.zeros(2), "a")
    with pytest.raises(StaderaError, match="no colour 'pink'"):
        Guide(1.0, colour="pink")
    with pytest.raises(StaderaError, match="only curves"):
        plotly.data(figure(Bars(np.zeros(1), "a"), y=Axis(labels=("p",))))


# -- zoomed on a page -------------------------------------------------------------------------------------------------
def test_plotly_gets_the_values_and_shared_axes() -> None:
    time = np.arange(4.0)
    panels = [
        Panel(Axis("time [s]"), Axis("mass [kg]", log=log), (line(time, 10.0**-time, "mass"),), (Guide(1.0, 2.0),))
        for log in (False, True)
    ]
    made = json.loads(plotly.data(stacked("</script>", panels, moves=True)))
    assert len(made["shared"]) == 1
    first, second = made["data"]
    assert np.frombuffer(base64.b64decode(first["y"]["bdata"]), "<f4") == pytest.approx(10.0**-time, rel=1e-6)
    assert np.frombuffer(base64.b64decode(made["shared"][first["x"]]), "<f4") == pytest.approx(time)
    assert (first["showlegend"], second["showlegend"]) == (True, False)
    layout = made["layout"]
    assert (layout["yaxis"]["type"], layout["yaxis2"]["type"]) == ("linear", "log")
    assert layout["xaxis2"]["matches"] == "x"
    assert [shape["xref"] for shape in layout["shapes"]] == ["x", "x2"]
    assert layout["yaxis"]["domain"][0] > layout["yaxis2"]["domain"][1]
    assert "</" not in plotly.data(stacked("</script>", panels, moves=True))


# -- for papers -------------------------------------------------------------------------------------------------------
MAGIC = {".pdf": b"%PDF", ".png": b"\x89PNG", ".svg": b"<?xml"}


@pytest.mark.parametrize("name", ["result", "weighed", "rested"])
def test_every_figure_of_a_result_is_drawn(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    found = request.getfixturevalue(name)
    for which, shown in found.to_figures().items():
        assert draw(shown).axes, which
    for suffix, magic in MAGIC.items() if name == "weighed" else ():
        found.save_figure(tmp_path / f"f{suffix}", "mass")
        assert (tmp_path / f"f{suffix}").read_bytes().startswith(magic)
    assert found.plot().axes


def test_a_paper_s_figure_shows_the_values() -> None:
    time = np.arange(5.0)
    drawn = draw(
        figure(line(time, time**2, "mass"), band(time, time**2, np.ones(5)), y=Axis("mass [kg]", limits=(-5.0, 20.0)))
    )
    (place,) = drawn.axes
    assert place.lines[0].get_ydata() == pytest.approx(time**2)
    assert place.get_ylim() == (-5.0, 20.0)
    assert place.get_ylabel() == "mass [kg]"


def test_wrong_suffix_wrong_name_and_no_matplotlib(weighed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StaderaError, match=r"f\.jpeg: a figure is written as one of \.pdf, \.png, \.svg"):
        weighed.save_figure(tmp_path / "f.jpeg")
    with pytest.raises(UnknownNameError, match="unknown figure 'balanse'; valid: payload, mass, convergence"):
        weighed.plot("balanse")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"stadera\[figures\]"):
        weighed.plot()
    assert not list(tmp_path.iterdir())


# -- the look ---------------------------------------------------------------------------------------------------------
def luminance(colour: str) -> float:
    """Relative, of WCAG 2.2."""
    c = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return float(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("k", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize(
    ("text", "under"),
    [
        *((name, "paper") for name in ("ink", "soft", "blue", "green", "red", "amber", "purple")),
        *((name, f"{name}-tint") for name in ("green", "red", "amber")),
        ("soft", "ground"),
        ("soft", "gray-tint"),
    ],
)
def test_texts_can_be_read(text: str, under: str, k: int) -> None:
    high, low = sorted((luminance(COLOURS[text][k]), luminance(COLOURS[under][k])), reverse=True)
    assert (high + 0.05) / (low + 0.05) >= 4.5
