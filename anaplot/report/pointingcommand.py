"""`anaplot pointing`: the truth of one's own pointing."""

from __future__ import annotations

import argparse
from dataclasses import replace

from anaplot.adjustment.pooling import VarianceTest
from anaplot.report.document import (
    BLANK,
    Answer,
    Document,
    Line,
    for_programs,
    name,
    number,
    say,
    table,
    whole,
)
from anaplot.report.document import Block as Part
from anaplot.report.journalnote import session_note, with_journal_notes
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.station.drift import Drift
from anaplot.station.pointing import Pointing, read_pointing

__all__ = ["pointing_document", "run_pointing"]

_GROUPS = {"all": "all models", "strip": "strip", "operator": "operator", "kind": "kind"}
_POOLED = (
    name("group", "SIGMA0 OF", 10, form=_GROUPS.__getitem__, gap=0),
    name("name", "", 10, none="", head=""),
    whole("rows", "ROWS", 7),
    number("redundancy", "REDUND", 1, 9),
    number("sigma_um", "SIGMA0 um", 2, 11, unit="um"),
    number("low_um", "FROM", 2, 8, unit="um"),
    number("high_um", "TO", 2, 8, unit="um"),
    *for_programs("degrees"),
)
_REPEATED = (
    name("who", "REPEATED BY", 11, none="", gap=0),
    name("kind", "KIND", 8),
    whole("points", "POINTS", 7),
    whole("pointings", "POINTINGS", 10),
    number("sigma_um", "SIGMA um", 2, 9, unit="um"),
    number("low_um", "FROM", 2, 7, unit="um"),
    number("high_um", "TO", 2, 7, unit="um"),
    number("x_um", "x", 2, 7, unit="um"),
    number("y_um", "y", 2, 7, unit="um"),
    number("px_um", "px", 2, 7, unit="um"),
    number("py_um", "py", 2, 7, unit="um"),
    *for_programs("degrees", "unmoved"),
)
_DRIFT = (
    name("day", "DAY", 10, gap=0),
    name("who", "WHO", 8, none=""),
    number("first_um", "FIRST HOUR um", 2, 15, unit="um"),
    number("last_um", "LAST HOUR um", 2, 14, unit="um"),
    number("F", "F", 2, 7),
    number("probability", "P", 3, 7),
    number("py_t", "t OF py", 2, 9),
    number("x_t", "t OF x", 2, 8),
    name("drifts", "", form=lambda drifts: "<< DRIFT" if drifts else "", head="", look=bool),
    *for_programs(
        *("why", "py_first_um", "py_last_um", "py_probability"),
        *("x_first_um", "x_last_um", "x_probability"),
    ),
)


def run_pointing(options: argparse.Namespace) -> int:
    """Say how precise the pointing of a block is and return the exit code.

    Raises
    ------
    InputError
        The block or its journal cannot be read.
    """
    output = Output.of(options)
    output.check({"is read": (options.session,)})
    with working("models"):
        document = pointing_document(read_pointing(options.session))
        note = session_note(options.session)
    if note is not None and note["count"] is None:
        # that the journal cannot be read is among the remarks already
        document = replace(document, answer=document.answer | {"differs_from_journal": note})
        note = None
    output.show(with_journal_notes(document, note))
    return 0


