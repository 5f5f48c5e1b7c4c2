"""Tables of displacements between two epochs, every pair of more, and of points through them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from anaplot.bundle.epochs.againstall import AgainstAll
from anaplot.bundle.epochs.displacementtests import CoordinateMove, EpochTests, PointMove
from anaplot.bundle.epochs.seriestests import PointSeries, SeriesTests
from anaplot.bundle.hypotheses.verdict import Verdict
from anaplot.report.columns import fitted
from anaplot.report.document import (
    Answer,
    Column,
    Table,
    for_programs,
    name,
    number,
    stacked,
    table,
)
from anaplot.report.movementdecimals import movement_decimals
from anaplot.report.verdicts import probability, verdict_json

__all__ = [
    "against_answer",
    "against_table",
    "is_marked",
    "pair_answer",
    "pair_table",
    "pairs_table",
    "point_answer",
    "series_answer",
    "series_table",
]


def _moved(verdict: Verdict | None) -> bool | None:
    return None if verdict is None else verdict.rejected


def _moves(decimals: int) -> tuple[Column, ...]:
    def millimetres(value: float | str) -> str:
        return value if isinstance(value, str) else fitted(value * 1e3, decimals, 8)

    def length(key: str, title: str) -> Column:
        return number(key, title, decimals, 9, unit="m", scale=1e3)

    return (
        name("point", "POINT", 5),
        *for_programs("X", "Y", "Z", "dX", "dY", "dZ"),
        *(Column("", f"d{axis} [mm]", 9, form=millimetres) for axis in "XYZ"),
        *(length(f"s{axis}", f"s{axis}") for axis in "XYZ"),
        length("length", "length"),
        length("s_length", "s"),
    )


def _expected(decimals: int) -> tuple[Column, ...]:
    return tuple(number(f"w{axis}", f"w{axis}", decimals, 9, unit="m", scale=1e3) for axis in "XYZ")


_TESTS = (
    Column("P", "P", 9, form=probability),
    *for_programs("moved_bonferroni", "moved_scheffe"),
    name("", "marks", head="", look=bool),
    *for_programs("moved_orthogonal"),
)


def _columns(expected: bool, decimals: int) -> tuple[Column, ...]:
    return (*_moves(decimals), *(_expected(decimals) if expected else ()), *_TESTS)


def pair_table(found: EpochTests) -> Table:
    """Return the displacements between two epochs."""
    expected = found.differences.expected is not None
    rows = []
    for p in found.points:
        test = None if p.verdict is None else p.verdict.decisive
        rows.append(
            (p.point, *p.place, *(c.d for c in p.coordinates),
             *("given" if c.given else c.d for c in p.coordinates), *(c.s for c in p.coordinates),
             p.length, p.s_length, *((c.expected for c in p.coordinates) if expected else ()),
             None if test is None else test.significance, _moved(p.verdict), p.scheffe,
             _marks(p, expected), _moved(p.orthogonal))
        )  # fmt: skip
    columns = _columns(expected, movement_decimals(found.differences))
    return table("displacements", columns, rows)


def is_marked(found: EpochTests) -> bool:
    """Whether a test of two epochs is rejected: of all points, of one, or of a coordinate."""
    return bool(_moved(found.everything)) or any(_marks(p, False) for p in found.points)


def pairs_table(found: SeriesTests, pairs: Sequence[EpochTests]) -> Table:
    """Return the displacements between any two of several epochs, pair by pair.

    Parameters
    ----------
    found
        All tests.
    pairs
        Which of its pairs.
    """
    parts = []
    for pair in pairs:
        first, second = pair.differences.numbers
        parts.append(((first, second, f"{first}-{second}"), pair_table(pair)))
    # one number of decimals for all pairs
    columns = _columns(found.series.expected is not None, movement_decimals(found.series))
    leading = for_programs("from", "to", "epochs")
    one = stacked("displacements", leading, columns, parts)
    return replace(one, group="epochs")


def series_table(found: SeriesTests) -> Table:
    """Return every point through its epochs: when it moved, and how far each time."""
    later = range(2, len(found.series.epochs) + 1)
    expected = found.series.expected is not None
    decimals = movement_decimals(found.series)
    columns = (
        name("point", "POINT", 5),
        *for_programs("X", "Y", "Z", "epochs"),
        name("moved", "MOVED", 5),
        *(number(f"length_{k}", f"to {k} [mm]", decimals, 10, unit="m", scale=1e3) for k in later),
        *for_programs(*(f"s_length_{k}" for k in later), unit="m"),
        *_TESTS,
    )

    def rows() -> Iterator[Sequence[Any]]:
        for p in found.points:
            test = None if p.verdict is None else p.verdict.decisive
            steps = {step.second: step for step in p.steps}
            yield (
                p.point,
                *p.place,
                " ".join(map(str, p.epochs)),
                " ".join(f"{first}-{second}" for first, second in p.moved) or None,
                *(steps[k].length if k in steps else None for k in later),
                *(steps[k].s_length if k in steps else None for k in later),
                None if test is None else test.significance,
                _moved(p.verdict),
                p.scheffe,
                _marked(_letters(_moved(p.verdict), p.scheffe, _moved(p.orthogonal)), (), expected),
                _moved(p.orthogonal),
            )

    return table("points", columns, rows)


def against_table(found: SeriesTests) -> Table:
    """Return every epoch against all the others, for programs."""
    keys = ("epoch", "points", "dimension", "statistic", "critical", "P", "rejected", "explains")

    def rows() -> Iterator[Sequence[Any]]:
        for one in found.against:
            test = one.verdict.decisive
            yield (
                one.epoch,
                one.points,
                *(
                    (None,) * 5
                    if test is None
                    else (test.dimension, test.statistic, test.critical, test.significance,
                          test.rejected)
                ),
                one.explains,
            )  # fmt: skip

    return table("epochs", for_programs(*keys), rows)


def _letters(bonferroni: bool | None, scheffe: bool | None, orthogonal: bool | None) -> str:
    return "".join(
        letter for letter, found in (("B", bonferroni), ("S", scheffe), ("O", orthogonal)) if found
    )


def _marked(own: str, single: Sequence[str], expected: bool) -> str:
    what = "NOT AS GIVEN " if expected else "MOVED "
    # a component by itself may show what a neighbour has done
    parts = ([own if own == "O" else what + own] if own else []) + list(single)
    return f"<< {', '.join(parts)}" if parts else ""


def _marks(p: PointMove, expected: bool) -> str:
    """Name the point's and its coordinates' verdicts."""
    own = _letters(_moved(p.verdict), p.scheffe, _moved(p.orthogonal))
    single = [
        f"{c.axis} {found}"
        for c in p.coordinates
        if (found := _letters(_moved(c.verdict), c.scheffe, _moved(c.orthogonal)))
    ]
    return _marked(own, single, expected)


def pair_answer(found: EpochTests) -> Answer:
    """Return what programs read of the tests of two epochs out of several."""
    first, second = found.differences.numbers
    return {
        "from": first,
        "to": second,
        "alpha": found.alpha,
        "variance_ratio": None if found.variance is None else found.variance._asdict(),
        "all": verdict_json(found.everything),
        "located": [step._asdict() for step in found.located],
        "points": [point_answer(p) for p in found.points],
    }


def against_answer(one: AgainstAll) -> Answer:
    """Return what programs read of an epoch against all the others."""
    return {
        "epoch": one.epoch,
        "points": one.points,
        "all": verdict_json(one.verdict),
        "rest": one.rest,
        "explains": one.explains,
    }


def point_answer(p: PointMove) -> Answer:
    """Return what programs read of a point's displacement between two epochs."""
    return {
        "point": p.point,
        **dict(zip("XYZ", p.place, strict=True)),
        "length": p.length,
        "s_length": p.s_length,
        "bonferroni": verdict_json(p.verdict),
        "scheffe": p.scheffe,
        "orthogonal": verdict_json(p.orthogonal),
        "coordinates": [_coordinate_answer(c) for c in p.coordinates],
    }


