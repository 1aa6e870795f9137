"""Figures as plain values, drawn by Plotly (pages) and by Matplotlib (papers)."""

from stadera.report.figures.model import Axis, Bars, Figure, Guide, Panel, Series, band, line, stacked

__all__ = ["Axis", "Bars", "Figure", "Guide", "Panel", "Series", "band", "line", "stacked"]
