"""`anaplot fit`: strips on the control measured so far."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import check_for_bridge, read_block
from anaplot.orientation.strip import BridgedStrip, bridge_strip
from anaplot.orientation.stripfit import Degree, StripFit, fit_models
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.rotation import rotation_angles
from anaplot.photogrammetry.selection import rows_by_photo
from anaplot.report.document import (
    BLANK,
    Answer,
    Document,
    Table,
    for_programs,
    name,
    number,
    say,
    stacked,
    table,
)
from anaplot.report.document import Block as Part
from anaplot.report.journalnote import journal_note, with_journal_notes
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.report.streams import complain
from anaplot.textfiles.wording import hint, quoted

__all__ = ["FittedBlock", "fit", "fit_document", "run_fit"]

_POINTS = (
    name("point", "POINT", 8),
    name("used", "USED", 4, form=lambda used: "yes" if used else "no"),
    number("dX", "dX [m]", 3, 11, unit="m"),
    number("dY", "dY [m]", 3, 11, unit="m"),
    number("dZ", "dZ [m]", 3, 11, unit="m"),
    number("r", "R", 2, 7),
    number("w", "W", 2, 8),
    name("flagged", "", form=lambda flagged: "< flagged" if flagged else "", head="", look=bool),
)
_GROUND = for_programs("point", "X", "Y", "Z")
_STRIP = for_programs("strip")


@dataclass(frozen=True, slots=True, eq=False)
class FittedBlock:
    """The strips of a block on their control: each its fit, or why there is none."""

    strips: tuple[tuple[str, StripFit | str], ...]


def run_fit(options: argparse.Namespace) -> int:
    """Fit the strips of a block, print the results, return the exit code.

    Raises
    ------
    InputError
        The block is wrong, or a name that it does not know.
    """
    block = read_block(options.block)
    check_for_bridge(block)
    output = Output.of(options)
    output.check({"is read": (options.block,)})
    with working("strips"):
        note = journal_note(options.block, block)
        found = fit(block, degree=options.degree, without=options.without, strip=options.strip)
    output.show(with_journal_notes(fit_document(found), note))
    failed = [why for _, why in found.strips if isinstance(why, str)]
    for why in failed:
        complain(why)
    if failed:
        return NotComputableError.exit_code
    flagged = any(p.flagged for _, f in found.strips if isinstance(f, StripFit) for p in f.points)
    return 1 if options.fail_on_flag and flagged else 0


def fit(
    block: Block,
    *,
    degree: Degree = 1,
    without: Collection[str] = (),
    strip: str | None = None,
) -> FittedBlock:
    """Bridge the strips of a block and fit each to its control.

    Parameters
    ----------
    block
        The block.
    degree
        1: similarity; 2 and 3: with polynomials.
    without
        Control points that are compared and do not take part.
    strip
        The one that is fitted; None: all.

    Raises
    ------
    InputError
        A strip or point that the block does not know.
    """
    known = {point.point for point in block.control}
    for point in without:
        if point not in known:
            raise InputError(f"no control point {quoted(point)}{hint(point, known)}")
    named = {one.id: one for one in block.strips}
    if strip is not None and strip not in named:
        raise InputError(f"no strip {quoted(strip)}{hint(strip, named)}")
    wanted = block.strips if strip is None else (named[strip],)
    rows = rows_by_photo(block.image_points)
    bridged = (bridge_strip(block, one, rows=rows) for one in wanted)
    return FittedBlock(tuple((one.strip, _fit(block, one, degree, without)) for one in bridged))


def _fit(
    block: Block, bridged: BridgedStrip, degree: Degree, without: Collection[str]
) -> StripFit | str:
    if bridged.error is not None and not bridged.models:
        return bridged.error
    try:
        return fit_models(block, bridged.strip, bridged.models, degree=degree, without=without)
    except NotComputableError as error:
        return str(error)


def fit_document(found: FittedBlock) -> Document:
    """Return the document of fitted strips."""
    answers: list[Answer] = []
    page: list[Part] = []
    tables: list[tuple[Sequence[str], Table, Table]] = []
    for strip, one in found.strips:
        if isinstance(one, str):
            answers.append({"strip": strip, "error": one})
            continue
        rows = [(p.point, p.used, *p.difference, p.r, p.w, p.flagged) for p in one.points]
        points = table("points", _POINTS, rows)
        tables.append(((strip,), points, table("ground", _GROUND, one.ground)))
        answers.append({"strip": strip, **_answer(one, points)})
        page += [*_lines(one), points, BLANK]
    stacks = tuple(
        stacked(key, _STRIP, columns, ((of, pair[k]) for of, *pair in tables))
        for k, (key, columns) in enumerate((("points", _POINTS), ("ground", _GROUND)))
    )
    return Document({"strips": answers}, tuple(page[:-1]), stacks)


def _answer(one: StripFit, points: Table) -> Answer:
    omega, phi, kappa = rotation_angles(one.similarity.rotation)
    return {
        "transformation": {
            "scale": one.similarity.scale,
            "rotation": {"omega": omega, "phi": phi, "kappa": kappa},
            "shift_m": one.similarity.shift,
            "polynomials": dict(one.polynomials),
        },
        "degree": one.degree,
        "redundancy": one.tested.redundancy,
        "sigma0": one.tested.sigma0,
        "rms_m": list(one.rms),
        "remarks": list(one.remarks),
        "points": points,
    }


def _lines(one: StripFit) -> list[Part]:
    used = sum(point.used for point in one.points)
    title = "similarity" + f" and polynomials of degree {one.degree}" * (one.degree > 1)
    x, y, z = one.rms
    return [
        say("STRIP {}  {}, {} control points", one.strip, title, used).of("heading"),
        say(
            "  scale 1 : {:.0f}, redundancy {}, sigma0 {:.2f||none}",
            one.similarity.scale * 1e3,
            one.tested.redundancy,
            one.tested.sigma0,
        ),
        say("  RMS  X {:.3f|m}  Y {:.3f|m}  Z {:.3f|m}", x, y, z),
        *(say("  note: {}", remark) for remark in one.remarks),
    ]
