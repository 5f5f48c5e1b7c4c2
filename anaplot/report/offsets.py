"""What stated positions and angles have in common: the options, and a part of the document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import degrees, isinf, radians
from typing import Any

from anaplot.bundle.hypotheses.offsetadvice import OffsetAdvice
from anaplot.bundle.hypotheses.offsettests import OffsetTests
from anaplot.bundle.hypotheses.verdict import Verdict
from anaplot.bundle.solve.problem import Datum
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.prioroffsets import PriorOffsets
from anaplot.report.document import (
    BLANK,
    Answer,
    Column,
    Document,
    Line,
    for_programs,
    name,
    say,
    table,
)
from anaplot.report.document import Block as PageBlock
from anaplot.report.verdicts import TEST_HEAD, labelled, probability, verdict_cells, verdict_json

__all__ = [
    "offset_advice_json",
    "offset_advice_lines",
    "offsets_document",
    "with_offset_advice",
    "with_offsets",
]

_OPTIONS = {"shift": "--gnss-shift", "drift": "--gnss-drift", "boresight": "--imu-boresight"}
_Asked = tuple[str | None, float | None]
_WIDTH = 30
_SHORT = "{:.5g}".format


def with_offsets(
    block: Block, datum: Datum, *, shift: _Asked, drift: _Asked, boresight: _Asked
) -> Block:
    """Return a block whose positions and angles have in common what options say.

    Parameters
    ----------
    block
        The block, with what its file says.
    datum
        Of the adjustment.
    shift, drift, boresight
        Of each the scope, or "none", and the standard deviation [m, m/s, degrees], infinite where
        it is free; None: as the file has it.

    Raises
    ------
    InputError
        A standard deviation of what is not asked for, or a datum in which nothing stated is
        observed.
    """
    asked = {"shift": shift, "drift": drift, "boresight": boresight}
    if not any(value is not None for pair in asked.values() for value in pair):
        return block
    offsets = block.offsets or PriorOffsets()
    for kind, (scope, sigma) in asked.items():
        option = _OPTIONS[kind]
        if datum != "control" and scope not in (None, "none"):
            raise InputError(
                f"{option} goes with the datum of control: in another one no stated position or "
                "angle is observed"
            )
        changed: dict[str, Any] = {}
        if scope is not None:
            changed[kind] = None if scope == "none" else scope
        if sigma is not None:
            if changed.get(kind, getattr(offsets, kind)) is None:
                raise InputError(f"{option}-sigma goes with {option}")
            each = radians(sigma) if kind == "boresight" else sigma
            changed[f"{kind}_sigma"] = None if isinf(sigma) else (each, each, each)
        offsets = replace(offsets, **changed)
    return replace(block, offsets=offsets if offsets.any else None)


def with_offset_advice(document: Document, found: Sequence[OffsetAdvice]) -> Document:
    """Return a document that ends with the offsets its block should have, where there are any."""
    if not found:
        return document
    answer = document.answer | {"offsets_advised": offset_advice_json(found)}
    return replace(document, answer=answer, page=(*document.page, *offset_advice_lines(found)))


def offset_advice_lines(found: Sequence[OffsetAdvice]) -> list[Line]:
    """Return for people which offsets a block should have."""
    return [
        say(
            "note: stated {}: with {} {} v'Pv falls by about {:.4g} of {:.4g} ({} unknowns, P {})",
            "angles are off by the same"
            if one.kind == "boresight"
            else "positions are off by the same, or control is",
            _OPTIONS[one.kind],
            one.scope,
            one.falls,
            one.vtpv,
            one.unknowns,
            probability(one.test.significance),
        ).of("remark")
        for one in found
    ]


def offset_advice_json(found: Sequence[OffsetAdvice]) -> list[Answer]:
    """Return it for programs."""
    return [
        {
            "option": f"{_OPTIONS[one.kind]} {one.scope}",
            **{key: value for key, value in one._asdict().items() if key != "test"},
            "probability": one.test.significance,
        }
        for one in found
    ]


_COLUMNS = (
    name("kind", "OFFSET", 9),
    name("group", "OF", 2, gap=1),
    name("axis", gap=1, least=5),
    name("unit", gap=1, least=7),
    Column("value", "value", 12, form=_SHORT),
    Column("s", "s", 11, form="{:.2g}".format),
    Column("P", "P", 9, form=probability),
    Column("detectable", "detectable", 12, form="{:.2g}".format),
    name("", gap=2, head=""),
    name("verdict"),
    *for_programs("since", unit="s"),
)


def offsets_document(found: OffsetTests) -> Document:
    """Return the document of tested offsets [m, m/s, rad]."""
    single = [
        {
            **{key: value for key, value in one.row._asdict().items() if key != "since"},
            "since": one.row.since,
            "detectable": one.mdb,
            "verdict": verdict_json(one.verdict),
        }
        for one in found.single
    ]
    groups = [
        {"kind": one.kind, "group": one.group, "verdict": verdict_json(one.verdict)}
        for one in found.groups
    ]
    stated = found.declared
    answer = {
        **{kind: getattr(stated, kind) for kind in _OPTIONS},
        "unknowns": single,
        "groups": groups,
    }
    rows = table("offsets", _COLUMNS, _rows(found))
    page: list[PageBlock] = [
        say("OFFSETS of what photos state: positions and angles minus what they are").of("heading"),
        rows,
        (labelled("three together are zero", _WIDTH) + TEST_HEAD).of("heading"),
    ]
    page += [
        labelled(f"the {one.kind} of {one.group}", _WIDTH)
        + verdict_cells(None if one.verdict is None else one.verdict.decisive)
        + f"  {_mark(one.verdict)}"
        for one in found.groups
    ]
    page += _known(stated)
    page += _middles(found)
    return Document(answer, (*page, BLANK), (rows,))


def _rows(found: OffsetTests) -> list[tuple[Any, ...]]:
    out = []
    for one in found.single:
        row, decisive = one.row, one.verdict.decisive
        in_degrees = f"{degrees(row.value):.5f} deg" if row.unit == "rad" else ""
        out.append(
            (
                row.kind,
                row.group,
                row.axis,
                row.unit,
                row.value,
                row.s,
                None if decisive is None else decisive.significance,
                one.mdb,
                in_degrees,
                _mark(one.verdict),
                row.since,
            )
        )
    return out


def _mark(verdict: Verdict | None) -> str:
    if verdict is None or verdict.rejected is None:
        return "not testable"
    return "<< not zero" if verdict.rejected else ""


def _known(stated: PriorOffsets) -> list[Line]:
    """Say what is known of the offsets beforehand."""
    said = []
    for kind in _OPTIONS:
        if getattr(stated, kind) is None:
            continue
        sigma = getattr(stated, f"{kind}_sigma")
        if sigma is None:
            said.append(say("  the {} is free", kind))
            continue
        shown = [degrees(one) if kind == "boresight" else one for one in sigma]
        unit = {"boresight": "deg", "shift": "m"}.get(kind, "m/s, or m/photo")
        numbers = ", ".join(f"{one:g}" for one in shown)
        said.append(say("  the {} is weighted: a priori {} {}", kind, numbers, unit))
    return said


def _middles(found: OffsetTests) -> list[Line]:
    """Say from when drifts are counted: a shift is that of the middle of its photos."""
    since = {one.row.group: one.row.since for one in found.single if one.row.kind == "drift"}
    return [
        say("  the drift of {} is counted from {}", group,
            "the middle of its photos" if time is None else say("{:.3f} s", time))
        for group, time in since.items()
    ]  # fmt: skip
