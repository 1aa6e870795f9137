"""Figures: what the drawings show is what they were given, whoever draws."""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from stadera.errors import MissingExtraError, StaderaError, UnknownNameError
from stadera.report.figures import Axis, Bars, Figure, Guide, Panel, Series, band, line, plotly, stacked
from stadera.report.figures.paper import draw
from stadera.report.look import COLOURS


def figure(*marks: Series | Bars, x: Axis | None = None, y: Axis | None = None, **more: object) -> Figure:
    panel = Panel(x or Axis("time [s]"), y or Axis("mass [kg]"), marks, **more)  # type: ignore[arg-type]
    return Figure("one <panel>", ((panel,),))


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


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(StaderaError, match=r"curve 'a': x of shape \(3,\)"):
        Series(np.zeros(3), np.zeros(2), "a")
    with pytest.raises(StaderaError, match="no colour 'pink'"):
        Guide(1.0, colour="pink")


# -- on a page --------------------------------------------------------------------------------------------------------
def unpacked(values: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(values["bdata"]), "<f4")


def test_bars_are_as_long_as_their_values_and_named() -> None:
    bars = [Bars(np.array([1.0, np.nan, 3.0]), name) for name in "ab"]
    names = ("p", "q", "the longest name of all")
    made = json.loads(plotly.data(figure(*bars, x=Axis("error [m]", zero=True), y=Axis(labels=names))))
    first, second = made["data"]
    assert unpacked(first["x"]) == pytest.approx([1.0, np.nan, 3.0], nan_ok=True)
    assert (first["y"], first["name"], second["name"]) == ([0, 1, 2], "a", "b")
    assert first["offset"] + first["width"] <= second["offset"]
    assert made["desk"]["yaxis1"]["ticktext"] == list(names)
    assert made["phone"]["yaxis1"]["ticktext"][2].endswith("…")
    assert made["desk"]["yaxis1"]["range"] == [2.5, -0.5]


def test_error_bars_markers_and_labels_are_what_was_given() -> None:
    x, y = np.array([1.0, 2.0]), np.array([5.0, 7.0])
    mark = Series(x, y, marker="ring", size=np.array([3.0, 9.0]), labels=("low", "high"), x_range=(x - 0.5, x + 2.0))
    (made,) = json.loads(plotly.data(figure(mark)))["data"]
    assert made["mode"] == "lines+markers+text"
    assert (made["text"], made["textposition"]) == (["low", "high"], ["bottom center", "top center"])
    assert unpacked(made["marker"]["size"]) == pytest.approx([3.0, 9.0])
    assert unpacked(made["error_x"]["array"]) == pytest.approx([2.0, 2.0])
    assert unpacked(made["error_x"]["arrayminus"]) == pytest.approx([0.5, 0.5])


def test_colours_are_the_page_s_own() -> None:
    drawn = plotly.data(figure(line(np.arange(3.0), np.arange(3.0), "a"), guides=(Guide(1.0, name="b"),)))
    assert "var(--blue)" in drawn
    assert "#" not in drawn


def test_a_phone_s_drawing_has_its_panels_below_each_other() -> None:
    panel = figure(line(np.arange(3.0), np.arange(3.0), "a")).panels[0]
    made = json.loads(plotly.data(Figure("three", ((panel, panel, panel),))))
    desk, phone = (
        [[made[where][f"{axis}axis{k}"]["domain"] for k in (1, 2, 3)] for axis in "xy"] for where in ("desk", "phone")
    )
    assert desk[1][0] == desk[1][1] == desk[1][2]
    assert desk[0][0][1] < desk[0][1][0] < desk[0][1][1] < desk[0][2][0]
    assert phone[0] == [[0.0, 1.0]] * 3
    assert phone[1][0][0] > phone[1][1][1] > phone[1][1][0] > phone[1][2][1] >= 0.0
    assert made["phone"]["height"] > 2.5 * made["desk"]["height"]


def test_plotly_gets_the_values_and_shared_axes() -> None:
    time = np.arange(4.0)
    panels = [
        Panel(Axis("time [s]"), Axis("mass [kg]", log=log), (line(time, 10.0**-time, "mass"),), (Guide(1.0, 2.0),))
        for log in (False, True)
    ]
    made = json.loads(plotly.data(stacked("</script>", panels)))
    assert len(made["shared"]) == 1
    first, second = made["data"]
    assert unpacked(first["y"]) == pytest.approx(10.0**-time, rel=1e-6)
    assert np.frombuffer(base64.b64decode(made["shared"][first["x"]]), "<f4") == pytest.approx(time)
    assert (first["showlegend"], second["showlegend"]) == (True, False)
    layout = made["desk"]
    assert (layout["yaxis1"]["type"], layout["yaxis2"]["type"]) == ("linear", "log")
    assert layout["xaxis2"]["matches"] == "x"
    assert [shape["xref"] for shape in layout["shapes"]] == ["x1", "x2"]
    assert layout["yaxis1"]["domain"][0] > layout["yaxis2"]["domain"][1]
    assert "</" not in plotly.data(stacked("</script>", panels))


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
    with pytest.raises(UnknownNameError, match="unknown figure 'balanse'; valid: payload, mass, balance, convergence"):
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
