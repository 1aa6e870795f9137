"""Base class of results: plain values, tables, figures, and files made from them."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from math import isfinite
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

from stadera.errors import of_extra
from stadera.files import save_text, written_together

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawn

    from stadera.report.figures import Figure
    from stadera.report.table import TableData


class Result(ABC):
    """A result that can be saved. Files are written completely or not at all.

    Every `save_...` raises StaderaError if the path cannot be written. `report` is the module that shows the result, by
    functions `html`, `tables` and `figures`; empty if it has no tables and figures of its own.
    """

    report: ClassVar[str] = ""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The result as plain values for JSON: SI units, null for unknown values."""

    @abstractmethod
    def to_dataframe(self) -> Any:
        """The result's main table as a pandas DataFrame. Raises MissingExtraError: pandas is not installed."""

    def to_html(self) -> str:
        """The report as one self-contained HTML page."""
        return str(import_module(self.report).html(self))

    def to_tables(self) -> list[TableData]:
        """Tables of the report that are suited to a paper."""
        return list(import_module(self.report).tables(self)) if self.report else []

    def to_figures(self) -> Mapping[str, Figure | TableData]:
        """Figures of the report by name, the most informative first."""
        return dict(import_module(self.report).figures(self)) if self.report else {}

    def to_latex(self) -> str:
        """The tables as LaTeX. Needs the packages booktabs and amsmath."""
        from stadera.report.table import latex

        return latex(self.to_tables())

    def plot(self, which: str | None = None) -> Drawn:
        """Draws one figure of `to_figures` with Matplotlib, None for the first. Raises StaderaError if there are none,
        or none of that name, MissingExtraError if Matplotlib is not installed.
        """
        from stadera.report.figures.paper import drawn

        return drawn(self.to_figures(), which)

    def save_json(self, path: str | PathLike[str]) -> None:
        """Writes `to_dict` as JSON."""
        save_text(path, json_text(self.to_dict()))

    def save_html(self, path: str | PathLike[str]) -> None:
        """Writes the HTML report."""
        save_text(path, self.to_html())

    def save_figure(self, path: str | PathLike[str], which: str | None = None) -> None:
        """Writes a figure as .pdf, .png or .svg. Raises as `plot`, and StaderaError for another suffix."""
        from stadera.report.figures.paper import check_figure, save

        check_figure(path)
        with written_together([path]) as (draft,):
            save(self.plot(which), draft)

    def save_latex(self, path: str | PathLike[str]) -> None:
        """Writes `to_latex`."""
        save_text(path, self.to_latex())


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Makes a pandas DataFrame from named columns. Raises MissingExtraError: pandas is not installed."""
    with of_extra("pandas", "dataframe", "a data frame"):
        import pandas as pd  # type: ignore[import-untyped]
    return pd.DataFrame(columns)


def json_text(value: Any) -> str:
    """Indented JSON with a newline at the end. ValueError for NaN and infinity."""
    return json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def finite_or_none(value: float) -> float | None:
    """A number for JSON, which has none for NaN and infinity."""
    return float(value) if isfinite(value) else None
