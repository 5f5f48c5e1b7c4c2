"""The bundle as arrays: what is observed, what is unknown, what is held (conventions, Bundle).

Counting: control free of error (sigma 0) is neither observation nor unknown; weighted control adds
observations and its coordinates to the unknowns; so does every prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.beforehand import (
    control_points,
    expected_coordinates,
    known_coordinates,
    stated_orientations,
)
from anaplot.bundle.solve.conditions import Conditions, lay_out_conditions
from anaplot.bundle.solve.estimatedfactors import EstimatedFactors
from anaplot.bundle.solve.givenprior import GivenPrior, locate
from anaplot.bundle.solve.laidoffsets import LaidOffsets, lay_out_offsets
from anaplot.bundle.solve.laidparameters import lay_out_parameters
from anaplot.bundle.solve.measuredrays import check_rows, measured_xy, stated_lenses
from anaplot.bundle.solve.pointgroups import Group, groups_by_rays
from anaplot.bundle.solve.priorbending import check_linear
from anaplot.bundle.solve.selection import LeftOut, select_rays
from anaplot.bundle.solve.sorting import order_of
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block, ControlPoint, TestSettings
from anaplot.photogrammetry.imagepoint import use_counts
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.pointcolumns import PointColumns
from anaplot.photogrammetry.rotation import rotation_matrix

__all__ = ["SEVEN", "Datum", "Problem", "listed", "make_problem", "of_rays"]

Datum = Literal["control", "minimal", "free"]

SEVEN = 7  # coordinates that a datum needs: shift, rotation and scale
_WIDE = 0.1  # of the distance of control: standard deviation of a prior that places nothing
_FULL_CONTROL = 3


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A bundle to be adjusted.

    Attributes
    ----------
    block
        What it was made from.
    datum
        "control": control and priors; "free": inner constraints; "minimal": seven coordinates.
    photos, points
        Names; points ordered by their number of rays.
    cameras
        (photos,) index of the camera in block.cameras.
    c
        (photos,) camera constants [mm].
    photo, point
        (m,) photo and point of each ray.
    xy, sigma
        (m, 2) observed image coordinates and (m,) their a-priori standard deviation [mm]: as they
        were measured, through the camera's lens.
    source
        (m,) row in block.image_points.
    groups
        Points by number of rays.
    fixed, known
        (points, 3) coordinates free of error, and the values of all control coordinates (NaN where
        there are none).
    known_sigma
        (points, 3) standard deviations of weighted control [m]; NaN where there is no observation.
    expected, expected_sigma
        (points, 3) priors of points, and their standard deviations [m]; NaN where there are none.
    position, position_sigma, rotation, rotation_sigma
        (photos, 3) approximate or prior orientations and their standard deviations; NaN without.
    additional
        Additional parameters, or None.
    basis
        (m, 2, q) what they do at the rays to first order.
    stated_lens, without_lens
        (photos, 10) lenses as the cameras state them, and (m, 2) `ideal` image coordinates; or
        None: no camera has one.
    lens_units
        (groups, q) parameters of a lens for 1 mm of effect; None for sets that are linear.
    additional_group, additional_groups
        (m,) group of each ray, and the names of the groups.
    additional_given, additional_sigma
        (groups, q) a-priori values and standard deviations [mm], infinite where there is none;
        no rows of sigmas when all are free.
    left_out
        What takes no part.
    unused_rays
        Rows of block.image_points that take no part.
    control_rows
        Control and check points, by name.
    rejected
        (m, 2) image coordinates of weight zero, or None.
    off
        (m, 2) which of them were switched off by a person: they are no observations; or None.
    aside
        The rays switched off altogether whose photo and point the others determine, as if they
        were its own; or None.
    axis_factor
        (m, 2) factors of `sigma` for x and y, where they are not both 1, or None.
    additional_reference
        (cameras,) lengths b [mm] of the parameters' terms, of every camera of the block, or None.
    additional_still
        (groups, q) parameters that are held at their a-priori values, neither unknown nor observed,
        while other groups have them; or None.
    image_shift, lens_held
        (m, 2) what additional parameters do that are held at given values [mm], and (groups, 10)
        those of a lens; or None.
    conditions, compared
        Conditions between points that take part, and those that are compared only or off, or None.
    given
        Coordinates that an earlier adjustment leaves as a prior, or None.
    left_open
        How many of the seven movements priors leave open that stay observations of a free network;
        None where they do not.
    lever_arm
        (photos, 3) antennas seen from the projection centres, in the images' axes [m]; None where
        all positions are those of projection centres.
    offsets
        What stated positions and angles have in common, or None.
    undetermined
        Points that are left out because their rays do not determine them, and why; None where that
        has not been looked at.
    estimated
        What the standard deviations are multiplied by because variances were estimated, or None:
        they are those that the block states.
    """

    block: Block = field(repr=False)
    datum: Datum
    photos: tuple[str, ...]
    points: tuple[str, ...] = field(repr=False)
    cameras: Index
    c: Array
    photo: Index
    point: Index
    xy: Array
    sigma: Array
    source: Index
    groups: tuple[Group, ...]
    fixed: Bools
    known: Array
    known_sigma: Array
    expected: Array
    expected_sigma: Array
    position: Array
    position_sigma: Array
    rotation: Array
    rotation_sigma: Array
    additional: AdditionalParameters | None
    basis: Array
    lens_units: Array | None
    additional_group: Index
    additional_groups: tuple[str, ...]
    additional_given: Array
    additional_sigma: Array
    left_out: tuple[LeftOut, ...]
    unused_rays: Index
    control_rows: Mapping[str, ControlPoint] = field(repr=False)
    rejected: Bools | None = field(default=None, repr=False)
    axis_factor: Array | None = field(default=None, repr=False)
    off: Bools | None = field(default=None, repr=False)
    aside: Problem | None = field(default=None, repr=False)
    additional_reference: Array | None = field(default=None, repr=False)
    additional_still: Bools | None = field(default=None, repr=False)
    image_shift: Array | None = field(default=None, repr=False)
    lens_held: Array | None = field(default=None, repr=False)
    conditions: Conditions | None = field(default=None, repr=False)
    compared: Conditions | None = field(default=None, repr=False)
    given: GivenPrior | None = field(default=None, repr=False)
    left_open: int | None = None
    stated_lens: Array | None = field(default=None, repr=False)
    without_lens: Array | None = field(default=None, repr=False)

    @property
    def ideal(self) -> Array:
        """(m, 2) image coordinates in which a ray is (x, y, -c) [mm]: stated lenses are taken off.

        What approximate values and single rays are computed from; additional parameters are in them
        as before.
        """
        return self.xy if self.without_lens is None else self.without_lens

    lever_arm: Array | None = field(default=None, repr=False)
    offsets: LaidOffsets | None = field(default=None, repr=False)
    undetermined: Mapping[str, str] | None = field(default=None, repr=False)
    estimated: EstimatedFactors | None = None

    @property
    def bare(self) -> Problem:
        """The same without additional parameters and conditions."""
        if self.additional is None and self.conditions is None:
            return self
        return replace(
            self,
            conditions=None,
            additional=None,
            basis=self.basis[:, :, :0],
            lens_units=None,
            additional_group=np.zeros_like(self.additional_group),
            additional_groups=(),
            additional_given=np.empty((0, 0)),
            additional_sigma=np.empty((0, 0)),
            additional_reference=None,
            additional_still=None,
            image_shift=None,
            lens_held=None,
            aside=None if self.aside is None else self.aside.bare,
        )

    @property
    def every(self) -> Problem:
        """The same with all its observations: nothing is rejected but what is off."""
        conditions = None if self.conditions is None else self.conditions.every
        return replace(self, rejected=self.off, conditions=conditions)

    @property
    def newly_rejected(self) -> Bools:
        """(m, 2) which observations are rejected."""
        out = np.zeros((len(self.photo), 2), dtype=bool)
        if self.rejected is not None:
            out |= self.rejected
        if self.off is not None:
            out &= ~self.off
        return out

    @property
    def ground(self) -> Array:
        """(2, points, 3) what is stated of the points [m]: control, and priors; NaN without."""
        return np.stack((self.known, self.expected))

    @property
    def ground_sigma(self) -> Array:
        """(2, points, 3) standard deviations of `ground` where it is observed [m]; else NaN."""
        return np.stack((self.known_sigma, self.expected_sigma))

    @property
    def controlled(self) -> Bools:
        """(p, 3) coordinates held or observed as control; not those given with a covariance."""
        out: Bools = np.isfinite(self.known) & (self.fixed | np.isfinite(self.known_sigma))
        return out

    @property
    def near(self) -> Array:
        """(points, 3) what approximate values are laid onto [m]: control, else also priors.

        Three full control points do without priors, which may be as wide as anything. So do two
        and a single coordinate, but for narrow ones: a wide one may lie anywhere.
        """
        x, y, z = np.isfinite(self.known).T
        full = x & y & z  # many times as quick as along the short axis
        if int(full.sum()) >= _FULL_CONTROL:
            return self.known
        expected = self.expected
        if int(full.sum()) == _FULL_CONTROL - 1 and int(np.isfinite(self.known).sum()) >= SEVEN:
            extent = float(np.ptp(self.known[full], axis=0).max())
            expected = np.where(self.expected_sigma < _WIDE * extent, expected, np.nan)
        return np.where(np.isfinite(self.known), self.known, expected)

    @property
    def sigma_xy(self) -> Array:
        """(m, 2) standard deviations of x and y [mm]."""
        if self.axis_factor is None:
            return np.repeat(self.sigma[:, None], 2, axis=1)
        return self.sigma[:, None] * self.axis_factor

    @property
    def prior_sigma(self) -> Array:
        """(photos, 6) standard deviations of prior orientations [m, rad]; NaN without."""
        return np.concatenate((self.position_sigma, self.rotation_sigma), axis=1)

    @property
    def stated_rotations(self) -> Array:
        """(photos, 3, 3) how photos are stated to be turned, image to ground; NaN without."""
        return np.array([rotation_matrix(*angles) for angles in self.rotation.tolist()])

    @property
    def stated_centres(self) -> Array:
        """(photos, 3) where projection centres are stated to be [m]; NaN without.

        Where angles are not stated, nobody knows which way the lever arm points.
        """
        if self.lever_arm is None:
            return self.position
        arms = np.einsum("nij,nj->ni", self.stated_rotations, self.lever_arm)
        out: Array = self.position - np.nan_to_num(arms)
        return out

    def given_sigma(self, row: ControlPoint) -> tuple[float, float, float]:
        """Return how a control or check point errs [m]: as stated, or as it was estimated."""
        x, y, z = self.block.sigma_of(row)
        known = self.estimated or EstimatedFactors()
        factor = known.check if row.use == "check" else known.control
        return factor * x, factor * y, factor * z

    @property
    def test(self) -> TestSettings:
        """The test that flags observations."""
        return self.block.test

    @property
    def per_photo(self) -> int:
        """Unknowns of a photo: six, and its own additional parameters."""
        return 6 + (int(self.basis.shape[2]) if self.photo_invariant else 0)

    @property
    def in_border(self) -> int:
        """Additional parameters that belong to several photos."""
        if self.photo_invariant:
            return 0
        return len(self.additional_groups) * int(self.basis.shape[2])

    @property
    def additional_unknowns(self) -> int:
        """Number of additional parameters that are unknown."""
        still = 0 if self.additional_still is None else int(self.additional_still.sum())
        return len(self.additional_groups) * int(self.basis.shape[2]) - still

    @property
    def photo_invariant(self) -> bool:
        """Whether every photo has additional parameters of its own."""
        return self.additional is not None and self.additional.scope == "photo"

    @property
    def frees_parameters(self) -> bool:
        """Whether there are additional parameters without an a-priori weight."""
        return int(np.isfinite(self.additional_sigma).sum()) < self.additional_unknowns

    @property
    def observations(self) -> int:
        """Number of observations n."""
        priors = sum(
            int(np.isfinite(a).sum())
            for a in (self.ground_sigma, self.position_sigma, self.rotation_sigma)
        )
        extra = int(np.isfinite(self.additional_sigma).sum())
        out = 0 if self.rejected is None else int(self.rejected.sum())
        extra += self.conditions.observations if self.conditions else 0
        extra += len(self.given) if self.given else 0
        extra += int(self.offsets.weighted.sum()) if self.offsets else 0
        return int(2 * len(self.photo) - out + priors + extra)

    @property
    def unknowns(self) -> int:
        """Number of unknowns u."""
        extra = self.additional_unknowns
        extra += self.conditions.unknowns if self.conditions else 0
        extra += int(self.offsets.observed(self.prior_sigma).sum()) if self.offsets else 0
        return 6 * len(self.photos) + int((~self.fixed).sum()) + extra

    @property
    def defect(self) -> int:
        """Rank defect that the datum takes care of."""
        if self.datum == "control":
            return 0
        if self.left_open is not None:
            return self.left_open
        return 6 if self.gives_scale else 7

    @property
    def gives_scale(self) -> bool:
        """Whether distances give a network its scale that the datum leaves open."""
        return self.conditions is not None and self.conditions.gives_scale

    @property
    def redundancy(self) -> int:
        """Observations minus unknowns plus the datum's defect."""
        return self.observations - self.unknowns + self.defect