def _coordinate_answer(c: CoordinateMove) -> Answer:
    return {
        "axis": c.axis,
        "d": c.d,
        "s": c.s,
        "given": c.given,
        "expected": c.expected,
        "bonferroni": verdict_json(c.verdict),
        "scheffe": c.scheffe,
        "half_bonferroni": c.half_bonferroni,
        "half_scheffe": c.half_scheffe,
        "detectable": c.mdb,
        "component": c.component,
        "component_correlation": c.alike,
        "orthogonal": verdict_json(c.orthogonal),
    }


def series_answer(p: PointSeries) -> Answer:
    """Return what programs read of a point through its epochs."""
    return {
        "point": p.point,
        **dict(zip("XYZ", p.place, strict=True)),
        "epochs": list(p.epochs),
        "moved": [{"from": first, "to": second} for first, second in p.moved],
        "bonferroni": verdict_json(p.verdict),
        "scheffe": p.scheffe,
        "orthogonal": verdict_json(p.orthogonal),
        "steps": [
            {
                "from": step.first,
                "to": step.second,
                **{f"d{axis}": d for axis, d in zip("XYZ", step.d, strict=True)},
                **{f"s{axis}": s for axis, s in zip("XYZ", step.s, strict=True)},
                **{f"w{axis}": w for axis, w in zip("XYZ", step.expected, strict=True)},
                "length": step.length,
                "s_length": step.s_length,
            }
            for step in p.steps
        ],
    }
