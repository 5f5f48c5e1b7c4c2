"""What one control point is worth to a block, and what a wrong one would do.

With z the errors that fit a point's own residuals best (eq. 18 of Gruen 1978, see
`anaplot.bundle.hypotheses.errorsets`), giving the point up changes the adjustment as if the given
coordinates were less by z: the photographs then make them given - z, and every other point moves by
what -z does to it. To first order that is the adjustment without the point, with no other
adjustment; the covariance of z, (C'RC)^-1 in units of its sigmas, is that of both together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import f_noncentrality
from anaplot.adjustment.tested import Observation
from anaplot.bundle.hypotheses.checktests import check_tests
from anaplot.bundle.hypotheses.controltests import control_tests
from anaplot.bundle.hypotheses.errorsets import (
    ErrorSet,
    ErrorSetTest,
    error_set_tests,
    set_statistic,
)
from anaplot.bundle.hypotheses.verdict import HypothesisSettings, VarianceFactor
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.residuals import residuals_of
from anaplot.bundle.solve.rows import RayRow

__all__ = [
    "ControlPage",
    "ControlPart",
    "ControlRay",
    "ControlVerdict",
    "Movement",
    "WithoutPoint",
    "control_pages",
]

ControlVerdict = Literal["good", "look", "weak", "unchecked"]

_WEAK = 0.1
"""Redundancy number below which an error has to be three times as large as a free one's to show."""

_AXES = "XYZ"


class Movement(NamedTuple):
    """A point that moves.

    Attributes
    ----------
    point
        Its name.
    by
        In X, Y, Z [m].
    """

    point: str
    by: tuple[float, float, float]


class ControlPart(NamedTuple):
    """Plan, or height, of a control point.

    Attributes
    ----------
    r
        Mean redundancy number of its coordinates; None of a check point, and of control that is
        free of error.
    detectable
        Length [m] of the smallest error that is found with the power of the block's test, in plan
        along the worst direction; None where nothing is found at any size.
    effect
        The point that such an error moves farthest; None where there is no `r`.
    """

    r: float | None
    detectable: float | None
    effect: Movement | None


class WithoutPoint(NamedTuple):
    """What the block would be without a control point.

    Attributes
    ----------
    difference
        Photogrammetric coordinates minus given ones [m], as at a check point; None where a
        coordinate is not given.
    s
        Their standard deviations [m], of both, with the sigma that the block's test says.
    farthest
        The other point that moves farthest; None where there is none.
    heights
        Mean and root mean square of what the heights of all other points move by [m].
    held
        Coordinates that are free of error: no observations, they hold the point all the same.
    """

    difference: tuple[float | None, float | None, float | None]
    s: tuple[float | None, float | None, float | None]
    farthest: Movement | None
    heights: tuple[float, float]
    held: tuple[str, ...] = ()


class ControlRay(NamedTuple):
    """A control point in a photo.

    Attributes
    ----------
    photo
        Its name.
    v
        (vx, vy) adjusted minus observed [um].
    pixel_um
        Size of a pixel [um]; None where the photo has no pixels.
    flagged
        Whether the test flags one of them.
    """

    photo: str
    v: tuple[float, float]
    pixel_um: float | None
    flagged: bool


@dataclass(frozen=True, slots=True)
class ControlPage:
    """A control or check point.

    Attributes
    ----------
    point
        Its name.
    use
        "control", "check", "fixed": control that is free of error, or "rejected": none of it is an
        observation any more.
    rays
        Where it is seen.
    verdict
        "look": something is flagged; "unchecked": an error of any size stays unseen; "weak": only
        a large one is seen; "good".
    plan, height
        None where it has no such coordinate, or only some of its coordinates are free of error
        and this one is.
    without
        None of a check point (its own differences stand in `difference`), of control that is free
        of error, and where the block would not be determined without it.
    difference, s
        Of a check point: adjusted minus given [m], and standard deviations.
    rejected
        Its coordinates that are no observations any more.
    """

    point: str
    use: Literal["control", "check", "fixed", "rejected"]
    rays: tuple[ControlRay, ...]
    verdict: ControlVerdict
    plan: ControlPart | None = None
    height: ControlPart | None = None
    without: WithoutPoint | None = None
    difference: tuple[float | None, float | None, float | None] = (None, None, None)
    s: tuple[float | None, float | None, float | None] = (None, None, None)
    rejected: tuple[str, ...] = ()


