"""An adjusted block as `adjust` prints it, part by part: nothing of its page is left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from anaplot.report.astext import line_text
from anaplot.report.document import Block, Document, Figure, Line, Table
from anaplot.report.html.parts import HtmlBlock, Section

__all__ = ["adjustment_section", "part_sections", "table_section"]


class _Part(NamedTuple):
    """A part of a page: how its heading begins, its address and its title in a report."""

    begins: str
    key: str
    title: str


_PARTS = (
    _Part("BLOCK", "adjustment", "The adjustment in its own words"),
    _Part("STEP 1", "errors-images", "Search for gross errors: the images, without control"),
    _Part("STEP 2", "errors-control", "Search for gross errors: control"),
    _Part("GROSS ERRORS", "errors", "Search for gross errors"),
    _Part("THINNING", "thinning", "Points that were left out, and what that costs"),
    _Part("GIVEN", "given", "What was known from an earlier adjustment"),
    _Part("CHOICE", "choice", "How additional parameters were chosen"),
    _Part("CALIBRATION", "calibration", "Calibration of the cameras"),
    _Part("DOMING", "doming", "What the calibration does to heights"),
    _Part("OFFSETS", "offsets", "Positions and angles measured in flight"),
    _Part("HYPOTHESES", "hypotheses", "Tests of hypotheses"),
    _Part("CONTROL AND CHECK POINTS", "control-pages", "Control and check points, one by one"),
    _Part("PRIOR KNOWLEDGE", "prior", "How good the prior knowledge is"),
    _Part("VARIANCE COMPONENTS", "components", "Variance components"),
    _Part("MODIFIED DATA SNOOPING", "snooping", "Modified data snooping beside the exact test"),
    _Part("CORRELATED RESIDUALS", "correlated-rays", "Correlated residuals of a point's rays"),
    _Part("COVARIANCE", "covariance", "Covariances that were asked for"),
    _Part("POSTERIOR", "posterior", "What was written for the next adjustment"),
)
_SETS = _Part("  SET ", "test-sets", "Observations tested together")
_APART = {"functions": _Part("", "functions", "Functions of coordinates")}


def adjustment_section(document: Document) -> Section | None:
    """Return what `adjust` says of the block in lines, before its tables."""
    first = next((part for part in _split(document) if part.key == "adjustment"), None)
    if first is None:
        return None
    return replace(first, blocks=_but_tables(first.blocks))


def _but_tables(blocks: Iterable[HtmlBlock]) -> tuple[HtmlBlock, ...]:
    return tuple(block for block in blocks if not isinstance(block, Table))


def table_section(
    document: Document, key: str, title: str, *, folded: bool = False
) -> Section | None:
    """Return a section of one table of the block's page; None where the page has none."""
    found = next((b for b in document.page if isinstance(b, Table) and b.key == key), None)
    return None if found is None else Section(key.replace("_", "-"), title, (found,), folded)


def part_sections(document: Document) -> tuple[Section, ...]:
    """Return a section of every part that an option added to the page, in its order."""
    return tuple(part for part in _split(document) if part.key != "adjustment")


def _split(document: Document) -> Iterator[Section]:
    """Yield the parts of a page, each from its heading to the next."""
    part: _Part | None = None
    blocks: list[HtmlBlock] = []
    for block in document.page:
        begins = _begins(block)
        if begins is not None and begins.key == "errors" and part is not None:
            begins = None if part.key.startswith("errors-") else begins  # within its step
        if begins is not None:
            if part is not None:
                yield Section(part.key, part.title, tuple(blocks))
            part, blocks = begins, []
        blocks += _kept(block, begins)
    if part is not None:
        yield Section(part.key, part.title, tuple(blocks))


def _begins(block: Block) -> _Part | None:
    """Return the part that begins here, or None: headings within a part stand further in."""
    if isinstance(block, Table):
        return _APART.get(block.key)
    if not isinstance(block, Line) or block.kind != "heading":
        return None
    text = line_text(block)
    known = next((part for part in (*_PARTS, _SETS) if text.startswith(part.begins)), None)
    if known is not None or text.startswith(" "):
        return known
    title = text.split("  ")[0].split(":")[0]
    return _Part(title, "part", title.capitalize())


def _kept(block: Block, begins: _Part | None) -> list[HtmlBlock]:
    """Return a block as a report has it; the heading of a part says more than its title."""
    if isinstance(block, Figure):
        return [Line((line,), indent=None) for line in block.lines(block.data)]
    if begins is None or not isinstance(block, Line):
        return [block]
    return [block.of("text")]
