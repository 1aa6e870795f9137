"""Every settings class refuses numbers that are none, where it is made, in one line."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields

import pytest

from stadera.errors import StaderaError
from stadera.excite.design import ExciteSettings
from stadera.excite.optimise import FourierSearch
from stadera.identify.settings import LagSettings, SignalSettings, TrustSettings
from stadera.identify.solutions import SolverSettings
from stadera.live.state import LiveSettings
from stadera.logs.bags.container import BagSettings
from stadera.robot.stance import StanceSettings
from stadera.trunk.settings import ChangeSettings, ModelErrors, OutlierSettings, SwingDetection
from stadera.weigh.settings import WeighSettings

SETTINGS = (
    BagSettings,
    ChangeSettings,
    ExciteSettings,
    FourierSearch,
    LagSettings,
    LiveSettings,
    ModelErrors,
    OutlierSettings,
    SignalSettings,
    SolverSettings,
    StanceSettings,
    SwingDetection,
    TrustSettings,
    WeighSettings,
)


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda settings: settings.__name__)
def test_what_is_no_number_is_refused(settings: type) -> None:
    made = settings()
    numbers = [f.name for f in fields(settings) if type(getattr(made, f.name)) is float]
    assert numbers
    for name in numbers:
        with pytest.raises(StaderaError) as error:
            settings(**{name: float("nan")})
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda settings: settings.__name__)
def test_settings_are_frozen_and_documented(settings: type) -> None:
    with pytest.raises(AttributeError):
        setattr(settings(), fields(settings)[0].name, 1.0)
    source = inspect.getsource(settings)
    for name in (f.name for f in fields(settings)):
        at_field = rf"^    {name}: .*  # \S|^    # .*\n    {name}: |^    # .*\b{name}\b.*: "
        assert name in (settings.__doc__ or "") or re.search(at_field, source, re.MULTILINE), name
