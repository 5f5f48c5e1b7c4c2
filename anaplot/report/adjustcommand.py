"""`anaplot adjust` and its call: a block in, the adjusted bundle and its document out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Grouping, PriorEstimator, Progress, Strategy
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.doublenames import double_names
from anaplot.bundle.hypotheses.blockhypotheses import block_hypotheses
from anaplot.bundle.hypotheses.coordinatefunctions import evaluate_functions
from anaplot.bundle.hypotheses.errorsets import error_set_tests
from anaplot.bundle.hypotheses.giventests import given_tests
from anaplot.bundle.hypotheses.offsetadvice import offset_advice
from anaplot.bundle.hypotheses.offsettests import offset_tests
from anaplot.bundle.hypotheses.verdict import HypothesisSettings
from anaplot.bundle.solve.posteriors import coordinates_meant
from anaplot.bundle.solve.posteriors import posterior_of as posterior_of_block
from anaplot.bundle.solve.problem import Datum, make_problem
from anaplot.errors import InputError
from anaplot.exchange.operatorscsv import read_operators
from anaplot.photogrammetry.posterior import Posterior
from anaplot.report import planting
from anaplot.report.accidentlines import with_photo_accidents
from anaplot.report.adjustarguments import add_adjust_arguments
from anaplot.report.adjustdocument import adjust_document
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.report.calibration import calibration_asked, calibration_document
from anaplot.report.camerafiles import (
    camera_files_asked,
    with_moved_points,
    write_cameras,
)
from anaplot.report.computed import Computed
from anaplot.report.conditionpoints import refuse_unknown_points
from anaplot.report.correlations import correlated_rays, correlations_document
from anaplot.report.covariance import (
    CovarianceQuestion,
    covariance_document,
    write_asked,
)
from anaplot.report.document import BLANK, Document, say
from anaplot.report.doming import doming_document
from anaplot.report.doublenames import with_double_names
from anaplot.report.errorsets import (
    error_sets_document,
    error_sets_of,
    functions_document,
    functions_of,
)
from anaplot.report.givenprior import given_document, posterior_document
from anaplot.report.hypotheses import hypotheses_document
from anaplot.report.journalnote import journal_note, with_journal_notes
from anaplot.report.keywords import names_in, takes_options
from anaplot.report.lengthunits import with_lengths_of
from anaplot.report.offsets import offsets_document, with_offset_advice, with_offsets
from anaplot.report.parameters import Known, automatic_choice, parameters_of
from anaplot.report.photocures import naming_wrong_photos
from anaplot.report.posteriorfile import check_carried, with_given, write_posterior
from anaplot.report.power import check_power
from anaplot.report.running import BlockOrFolder, block_of
from anaplot.session.photoaccidents import PhotoAccidentKind, photo_accidents
from anaplot.textfiles.wholefile import all_or_nothing

if TYPE_CHECKING:
    from anaplot.bundle.errors.controllast import ControlLast

__all__ = ["NO_ACCIDENT", "adjust"]

NO_ACCIDENT: tuple[PhotoAccidentKind, ...] = ("turned",)
"""What is wrong with a photo of a strip, and a bundle finds as well."""


@takes_options(add_adjust_arguments)
def adjust(
    block: BlockOrFolder,
    *,
    datum: Datum = "control",
    additional: str | None = None,
    additional_sigma_um: float | None = None,
    additional_prior: Known | None = None,
    additional_reference_mm: float | None = None,
    calibrate: str | Sequence[str] | None = None,
    calibrate_sigma: str | Sequence[str] | None = None,
    write_camera: str | os.PathLike[str] | Sequence[str] | None = None,
    gnss_shift: Literal["none", "block", "strip"] | None = None,
    gnss_shift_sigma: float | None = None,
    gnss_drift: Literal["none", "block", "strip"] | None = None,
    gnss_drift_sigma: float | None = None,
    imu_boresight: Literal["none", "block", "camera"] | None = None,
    imu_boresight_sigma: float | None = None,
    snooping: bool = False,
    snooping_tolerance: float | None = None,
    snooping_model: str | os.PathLike[str] | None = None,
    snooping_bridging: float | None = None,
    correlations: float | None = None,
    hypothesis_alpha: float = 0.05,
    errors: Strategy | None = None,
    control_last: bool = False,
    partner: float | None = None,
    as_given: bool = False,
    pairs: bool = False,
    thin: float | None = None,
    prior: PriorEstimator | None = None,
    given: str | os.PathLike[str] | Posterior | None = None,
    given_without: str | Sequence[str] | None = None,
    posterior: str | os.PathLike[str] | None = None,
    posterior_of: str | Sequence[str] | None = None,
    covariance: str | Sequence[str] | None = None,
    covariance_to: str | os.PathLike[str] | None = None,
    components: Grouping | None = None,
    operators: str | os.PathLike[str] | None = None,
    plant: str | Sequence[str] | None = None,
    test_set: str | Sequence[str] | None = None,
    function: str | Sequence[str] | None = None,
    control_page: bool = False,
    progress: Progress | None = None,
) -> Computed[BlockAdjustment]:
    """Adjust a block as one bundle, from nothing but its measurements.

    Parameters
    ----------
    block
        A block, or its folder; it is only read.
    datum
        "control", "minimal" or "free" by inner constraints over the points.
    additional
        "set", "set:scope", "set:names" or "set:names:scope" of additional parameters: ebner,
        gruen, gruen50, physical; block, strip, camera, photo; "b1,b2" or "-b1,-b2". "auto",
        "auto:set", "auto:scope": chosen by tests, step by step.
    additional_sigma_um
        Their a-priori standard deviation as effect in the image [um]; None: free.
    additional_prior
        An a-priori calibration: "b1=12+-3,b2=5", or a file; or several of these.
    additional_reference_mm
        The length b of the terms in x/b, y/b [mm], of a calibration that of its own block; None:
        half a camera's format, without one the largest coordinate measured.
    calibrate
        Parameters of the cameras' lenses that are unknown: "c,x0,y0,k1", "CAMERA:c,k1", or several
        of these; "k1=-0.05": a value in place of the camera's own.
    calibrate_sigma
        Their a-priori standard deviations: "k1=0.01,c=5px", "CAMERA:k1=0.01"; 0: held.
    write_camera
        A file that the calibrated camera is written into, "CAMERA=FILE" of several cameras.
    gnss_shift, gnss_drift
        Whether the stated positions of a strip, or of the block, are off by the same [m], and by
        what grows with the time; None: as block.toml has it.
    gnss_shift_sigma, gnss_drift_sigma
        Their a-priori standard deviations [m; m/s, without times m a photo], infinite where they
        are free; None: what block.toml has.
    imu_boresight
        Whether the stated angles belong to an instrument that is turned against the camera.
    imu_boresight_sigma
        Its a-priori standard deviation [degrees], infinite where it is free; None: what block.toml
        has.
    snooping
        Add the modified data snooping of 1980 beside the exact test.
    snooping_tolerance
        Its k_q [percent], 25 where it is None; 0: the model values alone decide.
    snooping_model, snooping_bridging
        Its model values, as `snooping_models` has them; those "sampled" where it is None.
    correlations
        Add the pairs of a point's rays whose residuals are correlated at or above this.
    hypothesis_alpha
        Significance of the tests of additional parameters, check points and control.
    errors
        Name of a strategy for gross errors: everything is told of the block without what it
        rejects.
    control_last
        Whether it cleans the image coordinates without control before control comes in.
    partner
        Residual correlation from which it calls two observations hard to tell apart; None: 0.9.
    as_given
        Whether it cleans also where the a-priori sigma0 cannot be right.
    pairs
        Whether it adds the odds over pairs of gross errors.
    thin
        Leave out as many tie points as can go while the mean redundancy number of every photo, and
        of every ninth of its format, stays at least this; None: none. Everything is told of the
        block without them.
    prior
        Estimator for the block with its prior knowledge; None: all stated variances, and the sigma
        that the block's test says.
    given
        A file that `posterior` has written, or what it has written: a prior with its covariance.
    given_without
        Names of its points and photos that are left out.
    posterior
        A file `.npz` that coordinates and their covariance are written into.
    posterior_of
        Which: "points" (None), "photos", names of points and photos.
    covariance
        Unknowns whose covariance with each other is told: "points:A,B", "photos:101",
        "parameters:c,k1", or as `unknowns_meant` has it.
    covariance_to
        A file `.npz` that it is written into.
    components
        Add variance components, image coordinates grouped like this.
    operators
        A file that says who measured which photo, for the grouping "operators".
    plant
        Errors "PHOTO:POINT:AXIS:UM" that are put in for a trial.
    test_set
        Sets of observations that are tested together: files, "point:POINT", "photo:PHOTO",
        "ray:PHOTO:POINT".
    function
        Functions of coordinates: "distance A B", "height A B", "centre A B C ...".
    control_page
        Add a page for every control and check point: what of an error in it would be found, and
        what would move with and without it.
    progress
        Called with what is being done and the fraction of it (0 to 1); a `Watch` also ends the
        search for gross errors early when it is stopped.

    Returns
    -------
    Computed of BlockAdjustment
        Units as conventions have them: m and rad on the ground, um in the image.

    Raises
    ------
    InputError
        Bad input; options that do not go together.
    NotComputableError
        Something is not determined, or no solution is found; names photos and points.
    """
    if errors is None and (partner is not None or pairs or control_last or as_given):
        raise InputError("--partner, --pairs, --as-given and --control-last go with --errors")
    if control_last and datum != "control":
        raise InputError("--control-last brings control in: it goes with the datum of control")
    if not snooping and any(
        one is not None for one in (snooping_tolerance, snooping_model, snooping_bridging)
    ):
        raise InputError(
            "--snooping-tolerance, --snooping-model and --snooping-bridging go with --snooping"
        )
    if (components == "operators") != (operators is not None):
        raise InputError("--components operators and --operators FILE go together")
    if prior is not None and components is not None:
        raise InputError("--prior and --components both estimate variances: one of them")
    check_carried(given, given_without, posterior, posterior_of, datum, prior)
    question = CovarianceQuestion.of(covariance, covariance_to, posterior)
    measured, where = block_of(block)
    note = journal_note(block, measured)
    refuse_unknown_points(measured)
    if prior is not None and any(one.use == "control" for one in measured.conditions):
        raise InputError(
            "--prior knows of no conditions between points: switch off those of distances.csv and "
            "conditions.csv, or leave it out"
        )
    measured, planted = planting.plant(measured, plant)
    measured = with_given(measured, given, names_in(given_without or ()))
    measured = with_offsets(
        measured,
        datum,
        shift=(gnss_shift, gnss_shift_sigma),
        drift=(gnss_drift, gnss_drift_sigma),
        boresight=(imu_boresight, imu_boresight_sigma),
    )
    check_power("--hypothesis-alpha", hypothesis_alpha, measured.test, where)
    who = None
    if operators is not None:
        who = read_operators(Path(operators), [photo.id for photo in measured.photos])
    tried = automatic_choice(
        additional, additional_sigma_um, additional_prior, additional_reference_mm
    )
    if tried and errors is not None:
        raise InputError(
            "--additional auto goes without --errors: choose parameters first, and clean with those"
        )
    chosen = calibration_asked(measured, calibrate, calibrate_sigma, additional)
    if not tried and chosen is None:
        chosen = parameters_of(
            additional, additional_sigma_um, additional_prior, additional_reference_mm
        )
    camera_files = camera_files_asked(measured, write_camera, chosen)
    if posterior is not None or question is not None:
        # what cannot be written is told before hours of adjusting
        problem = make_problem(measured, datum=datum, additional=chosen)
        if posterior is not None:
            coordinates_meant(problem, names_in(posterior_of or "points"))
        if question is not None and not tried:
            question = question.checked(problem)
    settings = HypothesisSettings(hypothesis_alpha, measured.test.power)
    asked = functions_of(function or ())
    watch = progress if isinstance(progress, Watch) else Watch(progress)
    cleaned = earlier = choice = thinning = None
    with naming_wrong_photos(measured, NO_ACCIDENT):
        if errors is None:
            adjusted = adjust_block(measured, datum=datum, additional=chosen, progress=watch)
            if tried:
                from anaplot.bundle.hypotheses.chosenparameters import choose_parameters

                choice = choose_parameters(adjusted, tried, settings, progress=watch)
                adjusted = choice.block
        elif control_last:
            from anaplot.report.adjusterrors import clean_step_by_step

            with watch.searching():
                earlier = clean_step_by_step(
                    measured,
                    errors,
                    partner,
                    pairs=pairs,
                    additional=chosen,
                    as_given=as_given,
                    watch=watch,
                )
            cleaned, adjusted = earlier.control, earlier.block
        else:
            from anaplot.report.adjusterrors import clean_block

            problem = make_problem(measured, datum=datum, additional=chosen)
            with watch.searching():
                cleaned = clean_block(
                    problem, errors, partner, pairs=pairs, as_given=as_given, watch=watch
                )
            adjusted = cleaned.block
        if thin is not None:
            from anaplot.report.thinning import named_points, thinned

            words = () if question is None else question.wanted
            words += () if posterior is None else names_in(posterior_of or "points")
            tests = error_sets_of(adjusted, test_set or ())
            keep = named_points(adjusted, asked, tests, planted, words)
            thinning = thinned(adjusted, thin, keep, watch)
            adjusted = thinning.block
    estimated = None
    if prior is not None:
        from anaplot.bundle.hypotheses.priorknowledge import prior_estimate

        estimated = prior_estimate(adjusted, prior, progress=watch)
        adjusted = estimated.block
    watch("results", 0.0)
    snooped = None
    if snooping:
        from anaplot.adjustment.modelvalues import MODEL_TOLERANCE
        from anaplot.report.snooping import snoop_block
        from anaplot.report.snoopingmodels import SAMPLED

        snooped = snoop_block(
            adjusted,
            tolerance=MODEL_TOLERANCE if snooping_tolerance is None else snooping_tolerance / 100.0,
            model=SAMPLED if snooping_model is None else snooping_model,
            bridging=snooping_bridging,
        )
    related = None if correlations is None else correlated_rays(adjusted, correlations)
    parted = None
    if components is not None:
        from anaplot.bundle.hypotheses.components import block_components

        parted = block_components(adjusted, components, operators=who, progress=watch)
    tested = block_hypotheses(adjusted, settings)
    agreed = given_tests(adjusted, settings)
    sets = error_set_tests(adjusted, error_sets_of(adjusted, test_set or ()))
    values = evaluate_functions(adjusted, asked)
    left = pages = None
    if posterior is not None:
        left = posterior_of_block(adjusted, names_in(posterior_of or "points"))
    if control_page:
        from anaplot.bundle.hypotheses.controlpages import control_pages

        pages = control_pages(adjusted)
    spread = None if question is None else question.answered(adjusted)
    found = BlockAdjustment(
        adjusted,
        tested,
        cleaned,
        earlier,
        estimated,
        parted,
        snooped,
        related,
        sets,
        values,
        choice,
        agreed,
        left,
        spread,
        offset_tests(adjusted, settings),
        pages,
        thinning,
    )
    flagged = adjusted.any_flagged or bool(found.rejected or found.points_left_out)
    flagged = flagged or (agreed is not None and agreed.flagged)
    with all_or_nothing():
        cameras = write_cameras(camera_files, adjusted)
        if left is not None and posterior is not None:
            write_posterior(Path(posterior), left)
        write_asked(spread)
    document = planting.with_planting(_document(found, snooping, correlations), planted)
    wrong = [one for one in photo_accidents(measured) if one.kind not in NO_ACCIDENT]
    document = with_photo_accidents(document, wrong)
    document = with_double_names(document, double_names(adjusted, watch))
    out = [one.name for one in found.rejected]
    document = with_offset_advice(document, offset_advice(adjusted, out))
    document = with_moved_points(document, cameras)
    document = with_lengths_of(measured, with_journal_notes(document, note))
    return Computed(found, document, flagged)


def _document(found: BlockAdjustment, snooping: bool, correlations: float | None) -> Document:
    """Return a block's document with a part for everything that was asked."""
    rejected = None
    if found.errors is not None:
        rejected = [(row.name, row.error) for row in found.rejected]
    parts = {"hypotheses": hypotheses_document(found.hypotheses)}
    calibrated = calibration_document(found.block)
    if calibrated is not None:
        parts["calibration"] = calibrated
    bent = doming_document(found.block)
    if bent is not None:
        parts["doming"] = bent
    if found.choice is not None:
        from anaplot.report.chosenparameters import choice_document

        parts["choice"] = choice_document(found.choice)
    if snooping:
        from anaplot.report.snooping import snooping_document

        parts["snooping"] = snooping_document(found.snooping)
    if found.correlations is not None and correlations is not None:
        parts["correlations"] = correlations_document(found.correlations, correlations)
    if found.prior_estimate is not None:
        from anaplot.report.priorknowledge import prior_document

        parts["prior_estimate"] = prior_document(found.prior_estimate)
    if found.components is not None:
        from anaplot.report.components import components_document

        parts["components"] = components_document(found.components)
    if found.offsets is not None:
        parts["offsets"] = offsets_document(found.offsets)
    if found.given is not None:
        parts["given"] = given_document(found.given, cleaned=found.errors is not None)
    if found.posterior is not None:
        parts["posterior"] = posterior_document(found.posterior)
    if found.asked_covariance is not None:
        parts["covariance"] = covariance_document(found.asked_covariance)
    if found.control_pages is not None:
        from anaplot.report.controlpages import control_pages_document

        parts["control_pages"] = control_pages_document(found.control_pages)
    if found.test_sets:
        parts["test_sets"] = error_sets_document(found.test_sets)
    if found.functions:
        parts["functions"] = functions_document(found.functions)
    if found.errors is not None:
        from anaplot.report.adjusterrors import errors_document

        parts["errors"] = errors_document(found.errors)
    if found.thinning is not None:
        from anaplot.report.thinning import thinning_document

        parts["thinning"] = thinning_document(found.thinning)
    if found.errors_without_control is not None:
        parts["errors_without_control"] = _without_control(found.errors_without_control)
    return _whole(adjust_document(found.block, rejected), parts)


