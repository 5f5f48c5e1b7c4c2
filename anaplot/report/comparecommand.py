"""`anaplot compare` and its call: epochs in, displacements and their document out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict, Unpack, overload

from anaplot.aliases import Progress
from anaplot.bundle.epochs.displacements import compare_series
from anaplot.bundle.epochs.displacementtests import EpochTests, epoch_tests
from anaplot.bundle.epochs.seriestests import SeriesTests, series_tests
from anaplot.errors import InputError
from anaplot.exchange.givenmovementcsv import read_given_movement
from anaplot.report.adjustarguments import add_compare_arguments
from anaplot.report.computed import Computed
from anaplot.report.epochaside import aside_of
from anaplot.report.epochdocument import compare_document, series_document
from anaplot.report.journalnote import journal_note, with_journal_notes
from anaplot.report.keywords import names_in, takes_options
from anaplot.report.parameters import Known, parameters_of
from anaplot.report.power import check_power
from anaplot.report.running import BlockOrFolder, block_of

__all__ = ["compare"]


class _Options(TypedDict, total=False):
    """The keywords of `compare`."""

    separate: bool
    additional: str | None
    additional_sigma_um: float | None
    additional_prior: Known | None
    additional_reference_mm: float | None
    common_parameters: bool | None
    stable: str | Sequence[str] | None
    points: str | Sequence[str] | None
    given_movement: str | Path | None
    alpha: float
    progress: Progress | None


@overload
def compare(
    first: BlockOrFolder, second: BlockOrFolder, **options: Unpack[_Options]
) -> Computed[EpochTests]: ...


@overload
def compare(
    first: BlockOrFolder,
    second: BlockOrFolder,
    third: BlockOrFolder,
    /,
    *more: BlockOrFolder,
    **options: Unpack[_Options],
) -> Computed[SeriesTests]: ...


@takes_options(add_compare_arguments)
def compare(
    first: BlockOrFolder,
    second: BlockOrFolder,
    *more: BlockOrFolder,
    separate: bool = False,
    additional: str | None = None,
    additional_sigma_um: float | None = None,
    additional_prior: Known | None = None,
    additional_reference_mm: float | None = None,
    common_parameters: bool | None = None,
    stable: str | Sequence[str] | None = None,
    points: str | Sequence[str] | None = None,
    given_movement: str | Path | None = None,
    alpha: float = 0.05,
    progress: Progress | None = None,
) -> Computed[EpochTests] | Computed[SeriesTests]:
    """Compare epochs of one object: what has moved, and when.

    Parameters
    ----------
    first, second, *more
        Two or more blocks, or their folders, in the order of time; they are only read.
    separate
        Whether each epoch is adjusted by itself; otherwise all in one, with common control.
    additional
        A set of additional parameters, some of it, and its scope, as `adjust` has them.
    additional_sigma_um
        Their a-priori standard deviation as effect in the image [um]; None: free.
    additional_prior
        An a-priori calibration, as `adjust` has it.
    additional_reference_mm
        The length b of the terms, as `adjust` has it.
    common_parameters
        Whether all epochs have the same ones; None: jointly, of block and camera, they have.
    stable
        Points that have not moved and hold the datum in place of control: a sequence of names, or
        names separated by commas.
    points
        Compare these only.
    given_movement
        A CSV file of the movement that displacements are tested against: point, dX, dY, dZ [m],
        and, of more than two epochs, from and to. What is not in it has not moved.
    alpha
        Significance of the global test, of every family of single tests, and of all together.
    progress
        Called with what is being done and the fraction of it (0 to 1).

    Returns
    -------
    Computed of EpochTests, of more than two epochs Computed of SeriesTests
        Displacements, later minus earlier [m], with covariances and tests; flagged when anything
        has moved (otherwise than given), all tests together at `alpha`.

    Raises
    ------
    InputError
        Bad input; options that do not go together.
    NotComputableError
        Something is not determined, or the epochs have nothing in common.
    """
    for option, text in (("--stable", stable), ("--points", points)):
        if text is not None and not names_in(text):
            raise InputError(f"{option}: no point is named")
    chosen = parameters_of(
        additional, additional_sigma_um, additional_prior, additional_reference_mm
    )
    epochs = (first, second, *more)
    blocks, places = zip(*map(block_of, epochs), strict=True)
    notes = [journal_note(epoch, block) for epoch, block in zip(epochs, blocks, strict=True)]
    check_power("--alpha", alpha, blocks[0].test, places[0])
    found = compare_series(
        blocks,
        separate=separate,
        additional=chosen,
        common_parameters=common_parameters,
        stable=names_in(stable or ()),
        points=names_in(points or ()),
        given=() if given_movement is None else read_given_movement(Path(given_movement)),
        progress=progress,
    )
    aside = aside_of(blocks)
    if len(blocks) == 2:
        two = epoch_tests(found.as_two(), alpha=alpha)
        document = with_journal_notes(compare_document(two, aside), *notes)
        return Computed(two, document, two.any_moved)
    several = series_tests(found, alpha=alpha)
    document = with_journal_notes(series_document(several, aside), *notes)
    return Computed(several, document, several.any_moved)