def listed(names: Sequence[str]) -> str:
    """Return names for a message, not more than eight of them."""
    limit = 8
    if len(names) <= limit:
        return ", ".join(names)
    return f"{', '.join(names[:limit])} and {len(names) - limit} more"


def make_problem(
    block: Block,
    *,
    datum: Datum = "control",
    additional: AdditionalParameters | None = None,
    undetermined: Mapping[str, str] | None = None,
) -> Problem:
    """Lay out a block as a bundle.

    Parameters
    ----------
    block
        The block.
    datum
        "control": control and priors as declared; "free" and "minimal": they are not observed, and
        distances give a free network its scale.
    additional
        Additional parameters.
    undetermined
        Points whose counted coordinates do not determine them, and why, where that is known.

    Raises
    ------
    InputError
        No image points, a standard deviation that is not positive, control twice.
    NotComputableError
        Nothing is left once points with too few rays and photos with too few points are gone.

    Notes
    -----
    A point with one ray and no known coordinate, and a photo with fewer than three points and no
    prior orientation, determine nothing; they are left out, together with their rays, and listed.
    A coordinate that is switched off is no observation, and a ray without any is none.
    """
    held = datum == "control"
    control = control_points(block)
    photo_names = {p.id: k for k, p in enumerate(block.photos)}
    rows = columns_of(block.image_points)
    if not len(rows):
        raise InputError(f"block {block.name}: no image points")
    every_xy = rows.xy
    sigmas = np.full(len(rows), block.precision.image_um)
    if rows.sigma_um is not None:
        sigmas = np.where(np.isnan(rows.sigma_um), sigmas, rows.sigma_um)
    check_rows(block, sigmas)
    photo, point = _photos_of(block, rows, photo_names), rows.point.index
    names = list(rows.point.values)
    known, known_sigma, fixed = known_coordinates(block, names, control, held)
    priors = stated_orientations(block, held)
    located = None
    if held and block.given is not None:
        located = locate(block.given, names, list(photo_names))
        located.hold(names, known, known_sigma, fixed)
        located.approximate(priors[0], priors[1], 0)
        located.approximate(priors[2], priors[3], 3)
    expected, expected_sigma, not_needed = expected_coordinates(block, names, fixed, held)
    counts = [[use_counts(one, axis) for axis in "xy"] for one in rows.use.values]
    counted = np.array(counts)[rows.use.index]
    has_prior = np.isfinite(priors[1]).sum(axis=1) + np.isfinite(priors[3]).sum(axis=1)
    observed = (fixed | np.isfinite(known_sigma) | np.isfinite(expected_sigma)).sum(axis=1)
    if located is not None:
        at_points, at_photos = located.counts(len(names), len(block.photos))
        observed, has_prior = observed + at_points, has_prior + at_photos
    useful, left_out = select_rays(
        block, photo, point, counted, names, observed, has_prior, undetermined or {}
    )
    left_out += [LeftOut("prior", *one) for one in not_needed]
    measured = frozenset(names)
    left_out += [
        LeftOut("control", name, "is not measured in any photo")
        for name, row in control.items()
        if name not in measured and row.use == "control"
    ]
    ray = np.nonzero(useful)[0]
    if len(ray) == 0:
        raise NotComputableError(
            f"block {block.name}: nothing can be computed: "
            + "; ".join(f"{o.kind} {o.name} {o.reason}" for o in left_out[:4])
        )
    count = np.bincount(point[ray], minlength=len(names))
    used_points = np.flatnonzero(count)
    used_points = used_points[np.argsort(count[used_points], kind="stable")]
    used_photos = np.flatnonzero(np.bincount(photo[ray]))
    new_point, new_photo = np.full(len(names), -1), np.full(len(block.photos), -1)
    new_point[used_points] = np.arange(len(used_points))
    ray = ray[order_of(new_point[point[ray]], len(used_points))]
    new_photo[used_photos] = np.arange(len(used_photos))
    camera_index = {c.id: k for k, c in enumerate(block.cameras)}
    cameras = np.array([camera_index[block.photos[k].camera] for k in used_photos], dtype=np.intp)
    # after the rays that count those off altogether, where photo and point are there
    aside = np.flatnonzero(~counted.any(axis=1) & (new_photo[photo] >= 0) & (new_point[point] >= 0))
    count_of_rays = len(ray)
    ray = np.concatenate((ray, aside))
    ideal, compact_photo = every_xy.take(ray, axis=0), new_photo[photo[ray]]
    c = np.array([block.cameras[k].c for k in cameras])
    lenses = stated_lenses(block, cameras)
    xy = ideal if lenses is None else measured_xy(block, cameras[compact_photo], ideal)
    parameters = lay_out_parameters(
        block,
        additional,
        [block.photos[k].id for k in used_photos],
        cameras,
        c,
        compact_photo,
        xy,
        count_of_rays,
    )
    used_names, fixed = tuple(names[k] for k in used_points), fixed[used_points]
    laid = lay_out_conditions(
        block.conditions, used_names, fixed, with_scale=held, scaling=datum == "free"
    )
    arms = np.array([block.cameras[k].lever_arm or (0.0, 0.0, 0.0) for k in cameras])
    problem = Problem(
        block=block,
        datum=datum,
        photos=tuple(block.photos[k].id for k in used_photos),
        points=used_names,
        cameras=cameras,
        c=c,
        photo=compact_photo,
        point=new_point[point[ray]],
        xy=xy,
        sigma=sigmas[ray] * 1e-3,
        source=ray,
        groups=groups_by_rays(count[used_points]),
        fixed=fixed,
        known=known[used_points],
        known_sigma=known_sigma[used_points],
        expected=expected[used_points],
        expected_sigma=expected_sigma[used_points],
        position=priors[0][used_photos],
        position_sigma=priors[1][used_photos],
        rotation=priors[2][used_photos],
        rotation_sigma=priors[3][used_photos],
        additional=additional,
        basis=parameters.basis,
        lens_units=parameters.lens_units,
        additional_group=parameters.group,
        additional_groups=parameters.groups,
        additional_given=parameters.given,
        additional_sigma=parameters.sigma,
        additional_reference=parameters.reference,
        additional_still=parameters.still,
        stated_lens=lenses,
        without_lens=None if lenses is None else ideal,
        image_shift=parameters.shift,
        lens_held=parameters.lens_held,
        left_out=(*left_out, *(LeftOut("condition", *one) for one in laid.left_out)),
        unused_rays=np.nonzero(~useful)[0],
        control_rows=control,
        conditions=laid.conditions,
        compared=laid.compared,
        lever_arm=arms if arms.any() else None,
        offsets=_offsets(block, used_photos, priors) if held else None,
        undetermined=undetermined,
    )
    if located is not None:
        given = located.among(new_point, new_photo, problem.per_photo, block.name)
        if given is not None:
            check_linear(given)
        problem = replace(problem, given=given)
    return _parted(problem, count_of_rays, ~counted[ray])


