"""Figures of experiments as plots."""

from __future__ import annotations

import numpy as np

from stadera.lab.experiments.result import FigureData, Line, Panel
from stadera.lab.report.experiments.plots import panels_figure


def test_each_panel_has_the_scale_it_asks_for() -> None:
    x = np.arange(4.0)
    line = Line("error", "measured", x, 10.0**-x)
    panels = tuple(Panel("panel", "time [s]", "error [m]", (line,), log_y=log) for log in (False, True))
    figure = panels_figure(FigureData("two", panels))
    assert (figure.layout.yaxis.type, figure.layout.yaxis2.type) == ("linear", "log")
    np.testing.assert_allclose(figure.data[1].y[:4], line.y, rtol=1e-3)
