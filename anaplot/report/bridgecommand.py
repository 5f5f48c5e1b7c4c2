"""The command `anaplot bridge`: a block folder in, the models of its strips out."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from typing import TypeAlias

from anaplot.adjustment.watch import Watch
from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import block_files, check_for_bridge, read_block
from anaplot.orientation.grosserrors import CleanedModel, CleanedStrip, strip_gross_errors
from anaplot.orientation.strip import BridgedStrip, bridge, pooled_sigma_um
from anaplot.photogrammetry import block as photogrammetry
from anaplot.report.document import BLANK, Block, Document
from anaplot.report.interrupts import ending_early
from anaplot.report.modeldocument import model_document, model_tables
from anaplot.report.modelerrors import model_errors_document, rejected_table
from anaplot.report.output import Output
from anaplot.report.progress import ProgressLine
from anaplot.report.searchoptions import search_settings
from anaplot.report.streams import complain

__all__ = ["bridge_block", "bridge_document", "run_bridge"]

Strips: TypeAlias = Sequence[BridgedStrip] | Sequence[CleanedStrip]


def run_bridge(options: argparse.Namespace) -> int:
    """Form the models of every strip of a block folder and print them.

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
    if options.errors is None and (
        options.partner is not None or options.pairs or options.as_given
    ):
        raise InputError("--partner, --pairs and --as-given go with --errors")
    output = Output.of(options)
    output.check({"is read": block_files(options.block)})
    block = read_block(options.block)
    check_for_bridge(block)
    with contextlib.ExitStack() as stack:
        watch = None
        if options.errors is not None:
            progress = stack.enter_context(ProgressLine(sys.stderr))
            watch = stack.enter_context(ending_early(Watch(progress), sys.stderr))
        strips = bridge_block(
            block,
            options.errors,
            partner=options.partner,
            pairs=options.pairs,
            as_given=options.as_given,
            watch=watch,
        )
    output.show(bridge_document(block, strips))
    parts = [_parts(strip) for strip in strips]
    errors = [strip.error for strip, _ in parts if strip.error is not None]
    for error in errors:
        complain(error)
    if errors:
        return NotComputableError.exit_code
    wrong = any(model.flagged for strip, _ in parts for model in strip.models)
    wrong = wrong or any(model.rejected for _, cleaned in parts for model in cleaned)
    return 1 if options.fail_on_flag and wrong else 0


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
        return bridge(block)
    settings = search_settings(block.test, partner, pairs=pairs)
    return [
        strip_gross_errors(block, strip, errors, settings, as_given=as_given, watch=watch)
        for strip in block.strips
    ]


def _parts(strip: BridgedStrip | CleanedStrip) -> tuple[BridgedStrip, tuple[CleanedModel, ...]]:
    if isinstance(strip, CleanedStrip):
        return strip.bridged, strip.models
    return strip, ()


def bridge_document(block: photogrammetry.Block, strips: Strips) -> Document:
    """Return the document of a block's strips, as `bridge_block` returns them.

    A strip that ended early carries "error" beside its models.
    """
    answers, page, models, rejected = [], list[Block](), [], []
    for declared, (strip, cleaned) in zip(block.strips, map(_parts, strips), strict=True):
        here = []
        for k, model in enumerate(strip.models):
            one = model_document(
                model,
                strip=strip.strip,
                number=k + 1,
                count=len(declared.models()),
                pooled_um=pooled_sigma_um(strip.models[: k + 1]),
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
