"""Whether a pattern of one's own can be measured in the models of a block."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from anaplot.errors import NotComputableError
from anaplot.orientation.idealmodel import ideal_model
from anaplot.orientation.ownpattern import OwnPattern
from anaplot.orientation.patterns import FEWEST_TIES, USUAL_C
from anaplot.photogrammetry.block import Block, Camera
from anaplot.planning.modelplan import standard_base, standard_d, ties_among
from anaplot.textfiles.wording import plain, quoted

__all__ = ["PatternFault", "pattern_fault"]

_LEAST_BASE = 1e-3  # mm
_LONGEST_LABEL = 100  # characters: it is a part of the names of points


class PatternFault(NamedTuple):
    """What is wrong with a pattern: the label of the point, or None, and what."""

    label: str | None
    message: str


class _Pair(NamedTuple):
    """Photos of a model, their cameras, and its base [mm at photo scale]."""

    left: str
    right: str
    left_camera: Camera
    right_camera: Camera
    base: float


def pattern_fault(pattern: OwnPattern, block: Block) -> PatternFault | None:
    """Return the first thing that keeps a pattern from being measured in a block, or None.

    Parameters
    ----------
    pattern
        The pattern.
    block
        The block; one without strips asks for nothing but an orientation.
    """
    for label in pattern.labels:
        if len(label) > _LONGEST_LABEL:
            return PatternFault(label, f"label of more than {_LONGEST_LABEL} characters")
    if pattern.usual_base < _LEAST_BASE:
        return PatternFault(
            None, "no point lies at an x greater than 0; the largest x is taken for the base"
        )
    goes_on = any(len(strip.photos) > 2 for strip in block.strips)
    if goes_on and len(pattern.ties) < FEWEST_TIES:
        return PatternFault(
            None,
            f"{len(pattern.ties)} of its points are ties (tie = yes): a strip of several models "
            f"needs {FEWEST_TIES} or more",
        )
    return (
        _undetermined(pattern, goes_on=goes_on)
        or next(_off(pattern, block), None)
        or (next(_untied(pattern, block), None) if goes_on else None)
    )


def _undetermined(pattern: OwnPattern, *, goes_on: bool) -> PatternFault | None:
    """Say which model the points do not determine: a strip's first one, or those after it."""
    at = {label: (x, y) for label, x, y in pattern.points}
    cases: list[tuple[tuple[str, ...], str]] = [((), "a strip's first model")]
    if goes_on:
        cases.append((pattern.ties, "a model with ties"))
    for ties, which in cases:
        try:
            ideal_model(at, ties, pattern.usual_base, USUAL_C)
        except NotComputableError as error:
            why = plain(str(error), 200).removeprefix("model left/right: ")
            return PatternFault(None, f"its points do not determine {which}: {why}")
    return None


def _pairs(block: Block) -> Iterator[_Pair]:
    """Yield the first of all models that are alike in cameras and nominal base."""
    seen = set()
    for strip in block.strips:
        for left, right in strip.models():
            cameras = block.camera_of(left), block.camera_of(right)
            base = strip.base or standard_base(cameras[0])
            key = (cameras[0].id, cameras[1].id, base)
            if key not in seen:
                seen.add(key)
                yield _Pair(left, right, *cameras, base)


def _off(pattern: OwnPattern, block: Block) -> Iterator[PatternFault]:
    """Yield the points that lie outside of a photo."""
    for pair in _pairs(block):
        for label, (x, y) in pattern.positions(pair.base, standard_d(pair.left_camera)).items():
            places = (
                (pair.left, pair.left_camera, x),
                (pair.right, pair.right_camera, x - pair.base),
            )
            for photo, camera, at in places:
                reach_x, reach_y = camera.reach()
                if abs(at) > reach_x or abs(y) > reach_y:
                    yield PatternFault(
                        label,
                        f"point {quoted(label)} would lie at x {at:.1f}, y {y:.1f} mm in photo "
                        f"{plain(photo, 60)}, which ends at {reach_x:g}, {reach_y:g} mm "
                        f"(base {pair.base:g} mm)",
                    )


def _untied(pattern: OwnPattern, block: Block) -> Iterator[PatternFault]:
    """Yield the ties that the preceding model has not measured."""
    for pair in _pairs(block):
        d = standard_d(pair.left_camera)
        wanted = pattern.positions(pair.base, d)
        preceding = {label: (x - pair.base, y) for label, (x, y) in wanted.items()}
        found = ties_among(preceding, pattern, wanted, d)
        for label in pattern.ties:
            if label not in found:
                yield PatternFault(
                    label,
                    f"tie {quoted(label)}: no other point lies near it one base further on "
                    f"(x {wanted[label][0] + pair.base:.1f}, y {wanted[label][1]:.1f} mm), where "
                    "the model before would measure it",
                )