def control_pages(block: AdjustedBlock) -> tuple[ControlPage, ...]:
    """Return a page for every control and check point that is in the block, in file order.

    With the significance and the power of the block's test. In a datum without control none of
    them takes part, and there is none.
    """
    problem = block.problem
    if problem.datum != "control":
        return ()
    at = {name: k for k, name in enumerate(problem.points)}
    held = dict(zip(problem.points, problem.fixed.tolist(), strict=True))
    rays: dict[str, list[RayRow]] = {}
    wanted = {name for name, row in problem.control_rows.items() if row.use != "off"} & set(at)
    for ray in block.ray_rows():
        if ray.point in wanted:
            rays.setdefault(ray.point, []).append(ray)
    tested = {one.key: one for one in block.control_rows()}
    mine: dict[str, dict[str, ObservationName]] = {}
    for one in tested.values():
        if one.use:
            mine.setdefault(str(one.key[1]), {})[str(one.key[2])] = one.key
    sets = {
        (point, part): ErrorSet(f"{point} {part}", names, by_length=True)
        for point, by_axis in mine.items()
        for part, axes in (("plan", "XY"), ("height", "Z"), ("all", _AXES))
        if (names := tuple(by_axis[axis] for axis in axes if axis in by_axis))
    }
    tests = dict(zip(sets, error_set_tests(block, tuple(sets.values())), strict=True))
    numbers = block.observations.image + block.observations.in_file_order(0)
    number = dict(zip(tested, numbers.tolist(), strict=True))
    flagged = {str(one.key[1]) for one in tested.values() if one.flagged}
    checks = _checks(block)
    fixed_parts: dict[tuple[str, str], _FixedPart] | None = None
    pages = []
    for name, row in problem.control_rows.items():
        if name not in wanted:
            continue
        seen = tuple(_ray(block, ray) for ray in rays.get(name, ()))
        look = name in flagged or any(ray.flagged for ray in seen)
        if row.use == "check":
            known = checks.get(name)
            page = _bare(name, seen, look) if known is None else known.page(name, seen, look)
            pages.append(page)
            continue
        gone = tuple(
            axis
            for axis, value, fixed in zip(_AXES, row.xyz, held[name], strict=True)
            if value is not None and not fixed and axis not in mine.get(name, {})
        )
        look = look or bool(gone)
        if name not in mine and gone:
            pages.append(ControlPage(name, "rejected", seen, "look", rejected=gone))
            continue
        if name not in mine:
            fixed_parts = _fixed_parts(block) if fixed_parts is None else fixed_parts
            pages.append(_fixed_page(name, seen, look, fixed_parts))
            continue
        plan, height, every = (tests.get((name, part)) for part in ("plan", "height", "all"))
        look = look or any(one is not None and one.rejected for one in (plan, height, every))
        in_plan, in_height = _part(tested, plan), _part(tested, height)
        rows = {axis: number[key] for axis, key in mine[name].items()}
        without = _without(block, rows, at[name])
        if without is not None:
            stays = tuple(axis for axis, is_held in zip(_AXES, held[name], strict=True) if is_held)
            without = without._replace(held=stays)
        parts = [part for part in (in_plan, in_height) if part is not None]
        verdict: ControlVerdict = "look" if look else _verdict(parts)
        pages.append(
            ControlPage(name, "control", seen, verdict, in_plan, in_height, without, rejected=gone)
        )
    return tuple(pages)


def _ray(block: AdjustedBlock, ray: RayRow) -> ControlRay:
    camera = block.problem.block.camera_of(ray.photo)
    x, y = ray.xy
    pixel = None if camera.pixels is None else 1e3 * camera.pixel_mm
    return ControlRay(ray.photo, (x.residual, y.residual), pixel, x.flagged or y.flagged)


def _part(
    tested: Mapping[ObservationName, Observation[ObservationName]], found: ErrorSetTest | None
) -> ControlPart | None:
    if found is None:
        return None
    r = [tested[one.name].r for one in found.errors]
    worst = [one.worst for one in found.errors]
    # a direction that nothing checks: no size is found along it
    if found.undetectable or any(one is None for one in worst):
        return ControlPart(float(np.mean(r)), None, None)
    length = float(np.linalg.norm(np.array(worst, dtype=float)))
    effect = None
    if found.moved is not None and found.moved_m is not None:
        effect = Movement(found.moved, found.moved_m)
    return ControlPart(float(np.mean(r)), length, effect)


def _verdict(parts: list[ControlPart]) -> ControlVerdict:
    if any(part.detectable is None for part in parts):
        return "unchecked"
    return "weak" if any((part.r or 0.0) < _WEAK for part in parts) else "good"


class _FixedPart(NamedTuple):
    found: ControlPart
    rejected: bool


def _fixed_parts(block: AdjustedBlock) -> dict[tuple[str, str], _FixedPart]:
    """Return plan and height of all control, tested by what the photographs make of it."""
    test = block.problem.test
    found = control_tests(block, HypothesisSettings(test.alpha, test.power))
    out: dict[tuple[str, str], _FixedPart] = {}
    for one in () if found is None else found.parts:
        size, rejected = None, False
        decisive = None if one.verdict is None else one.verdict.decisive
        if one.largest is not None and decisive is not None:
            degrees = VarianceFactor.of(block).without(0.0, one.coordinates).degrees
            square = f_noncentrality(test.alpha, test.power, one.coordinates, degrees)
            size = float(np.sqrt(square)) * one.largest
            rejected = decisive.significance < test.alpha
        out[one.point, one.part] = _FixedPart(ControlPart(None, size, None), rejected)
    return out


