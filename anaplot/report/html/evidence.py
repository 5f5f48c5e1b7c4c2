"""What a block's report says beside its adjustment: models, plates, what sessions did."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from anaplot.aliases import Progress
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import check_for_bridge
from anaplot.orientation.strip import BridgedStrip
from anaplot.orientation.strip import bridge as bridge_strips
from anaplot.photogrammetry.block import Block
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.bridgecommand import BridgedBlock, bridge_document
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import say
from anaplot.report.figures.bridged import figures_of_models
from anaplot.report.figures.correlations import parameter_matrix
from anaplot.report.figures.imageunits import image_units
from anaplot.report.html.parts import Section
from anaplot.report.html.sections.givenpoints import given_points_section
from anaplot.report.html.sections.grosserrors import rejected_section
from anaplot.report.html.sections.innerorientations import (
    OrientedPlate,
    inner_section,
    plates_in,
)
from anaplot.report.html.sections.models import models_section
from anaplot.report.html.sections.parametermatrix import parameter_matrix_section
from anaplot.report.html.sections.photoresiduals import photo_residuals_section
from anaplot.report.html.sections.photos import photos_section
from anaplot.report.html.sections.switchedoff import protocol_blocks, switched_off_section
from anaplot.report.keptblock import without_rejected
from anaplot.report.logcommand import log_document
from anaplot.station.sessionlog import read_log
from anaplot.textfiles.wording import typed_path

__all__ = ["Bridged", "block_plates", "bridged_strips", "evidence_sections"]

Bridged: TypeAlias = tuple[BridgedStrip, ...] | str
"""The strips of a block, or why they are not bridged."""

_PROTOCOL = "Protocol of the measurements"


def block_plates(folder: Path, fiducials: Iterable[Path] = ()) -> tuple[OrientedPlate, ...]:
    """Return the inner orientations of a block's journal, and those of fiducial files.

    Parameters
    ----------
    folder
        The block's folder. Of a journal that cannot be read there is none: the protocol says why.
    fiducials
        Files as `inner` takes them.

    Raises
    ------
    InputError
        A file of fiducials is wrong.
    """
    own = plates_in(None, fiducials)
    if not _has_journal(folder):
        return own
    try:
        return plates_in(folder) + own
    except InputError:
        return own


def evidence_sections(
    found: Computed[BlockAdjustment],
    folder: Path | None = None,
    plates: Sequence[OrientedPlate] = (),
    bridged: Bridged | None = None,
    progress: Progress | None = None,
) -> tuple[Section, ...]:
    """Return what is said of a block beside its adjustment, in the order of the page.

    Parameters
    ----------
    found
        What `adjust` has returned.
    folder
        The block's folder, which is only read; None: there are no models and no journal.
    plates
        Inner orientations, from `block_plates`.
    bridged
        From `bridged_strips`; None: they are bridged here.
    progress
        Told of every step; may raise to end it.
    """
    sections = []
    for section in _sections(found, folder, plates, bridged, progress):
        if progress is not None:
            progress("the page", 0.0)
        if section is not None:
            sections.append(section)
    return tuple(sections)


def bridged_strips(block: Block, progress: Progress | None = None) -> Bridged:
    """Return the strips of a block, or why they are not bridged; `progress` is told of models."""
    try:
        check_for_bridge(block)
        return bridge_strips(block, progress)
    except InputError as error:
        return str(error)


def _sections(
    found: Computed[BlockAdjustment],
    folder: Path | None,
    plates: Sequence[OrientedPlate],
    bridged: Bridged | None,
    progress: Progress | None,
) -> Iterator[Section | None]:
    answer = found.document.answer
    yield photos_section(answer)
    yield photo_residuals_section(found.result.block)
    yield given_points_section(answer)
    yield parameter_matrix_section(answer, parameter_matrix(found.result.block))
    yield rejected_section(found.result)
    if folder is not None and found.result.block.problem.block.strips:
        adjusted = found.result.block
        if bridged is None:
            bridged = bridged_strips(without_rejected(adjusted), progress)
        yield _models(adjusted, bridged, progress)
    yield inner_section(plates)
    yield switched_off_section(answer)
    if folder is not None:
        yield _protocol(folder)


def _has_journal(folder: Path) -> bool:
    return os.path.lexists(folder / "sessions")


def _models(adjusted: AdjustedBlock, strips: Bridged, progress: Progress | None) -> Section | None:
    """Return the models as `bridge` has them; accidents are looked for once, for the verdict."""
    if isinstance(strips, str):
        return Section("models", "Models", (say("Strips are not bridged: {}", strips),))
    block = without_rejected(adjusted)
    figure = figures_of_models(BridgedBlock(strips), image_units(block).small)
    section = models_section(bridge_document(block, strips, progress=progress).answer, figure)
    gone = len(adjusted.problem.block.image_points) - len(block.image_points)
    if section is None or not gone:
        return section
    line = say("Without {} of which the adjustment rejects a coordinate.",
               counted(gone, "image point")).of("remark")  # fmt: skip
    return replace(section, blocks=(line, *section.blocks))


def _protocol(folder: Path) -> Section:
    if not _has_journal(folder):
        return Section("protocol", _PROTOCOL, protocol_blocks(None))
    try:
        log = log_document(read_log(folder))
    except InputError as error:
        said = say("The journal cannot be read: {}", str(error)).of("look")
        return Section("protocol", _PROTOCOL, (said,))
    return Section("protocol", _PROTOCOL, protocol_blocks(log, typed_path(folder)))
