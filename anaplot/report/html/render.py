"""A report as HTML: one page that needs nothing beside it.

Everything goes through one template with autoescape, so that what a file says is never markup. The
page's policy lets nothing be loaded, and lets no style or script run but the two that are in it.
"""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from anaplot.drawing.palette import declarations
from anaplot.drawing.style import STYLE
from anaplot.report.html.parts import Report
from anaplot.report.html.views import PageView, page_view
from anaplot.version import __version__

if TYPE_CHECKING:
    from jinja2 import Template

__all__ = ["html_of", "is_report"]

_GENERATOR = "anaplot"


def html_of(report: Report | PageView) -> str:
    """Return a report as HTML, or what of it stands on a page."""
    page = report if isinstance(report, PageView) else page_view(report)
    style, script = _style(), _part("page.js")
    policy = (
        f"default-src 'none'; style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    return _template().render(
        title=page.title,
        lead=page.lead,
        verdict=page.verdict,
        sections=page.sections,
        style=style,
        script=script,
        policy=policy,
        generator=f"{_GENERATOR} {__version__}",
    )


def is_report(head: bytes) -> bool:
    """Return whether a file that begins like this is a report."""
    return head.startswith(b"<!DOCTYPE html>") and f'content="{_GENERATOR} '.encode() in head


@cache
def _template() -> Template:
    """Return the page's template; loaded when a report is written."""
    from jinja2 import DictLoader, Environment, StrictUndefined

    environment = Environment(
        loader=DictLoader({"page.html": _part("page.html")}),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    return environment.get_template("page.html")


def _style() -> str:
    """Return the page's style with that of its drawings, dark only on a screen that is."""
    return (
        f":root{{{declarations('light')}}}\n"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{declarations('dark')}}}}}\n"
        + STYLE
        + _part("page.css")
    )


@cache
def _part(name: str) -> str:
    return files("anaplot.report.html").joinpath("templates", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
