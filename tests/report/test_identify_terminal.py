"""The tables of the terminal."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from stadera.identify.varying import VARYING_UNITS
from stadera.report.identify.tables import (
    identification_tables,
    link_table,
    overall_rmse,
    remarks,
    shown,
    torque_rms,
)
from stadera.report.table import rich_table
from stadera.trust import Trust


def _printed(*renderables: object) -> str:
    console = Console(file=StringIO(), width=160, force_terminal=False)
    for renderable in renderables:
        console.print(renderable)
    return console.file.getvalue()


def test_every_parameter_is_there_with_its_unit(result):
    printed = _printed(*identification_tables(result))
    for label in ("mass [kg]", "com x [m]", "Ixx [kg·m²]", "armature [kg·m²]", "viscous [N·m·s/rad]", "coulomb [N·m]"):
        assert label in printed
    (leg,) = result.legs
    for name, quantity in leg.parameters.items():
        varies = name.rsplit(".", 1)[1] in VARYING_UNITS  # shown where a joint shows it
        if not varies and quantity.unit != "kg·m":  # shown as the centre of mass
            assert shown(quantity, "prior") in printed


def test_colours_of_table_one(result):
    console = Console(file=StringIO(), width=160, force_terminal=True, color_system="standard")
    console.print(rich_table(link_table(result.legs[0])))
    printed = console.file.getvalue()
    assert "\x1b[32m●" in printed
    assert "\x1b[90m◐" in printed
    assert "\x1b[31m○" in printed


def test_overall_error_is_the_root_of_the_mean_square(result):
    (leg,) = result.legs
    errors = leg.rmse["validation"]["prior"].values()
    assert overall_rmse(result, "validation")["prior"] == pytest.approx((sum(e**2 for e in errors) / 3) ** 0.5)
    assert torque_rms(leg, "validation")["rh_haa_joint"] > leg.rmse["validation"]["identified"]["rh_haa_joint"]


def test_remarks_are_said_once_and_the_worst_first(result):
    (leg,) = result.legs
    both = replace(result, legs=(leg, replace(leg, leg=replace(leg.leg, name="LH"))))
    texts = [remark.text for remark in remarks(both)]
    assert sum("rotor inertia" in text for text in texts) == 1
    assert next(text for text in texts if "rotor inertia" in text).startswith("RH, LH: ")
    assert [remark.level for remark in remarks(both)] == ["warning", "warning", "note"]


def test_trust_is_the_last_word(result):
    printed = _printed(*identification_tables(result))
    assert printed.index(f"Trust: {result.trust.verdict}, misfit") > printed.rindex("warning: ")
    assert "✗" not in printed


def test_every_figure_of_a_bad_result_is_marked(result):
    bad = replace(result, trust=Trust("bad", 40.0, {"RH": 40.0}, ("the torque of 'rh_kfe_joint' is reversed",)))
    printed = _printed(*identification_tables(bad))
    assert "problem: the torque of 'rh_kfe_joint' is reversed" in printed
    rows = [line for line in printed.splitlines() if any(mark in line for mark in "●◐○") and "observable  " not in line]
    assert len(rows) > 10
    assert all(line.count("✗") == sum(line.count(mark) for mark in "●◐○") for line in rows)
