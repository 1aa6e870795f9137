"""What every result offers: plain values, and files made of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from os import PathLike
from typing import Any

from stadera.files import write_text, written_together


class Result(ABC):
    """A result that can be saved. A file appears whole or not at all.

    Every `save_...` raises StaderaError for a path that cannot be written.
    """

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The result as plain values for JSON: SI units, null for what is not known."""

    @abstractmethod
    def to_html(self) -> str:
        """The report: one page that loads nothing."""

    def save_json(self, path: str | PathLike[str]) -> None:
        """Writes `to_dict` as JSON."""
        from stadera.report.json import json_text

        _save(path, json_text(self.to_dict()))

    def save_html(self, path: str | PathLike[str]) -> None:
        """Writes the report, to open in a browser."""
        _save(path, self.to_html())


def _save(path: str | PathLike[str], text: str) -> None:
    with written_together([path]) as (draft,):
        write_text(draft, text)
