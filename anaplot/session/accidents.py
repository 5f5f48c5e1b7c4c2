"""Numbering accidents: one id in two places, two ids in one place.

A parallax tells whether a point was pointed at alike in both photos. That it was another point is
told by what is known of it elsewhere: in its strip, in the neighbouring strip, on the ground.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
from math import hypot, sqrt
from typing import NamedTuple

from anaplot.photogrammetry.block import Precision
from anaplot.session.modelstate import ModelState
from anaplot.session.photoaccidents import wrong_photo
from anaplot.session.remembering import remembered
from anaplot.session.state import SessionState
from anaplot.session.tiecheck import GROUND, TieCheck
from anaplot.session.transfer import Transfer

__all__ = ["Accident", "accidents", "accidents_in", "farthest"]

_SIGMAS = 4.0  # of the difference of two pointings: as near as that, it is the same place
_POINTING = 0.3  # mm: farther off, it is another point rather than a bad pointing
_SHARP = 0.1  # mm: places less certain than this say nothing of a second name


class Accident(NamedTuple):
    """What is wrong with a point, in words.

    Attributes
    ----------
    point
        Name; "" where it is a photograph that is wrong.
    text
        One sentence.
    certain
        Whether it is certain that this point of the model (or strip) in question is the wrong one.
    against
        What has it elsewhere: another strip's name, `GROUND`, or "" for its own strip.
    other
        The name that it probably has, or "".
    first
        The model of the strip that had it first under its name, where that is not the one in
        question: there it got its name, and there it gets another one.
    """

    point: str
    text: str
    certain: bool
    against: str = ""
    other: str = ""
    first: str = ""


@remembered
def accidents(state: SessionState, known: Transfer) -> tuple[Accident, ...]:
    """Return what is wrong with points of the model in work, and with ties of its strip.

    Parameters
    ----------
    state
        The session's state.
    known
        What follows from what is known elsewhere.
    """
    found = _accidents(state.block.precision, state.models, state.current, known)
    model = state.current
    if model is None:
        return found
    strip = next(s for s in state.block.strips if s.id == model.strip)
    wrong = wrong_photo(model, strip.base, (m for m in state.models if m.strip == model.strip))
    return found if not wrong else (*found, Accident("", wrong, False))


@remembered
def _accidents(
    precision: Precision,
    models: tuple[ModelState, ...],
    model: ModelState | None,
    known: Transfer,
) -> tuple[Accident, ...]:
    here = () if model is None else model.used
    found = accidents_in(precision, models, model, known, {m.point for m in here})
    if model is None:
        return found
    return tuple(a._replace(first=_named_first(models, model, a.point)) for a in found)


def _named_first(models: tuple[ModelState, ...], model: ModelState, point: str) -> str:
    """Return the name of the first of the models before one that pass a point on to it, or ""."""
    first, here = "", model
    while before := next(
        (
            one
            for one in models
            if (one.strip, one.right) == (here.strip, here.left)
            and any(m.point == point for m in one.used)
        ),
        None,
    ):
        first, here = before.name, before
    return first


def accidents_in(
    precision: Precision,
    models: tuple[ModelState, ...],
    model: ModelState | None,
    known: Transfer,
    names: Set[str],
) -> tuple[Accident, ...]:
    """Return what is wrong with points of a model, and with ties of its strip.

    Parameters
    ----------
    precision
        Of the block.
    models
        Those that were measured before.
    model
        The model; None: ties alone.
    known
        What follows from what is known elsewhere.
    names
        Points that can be the wrong ones.
    """
    out = [found for check in known.checks for found in _of_check(check, names)]
    out += [
        Accident(
            point,
            f"{point} measured {mm:.1f} mm from where model {of} has it: another point?",
            True,
        )
        for point, mm, of in known.strayed
    ]
    if model is not None:
        out += _two_names(precision.image_um * 1e-3, models, model, known)
    # one sentence a point: the first system that tells it
    return tuple({found.point: found for found in reversed(out)}.values())[::-1]


def farthest(precision: Precision) -> float:
    """Return how far [mm] from a point that lies where another one lies that one is expected."""
    return _SIGMAS * hypot(_SHARP, precision.image_um * 1e-3)


def _of_check(check: TieCheck, here: Set[str]) -> Iterator[Accident]:
    """Yield the points that another system has elsewhere."""
    tie = check.tie
    if tie is None or check.cleaned is None:
        return
    wrong = check.wrong
    for point in wrong:
        text, other = _elsewhere(check, point, wrong)
        yield Accident(point, text, point in here, check.other, other)
    if not wrong and tie.suspects:
        first, *others = tie.suspects
        which = f"{first} or {' or '.join(others)}" if others else first
        fourth = "" if tie.checkable else ": a fourth common point tells which is wrong"
        text = f"{which} flagged against {check.named}{fourth}"
        yield Accident(first, text, False, check.other)


def _elsewhere(check: TieCheck, point: str, wrong: tuple[str, ...]) -> tuple[str, str]:
    """Return in words how far off a point is, and the name that it probably has, or ""."""
    assert check.cleaned is not None
    off = next(p.difference for p in check.cleaned.points if p.point == point)
    size = sqrt(sum(d * d for d in off))
    where = "the control list has it" if check.other == GROUND else f"{check.named} has it"
    if size < _POINTING:
        return f"{point} measured {1e3 * size:.0f} µm from where {where}: remeasure", ""
    metres = f" ({size * check.unit_m:.1f} m)" if check.unit_m and check.other == GROUND else ""
    places = {p.point: p.difference for p in check.cleaned.points}
    for other in wrong:
        # two that are interchanged are off by opposite amounts
        gap = sqrt(sum((a + b) ** 2 for a, b in zip(off, places[other], strict=True)))
        if other != point and gap < 0.1 * size:
            text = f"{point} and {other} interchanged? {point} is {size:.1f} mm from where {where}"
            return text, other
    return f"{point} measured {size:.1f} mm{metres} from where {where}: another point?", ""


def _two_names(
    sigma0: float, models: tuple[ModelState, ...], model: ModelState, known: Transfer
) -> Iterator[Accident]:
    """Yield points that lie where another one lies."""
    near = _SIGMAS * sqrt(2.0) * sigma0
    here = model.used
    there = _in_photos(models, model)
    for k, m in enumerate(here):
        for other in here[:k]:
            left, right = (
                hypot(m.xl - other.xl, m.yl - other.yl),
                hypot(m.xr - other.xr, m.yr - other.yr),
            )
            if left < near and right < near:
                # the model has both: one is too many, and to exchange them would change nothing
                yield _same(m.point, other.point, "")._replace(other="")
        for photo, x, y in ((model.left, m.xl, m.yl), (model.right, m.xr, m.yr)):
            for name, ox, oy in there.get(photo, ()):
                if abs(x - ox) < near and hypot(x - ox, y - oy) < near:
                    yield _same(m.point, name, "")
        for name, (at, sigma) in known.places.items():
            limit = _SIGMAS * hypot(sigma, sigma0)
            if abs(m.xl - at[0]) > limit or sigma > _SHARP:
                continue
            mine = (m.xl, m.yl, m.xr, m.yr)
            there_too = all(abs(a - b) < limit for a, b in zip(mine, at, strict=True))
            if there_too and name != m.point and model.measurement(name) is None:
                what = "control point " if known.marks.get(name) == "control" else ""
                yield _same(m.point, name, what)


def _same(point: str, other: str, what: str) -> Accident:
    text = f"{point} lies where {what}{other} lies: the same point under two names?"
    return Accident(point, text, False, other=other)


def _in_photos(
    models: tuple[ModelState, ...], model: ModelState
) -> dict[str, list[tuple[str, float, float]]]:
    """Return where points that are not of the model lie in its photos."""
    out: dict[str, list[tuple[str, float, float]]] = {}
    names = {p.point for p in model.plan}
    for one in models:
        for photo in set(one.photos) & set(model.photos):
            if one.photos == model.photos:
                continue
            left = photo == one.left
            out.setdefault(photo, []).extend(
                (m.point, m.xl, m.yl) if left else (m.point, m.xr, m.yr)
                for m in one.used
                if m.point not in names
            )
    return out
