"""`anaplot bridge` and its calls: the models of a block, or a single one, and their document."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Progress, Strategy, TestKind
from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import block_files, check_for_bridge
from anaplot.exchange.blockpack import block_paths
from anaplot.orientation.grosserrors import CleanedModel, CleanedStrip, strip_gross_errors
from anaplot.orientation.model import orient as orient_pair
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import BridgedStrip, pooled_sigma_um, stereopair
from anaplot.orientation.strip import bridge as bridge_strips
from anaplot.photogrammetry import block as photogrammetry
from anaplot.photogrammetry.block import Camera, Precision, TestSettings, TieVariance
from anaplot.photogrammetry.imagepoints import LARGEST_MM
from anaplot.report import planting
from anaplot.report.accidentlines import with_accidents
from anaplot.report.adjustarguments import add_bridge_arguments
from anaplot.report.computed import Computed
from anaplot.report.document import BLANK, Block, Document
from anaplot.report.journalnote import journal_note, with_journal_notes
from anaplot.report.keywords import takes_options
from anaplot.report.modeldocument import model_document, model_tables
from anaplot.report.modelerrors import model_errors_document, rejected_table
from anaplot.report.output import Output
from anaplot.report.pageoption import AskedPage, MakesPage
from anaplot.report.photocures import naming_wrong_photos, photo_cures
from anaplot.report.running import BlockOrFolder, block_of, computed
from anaplot.report.searchoptions import search_settings
from anaplot.report.streams import complain
from anaplot.session.blockaccidents import block_accidents
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "BridgedBlock",
    "bridge",
    "bridge_block",
    "bridge_document",
    "orient",
    "run_bridge",
]

Strips: TypeAlias = Sequence[BridgedStrip] | Sequence[CleanedStrip]


class BridgedBlock(NamedTuple):
    """The models of a block.

    Attributes
    ----------
    strips
        In file order, each as far as it could be bridged.
    cleaned
        The same with what the strategy for gross errors found in each model; None without one.
    """

    strips: tuple[BridgedStrip, ...]
    cleaned: tuple[CleanedStrip, ...] | None = None


def run_bridge(options: argparse.Namespace, report: MakesPage) -> int:
    """Form the models of every strip of a block folder and print them.

    Parameters
    ----------
    options
        Of the command line.
    report
        Makes the page that `--report` writes.

    Returns
    -------
    int
        4 when a model cannot be computed, 1 for `--fail-on-flag` with rejected or flagged rows,
        else 0.

    Raises
    ------
    InputError
        Bad input; nothing is printed then.
    """
    output = Output.of(options)
    reads = partial(block_paths, options.block)
    page = AskedPage.of(options, "bridge", add_bridge_arguments, reads, report)
    output.check({"is read": block_files(options.block), **page.uses})
    found = computed(options, bridge)
    output.show(page.shown(found))
    errors = [strip.error for strip in found.result.strips if strip.error is not None]
    for error in errors:
        complain(error)
    if errors:
        return NotComputableError.exit_code
    return 1 if options.fail_on_flag and found.flagged else 0


@takes_options(add_bridge_arguments)
def bridge(
    block: BlockOrFolder,
    *,
    errors: Strategy | None = None,
    partner: float | None = None,
    as_given: bool = False,
    pairs: bool = False,
    plant: str | Sequence[str] | None = None,
    matrix: bool = False,
    correlations: bool = False,
    progress: Progress | None = None,
) -> Computed[BridgedBlock]:
    """Form the models of every strip, one after another, as the operator would.

    Parameters
    ----------
    block
        A block, or its folder; it is only read.
    errors
        Name of a strategy for gross errors: every model loses the rows that it rejects before the
        next is tied to it.
    partner
        Residual correlation from which it calls two rows hard to tell apart; None: 0.9.
    as_given
        Whether it cleans also where the a-priori sigma0 cannot be right.
    pairs
        Whether it adds the odds over two gross errors.
    plant
        Errors "PHOTO:POINT:AXIS:UM" that are put in for a trial.
    matrix
        Whether every model's document has Q_vv P whole.
    correlations
        Whether every model's page has the correlations of its orientation.
    progress
        Called with what is being done and the fraction of it (0 to 1); a `Watch` also ends the
        search for gross errors early when it is stopped.

    Returns
    -------
    Computed of BridgedBlock
        Angles in rad, base and points in mm, residuals in um. A strip of which a model cannot be
        computed has an `error` beside the models before it.

    Raises
    ------
    InputError
        Bad input; the block cannot be bridged at all.
    """
    if errors is None and (partner is not None or pairs or as_given):
        raise InputError("--partner, --pairs and --as-given go with --errors")
    given, _ = block_of(block)
    note = journal_note(block, given)
    with naming_wrong_photos(given):
        check_for_bridge(given)
    given, planted = planting.plant(given, plant)
    watch = progress if isinstance(progress, Watch) else Watch(progress)
    with watch.searching() if errors is not None else nullcontext():
        strips = bridge_block(
            given, errors, partner=partner, pairs=pairs, as_given=as_given, watch=watch
        )
    parts = [_parts(strip) for strip in strips]
    flagged = any(model.flagged for strip, _ in parts for model in strip.models)
    flagged = flagged or any(model.rejected for _, cleaned in parts for model in cleaned)
    found = BridgedBlock(
        tuple(strip for strip, _ in parts),
        tuple(strip for strip in strips if isinstance(strip, CleanedStrip)) if errors else None,
    )
    watch("checks of the block", 0.0)
    accidents = block_accidents(_without_rejected(given, strips))
    cures = photo_cures(given, accidents.photos)
    watch("results", 0.0)
    document = bridge_document(given, strips, matrix=matrix, correlations=correlations)
    document = with_accidents(document, accidents, cures)
    document = planting.with_planting(document, planted)
    return Computed(found, with_journal_notes(document, note), flagged)


def _without_rejected(
    block: photogrammetry.Block, strips: Iterable[BridgedStrip | CleanedStrip]
) -> photogrammetry.Block:
    """Return a block without the points that a search rejected a row of, where it did."""
    gone = {
        (model, photo, row.name[0])
        for strip in strips
        for cleaned in _parts(strip)[1]
        for row in cleaned.rejected
        for photo in (cleaned.solution.left, cleaned.solution.right)
        for model in (cleaned.solution.name, None)
    }
    kept = (row for row in block.image_points if (row.model, row.photo, row.point) not in gone)
    return replace(block, image_points=tuple(kept)) if gone else block


def orient(
    left: ArrayLike,
    right: ArrayLike,
    *,
    c: float | tuple[float, float],
    names: Sequence[str] | None = None,
    photos: tuple[str, str] = ("left", "right"),
    base: float | None = None,
    preceding: ModelSolution | None = None,
    image_um: float = 5.0,
    tie_variance: TieVariance = "exact",
    test: TestKind = "tau",
    alpha: float = 0.001,
    power: float = 0.80,
) -> Computed[ModelSolution]:
    """Orient two photos to each other, and to the model before (Kratky and El-Hakim 1983).

    Parameters
    ----------
    left, right
        (n, 2) image coordinates [mm] of the same n points, origin in the principal point.
    c
        Camera constant [mm], or those of the two photos, a pair.
    names
        Of the points; None: "1" to "n". Points of `preceding` with the same names are ties.
    photos
        Names of the photos.
    base
        Magnitude of a first model's bx [mm]; None: the mean x-parallax.
    preceding
        The model whose right photo is now the left one; None: a strip's first model.
    image_um
        A-priori sigma0 [um].
    tie_variance
        How the errors of ties count.
    test, alpha, power
        The test of a single row, its significance, and the power of detectable errors.

    Returns
    -------
    Computed of ModelSolution
        Base, rotation, the tested rows and the model coordinates.

    Raises
    ------
    InputError
        Shapes, names or settings that do not fit.
    NotComputableError
        The points do not determine the model.
    """
    xy = [_numbers(what, each) for what, each in (("left", left), ("right", right))]
    n = len(xy[0]) if xy[0].ndim else 0
    if any(each.shape != (n, 2) for each in xy):
        raise InputError(f"left and right: shapes {xy[0].shape} and {xy[1].shape}, not (n, 2)")
    labels = [str(name) for name in (range(1, n + 1) if names is None else names)]
    if len(labels) != n or len(set(labels)) != n:
        raise InputError(f"names: {len(labels)} ({len(set(labels))} different) of {n} points")
    given = _numbers("c", c)
    if given.shape not in ((), (2,)):
        raise InputError("c: neither a number nor one for each of the two photos")
    constants = np.broadcast_to(given, 2).tolist()
    positive = [*(("c", one) for one in constants), ("image_um", image_um)]
    positive += [] if base is None else [("base", abs(base))]
    for what, value in positive:
        if not 0.0 < value < math.inf:
            raise InputError(f"{what}: {value:g} is no positive number")
    for what, word, known in (
        ("test", test, get_args(TestKind)),
        ("tie_variance", tie_variance, get_args(TieVariance)),
    ):
        if word not in known:
            raise InputError(f"{what}: no {quoted(str(word))}{hint(str(word), known)}")
    if not 0.0 < alpha < power < 1.0:
        raise InputError(f"alpha {alpha:g}, power {power:g}: 0 < alpha < power < 1")
    seen = [{p: (x, y) for p, (x, y) in zip(labels, each.tolist(), strict=True)} for each in xy]
    pair = stereopair(
        photos,
        seen[0],
        seen[1],
        (Camera(photos[0], constants[0]), Camera(photos[1], constants[1])),
        preceding=preceding,
        base=base,
    )
    model = orient_pair(pair, Precision(image_um, tie_variance), TestSettings(test, alpha, power))
    document = model_document(model, strip="1", number=1, count=1)
    return Computed(model, document, len(model.flagged) > 0)


def _numbers(what: str, given: ArrayLike) -> Array:
    """Return an array of floats; what is masked is no number.

    Raises
    ------
    InputError
        It is none, or has numbers that are not real or larger than anything measured.
    """
    try:
        if np.iscomplexobj(given):
            raise InputError(f"{what}: complex numbers")
        numbers = np.array(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: not an array of numbers") from error
    if isinstance(given, np.ma.MaskedArray):
        numbers[np.ma.getmaskarray(given)] = np.nan
    if (np.abs(numbers[np.isfinite(numbers)]) > LARGEST_MM).any():
        raise InputError(f"{what}: a number beyond {LARGEST_MM:g} mm")
    return numbers


def bridge_block(
    block: photogrammetry.Block,
    errors: str | None = None,
    *,
    partner: float | None = None,
    pairs: bool = False,
    as_given: bool = False,
    watch: Watch | None = None,
) -> Strips:
    """Form the models of every strip, one after another, as the operator would.

    Parameters
    ----------
    block
        The block.
    errors
        Name of a strategy for gross errors: every model loses the rows that it rejects before the
        next is tied to it.
    partner
        Residual correlation from which it calls two rows hard to tell apart; None: the default.
    pairs
        Whether it adds the odds over pairs of gross errors.
    as_given
        Whether it cleans also where the a-priori sigma0 cannot be right.
    watch
        Sees the search, and may end it.
    """
    if errors is None:
        return bridge_strips(block, watch)
    settings = search_settings(block.test, partner, pairs=pairs)
    return [
        strip_gross_errors(block, strip, errors, settings, as_given=as_given, watch=watch)
        for strip in block.strips
    ]


def _parts(strip: BridgedStrip | CleanedStrip) -> tuple[BridgedStrip, tuple[CleanedModel, ...]]:
    if isinstance(strip, CleanedStrip):
        return strip.bridged, strip.models
    return strip, ()


def bridge_document(
    block: photogrammetry.Block,
    strips: Strips,
    *,
    matrix: bool = False,
    correlations: bool = False,
    progress: Progress | None = None,
) -> Document:
    """Return the document of a block's strips, as `bridge_block` returns them.

    A strip that ended early carries "error" beside its models. `progress` is told of every strip.
    """
    answers, page, models, rejected = list[dict[str, Any]](), list[Block](), [], []
    for declared, (strip, cleaned) in zip(block.strips, map(_parts, strips), strict=True):
        if progress is not None:
            progress("tables of models", len(answers) / len(block.strips))
        here = []
        for k, model in enumerate(strip.models):
            one = model_document(
                model,
                strip=strip.strip,
                number=k + 1,
                count=len(declared.models()),
                pooled_um=pooled_sigma_um(strip.models[: k + 1]),
                matrix=matrix,
                correlations=correlations,
            )
            models.append((strip.strip, one))
            here.append(one.answer)
            page += one.page
            if cleaned:
                found = model_errors_document(cleaned[k])
                here[-1] = {**one.answer, "errors": found.answer}
                page += found.page
                rejected.append(((strip.strip, model.left, model.right), found.tables[0]))
            page.append(BLANK)
        answers.append({"strip": strip.strip, "models": here})
        if strip.error is not None:
            answers[-1]["error"] = strip.error
    tables = model_tables(models)
    if any(isinstance(strip, CleanedStrip) for strip in strips):
        tables = (*tables, rejected_table(rejected))
    return Document({"strips": answers}, tuple(page), tables)
