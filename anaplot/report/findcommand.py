"""The call that searches a block for gross errors, and does nothing else of what `adjust` does."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Literal

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Progress, Strategy
from anaplot.bundle.errors.grosserrors import BlockFindings
from anaplot.bundle.solve.problem import Datum, make_problem
from anaplot.photogrammetry.posterior import Posterior
from anaplot.report.adjustarguments import add_adjust_arguments
from anaplot.report.adjustcommand import NO_ACCIDENT
from anaplot.report.adjusterrors import clean_block, errors_document
from anaplot.report.calibration import calibration_asked
from anaplot.report.computed import Computed
from anaplot.report.conditionpoints import refuse_unknown_points
from anaplot.report.journalnote import journal_note, with_journal_notes
from anaplot.report.keywords import names_in, takes_options
from anaplot.report.lengthunits import with_lengths_of
from anaplot.report.offsets import with_offsets
from anaplot.report.parameters import Known, parameters_of
from anaplot.report.photocures import naming_wrong_photos
from anaplot.report.posteriorfile import check_carried, with_given
from anaplot.report.running import BlockOrFolder, block_of

__all__ = ["find_gross_errors"]


@takes_options(add_adjust_arguments)
def find_gross_errors(
    block: BlockOrFolder,
    errors: Strategy = "odds",
    *,
    datum: Datum = "control",
    additional: str | None = None,
    additional_sigma_um: float | None = None,
    additional_prior: Known | None = None,
    additional_reference_mm: float | None = None,
    calibrate: str | Sequence[str] | None = None,
    calibrate_sigma: str | Sequence[str] | None = None,
    gnss_shift: Literal["none", "block", "strip"] | None = None,
    gnss_shift_sigma: float | None = None,
    gnss_drift: Literal["none", "block", "strip"] | None = None,
    gnss_drift_sigma: float | None = None,
    imu_boresight: Literal["none", "block", "camera"] | None = None,
    imu_boresight_sigma: float | None = None,
    partner: float | None = None,
    as_given: bool = False,
    pairs: bool = False,
    given: str | os.PathLike[str] | Posterior | None = None,
    given_without: str | Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Computed[BlockFindings]:
    """Search a block for gross errors: what `adjust` says under "errors", and nothing else.

    Parameters
    ----------
    block
        A block, or its folder; it is only read.
    errors
        Name of the strategy.
    datum, given, given_without, partner, as_given, pairs, progress
        As `adjust` has them.
    additional, additional_sigma_um, additional_prior, additional_reference_mm
        As `adjust` has them.
    calibrate, calibrate_sigma
        As `adjust` has them.
    gnss_shift, gnss_shift_sigma, gnss_drift, gnss_drift_sigma
        As `adjust` has them.
    imu_boresight, imu_boresight_sigma
        As `adjust` has them.

    Returns
    -------
    Computed of BlockFindings
        What is rejected and on what evidence, and the block without it.

    Raises
    ------
    InputError
        Bad input.
    NotComputableError
        The block has no solution, also without what fits nowhere.
    """
    check_carried(given, given_without, None, None, datum, None)
    measured, _ = block_of(block)
    note = journal_note(block, measured)
    refuse_unknown_points(measured)
    measured = with_given(measured, given, names_in(given_without or ()))
    measured = with_offsets(
        measured,
        datum,
        shift=(gnss_shift, gnss_shift_sigma),
        drift=(gnss_drift, gnss_drift_sigma),
        boresight=(imu_boresight, imu_boresight_sigma),
    )
    chosen = calibration_asked(measured, calibrate, calibrate_sigma, additional)
    if chosen is None:
        chosen = parameters_of(
            additional, additional_sigma_um, additional_prior, additional_reference_mm
        )
    problem = make_problem(measured, datum=datum, additional=chosen)
    watch = progress if isinstance(progress, Watch) else Watch(progress)
    with naming_wrong_photos(measured, NO_ACCIDENT), watch.searching():
        found = clean_block(problem, errors, partner, pairs=pairs, as_given=as_given, watch=watch)
    document = with_lengths_of(measured, with_journal_notes(errors_document(found), note))
    return Computed(found, document, bool(found.rejected or found.points))
