"""Makes self-contained pages from jinja2 templates, with style, script library and figures included.

A template extends `page.html.j2` and uses the macros of `parts.html.j2`. Other packages, such as the laboratory, keep
their templates in a folder `templates`.
"""

from __future__ import annotations

from functools import cache, partial
from importlib import resources
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

import stadera
from stadera.report.figures import plotly
from stadera.report.look import style_variables
from stadera.report.numbers import number, with_std
from stadera.report.table import MARKS


def render(template: str, package: str = "stadera.report", **values: Any) -> str:
    """Renders a page from a template in the folder `templates` of a package, or of this one; text is escaped."""
    return _environment(package).get_template(template).render(values)


def script_data(json: str) -> Markup:
    """JSON as the text of a script element, which it cannot terminate."""
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
        "asset": partial(_asset, package=package),
        "plotly": plotly,
    }
    environment.filters |= {"number": number, "with_std": with_std, "commands": commands}
    return environment


def _asset(name: str, package: str, folder: str = "templates") -> Markup:
    """A style or script, unescaped."""
    return Markup((resources.files(package) / folder / name).read_text(encoding="utf-8"))


def commands(sentence: str) -> Markup:
    """A sentence with the parts between backquotes as code."""
    parts = (Markup("<code>{}</code>" if k % 2 else "{}").format(part) for k, part in enumerate(sentence.split("`")))
    return Markup("").join(parts)