def _photos_of(block: Block, rows: PointColumns, number: Mapping[str, int]) -> Index:
    """Return (n,) photos of image points; raises InputError where one is not of the block."""
    of_name = np.array([number.get(name, -1) for name in rows.photo.values], dtype=np.intp)
    photo = of_name[rows.photo.index]
    if (of_name < 0).any():
        stray = block.image_points[int((photo < 0).argmax())]
        raise InputError(f"image point {stray.point}: unknown photo {stray.photo}")
    return photo


def of_rays(problem: Problem, rays: Index | Bools | slice) -> Problem:
    """Return a bundle with some of its rays alone; its points stay what and where they are."""

    def some(values: Array | None) -> Array | None:
        return None if values is None else values[rays]

    return replace(
        problem,
        photo=problem.photo[rays],
        point=problem.point[rays],
        xy=problem.xy[rays],
        sigma=problem.sigma[rays],
        source=problem.source[rays],
        basis=problem.basis[rays],
        without_lens=some(problem.without_lens),
        additional_group=problem.additional_group[rays],
        image_shift=some(problem.image_shift),
        rejected=None if problem.rejected is None else problem.rejected[rays],
        off=None if problem.off is None else problem.off[rays],
        axis_factor=some(problem.axis_factor),
    )


def _offsets(block: Block, used: Index, priors: tuple[Array, ...]) -> LaidOffsets | None:
    names = [block.photos[k].id for k in used]
    return lay_out_offsets(block, names, priors[1][used], priors[3][used])


def _parted(problem: Problem, count: int, off: Bools) -> Problem:
    """Return a bundle with its first rays alone, and the others aside."""
    if not off.any():
        return problem
    its = off[:count] if off[:count].any() else None
    aside = of_rays(problem, slice(count, None)) if count < len(off) else None
    return replace(of_rays(problem, slice(count)), off=its, rejected=its, aside=aside)
