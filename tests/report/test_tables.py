"""The tables of the terminal."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from stadera.report.findings import findings, is_alarming, overall_rmse, torque_rms
from stadera.report.quantities import shown
from stadera.report.tables import identification_tables, link_table


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
    for quantity in leg.parameters.values():
        if quantity.unit != "kg·m":  # shown as the centre of mass
            assert shown(quantity, "prior") in printed


def test_colours_of_table_one(result):
    console = Console(file=StringIO(), width=160, force_terminal=True, color_system="standard")
    console.print(link_table(result.legs[0]))
    printed = console.file.getvalue()
    assert "\x1b[32m●" in printed
    assert "\x1b[90m◐" in printed
    assert "\x1b[31m○" in printed


def test_overall_error_is_the_root_of_the_mean_square(result):
    (leg,) = result.legs
    errors = leg.rmse["validation"]["prior"].values()
    assert overall_rmse(result, "validation")["prior"] == pytest.approx((sum(e**2 for e in errors) / 3) ** 0.5)
    assert torque_rms(leg, "validation")["rh_haa_joint"] > leg.rmse["validation"]["identified"]["rh_haa_joint"]


def test_findings_are_said_once_and_the_worst_first(result):
    (leg,) = result.legs
    both = replace(result, legs=(leg, replace(leg, leg=replace(leg.leg, name="LH"))))
    texts = [finding.text for finding in findings(both)]
    assert sum("rotor inertia" in text for text in texts) == 1
    assert next(text for text in texts if "rotor inertia" in text).startswith("RH, LH: ")
    assert [finding.level for finding in findings(both)] == ["warning", "warning", "note"]
    assert not is_alarming(both)


def test_no_better_than_cad_is_alarming(result):
    (leg,) = result.legs
    models = leg.rmse["validation"]
    worse = {**models, "identified": {joint: 1.01 * error for joint, error in models["prior_friction"].items()}}
    assert is_alarming(replace(result, legs=(replace(leg, rmse={"validation": worse}),)))
