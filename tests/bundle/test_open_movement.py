"""What nothing but the noise of the measurements holds is not determined, and said so."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.bundle.errors.misfits import adjust_without_misfits
from anaplot.bundle.solve import openmovement, somepoints
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.gaussnewton import NoConvergenceError, equations_at
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import effect, effects
from anaplot.bundle.solve.openmovement import held_by_noise, held_by_noise_at
from anaplot.bundle.solve.parameterpriors import parameter_priors
from anaplot.bundle.solve.problem import Datum, Problem, make_problem
from anaplot.bundle.solve.somepoints import some_points
from anaplot.bundle.solve.structure import Structure
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block
from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.report.calibration import calibration_of

pytestmark = pytest.mark.slow

TURNING = r"not determined: photos 201, 202, 203, 204, 205: their common points .* movement open"


def planned(sidelap: float) -> Block:
    """Two strips over flat ground, without noise."""
    return plan_block(BlockPlan(2, 5, 0.60, sidelap, control_m=0.05)).block


def noisy(block: Block, sigma_um: float, seed: int) -> Block:
    rng = np.random.default_rng(seed)
    off = rng.normal(size=(len(block.image_points), 2)) * sigma_um * 1e-3
    rows = tuple(
        replace(row, x=row.x + x, y=row.y + y)
        for row, (x, y) in zip(block.image_points, off.tolist(), strict=True)
    )
    return replace(block, image_points=rows)


def in_error(block: Block, photo: str, point: str, by_mm: float) -> Block:
    rows = tuple(
        replace(row, y=row.y + by_mm) if (row.photo, row.point) == (photo, point) else row
        for row in block.image_points
    )
    assert rows != block.image_points
    return replace(block, image_points=rows)


def refusal(
    block: Block, datum: Datum = "control", additional: str | None = None, priors: str | None = None
) -> str:
    known = () if priors is None else parameter_priors(priors)
    chosen = None if additional is None else additional_parameters(additional, None, known)
    with pytest.raises(NotComputableError) as caught:
        adjust_block(block, datum=datum, additional=chosen)
    return str(caught.value)


@pytest.mark.parametrize("name", ["ebner", "gruen", "physical"])
def test_additional_parameters_are_refused_for_one_reason_with_noise_or_without(name: str) -> None:
    block = planned(0.60)
    exact = refusal(block, additional=name)
    assert f"not determined: the additional parameters ({name}, block-invariant)" in exact
    for sigma_um in (1.0, 20.0):
        assert refusal(noisy(block, sigma_um, 1), additional=name) == exact
    wrong = in_error(noisy(block, 5.0, 2), "103", "02-03", 0.2)
    assert refusal(wrong, additional=name) == exact


@pytest.mark.parametrize(
    ("name", "weighted"), [("ebner", "b3"), ("gruen", "a43"), ("physical", "k3")]
)
def test_one_weight_among_free_parameters_changes_no_reason(name: str, weighted: str) -> None:
    block, chosen = planned(0.60), f"{name}:photo"
    exact = refusal(block, additional=chosen)
    assert f"not determined: the additional parameters ({name}, photo-invariant)" in exact
    assert refusal(block, additional=chosen, priors=f"{weighted}=0+-0.001") == exact


@pytest.mark.parametrize("sigma_um", [0.0, 1.0, 20.0])
def test_strips_that_turn_about_a_line_are_named_with_noise_or_without(sigma_um: float) -> None:
    block = noisy(planned(0.30), sigma_um, 3)
    assert re.search(TURNING, refusal(block, "free"))
    if sigma_um > 0.0:
        # measuring the point again would not help
        for photo, point, by_mm in (("104", "03-05", 0.2), ("202", "04-03", 2.0)):
            assert re.search(TURNING, refusal(in_error(block, photo, point, by_mm), "free"))


def test_step_by_step_blames_what_is_open_and_not_a_point() -> None:
    block = in_error(noisy(planned(0.30), 5.0, 4), "104", "03-05", 0.2)
    with pytest.raises(NotComputableError, match=f"as a free network: .*{TURNING}"):
        clean_control_last(block, "search", SearchSettings())


def test_what_holds_a_block_stays_the_same_whatever_the_noise() -> None:
    # weakly determined: a strip that only control at its ends holds, and not well
    for block in (
        aerial(1, 6, noise_um=5.0, control_sigma=5.0).block,
        aerial(2, 4, noise_um=20.0, control_sigma=0.05).block,
        noisy(planned(0.30), 5.0, 5),
    ):
        found = adjust_block(block)
        structure = found.cofactors.normal.structure
        assert held_by_noise(found.problem, structure, found.state) is None


def test_of_photos_far_from_their_rays_nothing_is_said() -> None:
    found = adjust_block(noisy(planned(0.30), 5.0, 5))
    free = replace(
        found.problem, datum="free", known_sigma=np.full_like(found.problem.known_sigma, np.nan)
    )
    structure = found.cofactors.normal.structure
    assert held_by_noise(free, structure, found.state) is not None
    last = found.problem.photo == found.problem.photos.index("205")
    off = free.xy + np.where(last[:, None], 1.0, 0.0)
    assert held_by_noise(replace(free, xy=off), structure, found.state) is None


def with_heights_on_a_line(seed: int) -> Block:
    """A flat block of which control knows heights on one line alone; noise of both."""
    block = noisy(plan_block(BlockPlan(3, 6, control_m=0.05)).block, 5.0, seed)
    rng = np.random.default_rng(seed)
    line = min(abs(point.xyz[1]) for point in block.control if point.xyz[1] is not None)
    control = []
    for point in block.control:
        x, y, z = point.xyz
        if x is None or y is None:
            continue
        off = (rng.normal(size=3) * 0.05).tolist()
        known = z is not None and abs(y) == line
        xyz = (x + off[0], y + off[1], z + off[2] if known and z is not None else None)
        control.append(replace(point, xyz=xyz, sigma=(0.05, 0.05, 0.05)))
    return replace(block, control=tuple(control))


def test_a_flat_block_that_turns_about_the_line_of_its_heights_is_not_determined() -> None:
    """The cosine of that turn is all that holds it: of the plan, by the square of its angle.

    Where noise of the plan alone has turned it by many standard deviations, these tell of it.
    """
    reasons = []
    for seed in (0, 1, 2, 5):
        try:
            found = adjust_block(with_heights_on_a_line(seed))
        except NotComputableError as error:
            reasons.append(str(error))
        else:
            assert tilts(found).max() > 5e-3
    assert len(reasons) >= 3
    said = r"not determined: photos .*: their common points .* movement open"
    assert all(re.search(said, reason) for reason in reasons)


def tilts(found: AdjustedBlock) -> np.ndarray:
    """(n, 2) standard deviations of the photos' turns about X and Y [rad]."""
    return np.sqrt(np.einsum("nii->ni", found.cofactors.photos)[:, 3:5])


