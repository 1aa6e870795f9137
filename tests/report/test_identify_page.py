"""The page of an identification: self-contained, well-formed, and honest about what was not measured."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from stadera.identify.observability import Identifiability
from stadera.identify.result import Quantity, TorqueTrace
from stadera.report.figures import Figure
from stadera.report.identify.page import error_figure, plotted_traces, torque_figure
from stadera.report.identify.tables import link_tables, remarks
from stadera.report.numbers import number
from stadera.trust import Trust

_VOID = {"meta", "br", "hr", "img", "link", "input"}


class _Page(HTMLParser):
    """Collects what a browser would load, table rows as text, figures, and checks that elements are closed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.rows: list[tuple[str, str]] = []
        self.figures: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self._row: list[str] | None = None
        self._kind = ""
        self._script = ""
        self.feed(page)
        self.close()
        assert not self._open

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        named = dict(attributes)
        self.loads += [str(named[key]) for key in ("src", "srcset", "data", "poster") if key in named]
        if tag == "link" or (tag == "a" and not str(named.get("href", "#")).startswith("#")):
            self.loads.append(str(named.get("href")))
        if tag not in _VOID:
            self._open.append(tag)
        if tag == "script":
            self._script = named.get("type") or "javascript"
        if tag == "tr":
            self._row, self._kind = [], named.get("class") or ""

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag
        if tag == "tr":
            self.rows.append((self._kind, " ".join(self._row or [])))
            self._row = None

    def handle_data(self, data: str) -> None:
        inside = self._open[-1] if self._open else ""
        if inside == "script" and self._script == "application/json":
            self.figures.append(data)
        elif inside not in ("script", "style"):
            self.text += data
            if self._row is not None:
                self._row.append(data.strip())


@pytest.fixture(scope="module")
def html(result) -> str:
    return result.to_html()


@pytest.fixture(scope="module")
def page(html) -> _Page:
    return _Page(html)


def test_loads_nothing(html, page):
    assert page.loads == []
    style = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style
    assert html.count("plotly.js (basic") == 1


def test_is_small_enough_to_mail(html):
    assert len(html.encode()) < 3_000_000


def test_names_are_escaped(html, page):
    assert "swing <RH>" not in html
    assert "swing <RH> & co.csv" in page.text


def test_what_was_not_measured_is_not_listed_as_if(html, result, page):
    (leg,) = result.legs
    for link, table in zip(leg.leg.links, link_tables(leg), strict=True):
        mass = leg.parameters[f"{link}.m"]
        assert mass.verdict is not Identifiability.OBSERVABLE
        assert table.note.startswith("Not measured: mass")
        assert table.note in page.text
        assert not any(row[0].text == "mass" for _, rows in table.groups for row in rows)
    kinds = {kind for kind, text in page.rows if kind in ("observable", "partial", "unobservable")}
    assert kinds == {"observable", "partial"}
    assert all("±" in text for kind, text in page.rows if kind in kinds)
    held = sum(q.is_held for name, q in leg.parameters.items() if name.rsplit(".", 1)[0] in leg.leg.joints)
    assert html.count(">not measured<") == held


def test_marks_do_not_rest_on_colour_alone(result, page):
    symbols = {"observable": "●", "partial": "◐", "unobservable": "○"}
    marked = [(kind, text) for kind, text in page.rows if kind in symbols]
    (leg,) = result.legs
    measured = [q for name, q in leg.parameters.items() if name.rsplit(".", 1)[0] in leg.leg.links and not q.is_held]
    combinations = [Quantity(c.prior, c.value, c.std, c.verdict, c.unit) for c in leg.combinations]
    assert len(marked) == len(measured) + sum(not quantity.is_held for quantity in combinations)
    assert all(text.startswith(symbols[kind]) for kind, text in marked)
    for joint in leg.leg.joints:
        drive = next(text for _, text in page.rows if text.startswith(joint) and "±" in text)
        assert sum(drive.count(symbol) for symbol in symbols.values()) == 4


def test_drives_come_before_errors_and_legs_are_folded(html):
    places = [html.index(f'id="{name}"') for name in ("drives", "errors", "remarks", "RH", "log", "how")]
    assert places == sorted(places)
    many = html[html.index('id="log"') :]
    assert many.index("<details>") < many.index("What was done to the log")


def test_warnings_of_legs_that_differ_in_numbers_are_one(result):
    (leg,) = result.legs
    legs = [
        replace(leg, leg=replace(leg.leg, name=name), warnings=(f"poor: {rank} of 33 by 0.{rank}",))
        for name, rank in (("LF", 13), ("RF", 9))
    ]
    texts = [remark.text for remark in remarks(replace(result, legs=tuple(legs)))]
    assert "LF, RF: poor: 9 to 13 of 33 by 0.13 to 0.9" in texts


def test_shows_errors_of_every_joint_and_their_unit(result, page):
    (leg,) = result.legs
    for joint, rmse in leg.rmse["validation"]["identified"].items():
        assert any(joint in text and number(rmse, 3) in text for _, text in page.rows)
    assert "N·m" in page.text


def test_every_figure_has_axes_with_units(result):
    figures = [figure for figure in result.to_figures().values() if isinstance(figure, Figure)]
    assert len(figures) == 4
    for figure in figures:
        titles = [axis.title for panel in figure.panels for axis in (panel.x, panel.y) if axis.title]
        assert titles
        assert all(re.search(r"\[.+\]$", title) for title in titles)


def test_bad_news_comes_first(result):
    bad = replace(result, trust=Trust("bad", 40.0, {"RH": 40.0}, ("the torque of 'rh_kfe_joint' is reversed",)))
    page = _Page(bad.to_html())
    assert page.text.index("Do not use these numbers") < page.text.index("the torque of 'rh_kfe_joint' is reversed")
    assert page.text.rindex("is reversed") < page.text.index("identified, all") < page.text.index("2 % of the")


def test_a_fit_without_validation_is_said_and_not_condemned(result):
    (leg,) = result.legs
    unvalidated = replace(result, legs=(replace(leg, rmse={"training": leg.rmse["training"]}),), validated_on=None)
    page = _Page(unvalidated.to_html())
    assert "nothing was held out" in page.text
    assert f"Trust: {result.trust.verdict}" in page.text
    assert "Do not use" not in page.text


def test_traces_whose_times_overlap_are_not_drawn_over_each_other(result):
    (leg,) = result.legs
    first, second = leg.traces
    assert plotted_traces([second, first]) == [first, second]
    again = TorqueTrace("validation", first.time, first.measured, first.predicted)
    assert plotted_traces([first, again]) == [again]


def test_gaps_are_drawn_as_gaps(result):
    (leg,) = result.legs
    (trace, _) = leg.traces
    late = np.where(np.arange(len(trace.time)) < 300, trace.time, trace.time + 10.0)
    figure = torque_figure(replace(leg, traces=(replace(trace, time=late),)))
    for panel in figure.panels:
        drawn = panel.marks[0]
        (gap,) = np.flatnonzero(np.isnan(drawn.y))
        assert drawn.x[gap + 1] - drawn.x[gap - 1] > 10.0


def test_no_traces_no_plots(result):
    (leg,) = result.legs
    assert error_figure(replace(leg, traces=())).is_empty
    without = replace(result, legs=(replace(leg, traces=()),)).to_html()
    assert len(_Page(without).figures) == 1
