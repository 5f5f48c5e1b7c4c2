"""Do check points agree with the adjusted block, both covariances counted (Gruen 1978, D2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import DependentConditionsError, quadratic_form, sidak_alpha
from anaplot.aliases import Array
from anaplot.bundle.hypotheses.givenparts import PartTest, parts_of
from anaplot.bundle.hypotheses.verdict import USUAL, HypothesisSettings, VarianceFactor, Verdict
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.problem import listed

__all__ = [
    "CheckCoordinateTest",
    "CheckGroupTest",
    "CheckPointTest",
    "CheckTests",
    "DeformationTest",
    "check_tests",
]


_MOST = 1500  # check coordinates that are tested together
_GROUPS = ("XYZ", "XY", "X", "Y", "Z")


class CheckGroupTest(NamedTuple):
    """All check coordinates of some axes together (eq. 48, 49).

    Attributes
    ----------
    axes
        "XYZ", "XY", "X", "Y" or "Z".
    coordinates
        Their number.
    rms
        Root mean square of the differences [m] (eq. 46).
    expected
        What it is expected to be [m] for the a-priori sigma0: from the trace of both covariances.
    verdict
        Of "all differences are zero".
    """

    axes: str
    coordinates: int
    rms: float
    expected: float
    verdict: Verdict


class CheckPointTest(NamedTuple):
    """The coordinates of one check point together; the family of points keeps the significance."""

    point: str
    coordinates: int
    verdict: Verdict


class CheckCoordinateTest(NamedTuple):
    """One check coordinate.

    Attributes
    ----------
    point, axis
        Which one.
    difference
        Adjusted minus given [m].
    s
        Its standard deviation [m] for the a-priori sigma0, of both.
    s_block, s_given
        Of the adjusted and of the given coordinate alone [m].
    verdict
        The family of all check coordinates keeps the significance.
    mdb
        Smallest difference [m] that is found with the settings' power.
    """

    point: str
    axis: str
    difference: float
    s: float
    s_block: float
    s_given: float
    verdict: Verdict
    mdb: float


class DeformationTest(NamedTuple):
    """A polynomial deformation of one axis, each term for itself.

    Attributes
    ----------
    axis, term
        "X", "Y" or "Z", and "shift", "slope along X", "slope along Y" or "bowl".
    size, s
        Estimated size [m] at the edge of the check points (of the shift: anywhere), and its
        standard deviation for the a-priori sigma0.
    verdict
        The family of all terms keeps the significance.
    mdb
        Smallest size [m] that is found with the settings' power.
    """

    axis: str
    term: str
    size: float
    s: float
    verdict: Verdict
    mdb: float


@dataclass(frozen=True, slots=True, eq=False)
class CheckTests:
    """The hypotheses about check points.

    Attributes
    ----------
    groups
        All coordinates, and those of single axes; empty when they are not tested together.
    points, coordinates
        Every point and every coordinate.
    deformations
        Terms of a systematic deformation.
    remarks
        Sentences for a person.
    parts
        Plan and height of every point.
    sigma_factor
        Of the standard deviations that the given coordinates state: that of control where its
        variance was estimated, else 1.
    """

    groups: tuple[CheckGroupTest, ...]
    points: tuple[CheckPointTest, ...]
    coordinates: tuple[CheckCoordinateTest, ...]
    deformations: tuple[DeformationTest, ...] = field(repr=False)
    remarks: tuple[str, ...]
    parts: tuple[PartTest, ...] = ()
    sigma_factor: float = 1.0


class _Differences(NamedTuple):
    """Check coordinates, their differences and covariances for sigma0 = 1."""

    names: list[tuple[str, str]]
    plan: Array  # (k, 2) where they are, X and Y
    d: Array
    q_block: Array
    q: Array


def check_tests(block: AdjustedBlock, settings: HypothesisSettings = USUAL) -> CheckTests | None:
    """Test adjusted against given coordinates of the check points; None when there are none.

    The covariance of a difference is that of the adjusted coordinate plus that of the given one:
    its standard deviation in the control file (0: free of error), or the block's default, with the
    factor of control where that was estimated: check points are control that is held back. Only
    with datum "control": other datums do not lie in the system of the check points.
    """
    problem = block.problem
    wanted = [
        (name, axis, value)
        for name, row in problem.control_rows.items()
        if row.use == "check"
        for axis, value in enumerate(row.xyz)
        if value is not None
    ]
    at = {name: k for k, name in enumerate(problem.points)}
    missing = list(dict.fromkeys(name for name, _, _ in wanted if name not in at))
    wanted = [(name, axis, value) for name, axis, value in wanted if name in at]
    if problem.datum != "control" or not (wanted or missing):
        return None
    remarks = []
    if missing:
        remarks.append(f"check points that are not in the adjustment: {listed(missing)}")
    if not wanted:
        return CheckTests((), (), (), (), tuple(remarks))
    known = problem.estimated
    factor = 1.0 if known is None else known.check
    if known is not None:
        remarks.append(_taken(factor, known.control_degrees))
    together = len(wanted) <= _MOST
    if not together:
        remarks.append(
            f"{len(wanted)} check coordinates are tested one by one, not all together "
            f"(that is done up to {_MOST})"
        )
    differences = _differences(block, wanted, together=together)
    positive = np.diag(differences.q) > 0.0
    if not positive.all():
        remarks.append(
            "check coordinates free of error at points free of error are not tested: "
            + ", ".join(
                f"{axis} of {name}"
                for (name, axis), good in zip(differences.names, positive, strict=True)
                if not good
            )
        )
        keep = np.nonzero(positive)[0]
        differences = _Differences(
            [differences.names[k] for k in keep],
            differences.plan[keep],
            differences.d[keep],
            differences.q_block[np.ix_(keep, keep)],
            differences.q[np.ix_(keep, keep)],
        )
        if not len(keep):
            return CheckTests((), (), (), (), tuple(remarks), sigma_factor=factor)
    variance = VarianceFactor.of(block)
    if known is not None and known.control_degrees is not None:
        variance = _with_control(variance, differences, known.control_degrees)
    groups: tuple[CheckGroupTest, ...] = ()
    deformations: tuple[DeformationTest, ...] = ()
    if together:
        try:
            groups = _groups(differences, variance, settings)
            deformations = _deformations(differences, variance, settings)
        except DependentConditionsError:
            groups, deformations = (), ()
            remarks.append(
                "the check coordinates are not independent of each other: only single points are "
                "tested"
            )
    return CheckTests(
        groups,
        _points(differences, variance, settings),
        _coordinates(differences, variance, settings),
        deformations,
        tuple(remarks),
        _parts(differences, variance, settings),
        factor,
    )


def _differences(
    block: AdjustedBlock, wanted: Sequence[tuple[str, int, float]], *, together: bool
) -> _Differences:
    problem = block.problem
    at = {name: k for k, name in enumerate(problem.points)}
    places = [(at[name], axis) for name, axis, _ in wanted]
    index = np.array(places)
    found = block.state.points[index[:, 0]]
    given = np.array([value for _, _, value in wanted]) - block.state.origin[index[:, 1]]
    if together:
        q_block = coordinate_cofactors(block, places)
    else:
        # of one point each: that is all its own tests need
        same = index[:, None, 0] == index[None, :, 0]
        q_block = np.zeros((len(places), len(places)))
        i, j = np.nonzero(same)
        q_block[i, j] = block.cofactors.points[index[i, 0], index[i, 1], index[j, 1]]
    spread = [problem.given_sigma(problem.control_rows[name])[axis] for name, axis, _ in wanted]
    return _Differences(
        [(name, "XYZ"[axis]) for name, axis, _ in wanted],
        found[:, :2] + block.state.origin[:2],
        found[np.arange(len(index)), index[:, 1]] - given,
        q_block,
        q_block + np.diag(np.square(spread)),
    )


def _taken(factor: float, degrees: float | None) -> str:
    if degrees is None:
        return "check points are taken to err as stated: no variance of control was estimated"
    return (
        f"check points are taken to err {factor:.3g} times as much as stated, as control does, "
        f"whose variance was estimated with {degrees:.3g} degrees of freedom"
    )


def _with_control(
    variance: VarianceFactor, differences: _Differences, degrees: float
) -> VarianceFactor:
    """Return the variance factor of differences to what errs by an estimated variance.

    What is expected of a difference is known with the degrees of freedom of that estimate as far
    as the given coordinate makes it (Satterthwaite). That in which it makes most counts for all.
    """
    if variance.sigma is None:
        return variance
    share = 1.0 - float((np.diag(differences.q_block) / np.diag(differences.q)).min())
    left = 1.0 / (share**2 / degrees + 1.0 / variance.redundancy)
    return variance.estimated_with(max(1, int(left)))


def _groups(
    differences: _Differences, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[CheckGroupTest, ...]:
    out = []
    axes_present = {axis for _, axis in differences.names}
    for axes in _GROUPS:
        if axes != "XYZ" and not axes_present >= set(axes):
            continue
        if axes == "XYZ" and len(axes_present) == 1:
            continue  # that axis alone says the same
        mine = [k for k, (_, axis) in enumerate(differences.names) if axis in axes]
        d, q = differences.d[mine], differences.q[np.ix_(mine, mine)]
        out.append(
            CheckGroupTest(
                axes,
                len(mine),
                sqrt(float(d @ d) / len(mine)),
                sqrt(float(np.trace(q)) / len(mine)),
                variance.test(quadratic_form(d, q), len(mine), settings.alpha),
            )
        )
    return tuple(out)


def _points(
    differences: _Differences, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[CheckPointTest, ...]:
    names = list(dict.fromkeys(name for name, _ in differences.names))
    alpha = sidak_alpha(settings.alpha, len(names))
    out = []
    for name in names:
        mine = [k for k, (owner, _) in enumerate(differences.names) if owner == name]
        square = quadratic_form(differences.d[mine], differences.q[np.ix_(mine, mine)])
        out.append(CheckPointTest(name, len(mine), variance.test(square, len(mine), alpha)))
    return tuple(out)


def _parts(
    differences: _Differences, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[PartTest, ...]:
    parts = parts_of(differences.names)
    alpha = sidak_alpha(settings.alpha, len(parts))
    out = []
    for (name, part), mine in parts.items():
        d, q = differences.d[mine], differences.q[np.ix_(mine, mine)]
        out.append(
            PartTest(
                name,
                part,
                len(mine),
                float(d[0]) if part == "height" else float(np.linalg.norm(d)),
                sqrt(float(np.trace(q))),
                variance.test(quadratic_form(d, q), len(mine), alpha),
            )
        )
    return tuple(out)


def _coordinates(
    differences: _Differences, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[CheckCoordinateTest, ...]:
    alpha = sidak_alpha(settings.alpha, len(differences.d))
    noncentrality = variance.detectable(alpha, settings.power)
    out = []
    for k, (name, axis) in enumerate(differences.names):
        d, q = float(differences.d[k]), float(differences.q[k, k])
        own = float(differences.q_block[k, k])
        out.append(
            CheckCoordinateTest(
                name,
                axis,
                d,
                sqrt(q),
                sqrt(max(own, 0.0)),
                sqrt(max(q - own, 0.0)),
                variance.test(d * d / q, 1, alpha),
                sqrt(noncentrality * q),
            )
        )
    return tuple(out)


def _deformations(
    differences: _Differences, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[DeformationTest, ...]:
    """Fit shift, slopes and bowl to each axis, every term alone, by generalised least squares."""
    rows = []
    for axis in "XYZ":
        mine = [k for k, (_, other) in enumerate(differences.names) if other == axis]
        if len(mine) < 2:
            continue
        at = differences.plan[mine] - differences.plan[mine].mean(axis=0)
        reach = np.abs(at).max(axis=0)
        terms = [("shift", np.ones(len(mine)))]
        for column, label in enumerate(("slope along X", "slope along Y")):
            if len(mine) >= 3 and reach[column] > 0.0:
                terms.append((label, at[:, column] / reach[column]))
        square = np.einsum("ij,ij->i", at, at)
        if len(mine) >= 4 and np.ptp(square) > 0.0:
            terms.append(("bowl", square / square.max()))
        d, q = differences.d[mine], differences.q[np.ix_(mine, mine)]
        for label, term in terms:
            weighted = np.linalg.solve(q, term)
            size = float(term @ weighted)
            rows.append((axis, label, float(weighted @ d) / size, sqrt(1.0 / size)))
    if not rows:
        return ()
    alpha = sidak_alpha(settings.alpha, len(rows))
    noncentrality = variance.detectable(alpha, settings.power)
    return tuple(
        DeformationTest(
            axis,
            label,
            value,
            s,
            variance.test((value / s) ** 2, 1, alpha),
            sqrt(noncentrality) * s,
        )
        for axis, label, value, s in rows
    )
