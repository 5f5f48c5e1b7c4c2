"""What the operator is told of an inner orientation: what to measure again, what is not known."""

from __future__ import annotations

from math import sqrt

from anaplot.adjustment.advice import (
    NOTHING_FLAGGED,
    odds_in_words,
    other_explanations,
    remeasure,
)
from anaplot.adjustment.tested import Observation
from anaplot.photogrammetry.innerresults import Fiducial, InnerOrientation
from anaplot.photogrammetry.platetransformation import TITLES, TransformationName
from anaplot.photogrammetry.plateunits import MILLIMETRE, PlateUnit

__all__ = ["inner_advice", "odd_scale"]

_ODD_SCALE = 0.02  # film does not shrink by this much: another unit, or another camera
_RICHER: dict[str, TransformationName] = {"distances": "scales", "helmert": "affine"}


def inner_advice(inner: InnerOrientation, unit: PlateUnit = MILLIMETRE) -> tuple[str, ...]:
    """Return sentences for the operator, the most useful first.

    Parameters
    ----------
    inner
        The inner orientation.
    unit
        Of its plate coordinates.
    """
    out = [*_what_to_measure(inner), *_what_cannot_be_known(inner), *inner.remarks]
    place = inner.placement
    odd = odd_scale(inner, unit)
    if odd is not None and not inner.exchanged:
        out.append(odd)
    if unit.name == "px" and not place.mirrored:
        out.append("y of these pixels runs up, or the photograph is seen from behind")
    if inner.unmeasured:
        out.append(f"not measured: {', '.join(inner.unmeasured)}")
    return tuple(out)


def odd_scale(inner: InnerOrientation, unit: PlateUnit = MILLIMETRE) -> str | None:
    """Return what is odd about the scale of a plate; None where nothing is."""
    place = inner.placement
    usual = unit.per_mm or sqrt(place.scale_x * place.scale_y)
    scale_x, scale_y = place.scale_x / usual, place.scale_y / usual
    if not max(abs(scale_x - 1.0), abs(scale_y - 1.0)) > _ODD_SCALE:
        return None
    question = (
        f"are the plate coordinates in {unit.name}, and is it this camera?"
        if unit.per_mm
        else f"is a {unit.name} not as long along both, and is it this camera?"
    )
    return f"the scale of the plate is {scale_x:.4f} along x and {scale_y:.4f} along y: {question}"


def _what_to_measure(inner: InnerOrientation) -> list[str]:
    names = list(dict.fromkeys(row.point for row in inner.rows))
    title = TITLES[inner.kind]
    if inner.exchanged:
        first, second = inner.exchanged
        return [
            f"{first} and {second} seem to be exchanged: the other way round they fit; measure "
            "both again"
        ]
    out = []
    flagged = inner.flagged
    if flagged:
        row = flagged[0]
        chances = inner.tested.point_odds()
        if inner.locatable:
            out.append(remeasure(row.point, row.axis, _odds(row, chances)))
        else:
            out.append(f"{_all(names)} must be measured again: which one is wrong is not known")
        partners = inner.partners if inner.locatable else ()
        out += other_explanations(row.key, partners, chances, inner.tested.odds.none)
    elif inner.refused and inner.sigma0_um is not None:
        times = f"sigma0 is {inner.sigma0_um / inner.apriori_um:.1f} times its a-priori value"
        if inner.locatable:
            out.append(
                f"{NOTHING_FLAGGED}, but {times}: a fiducial is wrong, or {title} does not suit "
                "this plate"
            )
        else:
            out.append(
                f"{times}: one of {_all(names)} is wrong, which one is not known: measure all of "
                "them again"
            )
        if inner.kind in _RICHER:
            out.append(
                "film that has shrunk unequally along x and y asks for "
                f"{TITLES[_RICHER[inner.kind]]}"
            )
    elif inner.redundancy > 0:
        out.append(NOTHING_FLAGGED)
    return out


def _what_cannot_be_known(inner: InnerOrientation) -> list[str]:
    count = len({row.point for row in inner.rows})
    title = TITLES[inner.kind]
    if inner.redundancy == 0:
        return [f"{_number_word(count)} fiducials and {title}: no check at all"]
    if not inner.locatable:
        return [
            f"among {_number_word(count)} fiducials one wrong fiducial cannot be located by "
            f"{title} (redundancy {inner.redundancy}): residuals of different fiducials are equal "
            "but for sign and size"
        ]
    blind = [f"{row.point} {row.axis}" for row in inner.rows if row.mdb is None]
    return [f"cannot be tested: {', '.join(blind)}"] if blind else []


def _odds(row: Observation[Fiducial], chances: dict[str, float]) -> str:
    others = {name: p for name, p in chances.items() if name != row.point}
    rival = max(others, key=others.__getitem__)
    return odds_in_words(chances, row.point, rival)


def _all(names: list[str]) -> str:
    return ", ".join(names[:-1]) + f" and {names[-1]}"


_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight")


def _number_word(count: int) -> str:
    return _WORDS[count] if count < len(_WORDS) else str(count)