def _fixed_page(
    name: str,
    seen: tuple[ControlRay, ...],
    look: bool,
    parts: Mapping[tuple[str, str], _FixedPart],
) -> ControlPage:
    """Return the page of control that is free of error: no observation, and tested all the same.

    At best it is weak: where an ever smaller sigma leads, a redundancy number of zero.
    """
    plan, height = parts.get((name, "plan")), parts.get((name, "height"))
    mine = [part for part in (plan, height) if part is not None]
    look = look or any(part.rejected for part in mine)
    verdict: ControlVerdict = "unchecked"
    if look or mine:
        verdict = "look" if look else _verdict([part.found for part in mine])
    return ControlPage(
        name,
        "fixed",
        seen,
        verdict,
        None if plan is None else plan.found,
        None if height is None else height.found,
    )


def _without(block: AdjustedBlock, row_of: Mapping[str, int], point: int) -> WithoutPoint | None:
    """Return what the block would be without a point, whose coordinates are observed in rows."""
    # its columns of R go with it: of all control points they would be a matrix
    system = residuals_of(block)
    axes = [axis for axis in _AXES if axis in row_of]
    rows = np.array([row_of[axis] for axis in axes], dtype=np.intp)
    found = set_statistic(system, rows)
    if found.undetectable or block.sigma is None:
        return None
    error = found.estimated
    covariance = (found.axes / found.values) @ found.axes.T
    sigma = system.sigma[rows]
    difference = dict(zip(axes, (-error * sigma).tolist(), strict=True))
    deviation = block.sigma * np.sqrt(np.diag(covariance)) * sigma
    s = dict(zip(axes, deviation.tolist(), strict=True))
    moved = -(system.moves(rows) @ error)
    others = np.flatnonzero(np.arange(len(moved)) != point)
    farthest, heights = None, (0.0, 0.0)
    if len(others):
        moved = moved[others]
        k = int(np.argmax((moved**2).sum(axis=1)))
        x, y, z = moved[k].tolist()
        farthest = Movement(block.problem.points[int(others[k])], (x, y, z))
        up = moved[:, 2]
        heights = float(up.mean()), float(np.sqrt((up**2).mean()))
    return WithoutPoint(
        (difference.get("X"), difference.get("Y"), difference.get("Z")),
        (s.get("X"), s.get("Y"), s.get("Z")),
        farthest,
        heights,
    )


class _Check(NamedTuple):
    difference: dict[str, float]
    s: dict[str, float]
    mdb: dict[str, float]
    rejected: bool

    def page(self, name: str, seen: tuple[ControlRay, ...], look: bool) -> ControlPage:
        plan, height = self.mdb.get("plan"), self.mdb.get("Z")
        return ControlPage(
            name,
            "check",
            seen,
            "look" if look or self.rejected else "good",
            None if plan is None else ControlPart(None, plan, None),
            None if height is None else ControlPart(None, height, None),
            difference=(
                self.difference.get("X"),
                self.difference.get("Y"),
                self.difference.get("Z"),
            ),
            s=(self.s.get("X"), self.s.get("Y"), self.s.get("Z")),
        )


def _bare(name: str, seen: tuple[ControlRay, ...], look: bool) -> ControlPage:
    """Return the page of a check point whose differences cannot be tested."""
    return ControlPage(name, "check", seen, "look" if look else "unchecked")


def _checks(block: AdjustedBlock) -> dict[str, _Check]:
    test = block.problem.test
    found = check_tests(block, HypothesisSettings(test.alpha, test.power))
    if found is None:
        return {}
    rejected = {one.point for one in found.points if one.verdict.rejected}
    rejected |= {one.point for one in found.coordinates if one.verdict.rejected}
    out: dict[str, _Check] = {}
    sigma = 1.0 if block.sigma is None else block.sigma
    sigmas = 0.0
    for one in found.coordinates:
        mine = out.setdefault(one.point, _Check({}, {}, {}, one.point in rejected))
        mine.difference[one.axis] = one.difference
        mine.s[one.axis] = sigma * one.s
        mine.mdb[one.axis] = one.mdb
        sigmas = one.mdb / one.s  # that are found, along any direction
    for point, mine in out.items():
        if mine.mdb.keys() >= {"X", "Y"}:
            mine.mdb["plan"] = sigmas * _largest_in_plan(block, point)
        elif along := [mine.mdb[axis] for axis in "XY" if axis in mine.mdb]:
            mine.mdb["plan"] = along[0]
    return out


def _largest_in_plan(block: AdjustedBlock, point: str) -> float:
    """Return the largest standard deviation of a difference [m] along any direction in plan."""
    problem = block.problem
    q = block.cofactors.points[block.point_number(point), :2, :2]
    given = problem.given_sigma(problem.control_rows[point])[:2]
    return float(np.sqrt(np.linalg.eigvalsh(q + np.diag(np.square(given)))[-1]))
