"""The hypotheses of an adjusted block: as text for people, as JSON for programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from anaplot.adjustment.hypothesis import FTest
from anaplot.bundle.hypotheses.blockhypotheses import BlockHypotheses
from anaplot.bundle.hypotheses.checktests import CheckTests
from anaplot.bundle.hypotheses.controltests import ControlTests
from anaplot.bundle.hypotheses.parametertests import ComponentTest, ParameterTests, SetTest
from anaplot.bundle.hypotheses.verdict import Verdict
from anaplot.report.columns import cell, column
from anaplot.textfiles.wording import plain

__all__ = ["hypotheses_json", "hypotheses_printout", "probability", "verdict_json"]

Json = dict[str, Any]
Label = tuple[str, str]

_RIGHT = {
    "all": "all is right",
    "plan": "plan is right",
    "heights": "heights are right",
    "weighted": "what is weighted",
    "free of error": "what is free of error",
}
_MOST = 30  # rows of a table of single tests, the least likely first; JSON holds them all


def hypotheses_printout(found: BlockHypotheses) -> str:
    """Return the report of tested hypotheses; empty when there was none.

    Ground coordinates in metres, additional parameters in micrometres. T is R / (b s^2) of
    Gruen 1978, eq. (31).
    """
    lines: list[str] = []
    if found.additional is not None:
        lines += _additional(found.additional, found.settings.correlated)
    if found.check is not None:
        lines += _check(found.check)
    if found.control is not None:
        lines += _control(found.control)
    if not lines:
        return ""
    head = (
        f"HYPOTHESES  alpha {found.settings.alpha:g} for every global test and for every family of "
        f"single tests; detectable with power {found.settings.power:g}"
    )
    together = "  each by itself: that one of several is rejected by chance is more probable"
    return "\n".join([head, together, *lines])


def probability(value: float) -> str:
    """Return a probability in at most seven characters."""
    if value <= 0.0:
        return "<1e-300"
    return f"{value:.4f}" if value >= 1e-4 else f"{value:.0e}"


def _cells(test: FTest) -> str:
    degrees = "known" if test.redundancy is None else str(test.redundancy)
    return (
        f"{column(test.dimension, 5)}{column(degrees, 7)}"
        f"{cell(test.statistic, 3, 10)}{cell(test.critical, 3, 10)}"
        f"{column(probability(test.significance), 9)}"
    )


_COLUMNS = f"{'b':>5}{'r':>7}{'T':>10}{'critical':>10}{'P':>9}"


def _global(
    label: str, width: int, verdict: Verdict | None, nothing: str, more: str = ""
) -> list[str]:
    """Lines of a global test: with the estimated and with the a-priori sigma0.

    `more` are the cells that follow in the first of them.
    """
    if verdict is None:
        return [f"  {label:<{width}}  {nothing}{more}"]
    lines: list[str] = []
    for test in (verdict.estimated, verdict.known):
        if test is None:
            continue
        if test is verdict.decisive:
            mark = "  << REJECTED" if test.rejected else "  accepted"
        elif verdict.decisive is None or test.rejected == verdict.rejected:
            mark = ""
        else:
            mark = "  (would be rejected)" if test.rejected else "  (would be accepted)"
        lines.append(
            f"  {'' if lines else label:<{width}}{_cells(test)}{'' if lines else more}{mark}"
        )
    return lines


def _mark(verdict: Verdict | None) -> str:
    if verdict is None or verdict.rejected is None:
        return "  not testable"
    return "  << REJECTED" if verdict.rejected else ""


def _p(verdict: Verdict | None) -> str:
    if verdict is None or verdict.decisive is None:
        return column("-", 9)
    return column(probability(verdict.decisive.significance), 9)


def _order(verdict: Verdict | None) -> float:
    """Sort by the probability, what cannot be tested last."""
    if verdict is None or verdict.decisive is None:
        return 2.0
    return verdict.decisive.significance


def _count(verdicts: Iterable[Verdict | None]) -> int:
    return sum(bool(v is not None and v.rejected) for v in verdicts)


def _remarks(remarks: tuple[str, ...]) -> list[str]:
    return [f"  note: {plain(remark)}" for remark in remarks]


def _additional(found: ParameterTests, limit: float) -> list[str]:
    several = len({row.group for row in found.parameters}) > 1

    def label(name: Label) -> str:
        return f"{name[1]} of {plain(name[0])}" if several else name[1]

    labels = [label((row.group, row.name)) for row in found.parameters]
    width = max(24, *(len(text) + 2 for text in labels))
    lines = [f"  {'ADDITIONAL PARAMETERS':<{width}}{_COLUMNS}"]
    lines += _global("all are zero", width, found.everything, "not tested together")
    for group in found.groups[:_MOST]:
        test = group.verdict.decisive
        if test is not None:
            lines.append(f"  {'those of ' + plain(group.group):<{width}}{_cells(test)}"
                         f"{_mark(group.verdict)}")  # fmt: skip
    lines += _remarks(found.remarks)
    lines += ["", *_parameters(found, labels, width, shorten=several)]
    lines += _pairs(found, label, width, limit)
    for entry in found.sets[:_MOST]:
        lines += ["", *_set(entry, label, width)]
    if found.removable is not None:
        kept = [
            text
            for text, row in zip(labels, found.parameters, strict=True)
            if (row.group, row.name) not in set(found.removable)
        ]
        lines += ["", _needed(kept, len(labels))]
    return [*lines, ""]


def _parameters(
    found: ParameterTests, labels: list[str], width: int, *, shorten: bool
) -> list[str]:
    """Lines of the single parameters; shortened, the least likely first."""
    rows = list(zip(labels, found.parameters, strict=True))
    if shorten:
        rows = sorted(rows, key=lambda r: _order(r[1].verdict))[:_MOST]
    lines = [
        f"  {'PARAMETER':<{width}}  value [um]    s [um]        P  detectable  power   inflation"
        "    kept"
    ]
    for text, row in rows:
        lines.append(
            f"  {text:<{width}}{cell(row.value * 1e3, 3, 12)}{cell(row.s * 1e3, 3, 10)}"
            f"{_p(row.verdict)}{cell(row.detectable * 1e3, 2, 12)}{cell(row.power, 2, 7)}"
            f"{cell(row.inflation, 1, 11)}{cell(row.kept, 5, 9)}{_mark(row.verdict)}"
        )
    if len(labels) > len(rows):
        lines.append(f"    and {len(labels) - len(rows)} more, with larger P")
    lines.append(
        "  power: against a value of the a-priori sigma0; inflation: of the variance, by the other "
        "parameters; kept: noncentrality left by all unknowns"
    )
    return lines


def _pairs(
    found: ParameterTests, label: Callable[[Label], str], width: int, limit: float
) -> list[str]:
    if not found.pairs:
        return []
    lines = ["", f"  {f'PAIRS correlated from {limit:g}':<{width}}{_COLUMNS}       rho"]
    for pair in found.pairs[:_MOST]:
        test = pair.verdict.decisive
        cells = " " * len(_COLUMNS) if test is None else _cells(test)
        text = f"{label(pair.first)}, {label(pair.second)}"
        lines.append(
            f"  {text:<{width}}{cells}{cell(pair.correlation, 3, 10)}{_mark(pair.verdict)}"
        )
    if len(found.pairs) > _MOST:
        lines.append(f"    and {len(found.pairs) - _MOST} more")
    return lines


def _set(entry: SetTest, label: Callable[[Label], str], width: int) -> list[str]:
    """Lines of a correlated set: all of it, and taken apart in both ways."""
    members = [label(member) for member in entry.members]
    names = ", ".join(members[:12])
    if len(members) > 12:
        names += f" and {len(members) - 12} more"
    lines = [f"  CORRELATED SET {names}"]
    lines += _global("all of it is zero", width, entry.verdict, "not tested")
    lines.append(f"  {'one after the other':<{width}}{'t':>10}{'P':>9}{'of its variance':>17}")
    lines += [
        f"  {label(part.parameter):<{width}}{cell(part.value, 2, 10)}{_p(part.verdict)}"
        f"{cell(part.variance, 4, 17)}{_mark(part.verdict)}"
        for part in entry.sequential[:_MOST]
    ]
    lines.append(
        f"  {'orthogonal combinations':<{width}}{'t':>10}{'P':>9}{'eigenvalue':>17}   mostly"
    )
    lines += [
        f"  {k + 1:<{width}d}{cell(part.value, 2, 10)}{_p(part.verdict)}"
        f"{cell(part.variance, 4, 17)}   " + _combination(part, members) + _mark(part.verdict)
        for k, part in enumerate(entry.principal[:_MOST])
    ]
    return lines


def _needed(kept: list[str], every: int) -> str:
    if not kept:
        return "  all may be left out: nothing systematic is proved"
    return (
        f"  {every - len(kept)} of {every} may be left out together; needed: "
        + ", ".join(kept[:_MOST])
        + (" ..." if len(kept) > _MOST else "")
    )


def _combination(part: ComponentTest, names: list[str]) -> str:
    """Write the three largest loadings, the largest as 1."""
    largest = max(abs(value) for value in part.loadings)
    order = sorted(range(len(names)), key=lambda k: -abs(part.loadings[k]))[:3]
    return " ".join(f"{part.loadings[k] / largest:+.2f} {names[k]}" for k in order)


def _check(found: CheckTests) -> list[str]:
    if not found.coordinates:
        return ["  CHECK POINTS", *_remarks(found.remarks), ""]
    width = 24
    lines = [f"  {'CHECK POINTS':<{width}}{_COLUMNS}    rms [m]  expected"]
    for group in found.groups:
        label = " ".join(group.axes) + " agree"
        sizes = cell(group.rms, 4, 11) + cell(group.expected, 4, 10)
        lines += _global(label, width, group.verdict, "not tested", sizes)
    lines += _remarks(found.remarks)
    rows = sorted(found.coordinates, key=lambda row: _order(row.verdict))
    lines += [
        "",
        f"  {_tally('point', [p.verdict for p in found.points])}; "
        f"{_tally('coordinate', [c.verdict for c in rows])}",
        f"  {'COORDINATE':<{width}}difference         s   s block   s given        P  detectable",
    ]
    lines += [
        f"  {plain(row.point) + ' ' + row.axis:<{width}}"
        + "".join(cell(v, 4, 10) for v in (row.difference, row.s, row.s_block, row.s_given))
        + f"{_p(row.verdict)}{cell(row.detectable, 4, 12)}{_mark(row.verdict)}"
        for row in rows[:_MOST]
    ]
    if len(rows) > _MOST:
        lines.append(f"    and {len(rows) - _MOST} more, with larger P")
    if found.deformations:
        lines += ["", f"  {'DEFORMATION':<{width}}  size [m]         s        P  detectable"]
        lines += [
            f"  {row.axis + ' ' + row.term:<{width}}{cell(row.size, 4, 10)}{cell(row.s, 4, 10)}"
            f"{_p(row.verdict)}{cell(row.detectable, 4, 12)}{_mark(row.verdict)}"
            for row in found.deformations
        ]
    return [*lines, ""]


def _tally(what: str, verdicts: list[Verdict | None]) -> str:
    """Say how many of those that can be tested are rejected."""
    count = sum(v is not None and v.rejected is not None for v in verdicts)
    text = f"{_count(verdicts)} of {count} {what}{'' if count == 1 else 's'} rejected"
    left = len(verdicts) - count
    return f"{text} ({left} not testable)" if left else text


def _control(found: ControlTests) -> list[str]:
    width = 24
    network = found.against == "network"
    title = "GIVEN COORDINATES" if network else "CONTROL"
    lines = [f"  {title:<{width}}{_COLUMNS}"]
    if network:
        lines.append("  against the network, up to a similarity; what is right agrees with it")
    for group in found.groups:
        lines += _global(
            _RIGHT[group.what],
            width,
            group.verdict,
            "1 coordinate only holds the datum: nothing checks it"
            if group.coordinates == 1
            else f"{group.coordinates} coordinates only hold the datum: nothing checks them",
        )
    lines += _remarks(found.remarks)
    rows = sorted(found.coordinates, key=lambda row: _order(row.verdict))
    lines += [
        "",
        f"  {_tally('point', [p.verdict for p in found.points])}; "
        f"{_tally('coordinate', [c.verdict for c in rows])}",
        f"  {'COORDINATE':<{width}}difference         s        P  detectable   "
        f"({'the network, laid on the others' if network else 'the photographs without it'}, "
        "minus given)",
    ]
    for row in rows[:_MOST]:
        name = f"{plain(row.point)} {row.axis}" + (" fixed" if row.fixed else "")
        lines.append(
            f"  {name:<{width}}{cell(row.difference, 4, 10)}{cell(row.s, 4, 10)}"
            f"{_p(row.verdict)}{cell(row.detectable, 4, 12)}{_mark(row.verdict)}"
        )
    if len(rows) > _MOST:
        lines.append(f"    and {len(rows) - _MOST} more, with larger P")
    return [*lines, ""]


def hypotheses_json(found: BlockHypotheses) -> Json:
    """Return tested hypotheses; what does not exist is None.

    Lengths in metres, additional parameters in millimetres. "square" is R for the a-priori sigma0,
    "statistic" T = R / (b s^2); "estimated" uses the adjustment's own sigma0, "known" the a-priori
    one; "rejected" goes by the block's test.
    """
    return {
        "alpha": found.settings.alpha,
        "power": found.settings.power,
        "correlated": found.settings.correlated,
        "additional": None if found.additional is None else _additional_json(found.additional),
        "check": None if found.check is None else _check_json(found.check),
        "control": None if found.control is None else _control_json(found.control),
    }


def _test_json(test: FTest | None) -> Json | None:
    return None if test is None else {**test._asdict(), "rejected": test.rejected}


def verdict_json(verdict: Verdict | None) -> Json | None:
    """Return a test with the estimated and with the known sigma; None without one."""
    if verdict is None:
        return None
    return {
        "rejected": verdict.rejected,
        "estimated": _test_json(verdict.estimated),
        "known": _test_json(verdict.known),
    }


def _row_json(row: Any) -> Json:
    """Return a row of single tests with its verdict written out."""
    out: Json = row._asdict()
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
        "remarks": list(found.remarks),
    }


def _control_json(found: ControlTests) -> Json:
    return {
        "against": found.against,
        "groups": [_row_json(row) for row in found.groups],
        "points": [_row_json(row) for row in found.points],
        "coordinates": [_row_json(row) for row in found.coordinates],
        "remarks": list(found.remarks),
    }
