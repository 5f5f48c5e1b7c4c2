"""The bundle as a whole: counting, invariants, self-calibration, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial, cube

from anaplot.bundle.adjust import _behind, adjust_block
from anaplot.bundle.solve.additional import additional_parameters, ebner, gruen, gruen50, physical
from anaplot.bundle.solve.parametercorrelations import parameter_correlations
from anaplot.bundle.solve.problem import make_problem
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import ControlPoint, ImagePoint, Photo, TestSettings

pytestmark = pytest.mark.slow


def test_counting() -> None:
    scene = aerial(2, 3, noise_um=5.0, control_sigma=0.0)
    rays = len(scene.block.image_points)
    points = len(scene.points)
    problem = make_problem(scene.block)
    fixed = sum(v is not None for c in scene.block.control for v in c.xyz)
    assert problem.observations == 2 * rays
    assert problem.unknowns == 6 * 6 + 3 * points - fixed
    weighted = aerial(2, 3, noise_um=5.0, control_sigma=0.05, priors=True)
    problem = make_problem(weighted.block)
    assert problem.observations == 2 * rays + fixed + 6 * 6
    assert problem.unknowns == 6 * 6 + 3 * points
    heights = tuple(
        replace(c, xyz=(None, None, c.xyz[2]), sigma=(None,) * 3) for c in scene.block.control
    )
    block = replace(scene.block, control=heights)
    problem = make_problem(block, additional=additional_parameters("ebner", 10.0))
    assert problem.observations == 2 * rays + len(block.control) + 12
    assert problem.unknowns == 36 + 3 * points + 12
    free = make_problem(scene.block, datum="free")
    assert free.redundancy == 2 * rays - 36 - 3 * points + 7
    # a control point's blank sigma is the block's default
    assert np.nanmax(problem.known_sigma) == scene.block.precision.control_m


def test_order_of_photos_and_points_does_not_matter() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=0.05)
    block = scene.block
    rng = np.random.default_rng(0)
    rows = [block.image_points[k] for k in rng.permutation(len(block.image_points))]
    photos = [block.photos[k] for k in rng.permutation(len(block.photos))]
    shuffled = replace(block, image_points=tuple(rows), photos=tuple(photos),
                       control=tuple(reversed(block.control)))  # fmt: skip
    first, second = adjust_block(block), adjust_block(shuffled)
    assert first.sigma0 == pytest.approx(second.sigma0, rel=1e-9)
    one = {(r.photo, r.point): r for r in first.ray_rows()}
    for row in second.ray_rows():
        other = one[row.photo, row.point]
        for mine, its in zip(row.xy, other.xy, strict=True):
            assert mine.residual == pytest.approx(its.residual, abs=1e-4)
            assert mine.r == pytest.approx(its.r, abs=1e-8)
    assert [r.row for r in second.ray_rows()] == list(range(len(rows)))
    where = {r.point: r for r in first.point_rows()}
    for point in second.point_rows():
        assert point.xyz == pytest.approx(where[point.point].xyz, abs=1e-5)


def test_residuals_change_by_r_times_a_planted_error() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=0.0)
    clean = adjust_block(scene.block)
    assert np.abs(clean.v).max() < 1e-4
    k = 40
    row = scene.block.image_points[k]
    rows = list(scene.block.image_points)
    rows[k] = replace(row, y=row.y + 1e-4)
    spoilt = {
        r.row: r for r in adjust_block(replace(scene.block, image_points=tuple(rows))).ray_rows()
    }
    assert spoilt[k].xy[1].residual == pytest.approx(-0.1 * spoilt[k].xy[1].r, rel=1e-3)


def test_tau_and_baarda() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=10.0)
    tau = adjust_block(scene.block)
    baarda = adjust_block(replace(scene.block, test=TestSettings(kind="baarda")))
    assert tau.sigma == tau.sigma0
    assert tau.sigma0 == pytest.approx(2.0, abs=0.3)
    assert baarda.sigma == 1.0
    np.testing.assert_allclose(
        np.nan_to_num(baarda.w), np.nan_to_num(tau.w * tau.sigma0), atol=1e-6
    )
    assert baarda.flagged.sum() > tau.flagged.sum()


# --- self-calibration -----------------------------------------------------------------------


@pytest.mark.parametrize("parameter_set", [ebner, physical])
def test_self_calibration_recovers_planted_parameters(parameter_set) -> None:
    q = len(parameter_set.names)
    rng = np.random.default_rng(5)
    planted = rng.normal(size=q) * 0.02
    plain = aerial(4, 5, per_base=2, relief=150.0, turned=True, seed=2)
    reach = max(max(abs(r.x), abs(r.y)) for r in plain.block.image_points)

    def distort(x: float, y: float):
        basis = parameter_set.basis(np.array([x]), np.array([y]), reach, np.array([150.0]))
        return basis[0] @ planted

    # crosswise turned strips, relief and dense control keep the physical set determined
    scene = aerial(4, 5, per_base=2, noise_um=3.0, sigma_um=3.0, relief=150.0, turned=True,
                   distort=distort, control_sigma=0.0, seed=2)  # fmt: skip
    if parameter_set is physical:
        control = tuple(
            ControlPoint(n, tuple(p.tolist()), (0.0,) * 3)
            for k, (n, p) in enumerate(scene.points.items())
            if k % 3 == 0
        )
        scene.block = replace(scene.block, control=control)
    without = adjust_block(scene.block)
    block = adjust_block(scene.block, additional=additional_parameters(parameter_set.name))
    assert block.sigma0 is not None
    assert without.sigma0 is not None
    assert block.sigma0 < 1.2 < without.sigma0
    # the image error itself is compared with what its own cofactors promise
    problem = block.problem
    x, y = problem.xy.T
    wanted = parameter_set.basis(x, y, reach, problem.c[problem.photo]) @ planted
    got = problem.basis @ block.state.shared
    q_shared = block.cofactors.shared
    spread = np.sqrt(np.einsum("mij,jk,mik->mi", problem.basis, q_shared, problem.basis))
    ratio = (got - wanted) / np.maximum(block.sigma0 * spread, 1e-6)
    assert np.sqrt(np.mean(ratio**2)) < 2.0
    assert np.abs(ratio).max() < 6.0


def test_scopes_of_additional_parameters() -> None:
    scene = aerial(3, 4, per_base=2, noise_um=5.0, control_sigma=0.05)
    for scope, groups in (("block", 1), ("strip", 3), ("camera", 1), ("photo", 12)):
        block = adjust_block(scene.block, additional=additional_parameters(f"ebner:{scope}", 5.0))
        rows = block.parameter_rows()
        assert len(rows) == 12 * groups
        assert len({row.group for row in rows}) == groups
        assert all(row.s is not None and row.s > 0 for row in rows)
        total = block.cofactors.r.sum() + np.nansum(block.cofactors.r_ground)
        total += np.nansum(block.cofactors.r_own) + np.nansum(block.cofactors.r_shared)
        assert total == pytest.approx(block.redundancy, abs=1e-7)
        assert len(block.prior_rows()) == 12 * groups


def test_correlated_parameters_are_named() -> None:
    scene = aerial(3, 4, per_base=2, noise_um=5.0, control_sigma=0.05)
    block = adjust_block(scene.block, additional=additional_parameters("physical", 100.0))
    found = parameter_correlations(block, 0.9)
    assert found
    assert all(abs(rho) > 0.9 for _, _, rho in found)
    assert any(("k1" in first and "k2" in second) or "k2" in first for first, second, _ in found)
    assert parameter_correlations(adjust_block(scene.block)) == []


def test_gruens_44_parameters_on_a_5_x_5_block() -> None:
    scene = aerial(4, 5, per_base=2, noise_um=5.0)
    block = adjust_block(scene.block, additional=additional_parameters("gruen", 20.0))
    assert len(block.parameter_rows()) == len(gruen.names) == 44


def test_of_the_complete_set_nothing_determines_the_one_that_is_kappa() -> None:
    scene = aerial(3, 4, per_base=2, noise_um=5.0, relief=150.0, turned=True)
    weighted = adjust_block(scene.block, additional=additional_parameters("gruen50", 20.0))
    assert len(weighted.parameter_rows()) == len(gruen50.names) == 50
    # an image turned about its origin is a kappa, whatever is seen: only noise says otherwise
    free = adjust_block(scene.block, additional=additional_parameters("gruen50:a21,b12"))
    shear, torsion = np.sqrt(np.diag(free.cofactors.shared))
    assert shear < 0.01
    assert torsion > 1.0


@pytest.mark.parametrize("text", ["ebner", "physical"])
def test_some_parameters_are_the_whole_set_with_the_others_held_at_zero(text: str) -> None:
    scene = aerial(4, 5, per_base=2, noise_um=3.0, relief=150.0, turned=True, control_sigma=0.05)
    whole = adjust_block(scene.block, additional=additional_parameters(text, 20.0))
    names = whole.problem.additional.set.names
    kept = [k for k in range(len(names)) if k % 3 == 0]
    away = [k for k in range(len(names)) if k % 3 != 0]
    chosen = ",".join(names[k] for k in kept)
    some = adjust_block(scene.block, additional=additional_parameters(f"{text}:{chosen}", 20.0))
    z, q = whole.state.shared, whole.cofactors.shared
    gain = q[np.ix_(kept, away)] @ np.linalg.inv(q[np.ix_(away, away)])
    s = np.sqrt(np.diag(some.cofactors.shared))
    np.testing.assert_allclose((some.state.shared - (z[kept] - gain @ z[away])) / s, 0.0, atol=1e-2)
    np.testing.assert_allclose(
        some.cofactors.shared, q[np.ix_(kept, kept)] - gain @ q[np.ix_(away, kept)], rtol=1e-2
    )


def test_too_many_free_parameters_are_named_as_undetermined() -> None:
    scene = aerial(2, 3, per_base=1, noise_um=5.0)
    with pytest.raises(NotComputableError, match="not determined"):
        adjust_block(scene.block, additional=additional_parameters("gruen:photo"))


# --- bad input ------------------------------------------------------------------------------


@pytest.fixture
def scene():
    return aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=0.05)


def test_points_with_one_ray_are_left_out_and_named(scene) -> None:
    rows = (*scene.block.image_points, ImagePoint("101", "lonely", 10.0, 10.0))
    block = adjust_block(replace(scene.block, image_points=rows))
    assert any("lonely" in remark and "one ray" in remark for remark in block.remarks)
    assert block.warnings == ()
    assert block.redundancy == adjust_block(scene.block).redundancy


def test_of_points_behind_most_of_a_photos_the_photo_is_named(scene) -> None:
    # each of its points was to be measured again, six times of a photo in a wrong place
    problem = make_problem(scene.block)
    mine = np.flatnonzero(problem.photo == 0)
    other = int(np.flatnonzero(problem.photo == 1)[3])
    behind = np.zeros(len(problem.photo), dtype=bool)
    behind[mine[1:]] = behind[other] = True
    of_photo, of_point = _behind(problem, behind)
    first, second = problem.photos[:2]
    assert of_photo.startswith(f"{len(mine) - 1} of {len(mine)} points of photo {first} lie behind")
    point = problem.points[problem.point[other]]
    assert of_point == f"point {point} lies behind photo {second}: remeasure it"
    assert _behind(problem, np.zeros(len(behind), dtype=bool)) == []


def test_photos_with_too_few_points_are_left_out_and_named(scene) -> None:
    photos = (*scene.block.photos, Photo("poor", "cam"), Photo("empty", "cam"))
    rows = (*scene.block.image_points, ImagePoint("poor", "p10", 1.0, 2.0),
            ImagePoint("poor", "p11", 5.0, 2.0))  # fmt: skip
    block = adjust_block(replace(scene.block, photos=photos, image_points=rows))
    assert any("photo poor" in remark for remark in block.remarks)
    assert any("photo empty" in remark for remark in block.remarks)
    assert "poor" not in block.problem.photos


def test_disconnected_parts_are_named() -> None:
    scene = aerial(2, 4, per_base=2, noise_um=5.0, control_sigma=0.05)
    strip = set(scene.block.strips[1].photos)
    rows = tuple(
        replace(r, point=f"q{r.point}") if r.photo in strip else r for r in scene.block.image_points
    )
    with pytest.raises(NotComputableError) as caught:
        adjust_block(replace(scene.block, image_points=rows))
    assert "disconnected" in str(caught.value)
    assert "201" in str(caught.value)
    with pytest.raises(NotComputableError, match="2 parts"):
        adjust_block(replace(scene.block, image_points=rows), datum="free")


def test_insufficient_control_is_said(scene) -> None:
    with pytest.raises(NotComputableError, match="scale"):
        adjust_block(replace(scene.block, control=scene.block.control[:1]))
    with pytest.raises(NotComputableError, match="rotation"):
        adjust_block(replace(scene.block, control=scene.block.control[:2]))
    with pytest.raises(NotComputableError, match="no control"):
        adjust_block(replace(scene.block, control=()))


def test_sigmas_that_are_none(scene) -> None:
    row = scene.block.image_points[3]
    for sigma in (0.0, -1.0, float("nan")):
        rows = (replace(row, sigma_um=sigma), *scene.block.image_points[1:3])
        with pytest.raises(InputError, match="sigma"):
            make_problem(replace(scene.block, image_points=rows))
    bad = replace(scene.block.control[0], sigma=(0.1, -0.1, 0.1))
    with pytest.raises(InputError, match="sY"):
        adjust_block(replace(scene.block, control=(bad,)))
    photos = (replace(scene.block.photos[0], position=(0.0, 0.0, 0.0), position_sigma=(0, 1, 1)),)
    with pytest.raises(InputError, match="position_sigma"):
        make_problem(replace(scene.block, photos=photos + scene.block.photos[1:]))
    with pytest.raises(InputError, match="twice"):
        adjust_block(replace(scene.block, control=(scene.block.control[0],) * 2))
    with pytest.raises(InputError, match="no image points"):
        adjust_block(replace(scene.block, image_points=()))


def culprit(block) -> set[str]:
    return {row.point for row in block.control_rows() if row.flagged}


def test_contradictory_control_is_accused(scene) -> None:
    control = list(scene.block.control)
    x, y, z = control[2].xyz
    control[2] = replace(control[2], xyz=(x, y, z + 5.0))
    block = adjust_block(replace(scene.block, control=tuple(control)))
    worst = max(block.control_rows(), key=lambda row: abs(row.w or 0.0))
    assert (worst.point, worst.axis) == (control[2].point, "Z")
    assert worst.flagged


@pytest.mark.parametrize("sigma", [0.0, 0.05])
def test_swapped_control_ids_are_accused(sigma: float) -> None:
    # small: every way to approximate values is tried to its end
    scene = aerial(1, 3, per_base=2, noise_um=5.0, control_sigma=sigma)
    control = list(scene.block.control)
    first, second = control[0], control[1]
    control[0] = replace(first, xyz=second.xyz)
    control[1] = replace(second, xyz=first.xyz)
    with pytest.raises(NotComputableError) as caught:
        adjust_block(replace(scene.block, control=tuple(control)))
    assert f"control point {first.point}" in str(caught.value)
    assert f"control point {second.point}" in str(caught.value)


def test_nonsense_ends_in_words() -> None:
    rng = np.random.default_rng(1)
    # small: with nonsense every way to approximate values is tried to its end
    block = aerial(1, 3, noise_um=5.0, control_sigma=0.05).block
    noise = [
        replace(r, x=rng.uniform(-80.0, 80.0), y=rng.uniform(-80.0, 80.0))
        for r in block.image_points
    ]
    nowhere = [replace(r, x=0.0, y=0.0) for r in block.image_points]
    for rows in (noise, nowhere):
        with pytest.raises(NotComputableError, match="block synthetic"):
            adjust_block(replace(block, image_points=tuple(rows)))
    same = tuple(replace(c, xyz=(1e6, 1e6, 5.0)) for c in block.control)
    with pytest.raises(NotComputableError, match="block synthetic"):
        adjust_block(replace(block, control=same))


def outcome_of(block) -> str:
    """What a person is told first: the worst flagged point, or the reason of the refusal."""
    try:
        found = adjust_block(block).suspects()
    except NotComputableError as error:
        return str(error).partition("no solution found: ")[2]
    return f"point {found[0][2]} in photo {found[0][1]}"


@pytest.mark.parametrize("size", [0.2, 10.0, 100.0])
def test_gross_errors_are_found_or_named(size: float) -> None:
    rng = np.random.default_rng(3)
    scene = cube("E", noise_um=5.0)
    for _ in range(6):
        k = int(rng.integers(len(scene.block.image_points)))
        axis = "xy"[int(rng.integers(2))]
        rows = list(scene.block.image_points)
        row = rows[k]
        rows[k] = replace(row, **{axis: getattr(row, axis) + size})
        outcome = outcome_of(replace(scene.block, image_points=tuple(rows)))
        assert outcome.startswith(f"point {row.point} in photo {row.photo}")


def test_a_torn_block_asks_a_robust_solution(scene) -> None:
    k = 80
    rows = list(scene.block.image_points)
    rows[k] = replace(rows[k], y=rows[k].y + 30.0)
    block = adjust_block(replace(scene.block, image_points=tuple(rows)))
    assert block.suspects()[0][1:3] == (rows[k].photo, rows[k].point)
    remark = next(r for r in block.remarks if "gross errors" in r)
    assert f"point {rows[k].point} in photo {rows[k].photo}" in remark
