"""Several methods on several logs, side by side."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stadera import IdentificationError, UnknownNameError, load_robot
from stadera.lab.plant.sensors import STANDARD
from stadera.logs import write_table
from stadera.weigh import weigh
from stadera.weigh.compare import compare
from standing import static_log
from walking import Walk, recorded, walked

HYQ = load_robot("hyq")
OWN = f"{Path(__file__).parents[2] / 'examples' / 'own_estimator.py'}:MeanMass"


def walk(folder: Path) -> Path:
    return write_table(recorded(HYQ, walked(HYQ, Walk(seconds=3.0, rate_hz=250.0)), STANDARD, 0), folder / "walk.csv")


def test_each_method_weighs_each_log(tmp_path: Path) -> None:
    found = compare("hyq", [static_log(HYQ), walk(tmp_path)], ["walking", "poses", OWN])
    assert [(each.log, each.label) for each in found.entries] == [
        (log, method)
        for log in ("recording", "walk.csv")
        for method in ("walking", "poses", "own_estimator.py:MeanMass")
    ]
    by = {(each.log, each.label): each for each in found.entries}
    assert by["walk.csv", "poses"].weighing is None
    assert by["walk.csv", "poses"].refusal
    alone = weigh(HYQ, static_log(HYQ), method="poses")
    weighed = by["recording", "poses"].weighing
    assert weighed is not None
    assert weighed.mass == alone.mass
    estimates, *curves = found.to_figures().values()
    assert len(curves) == 2
    (panel,) = estimates.panels
    assert len(panel.marks[0].x) == sum(each.weighing is not None for each in found.entries)
    low, high = panel.marks[0].x_range
    at = panel.y.labels.index("poses, recording")
    assert high[at] - low[at] == pytest.approx(4.0 * weighed.mass_std)
    assert "refused" in found.to_latex()


def test_a_table_a_page_and_json(run: Callable[..., Any], tmp_path: Path) -> None:
    log, values, page = walk(tmp_path), tmp_path / "c.json", tmp_path / "c.html"
    asked = ("--methods", "walking,contact", "--json", values, "--report", page)
    done = run("compare", log, "--robot", "hyq", *asked)
    assert done.code == 0, done.err
    assert "walking" in done.out
    entries = json.loads(values.read_text())["entries"]
    assert [entry["method"] for entry in entries] == ["walking", "contact"]
    assert entries[0]["weighing"]["trunk"]["mass"]["std"] > 0.0
    text = page.read_text()
    assert "Over time: walk.csv" in text
    assert "contact on walk.csv" in text
    assert re.search(r">Trunk \S{4,5}\s±\s\S{3,4}\skg by walking", text)


def test_curves_have_bands_and_payloads_in_their_method_s_colour(tmp_path: Path) -> None:
    found = compare("hyq", walk(tmp_path), ["walking", OWN], tare=(0.0, 1.5))
    _, curves = found.to_figures().values()
    mass, payload = curves.panels
    for panel in (mass, payload):
        lines = {mark.name: mark.colour for mark in panel.marks if not mark.fill}
        bands = {mark.name: mark.colour for mark in panel.marks if mark.fill}
        assert lines == bands == {"walking": "blue", "own_estimator.py:MeanMass": "orange"}
    assert re.search(r"\skg by walking and not determined by own_estimator.py:MeanMass\.", found.to_html())


def test_a_tare_may_be_another_log(run: Callable[..., Any], tmp_path: Path) -> None:
    log, values = walk(tmp_path), tmp_path / "c.json"
    done = run("compare", log, "--robot", "hyq", "--methods", "walking", "--tare", log, "--json", values)
    assert done.code == 0, done.err
    (entry,) = json.loads(values.read_text())["entries"]
    mass = entry["weighing"]["payload"]["mass"]
    assert abs(mass["value"]) < 3.0 * mass["std"]


def test_nothing_but_refusals_is_an_error(run: Callable[..., Any], tmp_path: Path) -> None:
    log, values = tmp_path / "empty.csv", tmp_path / "c.json"
    log.touch()
    done = run("compare", log, "--robot", "hyq", "--json", values)
    assert done.code == 1
    assert "the file is empty" in done.out
    assert f"wrote {values}" in "".join(done.out.splitlines())
    assert "no method gave a result" in done.err
    assert json.loads(values.read_text())["entries"][0]["weighing"] is None


def test_what_is_wrong_is_said() -> None:
    with pytest.raises(IdentificationError, match=r"--stiffness KX,KY,KZ .* which `stadera weigh` takes"):
        compare("hyq", static_log(HYQ), ["orientation"])
    with pytest.raises(UnknownNameError, match="walkng"):
        compare("hyq", static_log(HYQ), ["walkng"])
    with pytest.raises(IdentificationError, match="no such file"):
        compare("hyq", static_log(HYQ), ["nowhere.py:Mine"])