def flown(strips: int, length: int, sigma_m: float, seed: int) -> Block:
    """Photos with positions of that precision, and no control."""
    block = aerial(
        strips, length, noise_um=5.0, base=25.0, height=100.0, relief=1.0, seed=seed
    ).block
    rng = np.random.default_rng(seed)
    photos = []
    for photo in block.photos:
        row, column = int(photo.id[0]) - 1, int(photo.id[1:]) - 1
        at = np.array((25.0 * column, 25.0 * row, 100.0)) + rng.normal(size=3) * sigma_m
        x, y, z = at.tolist()
        photos.append(
            replace(photo, position=(x, y, z), rotation=None, position_sigma=(sigma_m,) * 3)
        )
    return replace(block, photos=tuple(photos), control=())


@pytest.mark.parametrize("seed", range(3))
def test_a_strip_with_positions_as_rough_as_it_is_straight_may_roll(seed: int) -> None:
    said = refusal(flown(1, 6, 5.0, seed))
    assert re.search(r"not determined: photos .*: their common points .* movement open", said)


@pytest.mark.parametrize("seed", range(3))
def test_rough_positions_of_a_block_that_is_as_wide_as_long_hold_it_roughly(seed: int) -> None:
    found = adjust_block(flown(3, 4, 5.0, seed))
    assert 0.01 < tilts(found).max() < 0.2
    assert held_by_noise(found.problem, found.cofactors.normal.structure, found.state) is None


@pytest.mark.parametrize("datum", ["control", "free"])
def test_gross_errors_of_a_determined_block_are_still_blamed_and_rescued(datum: Datum) -> None:
    scene = aerial(2, 3, per_base=2, noise_um=5.0, control_sigma=0.05)
    rows = list(scene.block.image_points)
    first, second = (k for k, r in enumerate(rows) if r.photo == "102" and r.point in ("p5", "p24"))
    rows[first], rows[second] = (
        replace(rows[first], x=rows[second].x, y=rows[second].y),
        replace(rows[second], x=rows[first].x, y=rows[first].y),
    )
    block = replace(scene.block, image_points=tuple(rows))
    with pytest.raises(NoConvergenceError, match="in photo 102 disagrees"):
        adjust_block(block, datum=datum)
    assert adjust_without_misfits(make_problem(block, datum=datum)).left_out


def test_parameters_of_cameras_that_are_left_open_are_named() -> None:
    """Over flat ground: c and the flying height, y0 and omega; what is weighted is left out."""
    block = aerial(1, 3, noise_um=5.0, relief=0.0).block
    for sigma, names in (([], r"\bc, y0 of 'cam'"), (["c=0.01"], r": y0 of 'cam'")):
        chosen = calibration_of(block, ["c,x0,y0"], sigma)
        with pytest.raises(NotComputableError, match=names) as caught:
            adjust_block(block, datum="free", additional=chosen)
        assert "use fewer or weight them (--calibrate-sigma, --add" in str(caught.value)
    chosen = calibration_of(block, ["c,x0,y0"], ["c=0.01,y0=0.01"])
    assert adjust_block(block, datum="free", additional=chosen).sigma0 < 2.0


