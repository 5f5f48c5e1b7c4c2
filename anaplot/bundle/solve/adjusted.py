"""An adjusted bundle: values, tests and reliability, as arrays and as rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt

import numpy as np

from anaplot.adjustment.consistency import GlobalTest, global_from_single
from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.tested import AppliedTest, Observation, Tested, examine
from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.checkedrows import checked_rows
from anaplot.bundle.solve.gaussnewton import Convergence
from anaplot.bundle.solve.imaging import BlockState, RobustPlace
from anaplot.bundle.solve.linearised import image_misclosures
from anaplot.bundle.solve.observations import (
    ORIENTATION,
    ObservationName,
    Observations,
    observations_of,
)
from anaplot.bundle.solve.parameternames import parameter_names
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors
from anaplot.bundle.solve.rows import (
    Indicators,
    ParameterRow,
    PhotoRow,
    PointRow,
    RayRow,
)
from anaplot.bundle.solve.selection import left_out_sentences
from anaplot.bundle.solve.upright import upright_sentences
from anaplot.photogrammetry.block import ControlPoint
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.rotation import rotation_angles, rotation_axes

__all__ = ["AdjustedBlock", "observation_in_words"]


_PORTION = 4096  # rays that are rows at a time

_Difference = tuple[float | None, float | None, float | None]


@dataclass(frozen=True, eq=False)
class AdjustedBlock:
    """An adjusted bundle.

    Attributes
    ----------
    problem, state
        What was adjusted, and the values of the unknowns.
    cofactors
        Cofactors and redundancy numbers.
    convergence
        How it was found.
    vtpv, redundancy
        Weighted sum of squares, n - u + defect.
    v
        (m, 2) residuals of the image coordinates in units of their a-priori sigmas; zero where
        they are rejected.
    warnings, of_control
        Sentences for a person about the solution; of them what is wrong with control as a whole.
    robust
        A robust solution, where one was looked for because of gross errors, or None.
    """

    problem: Problem = field(repr=False)
    state: BlockState = field(repr=False)
    cofactors: Cofactors = field(repr=False)
    convergence: Convergence
    vtpv: float
    redundancy: int
    v: Array = field(repr=False)
    warnings: tuple[str, ...]
    robust: RobustPlace | None = field(default=None, repr=False)
    of_control: str | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences for a person: what takes no part, the warnings, how the block lies."""
        lies = upright_sentences(self.problem, self.state.rotations)
        return (*left_out_sentences(self.problem.left_out), *self.warnings, *lies)

    @cached_property
    def test(self) -> AppliedTest:
        """The test of single observations."""
        return AppliedTest.of(self.problem.test, self.redundancy)

    @property
    def sigma0(self) -> float | None:
        """Factor sqrt(v'Pv / redundancy); None without redundancy."""
        return sqrt(self.vtpv / self.redundancy) if self.redundancy > 0 else None

    @property
    def sigma(self) -> float | None:
        """The factor that the test and the standard deviations use; None without."""
        return self.test.factor(self.sigma0)

    @property
    def critical(self) -> float | None:
        """Critical value of a single test; None where there is none."""
        return self.test.critical

    @cached_property
    def _point_numbers(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.problem.points)}

    def point_number(self, point: str) -> int:
        """Return which of the problem's points a name is; ValueError where it is none."""
        number = self._point_numbers.get(point)
        if number is None:
            raise ValueError(f"no point {point!r} in the block")
        return number

    @cached_property
    def observations(self) -> Observations:
        """Which observations there are."""
        return observations_of(self.cofactors)

    @cached_property
    def tested(self) -> Tested[ObservationName]:
        """The tested observations, in the order of `observations`."""
        problem, rows, cofactors = self.problem, self.observations, self.cofactors
        linear, own = cofactors.normal.linear, problem.photo_invariant
        out = self.rejected
        v = self.v
        if out.any():
            v = np.where(out, image_misclosures(problem, self.state)[0], v)
        white = rows.gather(
            v,
            linear.point_e,
            linear.photo_e,
            linear.own_e if own else linear.shared_e,
            _conditions_left(cofactors),
            None if linear.offsets is None else linear.offsets.e,
        )
        held = cofactors.r_own if own else cofactors.r_shared
        use = np.ones(rows.count, dtype=bool)
        use[: rows.image] = ~out.ravel()
        firm = np.zeros(rows.count, dtype=bool)
        if problem.conditions is not None:
            use[rows.starts[3] :] = ~problem.conditions.rejected
            firm[rows.starts[3] :] = problem.conditions.firm
        _, point, axis = rows.ground.T
        ground = np.full((rows.count, 3), np.nan)
        ground[: rows.image] = cofactors.response.transpose(0, 2, 1).reshape(-1, 3)
        # of an error of one sigma, as the response
        ground[rows.image : rows.starts[1]] = (
            cofactors.points[point, :, axis] / rows.sigma[rows.image : rows.starts[1], None]
        )
        return examine(
            rows.names,
            rows.units,
            white * rows.sigma,
            rows.gather(
                cofactors.r,
                cofactors.r_ground,
                cofactors.r_photo,
                held,
                cofactors.r_conditions,
                None if cofactors.offsets is None else cofactors.offsets.r,
            ),
            rows.sigma,
            vtpv=self.vtpv,
            redundancy=self.redundancy,
            test=problem.test,
            use=use,
            firm=firm,
            moved_ground=ground / rows.sigma[:, None],
        )

    @property
    def w(self) -> Array:
        """(m, 2) standardized residuals; NaN where a coordinate cannot be tested."""
        return self.tested.w[: self.observations.image].reshape(-1, 2)

    @property
    def flagged(self) -> Bools:
        """(m, 2) which image coordinates exceed the critical value."""
        return self.tested.flagged[: self.observations.image].reshape(-1, 2)

    @property
    def any_flagged(self) -> bool:
        """Whether any observation exceeds the critical value."""
        return bool(self.tested.flagged.any())

    @property
    def flagged_by_chance(self) -> float:
        """Number of observations that are flagged in the mean if none has a gross error."""
        can_be = checked_rows(self.tested, self.problem.conditions, self.observations.starts[3])
        return 0.0 if self.critical is None else self.problem.test.alpha * int(can_be.sum())

    def flagged_observations(self) -> list[tuple[float, str, str]]:
        """Return (abs(w), what, kind) of all that exceed the critical value, the worst first.

        Kinds are "image", "control", "point prior", "prior" (of an orientation), "parameter" and
        "condition".
        """
        return [(abs(row.w or 0.0), *observation_in_words(row.key)) for row in self.tested.worst]

    def global_test(self) -> GlobalTest | None:
        """Return Baarda's global test of sigma0^2 that is consistent with the single tests.

        The same power at the same noncentrality (1968; Gruen 1978, eq. 18 and 19): its alpha
        grows with the redundancy, beyond one half in large blocks. It compares designs; as an
        alarm it cries in that share of the blocks without any error. None without redundancy, or
        with a power below alpha.
        """
        test = self.problem.test
        if self.redundancy < 1 or not test.alpha < test.power:
            return None
        return global_from_single(test.alpha, test.power, self.redundancy)

    def indicators(self) -> Indicators:
        """Return the global indicators."""
        return self._indicators

    @cached_property
    def _indicators(self) -> Indicators:
        r = self.cofactors.r
        count = (~self.rejected).sum(axis=0)
        x, y = (r.sum(axis=0) / np.maximum(count, 1)).tolist()
        every = float(r.sum()) / max(int(count.sum()), 1)
        ai_x, ai_y, ai_z = self.cofactors.point_deviations.mean(axis=0).tolist()
        return Indicators(x, y, every, ai_x, ai_y, ai_z, (ai_x + ai_y + ai_z) / 3.0)

    @property
    def rejected(self) -> Bools:
        """(m, 2) which image coordinates have the weight zero."""
        if self.problem.rejected is None:
            return np.zeros(self.v.shape, dtype=bool)
        return self.problem.rejected

    def off_rays(self) -> dict[int, tuple[float, float]]:
        """Return the residuals [um] of rays that are switched off, by their row of the block.

        Adjusted minus observed; of those whose photo and point the others determine.
        """
        aside = self.problem.aside
        if aside is None:
            return {}
        with np.errstate(all="ignore"):
            v = 1e3 * aside.sigma_xy * image_misclosures(aside, self.state)[0]
        good = np.isfinite(v).all(axis=1)
        return {
            row: (x, y)
            for row, (x, y) in zip(aside.source[good].tolist(), v[good].tolist(), strict=True)
        }

    def ray_rows(self) -> Iterator[RayRow]:
        """Return the image points in file order."""
        problem = self.problem
        points = columns_of(problem.block.image_points)
        order = np.argsort(problem.source)
        for start in range(0, len(order), _PORTION):
            part = order[start : start + _PORTION]
            rows = self.tested.rows((2 * part[:, None] + np.arange(2)).ravel())
            for source, x, y in zip(
                problem.source[part].tolist(), rows[::2], rows[1::2], strict=True
            ):
                photo, point = points.photo.at(source), points.point.at(source)
                yield RayRow(source, photo, point, points.model.at(source), (x, y))

    def control_rows(self) -> list[Observation[ObservationName]]:
        """Return the weighted control coordinates in the order of the control file."""
        return self.tested.rows(self.observations.image + self.observations.in_file_order(0))

    def point_prior_rows(self) -> list[Observation[ObservationName]]:
        """Return the priors of points in the order of the control file."""
        return self.tested.rows(self.observations.image + self.observations.in_file_order(1))

    def off_control(self) -> list[tuple[str, str, float | None]]:
        """Return (point, axis, residual) of control that is switched off, in file order.

        Adjusted minus given [m]; None where the others determine no such point.
        """
        rows = [row for row in self.problem.block.control if row.use == "off"]
        return [
            (row.point, axis, v)
            for row, found in zip(rows, self._differences(rows), strict=True)
            for axis, given, v in zip("XYZ", row.xyz, found, strict=True)
            if given is not None
        ]

    def prior_rows(self) -> list[Observation[ObservationName]]:
        """Return the priors on orientations, on additional parameters and on offsets."""
        _, second, _, fourth = self.observations.starts
        return self.tested.rows(np.arange(second, fourth))

    def condition_rows(self) -> list[Observation[ObservationName]]:
        """Return the rows of the conditions between points, in their order."""
        return self.tested.rows(np.arange(self.observations.starts[3], len(self.tested)))

    def photo_rows(self) -> list[PhotoRow]:
        """Return the adjusted orientations in the block's order."""
        centres = (self.state.centres + self.state.origin).tolist()
        angles = [rotation_angles(rotation) for rotation in self.state.rotations]
        axes = np.array([rotation_axes(omega, phi) for omega, phi, _ in angles])
        q = np.einsum("nii->ni", self.cofactors.photos)[:, :6].copy()
        told = np.abs(np.linalg.det(axes)) > 1e-9  # omega and kappa are one at phi = 90 degrees
        inverse = np.linalg.inv(axes[told])
        turned = inverse @ self.cofactors.photos[told, 3:6, 3:6]
        q[told, 3:6] = np.einsum("nij,nij->ni", turned, inverse)
        s = self._deviations(q.ravel())
        unknown = (None, None, None)
        return [
            PhotoRow(
                name,
                (x, y, z),
                angles[k],
                s[6 * k : 6 * k + 3],  # type: ignore[arg-type]
                s[6 * k + 3 : 6 * k + 6] if told[k] else unknown,  # type: ignore[arg-type]
            )
            for k, (name, (x, y, z)) in enumerate(zip(self.problem.photos, centres, strict=True))
        ]

    def point_rows(self) -> list[PointRow]:
        """Return the adjusted points in the order of the image points' file."""
        problem = self.problem
        rays = np.bincount(problem.point, minlength=len(problem.points))
        first = np.full(len(problem.points), len(problem.block.image_points))
        np.minimum.at(first, problem.point, problem.source)
        order = np.argsort(first)
        # all at once: they are as many as half the rays
        s = self._deviations(np.einsum("nii->ni", self.cofactors.points)[order].ravel())
        at = (self.state.points + self.state.origin)[order].tolist()
        return [
            PointRow(problem.points[k], (x, y, z), s_xyz, count)
            for k, (x, y, z), s_xyz, count in zip(
                order.tolist(), at, zip(s[::3], s[1::3], s[2::3], strict=True),
                rays[order].tolist(), strict=True,
            )
        ]  # fmt: skip

    def check_rows(self) -> list[tuple[str, _Difference]]:
        """Return adjusted minus given coordinates [m] of the check points.

        With a free or minimal datum the control points are check points too.
        """
        problem = self.problem
        there = set(problem.points)
        rows = [
            row
            for row in problem.control_rows.values()
            if row.point in there and (row.use != "control" or problem.datum != "control")
        ]
        return [
            (row.point, found) for row, found in zip(rows, self._differences(rows), strict=True)
        ]

    def _differences(self, rows: Iterable[ControlPoint]) -> list[_Difference]:
        """Return adjusted minus given coordinates [m]; None where either does not exist."""
        at = {name: k for k, name in enumerate(self.problem.points)}
        origin = self.state.origin
        out = []
        for row in rows:
            k = at.get(row.point)
            out.append(
                tuple(
                    None
                    if value is None or k is None
                    else float(self.state.points[k][axis] - (value - origin[axis]))
                    for axis, value in enumerate(row.xyz)
                )
            )
        return out  # type: ignore[return-value]

    def parameter_rows(self) -> list[ParameterRow]:
        """Return the additional parameters that are unknown."""
        problem = self.problem
        if problem.additional is None:
            return []
        if problem.photo_invariant:
            values = self.state.own.reshape(-1)
            q = np.einsum("nii->ni", self.cofactors.photos)[:, 6:].reshape(-1)
        else:
            values, q = self.state.shared, np.diag(self.cofactors.shared)
        deviations = self._deviations(q)
        rows = []
        for k, name in enumerate(parameter_names(problem)):
            if name.held:
                continue
            value, s = float(values[k]), deviations[k]
            row = ParameterRow(name.owner, name.unknown, value, s)
            if problem.lens_units is not None:
                row = row._replace(
                    coefficient=value * name.factor,
                    s_coefficient=None if s is None else s * name.factor,
                )
            rows.append(row)
        return rows

    def spurs(self) -> list[tuple[str, str, str]]:
        """Return (photo, point, axis) of the 'spur' image coordinates: next to nothing checks them.

        Exactly r = 0 stands in ideal geometry only; tilts of 1e-3 make it their square.
        """
        problem = self.problem
        return [
            (problem.photos[problem.photo[k]], problem.points[problem.point[k]], "xy"[axis])
            for k, axis in np.argwhere((self.cofactors.r < SPUR) & ~self.rejected).tolist()
        ]

    def suspects(self) -> list[tuple[float, str, str, str]]:
        """Return (abs(w), photo, point, axis) of flagged image coordinates, the worst first."""
        problem, w = self.problem, np.abs(self.w)
        flagged = np.argwhere(self.flagged)
        order = np.argsort(-w[flagged[:, 0], flagged[:, 1]], kind="stable")
        return [
            (
                float(w[k, axis]),
                problem.photos[problem.photo[k]],
                problem.points[problem.point[k]],
                "xy"[axis],
            )
            for k, axis in flagged[order].tolist()
        ]

    def point_correlations(self, point: str) -> tuple[list[tuple[str, str | None, str]], Array]:
        """Return the correlations of the residuals of a point's rays.

        Returns
        -------
        tuple
            (photo, model, axis) of the 2k image coordinates, and (2k, 2k) correlations; NaN for
            coordinates that nothing checks.
        """
        problem = self.problem
        _, (rays, rho) = next(self.cofactors.several_correlations([self.point_number(point)]))
        models = columns_of(problem.block.image_points).model
        labels = [
            (problem.photos[problem.photo[k]], models.at(problem.source[k]), axis)
            for k in rays.tolist()
            for axis in "xy"
        ]
        return labels, rho

    def _deviations(self, q: Array) -> tuple[float | None, ...]:
        if self.sigma is None:
            return (None,) * len(q)
        return tuple((self.sigma * np.sqrt(np.where(q < 0.0, 0.0, q))).tolist())


def _conditions_left(cofactors: Cofactors) -> Array:
    """(n,) residuals of the conditions' rows in a-priori sigmas."""
    normal, factor = cofactors.normal, cofactors.factor
    conditions, equations = normal.problem.conditions, normal.linear.conditions
    if conditions is None or equations is None:
        return np.zeros(0)
    there = equations.misclosure / equations.sigma
    return np.where(conditions.rejected, there, normal.conditions_left(factor))


def observation_in_words(name: ObservationName) -> tuple[str, str]:
    """Return what was observed in words, and of which kind it is."""
    kind, what, *_ = name
    if kind == "image":
        return f"{name[-1]} of point {name[2]} in photo {what}", "image"
    if kind == "control":
        return f"{name[-1]} of control point {what}", "control"
    if kind == "point prior":
        return f"the prior {name[-1]} of point {what}", kind
    if kind == "condition":
        return f"{name[-1]} of {name[-2]} in {what}", "condition"
    of = "prior" if name[-1] in ORIENTATION else "parameter"
    return f"the prior {name[-1]} of {what}", of
