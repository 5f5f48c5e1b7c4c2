"""The sections of a block's report, in the order of the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from anaplot.aliases import Progress
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.block import Block
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.blocksummary import summary_tables
from anaplot.report.computed import Computed
from anaplot.report.document import Line, Table
from anaplot.report.html.evidence import Bridged, bridged_strips, evidence_sections
from anaplot.report.html.lengths import sections_with_lengths_of
from anaplot.report.html.parts import Section
from anaplot.report.html.sections.adjusted import (
    adjustment_section,
    part_sections,
    table_section,
)
from anaplot.report.html.sections.drawings import map_section, maps_section, residuals_section
from anaplot.report.html.sections.glance import (
    accuracy_section,
    glance_section,
)
from anaplot.report.html.sections.innerorientations import OrientedPlate
from anaplot.report.keptblock import without_rejected
from anaplot.report.statuscommand import adjusted_status
from anaplot.station.blockstatus import BlockStatus

__all__ = ["Material", "block_sections"]

_TABLES = (
    ("check", "Check points"),
    ("control", "Control as observations"),
    ("conditions", "Conditions between points"),
    ("point_priors", "Priors of points"),
    ("priors", "What was known before"),
    ("photos", "Orientations of the photos"),
    ("points", "Points"),
    ("rays", "Image coordinates"),
)
_EARLY = ("photo-checks", "given-points", "parameter-correlations")
_FOLDED = ("photos", "points", "rays")


@dataclass(frozen=True, eq=False)
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
    free
        What is said of a free datum that nobody asked for; None: nothing.
    progress
        Told of every step; may raise to end it.
    """

    adjusted: Computed[BlockAdjustment]
    folder: Path | None = None
    plates: tuple[OrientedPlate, ...] = ()
    free: Line | None = None
    progress: Progress | None = None

    @cached_property
    def summary(self) -> Mapping[str, Table]:
        """Accuracies and correlations in a few rows."""
        answer = self.adjusted.document.answer
        names = ("photos", "points", "photo_correlations")
        return summary_tables(self.block, *(answer[name] for name in names))

    @cached_property
    def status(self) -> BlockStatus:
        """Where the block stands."""
        bridged = () if isinstance(self.bridged, str) else self.bridged
        return adjusted_status(self.folder, self.measured, self.block, bridged, self.progress)[0]

    @cached_property
    def bridged(self) -> Bridged:
        """Its strips without what is rejected, for the verdict and for the models."""
        return bridged_strips(without_rejected(self.block), self.progress)

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
    found = (section for section in _told(material) if section is not None)
    return sections_with_lengths_of(material.measured, found)


def _told(material: Material) -> Iterator[Section | None]:
    for section in _sections(material):
        if material.progress is not None:
            material.progress("the page", 0.0)
        yield section


def _sections(material: Material) -> Iterator[Section | None]:
    found, document = material.adjusted.result, material.adjusted.document
    evidence = evidence_sections(
        material.adjusted,
        material.folder,
        material.plates,
        material.bridged,
        material.progress,
    )
    by_key = {section.key: section for section in evidence}
    yield glance_section(found, document, material.free)
    yield by_key.pop("rejected", None)
    yield map_section(material.block)
    yield accuracy_section(document, material.summary)
    yield from (by_key.pop(key, None) for key in _EARLY)
    yield residuals_section(material.block)
    yield by_key.pop("photo-residuals", None)
    yield maps_section(material.block)
    yield adjustment_section(document)
    yield from part_sections(document)
    yield from by_key.values()
    for key, title in _TABLES:
        yield table_section(document, key, title, folded=key in _FOLDED)
