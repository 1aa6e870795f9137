"""Pages: one file with its style, script library and figures, made from a jinja2 template, that loads nothing.

A template extends `page.html.j2` and uses the parts of `parts.html.j2`. Other packages, such as the laboratory, keep
templates of their own in a folder `templates`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

import stadera
from stadera.report.look import style_variables
from stadera.report.numbers import number, with_std
from stadera.report.table import MARKS

if TYPE_CHECKING:
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False)
class Plot:
    """A figure on a page.

    Attributes:
        title: above it, and its label for screen readers.
        figure: as plotly has it.
        note: how to read it.
    """

    title: str
    figure: go.Figure
    note: str = ""

    @property
    def height(self) -> int:
        """Of the figure [px]."""
        return int(self.figure.layout.height or 400)

    @property
    def data(self) -> Markup:
        """The figure as JSON that cannot end its script element."""
        return script_data(self.figure.to_json())


def render(template: str, package: str = "stadera.report", **values: Any) -> str:
    """A whole page from a template; all text in `values` is escaped.

    Args:
        template: the file's name in the package's folder `templates`.
        package: where templates are looked for before this package.
        values: what the template shows.
    """
    return _environment(package).get_template(template).render(values)


def script_data(json: str) -> Markup:
    """JSON as the text of a script element, which it cannot end."""
    return Markup(json.replace("</", "<\\/"))


@cache
def _environment(package: str) -> Environment:
    folders = dict.fromkeys((package, "stadera.report"))
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(folder) for folder in folders]),
        autoescape=select_autoescape(("html.j2",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        "version": stadera.__version__,
        "marks": MARKS,
        "style_variables": lambda: Markup(style_variables()),
        "asset": lambda name, package=package: _asset(package, name),
        "plot_library": _plot_library,
    }
    environment.filters |= {"number": number, "with_std": with_std, "commands": _commands}
    return environment


def _asset(package: str, name: str) -> Markup:
    """A style or script from a folder `templates`, as it is."""
    return Markup((resources.files(package) / "templates" / name).read_text(encoding="utf-8"))


def _plot_library() -> Markup:
    """The script that draws figures, read only for a page that has some; see `vendor/README.md`."""
    return Markup((resources.files("stadera.report") / "vendor" / "plotly-basic.min.js").read_text(encoding="utf-8"))


def _commands(sentence: str) -> Markup:
    """A sentence with what is between backquotes as code."""
    parts = (Markup("<code>{}</code>" if k % 2 else "{}").format(part) for k, part in enumerate(sentence.split("`")))
    return Markup("").join(parts)
