"""The tables of an adjusted block, as `adjust` prints them."""

from __future__ import annotations

from anaplot.report.document import Document, Line, Table
from anaplot.report.html.parts import Section

__all__ = ["adjusted_sections"]


def adjusted_sections(document: Document) -> tuple[Section, ...]:
    """Return a section for each table of a block's page, and one for what is said around them."""
    lines = tuple(block for block in document.page if not isinstance(block, Table))
    said = Section("adjustment", "The adjustment", tuple(b for b in lines if isinstance(b, Line)))
    tables = tuple(block for block in document.page if isinstance(block, Table))
    return (said, Section("tables", "Tables", tables))
