"""A prior from an earlier adjustment as a part of a block's document."""

from __future__ import annotations

from typing import Any

import numpy as np

from anaplot.bundle.hypotheses.giventests import GivenOwnerTest, GivenTests
from anaplot.bundle.solve.givenprior import is_regular
from anaplot.bundle.solve.priorbending import MOST_BENT
from anaplot.photogrammetry.posterior import Posterior
from anaplot.report.columns import counted
from anaplot.report.document import (
    Block,
    Column,
    Document,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    table,
)
from anaplot.report.verdicts import TEST_HEAD, labelled, probability, verdict_cells, verdict_json

__all__ = ["given_document", "posterior_document"]

_WIDTH = 24
_MOST = 30  # rows that a person reads, the least likely first; JSON holds them all
_LARGER = "    and {} more, with larger P"
_ROWS = (
    name("owner", "COORDINATE", 22),
    name("unknown", "", 6),
    name("unit", "", 4),
    number("v", "V", 6, 12),
    number("s", "S GIVEN", 6, 11),
    number("r", "R", 3, 8),
    number("w", "W", 2, 8),
    number("mdb", "MDB", 6, 11),
    name("flagged", form=lambda flagged: "<< CHECK" if flagged else "", look=bool),
    *for_programs("kind"),
)
_OWNERS = (
    name("owner", "POINT OR PHOTO", 22),
    *(number(f"d{axis}", f"d{axis} [m]", 4, 10) for axis in "XYZ"),
    number("T", "T", 2, 9),
    Column("P", "P", 9, form=probability),
    name("verdict", ""),
    *for_programs("kind"),
)


def given_document(found: GivenTests, *, cleaned: bool = False) -> Document:
    """Return the document of a prior and what the new observations say to it.

    Metres and radians; `difference` is what the coordinates of a point or photo would be if they
    were not given, minus what is given.
    """
    owners, rows = _owners(found), _rows(found)
    bad = found.contradicted
    page: list[Block] = [
        say("GIVEN  {} as a prior, with their covariance", _counted(found)).of("heading")
        if found.coordinates
        else say("GIVEN  {} free of error, held so", counted(found.exact, "coordinate")).of(
            "heading"
        ),
        say("  from {}", found.source),
    ]
    if found.exact and found.coordinates:
        page.append(say("  {} more free of error, held so", counted(found.exact, "coordinate")))
    if found.unknown:
        page.append(
            say(
                "  {} more {} not of this block: left out of x and C",
                counted(found.unknown, "coordinate"),
                "is" if found.unknown == 1 else "are",
            )
        )
    if found.bending > MOST_BENT:
        page.append(
            say(
                "  note: its datum is weak: movements as likely as its covariance says bend the "
                "shape of what is given by {:.2g} of its standard deviations; coordinates and "
                "standard deviations are only about right, of both blocks together they are",
                found.bending,
            ).of("look")
        )
    if found.doubled:
        page.append(
            say(
                "  note: {} weighted control here and given as well: of one survey it counts twice "
                "(--given-without, or control that is left out): {}",
                counted(len(found.doubled), "point is", "points are"),
                named(found.doubled, 6),
            ).of("remark")
        )
    if found.coordinates:
        page.append((labelled("PRIOR AND OBSERVATIONS", _WIDTH) + TEST_HEAD).of("heading"))
        page += _whole(found)
    if bad:
        listed = named([say("{} {}", one.kind, one.name) for one in bad], 6)
        page.append(
            say(
                "  {} the prior, worst first (it may pull the others along): {}",
                counted(len(bad), "point or photo contradicts", "points and photos contradict"),
                listed,
            ).of("look")
        )
    elif found.owners:
        page.append(say("  no point and no photo by itself contradicts the prior"))
    if cleaned and found.coordinates:
        page.append(
            say(
                "  note: what is given is never rejected, the rays of a point that has moved are: "
                "look without --errors, and leave it out with --given-without"
            ).of("remark")
        )
    tables = (owners, rows) if found.coordinates else ()
    page += tables
    answer = {
        "source": found.source,
        "coordinates": len(found.coordinates),
        "exact": found.exact,
        "unknown": found.unknown,
        "conditions": found.conditions,
        "control_as_well": list(found.doubled),
        "bending": found.bending,
        "verdict": verdict_json(found.verdict),
        "contradicted": [{"kind": one.kind, "name": one.name} for one in bad],
        "owners": [_owner_json(one) for one in found.owners],
        "rows": [
            {
                "kind": one.name.kind,
                "name": one.name.owner,
                "unknown": one.name.unknown,
                "unit": one.name.unit,
                "v": one.v,
                "s": one.s,
                "r": one.r,
                "w": one.w,
                "mdb": one.mdb,
                "flagged": one.flagged,
            }
            for one in found.coordinates
        ],
    }
    return Document(answer, tuple(page), tables)


