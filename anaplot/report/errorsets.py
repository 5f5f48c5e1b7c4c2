"""`adjust --test-set` and `--function`: what is asked for, and its part of the document."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import cast

from anaplot.bundle.hypotheses.coordinatefunctions import (
    CoordinateFunction,
    FunctionKind,
    FunctionValue,
)
from anaplot.bundle.hypotheses.errorsets import ErrorInSet, ErrorSet, ErrorSetTest
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.observations import ObservationName
from anaplot.errors import InputError
from anaplot.exchange.errorsetscsv import SetRow, read_error_sets
from anaplot.report.document import (
    Answer,
    Block,
    Document,
    Line,
    Table,
    name,
    named,
    number,
    say,
    table,
)
from anaplot.report.observationnames import SHOWN_UNITS, in_words, name_json
from anaplot.report.verdicts import TEST_HEAD, labelled, verdict_cells, verdict_json
from anaplot.textfiles.wording import hint, quoted

__all__ = ["error_sets_document", "error_sets_of", "functions_document", "functions_of"]

_FORMS = "a file, point:POINT, photo:PHOTO or ray:PHOTO:POINT"
_MOST = 3  # parts of the worst error that are named
_KINDS: dict[str, tuple[int, int | None]] = {
    "distance": (2, 2),
    "height": (2, 2),
    "centre": (2, None),
}


def error_sets_of(block: AdjustedBlock, given: Iterable[str]) -> tuple[ErrorSet, ...]:
    """Return the sets that were asked for.

    Parameters
    ----------
    block
        The adjusted block.
    given
        "point:7": all rays of a point; "photo:101": all of a photo; "ray:101:7": x and y of one;
        else the name of a file.

    Raises
    ------
    InputError
        No such point, photo or ray; a file that cannot be read, or names what there is not.
    """
    asked = list(given)
    every = [*block.observations.names] if asked else []
    out = []
    for one in asked:
        kind, colon, what = one.partition(":")
        if colon and kind in ("point", "photo", "ray"):
            out.append(_named_set(every, one, kind, what))
            continue
        rows = read_error_sets(Path(one))
        for of in dict.fromkeys(row.set for row in rows):
            out.append(_set_of_rows(every, of, [row for row in rows if row.set == of]))
    return tuple(out)


def _named_set(every: Sequence[ObservationName], given: str, kind: str, what: str) -> ErrorSet:
    def key(one: ObservationName) -> str:
        return {"point": str(one[2]), "photo": str(one[1])}.get(kind, f"{one[1]}:{one[2]}")

    images = [one for one in every if one[0] == "image"]
    mine = tuple(one for one in images if key(one) == what)
    if not mine:
        known = hint(what, list(dict.fromkeys(map(key, images))), listing=False)
        raise InputError(f"--test-set: no {kind} {quoted(what)} is adjusted{known} ({_FORMS})")
    return ErrorSet(given, mine)


def _set_of_rows(every: Sequence[ObservationName], of: str, rows: Sequence[SetRow]) -> ErrorSet:
    shares: dict[ObservationName, float | None] = {}
    for row in rows:
        mine = [one for one in every if _fits(row, one)]
        if not mine:
            raise InputError(f"{row.where}: set {quoted(of)}: no observation of the block fits")
        for one in mine:
            if one in shares:
                raise InputError(
                    f"{row.where}: set {quoted(of)}: an observation of an earlier row again"
                )
            shares[one] = row.share
    values = tuple(share for share in shares.values() if share is not None)
    return ErrorSet(of, tuple(shares), values or None)


def _fits(row: SetRow, one: ObservationName) -> bool:
    """Whether a row takes an observation in: of images, unless it says something else."""
    kind, axis = one[0], one[-1]
    if row.condition is not None:
        fits = kind == "condition" and one[1] == row.condition
        return fits and row.point in (None, one[2]) and row.axis in (None, axis)
    if row.prior:
        fits = kind == "point prior" and row.point == one[1]
    elif row.axis is None or row.axis in "xy":
        fits = kind == "image" and row.photo in (None, one[1]) and row.point in (None, one[2])
    elif row.photo is None:
        fits = kind == "control" and row.point == one[1]
    else:
        fits = kind == "prior" and row.photo == one[1] and row.point is None
    return fits and row.axis in (None, axis)


def functions_of(given: Iterable[str]) -> tuple[CoordinateFunction, ...]:
    """Return the functions of coordinates that were asked for, as "distance 7 8".

    Raises
    ------
    InputError
        No such function, or a wrong number of points.
    """
    out = []
    for one in given:
        word, *points = one.split() or [""]
        if word not in _KINDS:
            raise InputError(f"--function: no {quoted(word)}{hint(word, _KINDS)}")
        least, most = _KINDS[word]
        names = tuple(points)
        if len(names) < least or (most is not None and len(names) > most):
            wanted = f"{least}" if most == least else f"at least {least}"
            raise InputError(f"--function: {word} of {len(names)} points, {wanted} are needed")
        if len(set(names)) < len(names):
            raise InputError(f"--function: {word}: a point twice")
        out.append(CoordinateFunction(cast("FunctionKind", word), names))
    return tuple(out)


def error_sets_document(found: Sequence[ErrorSetTest]) -> Document:
    """Return the part of a document about tested sets; lengths in m, image errors in um."""
    width = max(len("SET"), *(min(len(one.name), 40) for one in found))
    page: list[Block] = [
        (labelled("SET", width) + say("{}{:>9}{:>8}", TEST_HEAD, "LAMBDA0", "POWER")).of("heading")
    ]
    for one in found:
        page += _set_lines(one, width)
    page += [
        say("  LAMBDA0: the noncentrality that is found with the power of [test]; POWER: against"),
        say("  an error that a single observation's test would find with that power"),
    ]
    return Document([_set_json(one) for one in found], tuple(page), ())


def _set_lines(one: ErrorSetTest, width: int) -> list[Block]:
    verdict = one.verdict
    head = labelled(one.name, width)
    if verdict is None:
        why = "nothing checks it" if one.dimension == 0 else "no redundancy is left beside it"
        return [head + say("  {} observations: {}", len(one.errors), why)]
    mark = "  << REJECTED" if verdict.rejected else "  accepted"
    lines: list[Block] = [
        head
        + verdict_cells(verdict.decisive)
        + say("{:9.2f}{:8.3f}", one.noncentrality, one.power)
        + mark
    ]
    if one.undetectable:
        lines.append(
            say("    {} of {} directions of its errors: checked by nothing", one.undetectable,
                one.undetectable + one.dimension)
        )  # fmt: skip
    worst = sorted(one.errors, key=lambda error: -abs((error.worst or 0.0) / _unit(error)))
    parts = [_part(error) for error in worst if error.worst]
    lines.append(
        say("    worst direction, {:.1f} sigma: {}", one.worst_sigmas, named(parts, _MOST, " ..."))
    )
    if one.moved is not None and one.moved_m is not None:
        x, y, z = (1e3 * value for value in one.moved_m)
        lines.append(
            say("    undetected it moves {} by {:.2f}, {:.2f}, {:.2f} mm", one.moved, x, y, z)
        )
    return lines


def _unit(error: ErrorInSet) -> float:
    return 1.0 / SHOWN_UNITS[error.unit][0]


def _part(error: ErrorInSet) -> Line:
    scale, unit = SHOWN_UNITS[error.unit]
    return say("{} {:+.1f} " + unit, in_words(error.name), scale * (error.worst or 0.0))


def _set_json(one: ErrorSetTest) -> Answer:
    return {
        "set": one.name,
        "dimension": one.dimension,
        "undetectable": one.undetectable,
        "square": one.square,
        "test": verdict_json(one.verdict),
        "rejected": one.rejected,
        "noncentrality": one.noncentrality,
        "power": one.power,
        "worst_sigmas": one.worst_sigmas,
        "largest_effect": None if one.moved_m is None else list(one.moved_m),
        "largest_effect_at": one.moved,
        "observations": [
            {
                **name_json(error.name),
                "unit": error.unit,
                "estimated": error.estimated,
                "worst": error.worst,
            }
            for error in one.errors
        ],
    }


_FUNCTIONS = (
    name("function", "FUNCTION", 8),
    name("axis", gap=1),
    number("value", "VALUE [m]", 4, 15, unit="m"),
    number("s", "s [m]", 4, 10, unit="m"),
    number("effect", "EFFECT [mm]", 2, 13, unit="m", scale=1e3),
    name("by", "BY"),
)


def functions_document(found: Sequence[FunctionValue]) -> Document:
    """Return the part of a document about functions of coordinates."""
    rows = [
        (
            one.function.name,
            one.axis,
            one.value,
            one.s,
            one.effect,
            "" if one.observation is None else " ".join(str(n) for n in one.observation if n),
        )
        for one in found
    ]
    functions: Table = table("functions", _FUNCTIONS, rows)
    note = say("  EFFECT: what the smallest detectable error of one observation, BY, does to it")
    return Document(functions, (functions, note), (functions,))
