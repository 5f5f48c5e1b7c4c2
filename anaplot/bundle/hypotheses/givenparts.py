"""Plan and height of a control or check point, each tested by itself."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from anaplot.bundle.hypotheses.verdict import Verdict

__all__ = ["Part", "PartTest", "parts_of"]

Part = Literal["plan", "height"]


class PartTest(NamedTuple):
    """Plan or height of one point.

    Attributes
    ----------
    point, part
        Which one.
    coordinates
        How many are given: of a plan 1 or 2.
    difference
        What the photographs make of it, minus what is given [m]: of a height with its sign, of a
        plan the length. Of control it is that without the tested part; None where nothing checks
        it.
    s
        Root of the sum of the variances of its coordinates' differences [m], of both, for the
        a-priori sigma0.
    verdict
        The family of all plans and heights keeps the significance; None where nothing checks it.
    largest
        Of control the largest standard deviation of the difference along any direction [m], as
        `s`; None of check points, and where nothing checks it.
    """

    point: str
    part: Part
    coordinates: int
    difference: float | None
    s: float | None
    verdict: Verdict | None
    largest: float | None = None


def parts_of(names: Iterable[tuple[str, str]]) -> dict[tuple[str, Part], list[int]]:
    """Return the indices of coordinates (point, axis) by point and part, in their order."""
    out: dict[tuple[str, Part], list[int]] = {}
    for k, (point, axis) in enumerate(names):
        out.setdefault((point, "height" if axis == "Z" else "plan"), []).append(k)
    return out