# what a person reads after the block itself, in this order
_ORDER = (
    *("errors_without_control", "errors", "thinning", "given", "choice"),
    *("calibration", "doming", "offsets"),
    *(
        "hypotheses",
        "control_pages",
        "prior_estimate",
        "components",
        "snooping",
        "correlations",
        "test_sets",
    ),
    *("functions", "covariance", "posterior"),
)


def _whole(document: Document, parts: dict[str, Document]) -> Document:
    """Return a block's document with its parts."""
    page = list(document.page)
    tables = list(document.tables)
    for key in _ORDER:
        if key in parts:
            tables += parts[key].tables
            if parts[key].page:
                page += [BLANK, *parts[key].page]
    answer = document.answer | {key: part.answer for key, part in parts.items()}
    return Document(answer, tuple(page), tuple(tables))


def _without_control(steps: ControlLast) -> Document:
    """Return the document of the cleaning before control came in."""
    from anaplot.report.adjusterrors import errors_document

    first = errors_document(steps.images)
    held = {
        "priors": "by priors",
        "free": "as a free network",
        "partly free": "as a free network where the priors leave it open",
    }[steps.datum]
    page = (
        say("STEP 1: image coordinates, without control, {}", held).of("heading"),
        *first.page,
        BLANK,
        say("STEP 2: control, without what step 1 rejected in the images").of("heading"),
    )
    tables = tuple(replace(table, key=f"{table.key}_without_control") for table in first.tables)
    return Document({"datum": steps.datum, **first.answer}, page, tables)
