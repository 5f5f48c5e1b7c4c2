"""The command `anaplot adjust`: a block folder in, a report or JSON out."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from anaplot.adjustment.modelvalues import MODEL_TOLERANCE
from anaplot.adjustment.watch import Watch
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.controllast import ControlLast
from anaplot.bundle.hypotheses.blockhypotheses import block_hypotheses
from anaplot.bundle.hypotheses.components import Grouping, block_components
from anaplot.bundle.hypotheses.priorknowledge import PriorEstimator, prior_estimate
from anaplot.bundle.hypotheses.verdict import HypothesisSettings
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.problem import Datum, make_problem
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files, read_block
from anaplot.exchange.operatorscsv import read_operators
from anaplot.report.adjustdocument import adjust_document
from anaplot.report.adjusterrors import clean_block, clean_step_by_step, errors_document
from anaplot.report.components import components_document
from anaplot.report.correlations import correlated_rays, correlations_document
from anaplot.report.document import BLANK, Document, say
from anaplot.report.hypotheses import hypotheses_document
from anaplot.report.interrupts import ending_early
from anaplot.report.output import PRINTED, Output
from anaplot.report.power import check_power
from anaplot.report.priorknowledge import prior_document
from anaplot.report.progress import ProgressLine
from anaplot.report.snooping import ModelSource, snoop_block, snooping_document

__all__ = ["run_adjust"]


def run_adjust(
    folder: Path,
    *,
    output: Output = PRINTED,
    fail_on_flag: bool = False,
    datum: Datum = "control",
    additional: str | None = None,
    additional_sigma_um: float | None = None,
    snooping: bool = False,
    tolerance: float = MODEL_TOLERANCE,
    model_values: ModelSource = "block",
    correlations: float | None = None,
    hypothesis_alpha: float = 0.05,
    errors: str | None = None,
    partner: float | None = None,
    pairs: bool = False,
    as_given: bool = False,
    control_last: bool = False,
    prior: PriorEstimator | None = None,
    components: Grouping | None = None,
    operators: Path | None = None,
    err: TextIO | None = None,
) -> int:
    """Adjust a block folder and print the result.

    Parameters
    ----------
    folder
        The block; it is only read.
    output
        How the result is shown.
    fail_on_flag
        Return 1 when an observation is flagged.
    datum
        "control", "minimal" or "free".
    additional
        "set" or "set:scope" of additional parameters: ebner, gruen, physical; block, strip,
        camera, photo.
    additional_sigma_um
        Their a-priori standard deviation as effect in the image [um]; None: free.
    snooping
        Add the modified data snooping of 1980 beside the exact test.
    tolerance
        Its k_q, a share.
    model_values
        Its model values: estimated for the block, or those of the paper for regular blocks.
    correlations
        Add the pairs of a point's rays whose residuals are correlated at or above this.
    hypothesis_alpha
        Significance of the tests of additional parameters, check points and control.
    errors
        Name of a strategy for gross errors: everything is printed of the block without what it
        rejects, and `fail_on_flag` counts what is rejected as well.
    partner
        Residual correlation from which it calls two observations hard to tell apart.
    pairs
        Whether it adds the odds over pairs of gross errors.
    as_given
        Whether it cleans also where the a-priori sigma0 cannot be right.
    control_last
        Whether it cleans the image coordinates without control before control comes in.
    prior
        Estimator for the block with its prior knowledge; None: all stated variances, and the sigma
        that the block's test says.
    components
        Add variance components, image coordinates grouped like this.
    operators
        A file that says who measured which photo, for the grouping "operators".
    err
        Standard error when None.

    Returns
    -------
    int
        Exit code 0, or 1 with `fail_on_flag`.

    Raises
    ------
    AnaplotError
        Bad input or a block that cannot be computed; nothing is printed then.
    """
    if errors is None and (partner is not None or pairs or control_last or as_given):
        raise InputError("--partner, --pairs, --as-given and --control-last go with --errors")
    if control_last and datum != "control":
        raise InputError("--control-last brings control in: it goes with the datum of control")
    if (components == "operators") != (operators is not None):
        raise InputError("--components operators and --operators FILE go together")
    if prior is not None and components is not None:
        raise InputError("--prior and --components both estimate variances: one of them")
    output.check({"is read": block_files(folder)})
    block = read_block(folder)
    check_power("--hypothesis-alpha", hypothesis_alpha, block.test, folder)
    who = None
    if operators is not None:
        who = read_operators(operators, [photo.id for photo in block.photos])
    chosen = None
    if additional is not None:
        chosen = additional_parameters(additional, additional_sigma_um)
    told = sys.stderr if err is None else err
    with ProgressLine(told) as progress:
        cleaned = earlier = None
        if errors is None:
            adjusted = adjust_block(block, datum=datum, additional=chosen, progress=progress)
        elif control_last:
            with ending_early(Watch(progress), told) as watch:
                steps = clean_step_by_step(
                    block,
                    errors,
                    partner,
                    pairs=pairs,
                    additional=chosen,
                    as_given=as_given,
                    watch=watch,
                )
            earlier, cleaned, adjusted = steps, steps.control, steps.block
        else:
            problem = make_problem(block, datum=datum, additional=chosen)
            with ending_early(Watch(progress), told) as watch:
                cleaned = clean_block(
                    problem, errors, partner, pairs=pairs, as_given=as_given, watch=watch
                )
            adjusted = cleaned.block
        estimated = None
        if prior is not None:
            estimated = prior_estimate(adjusted, prior, progress=progress)
            adjusted = estimated.block
        progress("report", 0.0)
        snooped = (
            snoop_block(adjusted, tolerance=tolerance, values=model_values) if snooping else None
        )
        related = None if correlations is None else correlated_rays(adjusted, correlations)
        parted = None
        if components is not None:
            parted = block_components(adjusted, components, operators=who, progress=progress)
        tested = block_hypotheses(adjusted, HypothesisSettings(hypothesis_alpha, block.test.power))
    gone = () if cleaned is None else cleaned.rejected
    if earlier is not None:
        gone = earlier.images.rejected + gone
    rejected = None if cleaned is None else [(row.name, row.error) for row in gone]
    document = adjust_document(adjusted, rejected)
    answers = {"hypotheses": hypotheses_document(tested)}
    if snooping:
        answers["snooping"] = snooping_document(snooped)
    if related is not None and correlations is not None:
        answers["correlations"] = correlations_document(related, correlations)
    if estimated is not None:
        answers["prior_estimate"] = prior_document(estimated)
    if parted is not None:
        answers["components"] = components_document(parted)
    if cleaned is not None:
        answers["errors"] = errors_document(cleaned)
    if earlier is not None:
        answers["errors_without_control"] = _without_control(earlier)
    output.show(_whole(document, answers))
    wrong = adjusted.any_flagged or len(gone) > 0
    return 1 if fail_on_flag and wrong else 0


# what a person reads after the block itself, in this order
_ORDER = (
    *("errors_without_control", "errors", "hypotheses", "prior_estimate", "components"),
    *("snooping", "correlations"),
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
    first = errors_document(steps.images)
    held = "by priors" if steps.datum == "priors" else "as a free network"
    page = (
        say("STEP 1: image coordinates, without control, {}", held).of("heading"),
        *first.page,
        BLANK,
        say("STEP 2: control, without what step 1 rejected in the images").of("heading"),
    )
    tables = tuple(replace(table, key=f"{table.key}_without_control") for table in first.tables)
    return Document({"datum": steps.datum, **first.answer}, page, tables)
