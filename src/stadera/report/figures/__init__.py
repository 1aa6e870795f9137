"""Figures as plain values, drawn as SVG (pages), by Plotly (interactive plots) and by Matplotlib (papers)."""

from stadera.report.figures.model import Axis, Bars, Figure, Guide, Panel, Series, band, line, stacked

__all__ = ["Axis", "Bars", "Figure", "Guide", "Panel", "Series", "band", "line", "stacked"]
