"""Priors of points: the same as pseudo-observations, of a class of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from denseblock import dense, dense_inverse

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.leftout import without
from anaplot.bundle.hypotheses.components import block_components
from anaplot.bundle.hypotheses.priorknowledge import prior_estimate
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.externalreliability import external_reliability
from anaplot.bundle.solve.residuals import residuals_of
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, ControlPoint, PointPrior

_SIGMA = 0.4


def with_priors(
    *, control: float | None = 0.05, sigma: float = _SIGMA, some: int = 1, seed: int = 4, **options
) -> Block:
    """Return a block with priors of every `some`-th point; no control where its sigma is None."""
    scene = aerial(2, 4, seed=seed, noise_um=5.0, control_sigma=control or 0.0, **options)
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(len(scene.points), 3)) * min(sigma, _SIGMA)
    priors = tuple(
        PointPrior(name, tuple((at + off).tolist()), (sigma,) * 3)
        for (name, at), off in list(zip(scene.points.items(), noise, strict=True))[::some]
    )
    block = replace(scene.block, priors=priors)
    return block if control is not None else replace(block, control=())


@pytest.mark.parametrize("control", [0.05, 0.0, None])
@pytest.mark.parametrize("additional", [None, "ebner"])
def test_priors_are_pseudo_observations_of_a_dense_adjustment(control, additional) -> None:
    chosen = None if additional is None else additional_parameters(additional, 5.0)
    block = adjust_block(with_priors(control=control, some=2), additional=chosen)
    problem, found, linear = block.problem, block.cofactors, block.cofactors.normal.linear
    design, free = dense(block)
    q = dense_inverse(design, free)
    r = 1.0 - np.einsum("ij,jk,ik->i", design, q, design, optimize=True)
    count, points = 2 * len(problem.photo), len(problem.points)
    np.testing.assert_allclose(found.r.ravel(), r[:count], atol=1e-9)
    expected = r[-3 * points :].reshape(points, 3)
    seen = np.isfinite(problem.expected_sigma)
    assert seen.any()
    np.testing.assert_allclose(found.r_ground[1][seen], expected[seen], atol=1e-9)
    assert block.tested.r.sum() == pytest.approx(block.redundancy, abs=1e-8)
    # at the minimum another step of the dense adjustment moves nothing
    own = np.zeros((len(problem.photos), problem.per_photo - 6))
    parts = (linear.e, linear.point_e[0], linear.photo_e, own, linear.shared_e, linear.point_e[1])
    e = np.concatenate([part.ravel() for part in parts])
    assert np.abs(q @ design.T @ e).max() < 1e-6
    # Q_vv P of the rows, by columns
    system = residuals_of(block)
    some = np.array([3, system.rows.starts[0], system.rows.starts[1] - 1])
    np.testing.assert_allclose(np.diag(system.columns(some)[some]), system.r[some], atol=1e-9)
    rows = np.flatnonzero(np.abs(design).sum(axis=1) > 0.0)
    whole = np.eye(len(rows)) - design[rows] @ q @ design[rows].T
    np.testing.assert_allclose(np.trace(whole), block.redundancy, atol=1e-8)
    np.testing.assert_allclose(
        np.sort(np.diag(whole)), np.sort(system.r), atol=1e-9
    )  # the same rows, in another order


def test_wide_priors_are_none_and_narrow_ones_are_control_free_of_error() -> None:
    scene = aerial(2, 4, seed=4, noise_um=5.0, control_sigma=0.05)
    bare = adjust_block(scene.block)
    wide = adjust_block(with_priors(sigma=1e7))
    np.testing.assert_allclose(wide.state.points, bare.state.points, atol=1e-7)
    np.testing.assert_allclose(wide.cofactors.r, bare.cofactors.r, atol=1e-8)
    assert wide.redundancy == bare.redundancy + 3 * len(scene.points)
    np.testing.assert_allclose(wide.cofactors.r_ground[1], 1.0, atol=1e-8)
    held = adjust_block(with_priors(control=0.0, some=1, sigma=1e-7, seed=4))
    names = held.problem.points
    for prior in held.problem.block.priors:
        at = held.state.points[names.index(prior.point)] + held.state.origin
        np.testing.assert_allclose(at, prior.xyz, atol=1e-6)


def test_a_prior_is_no_control() -> None:
    block = with_priors(some=3)
    adjusted = adjust_block(block)
    control = {row.point for row in block.control}
    assert {row.key[1] for row in adjusted.control_rows()} == control
    expected = adjusted.point_prior_rows()
    order = [row.point for row in block.priors]
    assert [row.key[1] for row in expected][::3] == order
    assert {row.key[0] for row in expected} == {"point prior"}
    assert not adjusted.check_rows()
    off = next(name for name in order if name not in control)
    moved = adjust_block(
        replace(
            block,
            priors=tuple(
                replace(row, xyz=(row.xyz[0] + 8.0, *row.xyz[1:])) if row.point == off else row
                for row in block.priors
            ),
        )
    )
    assert (f"the prior X of point {off}", "point prior") in [
        one[1:] for one in moved.flagged_observations()
    ]
    cleaned = block_gross_errors(moved.problem, "baarda")
    assert ("point prior", off, "X") in [row.name for row in cleaned.rejected]


def test_undetected_errors_of_priors_move_what_the_dense_adjustment_says() -> None:
    block = adjust_block(with_priors(some=5))
    found = external_reliability(block).point_priors
    design, free = dense(block)
    q, problem = dense_inverse(design, free), block.problem
    for row, effect in zip(block.point_prior_rows(), found, strict=True):
        point, axis = problem.points.index(row.key[1]), "XYZ".index(row.key[2])
        column = 6 * len(problem.photos) + 3 * point + axis
        moved = q[:, column].reshape(-1, 3)[2 * len(problem.photos) :] / _SIGMA**2 * row.mdb
        at = int(np.argmax((moved**2).sum(axis=1)))
        assert effect.point == problem.points[at]
        np.testing.assert_allclose(effect.effect_m, moved[at], atol=1e-9)


def test_control_last_keeps_the_priors() -> None:
    block = with_priors(some=1)
    rows = list(block.image_points)
    rows[20] = replace(rows[20], x=rows[20].x + 0.2)
    k = 1
    x, y, z = block.control[k].xyz
    control = list(block.control)
    control[k] = replace(control[k], xyz=(x, y + 1.5, z))
    steps = clean_control_last(
        replace(block, image_points=tuple(rows), control=tuple(control)), "search"
    )
    assert steps.datum == "priors"
    without_control = steps.images.block
    assert len(without_control.point_prior_rows()) == 3 * len(block.priors)
    assert not without_control.control_rows()
    assert ("image", rows[20].photo, rows[20].point, None, "x") in [
        row.name for row in steps.images.rejected
    ]
    assert ("control", control[k].point, "Y") in [row.name for row in steps.control.rejected]
    assert len(steps.block.point_prior_rows()) == 3 * len(block.priors)


_HEIGHTS, _ALL = (2,), (0, 1, 2)


@pytest.mark.parametrize(
    ("some", "axes", "sigma", "left_open", "photos"),
    [
        (slice(None), _HEIGHTS, 0.1, 3, ()),
        (slice(2), _ALL, 0.1, 1, ()),
        (slice(1), _ALL, 0.1, 4, ()),
        (slice(None), _ALL, 500.0, 0, ()),
        # positions of a strip and one height leave the turn about the strip nearly to the priors
        (slice(1), _HEIGHTS, 0.1, 0, ("101", "102", "103", "104")),
    ],
)
def test_control_last_keeps_priors_that_hold_no_datum(
    some: slice, axes: tuple[int, ...], sigma: float, left_open: int, photos: tuple[str, ...]
) -> None:
    scene = aerial(2, 4, seed=4, noise_um=5.0, control_sigma=0.05)
    rng = np.random.default_rng(3)

    def prior(name: str) -> PointPrior:
        at = scene.points[name] + rng.normal(size=3) * min(sigma, 1.0)
        of = [(float(at[k]), sigma) if k in axes else (None, None) for k in range(3)]
        return PointPrior(name, tuple(one[0] for one in of), tuple(one[1] for one in of))

    rows = list(scene.block.image_points)
    rows[20] = replace(rows[20], x=rows[20].x + 0.2)
    block = replace(
        scene.block,
        image_points=tuple(rows),
        priors=tuple(prior(name) for name in list(scene.points)[some]),
        photos=tuple(
            replace(
                photo,
                position=tuple(scene.centres[photo.id].tolist()),
                position_sigma=(0.1,) * 3,
            )
            if photo.id in photos
            else photo
            for photo in scene.block.photos
        ),
    )
    steps = clean_control_last(block, "baarda")
    found = steps.images.block
    problem = found.problem
    wrong = ("image", rows[20].photo, rows[20].point, None, "x")
    assert wrong in [row.name for row in steps.images.rejected]
    assert steps.datum == ("partly free" if left_open else "priors")
    assert problem.defect == left_open
    count = len(axes) * len(block.priors)
    assert len(found.point_prior_rows()) == count
    assert len(steps.block.point_prior_rows()) == count
    assert not found.control_rows()
    # against a dense adjustment by the pseudo-inverse
    design, _ = dense(found)
    design = design / np.linalg.norm(design, axis=0)
    hat = design @ np.linalg.pinv(design, rcond=1e-9)
    r = 1.0 - np.diag(hat)
    n, p = 2 * len(problem.photo), len(problem.points)
    kept = ~found.rejected.ravel()
    np.testing.assert_allclose(found.cofactors.r.ravel()[kept], r[:n][kept], atol=1e-6)
    seen = np.isfinite(problem.expected_sigma)
    of_priors = r[-3 * p :].reshape(p, 3)[seen]
    np.testing.assert_allclose(found.cofactors.r_ground[1][seen], of_priors, atol=1e-6)
    assert found.tested.r.sum() == pytest.approx(found.redundancy, abs=1e-6)
    assert found.redundancy == problem.observations - np.linalg.matrix_rank(hat, tol=0.5)
    # inner constraints close what is open: nothing of it is left in the points' cofactors
    change = found.cofactors.change
    assert (change is None) == (left_open == 0)
    if change is not None:
        assert change.null_points.shape == (p, 3, left_open)
        np.testing.assert_allclose(
            change.held(change.null_photos, change.null_points), change.defect, atol=1e-9
        )


def test_control_last_keeps_photos_priors_beside_those_of_points() -> None:
    scene = aerial(2, 4, seed=4, noise_um=5.0, control_sigma=0.05)
    first = scene.block.photos[0]
    at = tuple(scene.centres[first.id].tolist())
    photos = (replace(first, position=at, position_sigma=(0.1,) * 3), *scene.block.photos[1:])
    name, place = next(iter(scene.points.items()))
    priors = (PointPrior(name, tuple(place.tolist()), (0.1,) * 3),)
    steps = clean_control_last(replace(scene.block, photos=photos, priors=priors), "baarda")
    # two places: the turn about the line through them is open
    assert (steps.datum, steps.images.block.problem.defect) == ("partly free", 1)
    assert np.isfinite(steps.images.block.problem.position_sigma).sum() == 3
    assert np.isfinite(steps.block.problem.expected_sigma).sum() == 3


def test_priors_have_a_variance_of_their_own() -> None:
    block = adjust_block(with_priors())
    parts = block_components(block, "kinds")
    assert [c.name for c in parts.variances.components] == ["image", "control", "priors of points"]
    assert parts.sigmas[2].apriori == _SIGMA
    found = prior_estimate(block, "separate")
    assert found.control is not None
    assert found.prior.observations == 3 * len(block.problem.points)
    assert found.control.observations == 3 * len(block.problem.block.control)
    total = found.image.redundancy + found.prior.redundancy + found.control.redundancy
    assert total == pytest.approx(block.redundancy, abs=1e-6)
    assert prior_estimate(adjust_block(with_priors(control=None)), "common").control is None


@pytest.mark.slow
def test_few_image_coordinates_that_are_checked_do_not_judge_their_sigma() -> None:
    for seed in (3, 11, 14, 18, 19, 20, 22, 34, 40):
        scene = aerial(1, 2, seed=seed, noise_um=5.0)
        rays: dict[str, int] = {}
        for row in scene.block.image_points:
            rays[row.point] = rays.get(row.point, 0) + 1
        pairs = [name for name, count in rays.items() if count == 2][:6]
        rng = np.random.default_rng(seed)
        places = {name: scene.points[name] + 20.0 * rng.normal(size=3) for name in pairs}
        block = replace(
            scene.block,
            image_points=tuple(row for row in scene.block.image_points if row.point in places),
            control=(),
            priors=tuple(
                PointPrior(p, tuple(at.tolist()), (20.0,) * 3) for p, at in places.items()
            ),
        )
        found = block_gross_errors(block, "baarda").block
        # twelve of redundancy, of which the image coordinates have one
        assert found.redundancy == 12
        assert found.cofactors.r.sum() < 2.0


@pytest.mark.parametrize("sigma", [1e6, 5000.0])
def test_approximate_values_are_not_laid_onto_priors_that_lie_anywhere(sigma: float) -> None:
    scene = aerial(2, 4, seed=4, noise_um=5.0, control_sigma=0.05)
    first, second, third, *_, last = scene.block.control
    heights = tuple(
        replace(row, xyz=(None, None, row.xyz[2]), sigma=(None, None, row.sigma[2]))
        for row in (second, third)
    )
    block = replace(scene.block, control=(first, last, *heights))
    bare = adjust_block(block)
    middle = (0.0,) * 3 if sigma > 1e5 else tuple(np.mean(list(scene.points.values()), axis=0))
    priors = tuple(PointPrior(name, middle, (sigma,) * 3) for name in scene.points)
    found = adjust_block(replace(block, priors=priors))
    moved = found.state.points + found.state.origin - bare.state.points - bare.state.origin
    np.testing.assert_allclose(moved, 0.0, atol=1e-4)


def test_a_prior_is_switched_off_beside_the_control_of_its_point() -> None:
    block = with_priors(some=1)
    held = block.control[0]
    rows = tuple(row for row in block.priors if row.point != held.point)
    gone = next(row for row in block.priors if row.point == held.point)
    off = ControlPoint(gone.point, gone.xyz, gone.sigma, "off")
    found = adjust_block(replace(block, priors=rows, control=(off, *block.control, off)))
    bare = adjust_block(replace(block, priors=rows))
    assert found.redundancy == bare.redundancy
    np.testing.assert_allclose(found.state.points, bare.state.points, atol=1e-9)
    assert [name for name, *_ in found.off_control()] == [held.point] * 6
    assert ("point prior", held.point, "X") not in {row.key for row in found.point_prior_rows()}
    with pytest.raises(InputError, match="stands twice"):
        adjust_block(replace(block, control=(*block.control, held)))


def test_leaving_priors_out() -> None:
    block = adjust_block(with_priors())
    system = residuals_of(block)
    row = system.rows.starts[0] + system.rows.control + 4
    kind, point, axis = system.rows.ground[row - system.rows.starts[0]].tolist()
    reduced = without(system.rows, frozenset([row]))
    assert kind == 1
    assert np.isnan(reduced.expected_sigma[point, axis])
    assert np.isfinite(reduced.known_sigma).sum() == np.isfinite(block.problem.known_sigma).sum()
    assert reduced.observations == block.problem.observations - 1


def test_what_is_wrong_or_useless_is_said() -> None:
    block = with_priors(control=0.0)
    said = adjust_block(block).remarks
    known = block.control[0].point
    assert any(
        f"prior {known} is left out: it is of X, Y, Z, which control knows" in one for one in said
    )
    stray = PointPrior("nowhere", (1.0, 2.0, 3.0), (1.0, 1.0, 1.0))
    said = adjust_block(replace(block, priors=(*block.priors, stray))).remarks
    assert any(
        "prior nowhere is left out: it is of a point that is not measured" in s for s in said
    )
    for wrong in (
        replace(block.priors[0], sigma=(0.0, 1.0, 1.0)),
        replace(block.priors[0], sigma=(None, 1.0, 1.0)),
        replace(block.priors[0], xyz=(float("nan"), 1.0, 1.0)),
    ):
        with pytest.raises(InputError, match=f"prior of point {wrong.point}"):
            adjust_block(replace(block, priors=(wrong,)))
    with pytest.raises(InputError, match="stands twice"):
        adjust_block(replace(block, priors=(block.priors[0],) * 2))
