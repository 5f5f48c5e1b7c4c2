"""What is to be thought of an adjusted block: sound or not, and what is wrong first of all.

The adjustment's own suspects, tests and rejections come first. One error shows in many
observations, and in tests of given points: of what is flagged the most improbable alone is named,
for the others are judged when that is put right. What strips and models say of themselves accuses
nobody beside it, and is no doubt about a bundle that closes, but where it is certain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import log, pi, sqrt
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from anaplot.adjustment.testdistribution import TestDistribution
from anaplot.bundle.errors.bychance import (
    ALARM,
    exceeding_by_chance,
    may_be_chance,
    own_tests,
    tested_count,
)
from anaplot.bundle.errors.suspects import Suspect, likeliest_suspect
from anaplot.bundle.hypotheses.givenparts import PartTest
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.report.adjustdocument import others_flagged, sigma0_limit
from anaplot.report.blockadjustment import BlockAdjustment
from anaplot.station.blockstatus import BlockStatus

__all__ = [
    "Cause",
    "Given",
    "Grade",
    "Judgement",
    "Noise",
    "Other",
    "Scale",
    "judged",
    "least_sigma0",
    "mean_deviations",
    "points_of_two_photos",
    "tested_parts",
]

Grade = Literal["sound", "doubts", "wrong", "unknown"]
Scale = Literal["none", "stated", "larger", "smaller"]

_FEW_TESTED = 2 / 3  # of the observations: where fewer can be tested, errors hide
_SMALL = 0.7  # sigma0 below which detectable errors are stated half as large again as they are


class Given(NamedTuple):
    """Plan or height of a control or check point that a test rejects."""

    use: str
    part: PartTest


class Other(NamedTuple):
    """A flagged observation that is no image coordinate, in words, and its abs(w)."""

    what: str
    w: float


class Noise(NamedTuple):
    """That sigma0 is too large, and no single observation stands out against it."""


Cause: TypeAlias = Suspect | Given | Other | Noise


@dataclass(frozen=True, slots=True)
class Judgement:
    """What is to be thought of an adjusted block.

    Attributes
    ----------
    grade
        "wrong": something is flagged, or a photograph is not what it is called; "doubts"; "sound";
        "unknown": nothing is redundant.
    scale
        Sigma0 against the a-priori one: significantly larger, significantly and far smaller, or as
        stated.
    flagged, tested, observations
        How many are flagged, can be tested (`bychance.tested_count`), and take part.
    cause
        What explains most of what is flagged or rejected by tests; None where nothing is.
    refused
        Given points that have no part in the adjustment and that tests reject, the most improbable
        first; none beside a cause, which may be theirs.
    photos
        Photographs that are surely not what they are called, in words.
    hints
        What the strips are certain of: of the accused point; all of it in a bundle that closes.
    by_chance
        Whether so much is flagged, and so far out, in one of twenty blocks where nothing is wrong.
    """

    grade: Grade
    scale: Scale
    flagged: int
    tested: int
    observations: int
    cause: Cause | None
    refused: tuple[Given, ...]
    photos: tuple[str, ...]
    hints: tuple[str, ...]
    by_chance: bool

    @property
    def hardly_tested(self) -> bool:
        """Whether many observations cannot be tested."""
        return self.tested < _FEW_TESTED * self.observations


def judged(found: BlockAdjustment, status: BlockStatus) -> Judgement:
    """Return what is to be thought of an adjusted block.

    Parameters
    ----------
    found
        What `adjust` has found.
    status
        Where the block stands, without what was rejected.
    """
    block = found.block
    tested = tested_count(block)
    scale = _scale(block)
    cause = _cause(found, scale)
    refused = () if cause is not None else tuple(_refused_beside(found))
    photos = tuple(one.text for one in status.accidents.photos)
    flagged = int(block.tested.flagged.sum())
    said = partial(
        Judgement,
        scale=scale,
        flagged=flagged,
        tested=tested,
        observations=int(block.tested.use.sum()),
        cause=cause,
        refused=refused,
        photos=photos,
        hints=tuple(_hints(status, cause, scale)),
        by_chance=may_be_chance(block),
    )
    if block.critical is None or block.redundancy < 1:
        return said("unknown")
    doubts = said("doubts")
    if (flagged and not doubts.by_chance) or photos:
        return said("wrong")
    if flagged or scale != "stated" or cause or refused or doubts.hints or doubts.hardly_tested:
        return doubts
    return said("sound")


def least_sigma0(block: AdjustedBlock) -> float | None:
    """Return the sigma0^2 that one of twenty good blocks stays below; None without redundancy."""
    if block.redundancy < 1:
        return None
    from scipy.special import chdtri

    return float(chdtri(block.redundancy, 1.0 - ALARM)) / block.redundancy


def _scale(block: AdjustedBlock) -> Scale:
    most, least, sigma0 = sigma0_limit(block), least_sigma0(block), block.sigma0
    if most is None or least is None or sigma0 is None:
        return "none"
    if sigma0**2 > most:
        return "larger"
    return "smaller" if sigma0**2 < min(least, _SMALL**2) else "stated"


class _Accused(NamedTuple):
    """What is accused, how much of v'Pv it explains with how many conditions."""

    cause: Cause
    square: float
    conditions: int

    @property
    def surprise(self) -> float:
        """About -2 log P of chi-square; of large values P itself is zero in the computer."""
        if self.conditions == 1:
            return self.square + log(max(self.square, 1.0) * pi / 2.0)
        return self.square


