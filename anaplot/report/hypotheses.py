"""The hypotheses of an adjusted block as a part of its document."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from anaplot.bundle.hypotheses.blockhypotheses import BlockHypotheses
from anaplot.bundle.hypotheses.checktests import CheckTests
from anaplot.bundle.hypotheses.conditiontests import ConditionTests
from anaplot.bundle.hypotheses.controltests import ControlTests
from anaplot.bundle.hypotheses.parametertests import ComponentTest, ParameterTests, SetTest
from anaplot.bundle.hypotheses.verdict import CORRELATED, Verdict
from anaplot.report.document import (
    BLANK,
    Block,
    Column,
    Document,
    Line,
    Listed,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    table,
)
from anaplot.report.planandheight import plan_and_height_table
from anaplot.report.verdicts import (
    TEST_HEAD,
    labelled,
    probability,
    verdict_cells,
    verdict_json,
)
from anaplot.textfiles.wording import plain

__all__ = ["hypotheses_document"]

Json = dict[str, Any]
Label = tuple[str, str]

_RIGHT = {
    "all": "all is right",
    "plan": "plan is right",
    "heights": "heights are right",
    "weighted": "what is weighted",
    "free of error": "what is free of error",
}
_WIDTH = 24
_MOST = 30  # rows of a table of single tests, the least likely first; JSON holds them all


def hypotheses_document(found: BlockHypotheses) -> Document:
    """Return the document of tested hypotheses; its page is empty when there was none.

    Ground coordinates in metres, additional parameters in millimetres (people read micrometres). T
    is R / (b s^2) of Gruen 1978, eq. (31).
    """
    page: list[Block] = []
    if found.additional is not None:
        page += _additional(found.additional)
    if found.check is not None:
        page += _check(found.check)
    if found.conditions is not None:
        page += _conditions(found.conditions)
    if found.control is not None:
        page += _control(found.control)
    if page:
        head = say(
            "HYPOTHESES  alpha {:g} for every global test and for every family of single tests; "
            "detectable with power {:g}",
            found.settings.alpha,
            found.settings.power,
        )
        page = [
            head.of("heading"),
            say("  each by itself: that one of several is rejected by chance is more probable"),
            *page,
        ]
    tables = tuple(block for block in page if isinstance(block, Table))
    parts = plan_and_height_table(found)
    answer = {**_json(found), "plan_and_height": parts}
    return Document(answer, tuple(page), (*tables, parts) if len(parts) else tables)


def _global(
    label: str, width: int, verdict: Verdict | None, nothing: str, more: Line | str = ""
) -> list[Line]:
    """Lines of a global test: with the estimated and with the a-priori sigma0.

    `more` are the cells that follow in the first of them.
    """
    if verdict is None:
        return [labelled(label, width) + say("  {}", nothing) + more]
    lines: list[Line] = []
    for test in (verdict.estimated, verdict.known):
        if test is None:
            continue
        if test is verdict.decisive:
            mark = "  << REJECTED" if test.rejected else "  accepted"
        elif verdict.decisive is None or test.rejected == verdict.rejected:
            mark = ""
        else:
            mark = "  (would be rejected)" if test.rejected else "  (would be accepted)"
        head = labelled("" if lines else label, width)
        lines.append(head + verdict_cells(test) + ("" if lines else more) + mark)
    return lines


def _head(title: str, width: int, more: str = "") -> Line:
    return (labelled(title, width) + TEST_HEAD + more).of("heading")


def _mark(verdict: Verdict | None) -> str:
    if verdict is None or verdict.rejected is None:
        return "not testable"
    return "<< REJECTED" if verdict.rejected else ""


def _p(verdict: Verdict | None) -> float | None:
    """Return the probability that a person reads."""
    if verdict is None or verdict.decisive is None:
        return None
    return verdict.decisive.significance


def _order(verdict: Verdict | None) -> float:
    """Sort by the probability, what cannot be tested last."""
    p = _p(verdict)
    return 2.0 if p is None else p


def _count(verdicts: Iterable[Verdict | None]) -> int:
    return sum(bool(v is not None and v.rejected) for v in verdicts)


def _remarks(remarks: tuple[str, ...]) -> list[Line]:
    return [say("  note: {}", remark).of("remark") for remark in remarks]


# of every table of single tests
_P = Column("P", "P", 9, form=probability)
_VERDICT = name("verdict")
_LARGER = "    and {} more, with larger P"


def _tests(
    key: str,
    columns: tuple[Column, ...],
    rows: Iterable[tuple[Any, ...]],
    most: int | None = _MOST,
) -> Table:
    """Return a table of single tests; the last two cells of a row come from its verdict."""
    cells = ((*row[:-1], _mark(row[-1])) for row in rows)
    return replace(table(key, columns, cells, units=">"), most=most, more=_LARGER)


def _additional(found: ParameterTests) -> list[Block]:
    several = len({row.group for row in found.parameters}) > 1

    def label(name: Label) -> str:
        return f"{name[1]} of {name[0]}" if several else name[1]

    labels = [label((row.group, row.name)) for row in found.parameters]
    width = max(24, *(len(plain(text)) + 2 for text in labels))
    page: list[Block] = [_head("ADDITIONAL PARAMETERS", width)]
    given = any(row.given for row in found.parameters)
    null = "all are as given" if given else "all are zero"
    page += _global(null, width, found.everything, "not tested together")
    groups = [
        labelled(f"those of {group.group}", width) + verdict_cells(test) + _marked(group.verdict)
        for group in found.groups
        if (test := group.verdict.decisive) is not None
    ]
    page.append(Listed(tuple(groups), _MOST, ""))
    page += _remarks(found.remarks)
    page += [BLANK, _parameters(found, labels, width, shorten=several, given=given)]
    page.append(
        say(
            "  power: against a value of the a-priori sigma0; inflation: of the variance, by the "
            "other parameters; kept: noncentrality left by all unknowns"
        )
    )
    page += _pairs(found, label, width)
    for entry in found.sets[:_MOST]:
        page += [BLANK, *_set(entry, label, width)]
    if found.removable is not None:
        kept = [
            text
            for text, row in zip(labels, found.parameters, strict=True)
            if (row.group, row.name) not in set(found.removable)
        ]
        page += [BLANK, _needed(kept, len(labels), given=given)]
    return [*page, BLANK]


def _marked(verdict: Verdict | None) -> str:
    mark = _mark(verdict)
    return f"  {mark}" if mark else ""


_PARAMETERS = (
    number("value", "value [um]", 3, 12, unit="mm", scale=1e3),
    number("s", "s [um]", 3, 10, unit="mm", scale=1e3),
    _P,
    number("detectable", "detectable", 2, 12, unit="mm", scale=1e3),
    number("power", "power", 2, 7),
    replace(number("inflation", "inflation", 1, 11), head="   inflation"),
    replace(number("kept", "kept", 5, 9), head="    kept"),
    number("given", "given [um]", 3, 12, unit="mm", scale=1e3),
    _VERDICT,
)


def _parameters(
    found: ParameterTests, labels: list[str], width: int, *, shorten: bool, given: bool
) -> Table:
    """Return the single parameters; shortened, the least likely first."""
    rows = list(zip(labels, found.parameters, strict=True))
    if shorten:
        rows = sorted(rows, key=lambda r: _order(r[1].verdict))
    columns = (name("parameter", "PARAMETER", width), *_PARAMETERS)
    cells = (
        (text, row.value, row.s, _p(row.verdict), row.mdb, row.power, row.inflation,
         row.kept, row.given, row.verdict)
        for text, row in rows
    )  # fmt: skip
    tests = _tests("hypotheses_parameters", columns, cells, most=_MOST if shorten else None)
    shown = tuple(one.key for one in columns if given or one.key != "given")
    return replace(tests, shown=shown)


def _pairs(found: ParameterTests, label: Callable[[Label], str], width: int) -> list[Block]:
    if not found.pairs:
        return []
    lines = []
    for pair in found.pairs:
        both = labelled(f"{label(pair.first)}, {label(pair.second)}", width)
        correlation = say("{:10.3c}", pair.correlation)
        lines.append(
            both + verdict_cells(pair.verdict.decisive) + correlation + _marked(pair.verdict)
        )
    head = _head(f"PAIRS correlated from {CORRELATED:g}", width, "       rho")
    return [BLANK, head, Listed(tuple(lines), _MOST)]


def _set(entry: SetTest, label: Callable[[Label], str], width: int) -> list[Block]:
    """Blocks of a correlated set: all of it, and taken apart in both ways."""
    members = [label(member) for member in entry.members]
    page: list[Block] = [
        say("  CORRELATED SET {}", named(members, 12)).of("heading"),
        *_global("all of it is zero", width, entry.verdict, "not tested"),
        labelled("one after the other", width) + f"{'t':>10}{'P':>9}{'of its variance':>17}",
    ]
    lines = [
        labelled(label(part.parameter), width) + _part(part) + _marked(part.verdict)
        for part in entry.sequential
    ]
    page += [
        Listed(tuple(lines), _MOST, ""),
        labelled("orthogonal combinations", width)
        + f"{'t':>10}{'P':>9}{'eigenvalue':>17}   mostly",
    ]
    lines = [
        labelled(str(k + 1), width) + _part(part) + "   " + _combination(part, members)
        + _marked(part.verdict)
        for k, part in enumerate(entry.principal)
    ]  # fmt: skip
    return [*page, Listed(tuple(lines), _MOST, "")]


def _part(part: ComponentTest) -> Line:
    p = _p(part.verdict)
    shown = None if p is None else probability(p)
    return say("{:10.2c}{:9c}{:17.4c}", part.value, shown, part.variance)


def _needed(kept: list[str], every: int, *, given: bool) -> Line:
    if not kept and given:
        return say("  all may be held at the given values: nothing else is proved")
    if not kept:
        return say("  all may be left out: nothing systematic is proved")
    return say(
        "  {} of {} may be {}; needed: {}",
        every - len(kept),
        every,
        "held at the given values together" if given else "left out together",
        named(kept, _MOST, " ..."),
    )


def _combination(part: ComponentTest, names: list[str]) -> Line:
    """Write the three largest loadings, the largest as 1."""
    largest = max(abs(value) for value in part.loadings)
    order = sorted(range(len(names)), key=lambda k: -abs(part.loadings[k]))[:3]
    terms = [say("{:+.2f} {}", part.loadings[k] / largest, names[k]) for k in order]
    return say("{}", replace(named(terms), separator=" "))


_NAMED = (*for_programs("point", "axis"), name("", "COORDINATE", _WIDTH))
_CHECK = (
    *_NAMED,
    number("difference", "difference", 4, 10, unit="m"),
    number("s", "s", 4, 10, unit="m"),
    number("s_block", "s block", 4, 10, unit="m"),
    number("s_given", "s given", 4, 10, unit="m"),
    _P,
    number("detectable", "detectable", 4, 12, unit="m"),
    _VERDICT,
)
_DEFORMATIONS = (
    *for_programs("axis", "term"),
    name("", "DEFORMATION", _WIDTH),
    number("size", "size [m]", 4, 10, unit="m"),
    number("s", "s", 4, 10, unit="m"),
    _P,
    number("detectable", "detectable", 4, 12, unit="m"),
    _VERDICT,
)


def _check(found: CheckTests) -> list[Block]:
    if not found.coordinates:
        return [say("  CHECK POINTS").of("heading"), *_remarks(found.remarks), BLANK]
    page: list[Block] = [_head("CHECK POINTS", _WIDTH, "    rms [m]  expected")]
    for group in found.groups:
        label = " ".join(group.axes) + " agree"
        sizes = say("{:11.4c}{:10.4c}", group.rms, group.expected)
        page += _global(label, _WIDTH, group.verdict, "not tested", sizes)
    page += _remarks(found.remarks)
    rows = sorted(found.coordinates, key=lambda row: _order(row.verdict))
    cells = (
        (row.point, row.axis, f"{row.point} {row.axis}", row.difference, row.s, row.s_block,
         row.s_given, _p(row.verdict), row.mdb, row.verdict)
        for row in rows
    )  # fmt: skip
    page += [BLANK, _tallies(found), _tests("hypotheses_check", _CHECK, cells)]
    if found.deformations:
        deformed = (
            (row.axis, row.term, f"{row.axis} {row.term}", row.size, row.s, _p(row.verdict),
             row.mdb, row.verdict)
            for row in found.deformations
        )  # fmt: skip
        page += [BLANK, _tests("hypotheses_deformations", _DEFORMATIONS, deformed, most=None)]
    return [*page, BLANK]


_CONDITIONS = (
    *for_programs("id", "what", "axis"),
    name("", "CHECK", _WIDTH),
    name("unit", gap=1, head="  "),
    number("difference", "difference", 6, 12),
    number("s", "s", 6, 10),
    number("s_given", "s given", 6, 10),
    _P,
    number("detectable", "detectable", 6, 12),
    _VERDICT,
)


def _conditions(found: ConditionTests) -> list[Block]:
    head = "    rms [m]  expected" if found.distances else ""
    sizes = say("{:11.6c}{:10.6c}", found.rms, found.expected) if found.distances else say("")
    page: list[Block] = [
        _head("CHECK DISTANCES" if found.distances else "CHECKS", _WIDTH, head),
        *_global("all agree", _WIDTH, found.everything, "not tested together", sizes),
    ]
    rows = sorted(found.single, key=lambda row: _order(row.verdict))
    cells = (
        (row.id, row.what, row.axis, f"{row.axis} {row.what}", row.unit, row.difference, row.s,
         row.s_given, _p(row.verdict), row.mdb, row.verdict)
        for row in rows
    )  # fmt: skip
    tally = say("  {}", _tally("check", [one.verdict for one in found.single]))
    return [*page, BLANK, tally, _tests("hypotheses_conditions", _CONDITIONS, cells), BLANK]


def _tallies(found: CheckTests | ControlTests) -> Line:
    points = _tally("point", [one.verdict for one in found.points])
    return say("  {}; {}", points, _tally("coordinate", [one.verdict for one in found.coordinates]))


def _tally(what: str, verdicts: list[Verdict | None]) -> Line:
    """Say how many of those that can be tested are rejected."""
    count = sum(v is not None and v.rejected is not None for v in verdicts)
    text = say("{} of {} {}{} rejected", _count(verdicts), count, what, "" if count == 1 else "s")
    left = len(verdicts) - count
    return text + say(" ({} not testable)", left) if left else text


_CONTROL = (
    *for_programs("point", "axis", "fixed"),
    name("", "COORDINATE", _WIDTH),
    number("difference", "difference", 4, 10, unit="m"),
    number("s", "s", 4, 10, unit="m"),
    _P,
    number("detectable", "detectable", 4, 12, unit="m"),
)


def _control(found: ControlTests) -> list[Block]:
    network = found.against == "network"
    page: list[Block] = [_head("GIVEN COORDINATES" if network else "CONTROL", _WIDTH)]
    if network:
        left = "shift and rotation, distances give its scale" if found.scaled else "a similarity"
        page.append(say("  against the network, up to {}; what is right agrees with it", left))
    for group in found.groups:
        page += _global(
            _RIGHT[group.what],
            _WIDTH,
            group.verdict,
            "1 coordinate only holds the datum: nothing checks it"
            if group.coordinates == 1
            else f"{group.coordinates} coordinates only hold the datum: nothing checks them",
        )
    page += _remarks(found.remarks)
    rows = sorted(found.coordinates, key=lambda row: _order(row.verdict))
    against = "the network, laid on the others" if network else "the photographs without it"
    cells = (
        (row.point, row.axis, row.fixed, f"{row.point} {row.axis}" + " fixed" * row.fixed,
         row.difference, row.s, _p(row.verdict), row.mdb, row.verdict)
        for row in rows
    )  # fmt: skip
    columns = (*_CONTROL, replace(_VERDICT, head=f"   ({against}, minus given)"))
    return [*page, BLANK, _tallies(found), _tests("hypotheses_control", columns, cells), BLANK]


def _json(found: BlockHypotheses) -> Json:
    """Return tested hypotheses; what does not exist is None.

    Lengths in metres, additional parameters in millimetres. "square" is R for the a-priori sigma0,
    "statistic" T = R / (b s^2); "estimated" uses the adjustment's own sigma0, "known" the a-priori
    one; "rejected" goes by the block's test.
    """
    return {
        "alpha": found.settings.alpha,
        "power": found.settings.power,
        "correlated": CORRELATED,
        "additional": None if found.additional is None else _additional_json(found.additional),
        "check": None if found.check is None else _check_json(found.check),
        "control": None if found.control is None else _control_json(found.control),
        "conditions": None if found.conditions is None else _conditions_json(found.conditions),
    }


def _row_json(row: Any) -> Json:
    """Return a row of single tests with its verdict written out."""
    out = {"detectable" if name == "mdb" else name: value for name, value in row._asdict().items()}
    out["verdict"] = verdict_json(row.verdict)
    return out


def _label_json(label: Label) -> Json:
    return {"group": label[0], "name": label[1]}


def _component_json(part: ComponentTest) -> Json:
    return {
        "parameter": _label_json(part.parameter),
        "value": part.value,
        "variance": part.variance,
        "loadings": list(part.loadings),
        "verdict": verdict_json(part.verdict),
    }


def _additional_json(found: ParameterTests) -> Json:
    return {
        "all": verdict_json(found.everything),
        "groups": [_row_json(row) for row in found.groups],
        "parameters": [_row_json(row) for row in found.parameters],
        "pairs": [
            {
                "first": _label_json(pair.first),
                "second": _label_json(pair.second),
                "correlation": pair.correlation,
                "verdict": verdict_json(pair.verdict),
            }
            for pair in found.pairs
        ],
        "sets": [
            {
                "members": [_label_json(member) for member in entry.members],
                "verdict": verdict_json(entry.verdict),
                "sequential": [_component_json(part) for part in entry.sequential],
                "principal": [_component_json(part) for part in entry.principal],
            }
            for entry in found.sets
        ],
        "orthogonal": [
            {key: value for key, value in _component_json(part).items() if key != "loadings"}
            for part in found.orthogonal
        ],
        "removable": (
            None if found.removable is None else [_label_json(label) for label in found.removable]
        ),
        "remarks": list(found.remarks),
    }


def _check_json(found: CheckTests) -> Json:
    return {
        "groups": [_row_json(row) for row in found.groups],
        "points": [_row_json(row) for row in found.points],
        "coordinates": [_row_json(row) for row in found.coordinates],
        "deformations": [_row_json(row) for row in found.deformations],
        "sigma_factor": found.sigma_factor,
        "remarks": list(found.remarks),
    }


def _conditions_json(found: ConditionTests) -> Json:
    return {
        "all": verdict_json(found.everything),
        "distances": found.distances,
        "rms": found.rms,
        "expected": found.expected,
        "rows": [_row_json(row) for row in found.single],
    }


def _control_json(found: ControlTests) -> Json:
    return {
        "against": found.against,
        "groups": [_row_json(row) for row in found.groups],
        "points": [_row_json(row) for row in found.points],
        "coordinates": [_row_json(row) for row in found.coordinates],
        "remarks": list(found.remarks),
    }
