"""What a report is made of: sections of lines, tables and drawings.

A report is a document for a page: it holds the same lines and tables as `report/document.py`, so
that what is read there is what `--json` writes, and drawings beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

from anaplot.drawing.drawing import Drawing
from anaplot.report.document import Line, Listed, Table

__all__ = [
    "Captioned",
    "Defined",
    "Definitions",
    "Facts",
    "HtmlBlock",
    "Report",
    "Section",
    "drawings_in",
    "tables_in",
    "with_blocks",
]


@dataclass(frozen=True, slots=True, eq=False)
class Captioned:
    """A table with a caption of its own: of which model, of which photo it is."""

    table: Table
    caption: Line


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """What belongs to some words, one below the other: "Redundancy", "66"."""

    items: tuple[tuple[str, Line], ...]


class Defined(NamedTuple):
    """What columns mean: their titles, words, equation and source."""

    columns: str
    words: str
    equation: str
    source: str


@dataclass(frozen=True, slots=True, eq=False)
class Definitions:
    """What columns mean."""

    rows: tuple[Defined, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A part of a report under a heading.

    Attributes
    ----------
    key
        Its name in the page's addresses: small letters, digits, hyphens; once in a report.
    title
        Its heading; a name from a file may stand in it.
    blocks
        From top to bottom. A section within it has a heading one level below.
    folded
        Whether only the heading is shown until it is opened; on paper it always is.
    on_paper
        "columns": what is within it stands in two columns there; "beside": tables of few columns
        stand beside each other, and all of it on one page where it has room; "untitled": its
        heading is left out, since that of its drawing says the same.
    """

    key: str
    title: str | Line
    blocks: tuple[HtmlBlock, ...]
    folded: bool = False
    on_paper: Literal["", "columns", "beside", "untitled"] = ""


HtmlBlock: TypeAlias = Line | Listed | Table | Captioned | Facts | Definitions | Drawing | Section
"""A part of a section."""


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """A whole report.

    Attributes
    ----------
    title
        What it is about, in one line.
    verdict
        The answer in a few lines, before everything else; each may begin with a word and a colon.
    sections
        In the order of the page.
    provenance
        What was computed with which version, settings and files; None: nothing is known of it.
    lead
        Stands under the title: by what and when; None: nothing.
    """

    title: Line
    verdict: tuple[Line, ...]
    sections: tuple[Section, ...]
    provenance: Section | None = None
    lead: Line | None = None

    @property
    def all_sections(self) -> tuple[Section, ...]:
        """The sections, and the provenance at the end."""
        return self.sections + (() if self.provenance is None else (self.provenance,))


def with_blocks(
    sections: Iterable[Section], change: Callable[[HtmlBlock], HtmlBlock]
) -> tuple[Section, ...]:
    """Return sections with every part changed, also within those within them."""

    def changed(block: HtmlBlock) -> HtmlBlock:
        return of(block) if isinstance(block, Section) else change(block)

    def of(section: Section) -> Section:
        return replace(section, blocks=tuple(map(changed, section.blocks)))

    return tuple(map(of, sections))


def tables_in(sections: Iterable[Section]) -> Iterator[Table]:
    """Yield all tables, from top to bottom."""
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Table):
                yield block
            elif isinstance(block, Captioned):
                yield block.table
            elif isinstance(block, Section):
                yield from tables_in((block,))


def drawings_in(sections: Iterable[Section]) -> Iterator[Drawing]:
    """Yield all drawings, from top to bottom."""
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Drawing):
                yield block
            elif isinstance(block, Section):
                yield from drawings_in((block,))
