"""Each epoch by itself: adjusted, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from anaplot.aliases import Progress
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.epochs.joint import progress_of
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Datum
from anaplot.errors import AnaplotError, InputError, NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = ["adjust_alone", "check_measured_twice", "remarks_on"]

_REMEDY = {
    "image": "remeasure it, or remove it from image_points.csv",
    "control": "check it, or remove it from control.csv",
    "prior": "check it, or remove it from block.toml",
    "parameter": "the sigma of the additional parameters is too small for it",
}


def adjust_alone(
    block: Block,
    number: int,
    datum: Datum,
    additional: AdditionalParameters | None,
    progress: Progress | None,
) -> AdjustedBlock:
    """Adjust one epoch: conditions between points and priors of points are no part of it.

    Parameters
    ----------
    block, number
        The epoch, and its number from 1: messages name it.
    datum, additional, progress
        As `adjust_block` has them.

    Raises
    ------
    AnaplotError
        As `adjust_block`; the message names the epoch.
    """
    try:
        return adjust_block(
            replace(block, conditions=(), priors=()),
            datum=datum,
            additional=additional,
            progress=progress_of(f"epoch {number}", progress),
        )
    except AnaplotError as error:
        hint = ""
        bare = not any(row.use == "control" for row in block.control)
        if isinstance(error, NotComputableError) and datum == "control" and bare:
            no_part = "its priors of points take no part: " if block.priors else ""
            hint = f" ({no_part}points that have not moved can hold the datum: --stable)"
        # a search without end carries more than its message
        kind = NotComputableError if isinstance(error, NotComputableError) else type(error)
        raise kind(f"epoch {number}: {error}{hint}") from error


def check_measured_twice(blocks: Sequence[Block]) -> str | None:
    """Return the remark that both of two epochs are one.

    Raises
    ------
    InputError
        One of more than two epochs is there twice: it would count twice in sigma0.
    """
    first: dict[tuple[tuple[str, float, float], ...], int] = {}
    for k, block in enumerate(blocks):
        measured = tuple(sorted((row.point, row.x, row.y) for row in block.image_points))
        if not measured:
            continue  # what such an epoch lacks, its adjustment says
        other = first.setdefault(measured, k)
        if other == k:
            continue
        if len(blocks) == 2:
            return "both epochs have the same image measurements: they are not two epochs"
        raise InputError(
            f"epochs {other + 1} and {k + 1} have the same image measurements: they are one epoch"
        )
    return None


def remarks_on(block: AdjustedBlock, number: int, without: bool) -> list[str]:
    """Return the remarks on an epoch by itself.

    Parameters
    ----------
    block, number
        The epoch, and its number from 1.
    without
        Whether the joint adjustment has additional parameters that this one has not.
    """
    by_itself = " (by itself, without additional parameters)" if without else ""
    out = [f"epoch {number}: {remark}" for remark in block.remarks]
    flagged = block.flagged_observations()
    if flagged:
        size, what, kind = flagged[0]
        chance = f"(by chance about {block.flagged_by_chance:.1f})"
        which = f"1 observation flagged {chance}, {what}" if len(flagged) == 1 else (
            f"{len(flagged)} observations flagged {chance}, the largest {what}"
        )  # fmt: skip
        more = "" if len(flagged) == 1 else "; adjust --errors names what else is wrong"
        out.append(f"epoch {number}: {which} (w {size:.1f}){by_itself}: {_REMEDY[kind]}{more}")
    return out