@pytest.mark.parametrize("additional", [None, "ebner"])
def test_changes_looked_at_together_do_what_each_does(additional: str | None) -> None:
    """Also of shared parameters."""
    chosen = None if additional is None else additional_parameters(additional)
    found = adjust_block(noisy(aerial(2, 3).block, 5.0, 1), additional=chosen)
    problem, structure = found.problem, found.cofactors.normal.structure
    normal, _, _ = equations_at(problem, structure, found.state)
    rng = np.random.default_rng(3)
    shapes = (
        (len(problem.photos), problem.per_photo),
        (len(problem.points), 3),
        (problem.in_border,),
    )
    photos, points, shared = (rng.normal(size=(*shape, 3)) for shape in shapes)
    several = effects(problem, normal.linear, (photos, points, shared))
    for k, together in enumerate(several):
        alone = effect(problem, normal.linear, (photos[..., k], points[..., k], shared[..., k]))
        for one, other in zip(together.misclosures, alone.misclosures, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-9)
        rays = normal.seen(photos, points, shared)[:, :, k]
        np.testing.assert_allclose(together.e, rays, rtol=1e-10, atol=1e-8)


def turning() -> tuple[Problem, Structure, BlockState]:
    """A free network of two strips that turn about a line, but for noise."""
    found = adjust_block(noisy(planned(0.30), 5.0, 5))
    unknown = np.full_like(found.problem.known_sigma, np.nan)
    free = replace(found.problem, datum="free", known_sigma=unknown)
    return free, found.cofactors.normal.structure, found.state


def test_what_is_firm_where_errors_bend_it_is_looked_at_again_elsewhere() -> None:
    free, structure, state = turning()
    bent = state.points + np.random.default_rng(6).normal(size=state.points.shape) * 100.0
    errors = replace(state, points=bent)
    assert held_by_noise(free, structure, errors) is None
    remark = held_by_noise(free, structure, state)
    assert remark is not None
    asked = held_by_noise_at(free, structure, [(errors, None), (state, None)])
    assert asked == (remark, state)


def test_the_first_place_that_noise_holds_is_told_of_whichever_is_looked_at_first() -> None:
    free, structure, state = turning()
    other = replace(state, points=state.points + 1e-4)
    places = [(other, None), (state, equations_at(free, structure, state)[:2])]
    asked = held_by_noise_at(free, structure, places)
    assert asked is not None
    assert asked[0] == held_by_noise(free, structure, other)
    assert asked[1] is other


def test_a_firm_place_whose_equations_are_known_spares_those_of_one_near_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = adjust_block(aerial(1, 6, noise_um=5.0, control_sigma=0.05).block)
    normal, factor = found.cofactors.normal, found.cofactors.factor
    near = replace(found.state, points=found.state.points + 1e-3)
    monkeypatch.setattr(openmovement, "NormalEquations", None)  # none are made
    places = [(near, None), (found.state, (normal, factor))]
    assert held_by_noise_at(found.problem, normal.structure, places) is None


def test_a_place_near_a_firm_one_needs_no_look_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    found = adjust_block(aerial(1, 6, noise_um=5.0, control_sigma=0.05).block)
    looked = []

    def seen(*given: object) -> object:
        looked.append(given)
        return looked_at(*given)

    looked_at = openmovement._looked_at
    monkeypatch.setattr(openmovement, "_looked_at", seen)
    near = replace(found.state, points=found.state.points + 1e-3)
    structure = found.cofactors.normal.structure
    places = [(found.state, None), (near, None)]
    assert held_by_noise_at(found.problem, structure, places) is None
    assert len(looked) == 1


def test_some_points_tell_of_a_large_block_what_all_of_them_tell(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    free, structure, state = turning()
    firm = adjust_block(noisy(planned(0.60), 5.0, 5))
    before = held_by_noise(free, structure, state)
    for name, value in (("_LARGE", 10), ("_RAYS", 3), ("_FEWEST", 3), ("_TIMES", 2)):
        monkeypatch.setattr(somepoints, name, value)
    parted = []

    def chosen(problem: Problem) -> object:
        parted.append(some_points(problem))
        return parted[-1]

    monkeypatch.setattr(openmovement, "some_points", chosen)
    monkeypatch.setattr(openmovement, "_ITSELF", np.inf)  # of all points at once
    assert before is not None
    assert held_by_noise(free, structure, state) == before
    assert held_by_noise(firm.problem, firm.cofactors.normal.structure, firm.state) is None
    assert all(one is not None and one.sum() < 0.8 * len(one) for one in parted)
    assert len(parted) == 2