def posterior_document(left: Posterior) -> Document:
    """Return what is said of coordinates that are left to the next adjustment."""
    counts = {
        kind: len({name.owner for name in left.names if name.kind == kind})
        for kind in ("point", "photo")
    }
    owners = " and ".join(counted(count, kind) for kind, count in counts.items() if count)
    page: list[Block] = [
        say(
            "POSTERIOR  {} of {} with their covariance are written",
            counted(len(left.names), "coordinate"),
            owners,
        ).of("heading")
    ]
    free = np.diag(left.covariance) > 0.0
    firm = int((~free).sum())
    if firm:
        page.append(say("  {} free of error among them", counted(firm, "coordinate")))
    regular = is_regular(left.covariance[np.ix_(free, free)])
    if not regular:
        page.append(
            say(
                "  note: C is singular, as by conditions free of error: --given takes it only "
                "without some of what they tie (--given-without)"
            ).of("remark")
        )
    answer = {
        "coordinates": len(left.names),
        "points": counts["point"],
        "photos": counts["photo"],
        "exact": firm,
        "singular": not regular,
    }
    return Document(answer, tuple(page), ())


def _counted(found: GivenTests) -> str:
    points = sum(one.kind == "point" for one in found.owners)
    parts = [
        counted(count, kind)
        for count, kind in ((points, "point"), (len(found.owners) - points, "photo"))
        if count
    ]
    return f"{counted(len(found.coordinates), 'coordinate')} of {' and '.join(parts)}"


def _whole(found: GivenTests) -> list[Block]:
    verdict = found.verdict
    if verdict is None:
        return [say("  the new observations check none of it: it only holds what they leave open")]
    lines: list[Block] = []
    for test in (verdict.estimated, verdict.known):
        if test is None:
            continue
        mark = ""
        if test is verdict.decisive:
            mark = "  << REJECTED" if test.rejected else "  accepted"
        label = "" if lines else "they agree"
        lines.append(labelled(label, _WIDTH) + verdict_cells(test) + mark)
    return lines


def _order(one: GivenOwnerTest) -> float:
    return 2.0 if one.verdict is None else one.verdict.known.significance


def _owners(found: GivenTests) -> Table:
    cells = []
    for one in sorted(found.owners, key=_order):
        test = None if one.verdict is None else one.verdict.decisive
        by_axis = dict(zip(one.unknowns, one.difference, strict=True))
        rejected = test is not None and test.rejected
        cells.append(
            (
                one.name,
                *(by_axis.get(axis) for axis in "XYZ"),
                None if test is None else test.statistic,
                None if test is None else test.significance,
                "<< REJECTED" if rejected else "" if test is not None else "not testable",
                one.kind,
            )
        )
    return table("given_owners", _OWNERS, cells, most=_MOST, more=_LARGER)


def _rows(found: GivenTests) -> Table:
    order = sorted(found.coordinates, key=lambda one: -abs(one.w or 0.0))
    cells = (
        (one.name.owner, one.name.unknown, one.name.unit, one.v, one.s, one.r, one.w, one.mdb,
         one.flagged, one.name.kind)
        for one in order
    )  # fmt: skip
    return table("given", _ROWS, cells, most=_MOST, more="    and {} more, with smaller W")


def _owner_json(one: GivenOwnerTest) -> dict[str, Any]:
    return {
        "kind": one.kind,
        "name": one.name,
        "unknowns": list(one.unknowns),
        "difference": list(one.difference),
        "conditions": one.conditions,
        "verdict": verdict_json(one.verdict),
    }