def _cause(found: BlockAdjustment, scale: Scale) -> Cause | None:
    """Return the most improbable of what the adjustment itself accuses."""
    accused = list(_accused(found))
    if scale == "larger":
        among = own_tests(found.block).tests
        accused = [one for one in accused if _stands_out(found.block, one, among)]
        if not accused:
            return Noise()
    first = max(accused, key=lambda one: one.surprise, default=None)
    return None if first is None else first.cause


def _accused(found: BlockAdjustment) -> Iterator[_Accused]:
    """Yield what is accused; of two that are as improbable the first bends the rays about it."""
    block = found.block
    sigma = block.sigma or 1.0
    control = found.hypotheses.control
    if control is not None and control.against == "photographs":
        for part in control.parts:
            if part.verdict is not None and part.verdict.rejected:
                yield _of_given(Given("control", part))
    for w, what, _ in others_flagged(block)[:1]:
        yield _Accused(Other(what, w), (sigma * w) ** 2, 1)
    suspect = likeliest_suspect(block)
    if suspect is not None:
        worst = float(np.abs(block.w[block.flagged]).max())
        yield _Accused(suspect, (sigma * worst) ** 2, 1)


def _of_given(given: Given) -> _Accused:
    assert given.part.verdict is not None
    test = given.part.verdict.known
    return _Accused(given, test.square, test.dimension)


def _stands_out(block: AdjustedBlock, accused: _Accused, among: int) -> bool:
    """Whether what is accused is improbable among so many tests with the estimated sigma0, too."""
    if isinstance(accused.cause, Given):
        verdict = accused.cause.part.verdict
        return verdict is None or verdict.estimated is None or verdict.estimated.rejected
    if block.redundancy < 2 or not block.sigma0:
        return True
    tau = TestDistribution(block.redundancy)
    return exceeding_by_chance(tau, sqrt(accused.square) / block.sigma0, among) <= ALARM


def tested_parts(found: BlockAdjustment) -> Iterator[Given]:
    """Yield plan and height of the given points, with their tests."""
    tests = found.hypotheses
    for use, tested in (("control", tests.control), ("check", tests.check)):
        yield from (Given(use, part) for part in (() if tested is None else tested.parts))


def _refused_beside(found: BlockAdjustment) -> list[Given]:
    """Return given points that a test rejects and that have no part in the adjustment."""
    refused = [
        one
        for one in tested_parts(found)
        if one.part.verdict is not None and one.part.verdict.rejected
    ]
    return sorted(refused, key=lambda one: -_of_given(one).surprise)


def _hints(status: BlockStatus, cause: Cause | None, scale: Scale) -> Iterator[str]:
    certain = [one for one in status.accidents.found if one.accident.certain]
    if isinstance(cause, Suspect):
        strips = {
            strip.strip
            for strip in status.strips
            for model in strip.models
            if cause.where.photo in (model.left, model.right)
        }
        certain = [
            one for one in certain if one.accident.point == cause.point and one.strip in strips
        ]
    elif cause is not None or scale == "larger":
        return
    yield from (f"model {one.model}: {one.accident.text}" for one in certain)


def mean_deviations(block: AdjustedBlock) -> tuple[float, float, float] | None:
    """Return mean standard deviations [m] of new points in X, Y, Z, with the sigma of the tests.

    What is given free of error or observed on the ground is not counted, but where there is nothing
    else; None where sigma0 does not exist, or all is free of error.
    """
    if block.sigma is None:
        return None
    problem = block.problem
    s = block.sigma * block.cofactors.point_deviations
    unknown = ~problem.fixed if problem.datum == "control" else np.ones(s.shape, dtype=bool)
    new = unknown & ~np.isfinite(problem.known_sigma)
    out = [
        float(of[here].mean()) if here.any() else float(of[there].mean()) if there.any() else None
        for of, here, there in zip(s.T, new.T, unknown.T, strict=True)
    ]
    x, y, z = out
    return None if x is None or y is None or z is None else (x, y, z)


def points_of_two_photos(block: AdjustedBlock) -> int:
    """Return how many points have used image coordinates in two photographs, or in one.

    A photograph counts once, whatever models it was measured in.
    """
    problem = block.problem
    used = block.tested.use[: block.observations.image].reshape(-1, 2).any(axis=1)
    pairs = np.unique(np.stack((problem.point[used], problem.photo[used]), axis=1), axis=0)
    photos = np.bincount(pairs[:, 0], minlength=len(problem.points))
    return int(((photos > 0) & (photos < 3)).sum())
