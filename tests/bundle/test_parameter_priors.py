"""What is known of additional parameters beforehand: weights, held values, H0: dz = dz'."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from denseblock import dense, dense_inverse

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.parametertests import parameter_tests
from anaplot.bundle.solve.additional import additional_parameters, ebner
from anaplot.bundle.solve.imaging import imaged, imaged_with_derivatives
from anaplot.bundle.solve.linearised import move
from anaplot.bundle.solve.parameterpriors import ParameterPrior, parameter_priors
from anaplot.bundle.solve.problem import make_problem
from anaplot.errors import InputError
from anaplot.photogrammetry.block import PointPrior

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene():
    return aerial(3, 3, per_base=2, noise_um=5.0, relief=150.0, turned=True, control_sigma=0.05)


def adjusted(scene, text: str, priors: str, sigma_um: float | None = None):
    known = parameter_priors(priors) if priors else ()
    return adjust_block(scene.block, additional=additional_parameters(text, sigma_um, known))


def same(one, two, rtol: float = 1e-6) -> None:
    """The same points, and standard deviations of them."""
    np.testing.assert_allclose(
        one.state.points + one.state.origin, two.state.points + two.state.origin, atol=2e-5
    )
    np.testing.assert_allclose(one.cofactors.points, two.cofactors.points, rtol=rtol, atol=1e-9)


def stated(scene, what: str, sigma: float):
    """Return the block with one thing stated, and priors of parameters."""
    block, sigmas = scene.block, (sigma,) * 3
    if what == "parameter":
        return block, [ParameterPrior("b3", 4.0, sigma)]
    if what == "control":
        control = (replace(block.control[0], sigma=sigmas), *block.control[1:])
        return replace(block, control=control), []
    if what == "photo":
        at = tuple(map(float, scene.centres["101"]))
        photo = replace(block.photos[0], position=at, position_sigma=sigmas)
        return replace(block, photos=(photo, *block.photos[1:])), []
    given = {row.point for row in block.control}
    name = next(row.point for row in block.image_points if row.point not in given)
    at = tuple(map(float, scene.points[name]))
    return replace(block, priors=(PointPrior(name, at, sigmas),)), []


@pytest.mark.parametrize("text", ["ebner:b3,b5,b9", "physical:k1,b1,c"])
def test_a_sigma_without_end_is_free_and_one_of_nothing_holds(scene, text: str) -> None:
    names = text.partition(":")[2].split(",")
    value = {"ebner": 8.0, "physical": 2e-4}[text.partition(":")[0]]
    free = adjusted(scene, text, "")
    same(adjusted(scene, text, f"{names[0]}={value}+-1e9"), free)
    held = adjusted(scene, text, f"{names[0]}={value}+-0")
    assert [row.name for row in free.parameter_rows() if row.name != names[0]] == [
        row.name for row in held.parameter_rows()
    ]
    tight = adjusted(scene, text, f"{names[0]}={value}+-{value * 1e-7}")
    same(tight, held, rtol=1e-5)
    assert tight.redundancy == held.redundancy == free.redundancy + 1
    # held at zero is not there
    away = adjusted(scene, f"{text.partition(':')[0]}:{','.join(names[1:])}", "")
    same(adjusted(scene, text, f"{names[0]}=0+-0"), away)
    everything = adjusted(scene, text, ",".join(f"{n}=0+-0" for n in names))
    same(everything, adjust_block(scene.block))
    assert everything.parameter_rows() == []


@pytest.mark.parametrize("scope", ["block", "strip", "photo"])
def test_every_prior_is_an_observation(scene, scope: str) -> None:
    block = adjusted(scene, f"ebner:b3,b5,b9:{scope}", "b3=4+-2,b9=-3+-5,b5=1")
    names = block.problem.additional_groups
    rows = block.prior_rows()
    assert [row.key for row in rows] == [("prior", g, n) for g in names for n in ("b3", "b9")]
    assert block.problem.observations == 2 * len(block.problem.photo) + 2 * len(names) + int(
        np.isfinite(block.problem.known_sigma).sum()
    )
    # r, residual, smallest detectable error and w by the dense design
    design, free = dense(block)
    q = dense_inverse(design, free)
    n, d, p = len(block.problem.photos), block.problem.per_photo, len(block.problem.points)
    values = {(row.group, row.name): row.value for row in block.parameter_rows()}
    for row in rows:
        _, group, name = row.key
        k, index = names.index(group), ("b3", "b5", "b9").index(name)
        at = k * d + 6 + index if scope == "photo" else n * d + 3 * p + 3 * k + index
        known, sigma = {"b3": (4e-3, 2e-3), "b9": (-3e-3, 5e-3)}[name]
        assert row.r == pytest.approx(1.0 - q[at, at] / sigma**2, abs=1e-8)
        assert row.residual == pytest.approx(values[group, name] - known, abs=1e-9)
        expected = block.sigma * sigma * np.sqrt(row.r)
        assert row.w == pytest.approx(row.residual / expected, rel=1e-6)
        assert row.mdb == pytest.approx(4.132 * sigma / np.sqrt(row.r), rel=1e-3)


@pytest.mark.parametrize("sigma", [1e-100, 1e-12, 1e12, 1e100])
@pytest.mark.parametrize("what", ["parameter", "control", "point", "photo"])
def test_all_that_counts_is_an_observation_whatever_its_sigma(scene, what: str, sigma) -> None:
    block, known = stated(scene, what, sigma)
    chosen = additional_parameters("ebner:b3,b5", None, known)
    found = adjust_block(block, additional=chosen)
    assert found.problem.observations == found.observations.count
    assert found.tested.r.sum() == pytest.approx(found.redundancy, abs=1e-6)


@pytest.mark.parametrize("sigma", [1e-200, 1e200])
@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("parameter", "the prior of 'b3'"),
        ("control", "control point {}: X"),
        ("point", "prior of point {}: X"),
        ("photo", "photo 101: position"),
    ],
)
def test_a_sigma_without_a_weight_is_refused(scene, what: str, said: str, sigma) -> None:
    block, known = stated(scene, what, sigma)
    point = block.priors[0].point if block.priors else block.control[0].point
    with pytest.raises(InputError) as refused:
        make_problem(block, additional=additional_parameters("ebner:b3,b5", None, known))
    size = "large" if sigma > 1.0 else "small"
    assert str(refused.value).startswith(f"{said.format(point)}: the sigma {sigma:g} is too {size}")
    # where nothing is observed, a sigma is as good as another
    free = additional_parameters("ebner:b3,b5")
    assert make_problem(block, datum="free", additional=free).observations > 0


def test_priors_of_groups(scene) -> None:
    known = [
        ParameterPrior("b3", 1.0, 2.0),
        ParameterPrior("b3", 5.0, 3.0, "s2"),
        ParameterPrior("b5", 7.0, None, "s1"),
    ]
    block = make_problem(
        scene.block, additional=additional_parameters("ebner:b3,b5:strip", None, known)
    )
    assert block.additional_groups == ("s1", "s2", "s3")
    np.testing.assert_allclose(block.additional_given * 1e3, [[1.0, 7.0], [5.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(
        block.additional_sigma * 1e3, [[2.0, np.inf], [3.0, np.inf], [2.0, np.inf]]
    )
    for wrong, said in (
        ([ParameterPrior("b3", 1.0, 2.0, "9")], "no strip '9'"),
        ([ParameterPrior("b3", 1.0, 0.0, "s2")], "held (sigma 0), but not for 's1'"),
    ):
        with pytest.raises(InputError, match=r".") as refused:
            make_problem(
                scene.block, additional=additional_parameters("ebner:b3,b5:strip", None, wrong)
            )
        assert said in str(refused.value)


@pytest.mark.parametrize(
    ("sigma_um", "known", "free"),
    [
        # the group's own row counts, and has no sigma
        (None, [("b3", 1.0, 2.0), ("b3", 5.0, None, "s2")], [False, True, False]),
        (10.0, [("b3", 5.0, None)], [True, True, True]),
        (10.0, [("b3", 5.0, None, "s2")], [False, True, False]),
    ],
)
def test_a_value_without_a_sigma_has_no_weight(scene, sigma_um, known, free) -> None:
    priors = [ParameterPrior(*one) for one in known]
    block = make_problem(
        scene.block, additional=additional_parameters("ebner:b3,b5:strip", sigma_um, priors)
    )
    found = block.additional_sigma * 1e3
    if not len(found):  # all are free
        found = np.full((3, 2), np.inf)
    assert np.isinf(found[:, 0]).tolist() == free
    assert np.isinf(found[:, 1]).tolist() == [sigma_um is None] * 3
    assert block.additional_given[1, 0] == 5e-3
    weighted = int(np.isfinite(found).sum())
    bare = make_problem(scene.block)
    assert block.observations == bare.observations + weighted


def without_the_edge(block):
    """Return the block without the rays near the largest coordinate."""
    largest = max(max(abs(row.x), abs(row.y)) for row in block.image_points)
    kept = [row for row in block.image_points if max(abs(row.x), abs(row.y)) < 0.9 * largest]
    assert len(kept) < len(block.image_points)
    return replace(block, image_points=tuple(kept))


def with_format(block):
    """Return the block with the format of its camera: 230 mm x 200 mm."""
    return replace(block, cameras=tuple(replace(c, format=(230.0, 200.0)) for c in block.cameras))


def effects(block, **options) -> dict[tuple[str, str], np.ndarray]:
    """Return what b3, b9 of 1 mm do at each ray."""
    problem = make_problem(block, additional=additional_parameters("ebner:b3,b9", **options))
    rays = zip(problem.photo, problem.point, strict=True)
    return {
        (problem.photos[photo], problem.points[point]): problem.basis[k]
        for k, (photo, point) in enumerate(rays)
    }


@pytest.mark.parametrize("options", [{}, {"reference_mm": 90.0}])
def test_a_parameter_is_the_same_function_whatever_is_measured(scene, options) -> None:
    block = scene.block if options else with_format(scene.block)
    whole, inner = effects(block, **options), effects(without_the_edge(block), **options)
    assert 0 < len(inner) < len(whole)
    for ray, effect in inner.items():
        np.testing.assert_array_equal(effect, whole[ray])
    b = 90.0 if options else 115.0
    row = block.image_points[0]
    at = np.array([row.x]), np.array([row.y])
    term = ebner.only(["b3", "b9"]).terms(*at, b, np.array([150.0]))[0]
    np.testing.assert_allclose(whole[row.photo, row.point], term, rtol=1e-12)


def test_without_a_format_the_length_is_the_largest_coordinate_measured(scene) -> None:
    largest = max(max(abs(row.x), abs(row.y)) for row in scene.block.image_points)
    as_stated = effects(scene.block, reference_mm=largest)
    for ray, effect in effects(scene.block).items():
        np.testing.assert_array_equal(effect, as_stated[ray])


@pytest.mark.parametrize("how", ["format", "stated", "neither"])
def test_a_calibration_is_carried_to_another_block(how: str) -> None:
    planted = {"b3": 0.25, "b5": -0.2, "b9": 0.3}
    made = ebner.only(planted)
    values = np.array([planted[name] for name in made.names])

    def distort(x: float, y: float) -> tuple[float, float]:
        at = np.array([x]), np.array([y])
        dx, dy = (made.terms(*at, 115.0, np.array([150.0]))[0] @ values).tolist()
        return dx, dy

    # another place, another noise, and rays at the edge that it has not
    first = aerial(
        3, 3, per_base=2, noise_um=5.0, seed=1, control_sigma=0.05, distort=distort
    ).block
    other = aerial(
        2, 4, per_base=2, noise_um=5.0, seed=2, control_sigma=0.05, distort=distort
    ).block
    other = without_the_edge(other)
    reference = None
    if how == "format":
        first, other = with_format(first), with_format(other)
    elif how == "stated":
        reference = 115.0
    text = "ebner:b3,b5,b9"
    calibration = adjust_block(
        first, additional=additional_parameters(text, reference_mm=reference)
    )
    held = [ParameterPrior(row.name, row.value * 1e3, 0.0) for row in calibration.parameter_rows()]
    carried = adjust_block(
        other, additional=additional_parameters(text, None, held, reference_mm=reference)
    )
    bound = 1.0 + 3.0 / np.sqrt(2.0 * carried.redundancy)
    if how == "neither":  # other functions: they are no calibration of this block
        assert carried.sigma0 > bound
    else:
        assert carried.sigma0 < bound
        assert adjust_block(other).sigma0 > 2.0 * bound
        for row in calibration.parameter_rows():
            assert abs(row.value - planted[row.name]) < 4.0 * row.s


@pytest.mark.parametrize("reference", [0.0, -3.0, 1e9, float("nan")])
def test_a_reference_length_beyond_any_image_is_refused(reference: float) -> None:
    with pytest.raises(InputError, match="the reference length"):
        additional_parameters("ebner", reference_mm=reference)


@pytest.mark.parametrize("text", ["ebner:b3,b5,b9:camera", "physical:k1,b1,c:photo"])
def test_derivatives_with_held_parameters_are_the_numerical_ones(scene, text: str) -> None:
    held = {"ebner": "b5=30+-0", "physical": "k1=0.003+-0"}[text.partition(":")[0]]
    problem = make_problem(
        scene.block, additional=additional_parameters(text, None, parameter_priors(held))
    )
    state = scene.start(problem)
    found = imaged_with_derivatives(problem, state)
    np.testing.assert_allclose(found.xy, imaged(problem, state).xy, atol=1e-12)
    without = make_problem(scene.block, additional=additional_parameters(text))
    moved = found.xy - imaged(without, scene.start(without)).xy
    assert np.abs(moved).max() > 0.01
    photos = np.zeros((len(problem.photos), problem.per_photo))
    photos[:, 0] = 1e-2
    nothing = np.zeros_like(state.points), np.zeros_like(state.shared)
    up, down = (imaged(problem, move(state, sign * photos, *nothing)).xy for sign in (1, -1))
    np.testing.assert_allclose((up - down) / 2e-2, found.photo[:, :, 0], rtol=1e-5, atol=1e-7)


def test_parameters_are_tested_against_given_values(scene) -> None:
    free = adjusted(scene, "ebner:b3,b5,b9", "")
    given = adjusted(scene, "ebner:b3,b5,b9", "b3=20,b5=-4,b9=100")
    same(given, free)
    found, other = parameter_tests(given), parameter_tests(free)
    z = free.state.shared - np.array([20e-3, -4e-3, 100e-3])
    square = z @ np.linalg.solve(free.cofactors.shared, z)
    assert found.everything.known.square == pytest.approx(square, rel=1e-6)
    for k, (one, two) in enumerate(zip(found.parameters, other.parameters, strict=True)):
        assert one.value == pytest.approx(two.value, abs=1e-8)
        assert one.given == pytest.approx([20e-3, -4e-3, 100e-3][k])
        assert one.verdict.known.square == pytest.approx((z[k] / two.s) ** 2, rel=1e-5)
    assert other.everything.known.square != pytest.approx(square, rel=1e-2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("b1", "written as"),
        ("b1=x+-3", "written as"),
        ("b1=3+--1", "written as"),
        ("b1=nan", "written as"),
        ("=3", "written as"),
        ("b3=1,b3=2", "stands twice"),
        ("b33=1", "which takes no part (did you mean 'b3'?)"),
        ("b4=1", "which takes no part"),
        ("b3=4+-1e-200", "the prior of 'b3': the sigma 1e-200 is too small for a weight"),
        ("b3=4+-1e200", "the prior of 'b3': the sigma 1e+200 is too large for a weight"),
    ],
)
def test_a_wrong_prior_is_told(text: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        additional_parameters("ebner:b3,b5", None, parameter_priors(text))
    assert said in str(refused.value)
