"""The JSON of an identification."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from stadera.inertia import ORDER
from stadera.results import json_text


def test_values_are_the_estimates(result):
    found = result.to_dict()
    (leg,) = result.legs
    by_name = leg.estimate.by_name()
    for link in leg.leg.links:
        entry = found["links"][link]
        assert entry["mass"]["value"] == by_name[f"{link}.m"]
        assert [entry["inertia"][n.removeprefix("I")]["value"] for n in ORDER[4:]] == [
            by_name[f"{link}.{n}"] for n in ORDER[4:]
        ]
        moments = [by_name[f"{link}.mc{axis}"] for axis in "xyz"]
        assert [q["value"] * by_name[f"{link}.m"] for q in entry["com"]] == pytest.approx(moments)
    for joint in leg.leg.joints:
        for term, entry in found["joints"][joint].items():
            assert entry["value"] == by_name[f"{joint}.{term}"]
    assert found["rank"] == leg.estimate.observability.rank
    assert found["parameters"] == len(leg.estimate.columns)
    assert found["rmse"]["validation"]["identified"] == leg.rmse["validation"]["identified"]


def test_what_is_not_measured_has_no_std(result):
    found = result.to_dict()
    quantities = [
        q for link in found["links"].values() for q in (link["mass"], *link["com"], *link["inertia"].values())
    ]
    assert any(q["observability"] == "unobservable" for q in quantities)
    assert any(q["observability"] == "observable" for q in quantities)
    for quantity in quantities:
        if quantity["observability"] == "unobservable":
            assert quantity["std"] is None
        if quantity["observability"] == "observable":
            assert quantity["std"] > 0
    assert all(link["mass"]["std"] is None for link in found["links"].values())


def test_it_is_strict_json(result):
    found = result.to_dict()
    assert json.loads(json_text(found)) == found
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_text(replace(result, torque_lag=float("nan")).to_dict())
