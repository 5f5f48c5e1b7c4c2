"""The sections of a block's report, in the order of the page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.block import Block
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.computed import Computed
from anaplot.report.html.evidence import evidence_sections
from anaplot.report.html.parts import Section
from anaplot.report.html.sections.adjusted import adjusted_sections
from anaplot.report.html.sections.innerorientations import OrientedPlate

__all__ = ["Material", "block_sections"]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """What a block's report is made of.

    Attributes
    ----------
    adjusted
        What `adjust` has returned.
    folder
        Where the block comes from, with its journal and fiducials; None: from a program.
    plates
        Inner orientations of its photos.
    """

    adjusted: Computed[BlockAdjustment]
    folder: Path | None = None
    plates: tuple[OrientedPlate, ...] = ()

    @property
    def block(self) -> AdjustedBlock:
        """The adjusted block, without what is rejected."""
        return self.adjusted.result.block

    @property
    def measured(self) -> Block:
        """The block as it was read."""
        return self.block.problem.block


def block_sections(material: Material) -> tuple[Section, ...]:
    """Return the sections of a block's report; one that has nothing to say is left out."""
    return tuple(section for section in _sections(material) if section is not None)


def _sections(material: Material) -> Iterator[Section | None]:
    yield from adjusted_sections(material.adjusted.document)
    yield from evidence_sections(material.adjusted, material.folder, material.plates)