def pointing_document(found: Pointing) -> Document:
    """Return the document of the precision of pointing."""
    pooled = table(
        "pooled",
        _POOLED,
        [
            (
                one.group,
                one.name or None,
                one.rows,
                one.redundancy,
                one.sigma.um,
                one.sigma.low_um,
                one.sigma.high_um,
                one.sigma.degrees,
            )
            for one in found.pooled
        ],
    )
    repeated = table(
        "repeated",
        _REPEATED,
        [
            (
                one.who or None,
                one.kind,
                one.points,
                one.pointings,
                *(
                    (None, None, None)
                    if one.sigma is None
                    else (one.sigma.um, one.sigma.low_um, one.sigma.high_um)
                ),
                *(one.x_um, one.y_um, one.px_um, one.py_um),
                one.degrees,
                one.unmoved,
            )
            for one in found.repeated
        ],
    )
    drift = table("drift", _DRIFT, [_drift_row(one) for one in found.drift])
    answer: Answer = {
        "apriori_um": found.apriori_um,
        "pooled": pooled,
        "tests": [
            {"of": one.group, **_test(one.test), "differ": one.differ} for one in found.tests
        ],
        "repeated": repeated,
        "offer": _offer(found),
        "drift": drift,
        "remarks": list(found.remarks),
    }
    page: list[Part] = []
    if found.pooled:
        page += [pooled, say("  a priori {:.2f} um; intervals of 95 %", found.apriori_um)]
        page += [
            say(
                "  {}: {} {:.2f}, P {:.3f}: {}",
                {"strip": "strips", "operator": "operators"}[one.group],
                one.test.kind,
                one.test.statistic,
                one.test.probability,
                "they differ" if one.differ else "no difference is shown",
            ).of("look" if one.differ else "text")
            for one in found.tests
        ]
    else:
        page.append(say("no model with redundancy is accepted yet"))
    page.append(BLANK)
    if found.repeated:
        page += [repeated, *_unmoved(found), BLANK]
    page += [*_offer_lines(found), BLANK]
    if any(not one.why for one in found.drift):
        page.append(drift)
    page += _untested(found.drift)
    page += [say("remark: {}", remark).of("remark") for remark in found.remarks]
    return Document(answer, tuple(page), (pooled, repeated, drift))


def _offer(found: Pointing) -> Answer | None:
    offer = found.offer
    if offer is None:
        return None
    against = found.against_models
    return {
        "sigma_um": offer.um,
        "low_um": offer.low_um,
        "high_um": offer.high_um,
        "degrees": offer.degrees,
        "pointings": found.pointings,
        "apriori_um": found.apriori_um,
        "agrees": offer.holds(found.apriori_um),
        "line": found.line_to_write or None,
        "against_models": None if against is None else _test(against),
    }


def _offer_lines(found: Pointing) -> list[Line]:
    if found.offer is None:
        return [say("nothing was pointed at twice: in the console P, then Enter, points again")]
    lines = [say("{}", found.offered).of("heading")]
    if found.line_to_write:
        words = "  to take it as the weight: in block.toml, [precision], {}"
        lines.append(say(words, found.line_to_write))
    else:
        lines.append(say("  that agrees: nothing needs to be changed"))
    if found.beside_models:
        lines.append(say("  {}", found.beside_models).of("look"))
    return lines


def _unmoved(found: Pointing) -> list[Line]:
    number_of = sum(one.unmoved for one in found.repeated)
    if not number_of:
        return []
    return [
        say("  {} more do not count: the mark was not seen to move away before them", number_of).of(
            "remark"
        )
    ]


def _untested(drift: tuple[Drift, ...]) -> list[Line]:
    lines = [
        say("drift: {}{}: {}", one.day, f" {one.who}" if one.who else "", one.why)
        for one in drift
        if one.why
    ]
    if any(not one.why for one in drift):
        lines.append(
            say(
                "  t: of the means of standardised residuals with their correlations, models "
                "as independent; of an offset, what the orientations take up is not seen"
            )
        )
    return lines


def _test(test: VarianceTest) -> Answer:
    return {
        "test": test.kind,
        "statistic": test.statistic,
        "degrees": list(test.degrees),
        "probability": test.probability,
    }


def _drift_row(one: Drift) -> tuple[object, ...]:
    by_axis = {shift.axis: shift for shift in one.shifts}
    shifts = [by_axis.get("y"), by_axis.get("x")]
    return (
        one.day,
        one.who or None,
        None if one.first is None else one.first.um,
        None if one.last is None else one.last.um,
        None if one.test is None else one.test.statistic,
        None if one.test is None else one.test.probability,
        *(None if shift is None else shift.t for shift in shifts),
        one.drifts,
        one.why or None,
        *(
            value
            for shift in shifts
            for value in (
                (None, None, None)
                if shift is None
                else (shift.first_um, shift.last_um, shift.probability)
            )
        ),
    )
