"""Single wild samples: found, replaced and counted, and nothing else touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stadera
from identify.leg_runs import hyq, noisy, run
from stadera.identify.log import without_spikes
from stadera.identify.settings import IdentifySettings

RH = IdentifySettings(legs=("RH",), torque_lag=0.0)


def test_a_log_without_spikes_stays_as_it_is() -> None:
    for log in (run(), noisy(run(), 2.0, 1e-4), replace(run(), position=np.round(run().position, 3))):
        assert without_spikes(log) is log


def test_spikes_are_replaced_and_counted() -> None:
    clean = noisy(run(), 1.0)
    position, effort = clean.position.copy(), clean.channel("effort", clean.joints).copy()
    position[100, 0] += 0.5
    position[2000, 2] -= 3.0
    effort[500, 1] = 400.0
    found = without_spikes(replace(clean, position=position, effort=effort))
    assert found.notes[-1] == "replaced 3 wild values of position, effort"
    np.testing.assert_allclose(found.position, clean.position, atol=0.02)
    np.testing.assert_allclose(found.channel("effort", clean.joints), effort - (effort == 400.0) * 400.0, atol=40.0)


def test_from_where_on_a_sample_is_wild_is_a_setting() -> None:
    clean = run()
    effort = clean.channel("effort", clean.joints).copy()
    effort[500, 1] = 400.0
    log = replace(clean, effort=effort)
    assert without_spikes(log, wild=1e6) is log
    assert without_spikes(log) is not log


def test_a_step_is_no_spike() -> None:
    log = run()
    step = log.channel("effort", log.joints) + 50.0 * (log.time > 5.0)[:, None]
    assert without_spikes(replace(log, effort=step)).effort is step


def test_identification_does_not_suffer_from_them() -> None:
    clean = noisy(run(), 1.0, 1e-5)
    position = clean.position.copy()
    for joint in range(3):
        position[100 + 70 * joint :: 503, joint] += 0.3
    spoilt, fine = (
        stadera.identify(hyq(), replace(clean, position=p, source="log"), RH) for p in (position, clean.position)
    )
    std = np.sqrt(np.diag(fine.legs[0].estimate.covariance))
    assert spoilt.trust.verdict == "good"
    assert np.abs((spoilt.legs[0].estimate.values - fine.legs[0].estimate.values) / std).max() < 1.0


@pytest.mark.parametrize("samples", [2, 3])
def test_short_logs(samples: int) -> None:
    from identify.leg_runs import cut

    short = cut(run(), 0, samples)
    assert without_spikes(short) is short
