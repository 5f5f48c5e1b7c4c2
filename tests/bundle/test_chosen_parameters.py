"""Additional parameters chosen by tests: what is planted is found, what is not is rejected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.chosenparameters import choose_parameters
from anaplot.bundle.hypotheses.parametertests import parameter_tests
from anaplot.bundle.hypotheses.verdict import HypothesisSettings
from anaplot.bundle.solve.additional import additional_parameters, automatic_sets, ebner
from anaplot.errors import InputError
from anaplot.photogrammetry.block import TestSettings

pytestmark = pytest.mark.slow

_OPTIONS = {"per_base": 2, "noise_um": 5.0, "relief": 50.0}


def block_of(seed: int, planted: dict[str, float], kind: str = "tau", scale: float = 1.0):
    """A block whose images have some of Ebner's errors [mm], in its own reach."""
    bare = aerial(2, 4, seed=seed, **_OPTIONS).block
    reach = max(max(abs(row.x), abs(row.y)) for row in bare.image_points)
    rows = []
    for row in bare.image_points:
        at = np.array([row.x]), np.array([row.y])
        basis = ebner.basis(*at, reach, np.array([150.0]))[0]
        dx, dy = sum(
            basis[:, ebner.names.index(name)] * v for name, v in planted.items()
        ) + np.zeros(2)
        rows.append(replace(row, x=row.x + dx, y=row.y + dy))
    return replace(bare, image_points=tuple(rows), test=replace(TestSettings(), kind=kind))


def chosen(block, text: str = "auto", alpha: float = 0.05):
    settings = HypothesisSettings(alpha, 0.8)
    return choose_parameters(adjust_block(block), automatic_sets(text), settings)


@pytest.mark.parametrize("kind", ["tau", "baarda"])
def test_planted_parameters_are_found(kind: str) -> None:
    planted = {"b3": 0.020, "b5": -0.015, "b8": 0.030}
    found = chosen(block_of(2, planted, kind), "auto:ebner")
    assert found.chosen is not None
    # of each the noncentrality is above 50: that a test misses one is less probable than 1e-4
    assert found.chosen.kept == tuple(planted)
    rows = {row.name: row for row in found.block.parameter_rows()}
    assert all(abs(rows[name].value - v) < 4.0 * rows[name].s for name, v in planted.items())
    stages = [step.stage for step in found.chosen.steps]
    assert stages[0] == "all"
    assert stages[-2:] == ["rejected", "kept"]
    moved = (_places(found.block) - _places(found.without)).ravel().tolist()
    assert found.chosen.steps[-1].change.change == pytest.approx(max(moved, key=abs))


def test_of_several_sets_the_one_that_explains_most_with_least_is_taken() -> None:
    block = block_of(2, {"b3": 0.020, "b5": -0.015, "b8": 0.030})
    found = chosen(block)
    assert [one.name for one in found.sets] == ["physical", "ebner", "gruen"]
    assert found.chosen.criterion == min(one.criterion for one in found.sets) < -100.0
    n = found.without.problem.observations
    for one in found.sets:
        k = len(one.kept)
        assert one.block.parameter_rows()[0].name == one.kept[0]
        ratio = one.block.vtpv / found.without.vtpv
        assert one.criterion == pytest.approx(n * np.log(ratio) + k * np.log(n))
    # sigma0 is what it is without systematic errors, but for its own standard deviation
    assert abs(found.block.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * found.block.redundancy)
    assert found.without.sigma0 > 1.5


def _places(block):
    order = np.argsort(block.problem.points)
    return (block.state.points + block.state.origin)[order]


def test_nothing_is_found_where_nothing_is_at_the_significance_of_the_choice() -> None:
    found = [chosen(block_of(seed, {}), "auto:ebner", 0.5) for seed in range(100, 120)]
    count = sum(one.chosen is not None for one in found)
    # binomial(20, .5): outside of these with a probability of .0026
    assert 4 <= count <= 16
    # the global test of the whole set decides: its statistic is F(12, r)
    assert all(one.chosen is None or one.sets[0].steps[0].outcome == "significant" for one in found)
    for one in found:
        assert one.chosen is not None or one.block is one.without


def test_three_sets_share_the_significance() -> None:
    found = chosen(block_of(8, {}), alpha=0.06)
    assert [one.name for one in found.sets] == ["physical", "ebner", "gruen"]
    assert found.set_alpha == pytest.approx(0.02)
    assert found.chosen is None
    assert found.block is found.without


@pytest.mark.parametrize(
    ("planted", "outcome"), [({"b3": 0.02}, "back"), ({"b9": 0.015, "b10": 0.02}, "significant")]
)
def test_what_is_significant_says_what_it_does_to_the_ground(planted, outcome) -> None:
    """A group, and what comes back, as every other step."""
    steps = chosen(block_of(2, planted), "auto:physical").sets[0].steps
    mine = [one for one in steps if one.stage != "all" and one.outcome == outcome]
    assert mine
    assert all(step.change is not None and step.change.change != 0.0 for step in steps)


def test_what_a_step_does_to_the_ground_is_what_an_adjustment_without_it_says() -> None:
    block = block_of(3, {"b3": 0.015, "b9": 0.01})
    found = chosen(block, "auto:ebner")
    held: list[str] = []
    steps = [step for step in found.sets[0].steps if step.outcome == "rejected"]
    steps = [step for step in steps if step.stage in ("single", "group")]
    assert len(steps) >= 3
    before = adjust_block(block, additional=additional_parameters("ebner"))
    for step in steps:
        held += step.parameters
        text = "ebner:" + ",".join(f"-{name}" for name in held)
        after = adjust_block(block, additional=additional_parameters(text))
        moved = _places(after) - _places(before)
        assert step.change.change == pytest.approx(max(moved.ravel().tolist(), key=abs), abs=2e-4)
        np.testing.assert_allclose(step.change.rms, np.sqrt((moved**2).mean(axis=0)), atol=1e-4)
        at = (
            before.problem.points.index(step.change.sigma.point),
            "XYZ".index(step.change.sigma.axis),
        )
        for one, sigma in ((before, step.change.sigma.before), (after, step.change.sigma.after)):
            wanted = np.sqrt(one.cofactors.points[at[0], at[1], at[1]])
            assert sigma == pytest.approx(wanted, rel=2e-3)
        # its test is that of the difference between both adjustments
        assert step.verdict.known.square == pytest.approx(after.vtpv - before.vtpv, abs=0.02)
        before = after


def test_the_steps_take_the_tests_that_there_are() -> None:
    block = block_of(3, {"b3": 0.015})
    steps = chosen(block, "auto:ebner").sets[0].steps
    tests = parameter_tests(adjust_block(block, additional=additional_parameters("ebner")))
    assert steps[0].verdict.known.square == pytest.approx(tests.everything.known.square, rel=1e-6)
    single = {step.parameters[0]: step for step in steps if step.stage == "single"}
    assert set(single) <= set(ebner.names)
    gone = next(step for step in steps if step.stage == "rejected")
    rejected = [step for step in steps if step.outcome == "rejected" and step.stage != "rejected"]
    assert gone.verdict.known.dimension == sum(len(step.parameters) for step in rejected)


def test_what_the_geometry_does_not_determine_is_left_out() -> None:
    # kappa turns every image as b12 does, whatever is seen
    scene = aerial(2, 4, per_base=2, noise_um=5.0, relief=0.0, tilt=0.0)
    without = adjust_block(scene.block)
    found = choose_parameters(without, (additional_parameters("gruen50"),))
    assert "b12" in found.sets[0].not_determined
    assert not set(found.sets[0].parameters) & set(found.sets[0].not_determined)
    assert found.sets[0].failure is None
    own = choose_parameters(without, automatic_sets("auto:ebner:strip"))
    # a name is one parameter of each strip
    tested = own.sets[0].steps[0]
    assert (
        tested.verdict.known.dimension
        == 2 * len(tested.parameters)
        == 2 * len(own.sets[0].parameters)
    )


@pytest.mark.parametrize("text", ["auto:photo", "auto:ebnr", "auto:ebner:b1", "auto:strip:ebner"])
def test_a_wrong_choice_is_told(text: str) -> None:
    with pytest.raises(InputError, match="after auto a set and a scope"):
        automatic_sets(text)


def test_a_group_is_tested_with_its_parameters_of_all_strips() -> None:
    """A term that is there makes the set significant; the others' tests keep their size."""
    sizes = []
    for seed in range(6):
        block = aerial(
            3, 4, relief=30.0, noise_um=5.0, seed=seed, tilt=0.03, per_base=2,
            distort=lambda x, y: (0.060 * (x / 95.0) * ((y / 95.0) ** 2 - 2.0 / 3.0), 0.0),
        ).block  # fmt: skip
        one = additional_parameters("ebner:strip", reference_mm=95.0)
        found = choose_parameters(adjust_block(block), (one,), HypothesisSettings(0.05, 0.8))
        for step in found.sets[0].steps:
            if step.stage == "group":
                known = step.verdict.known
                assert known.dimension == 3 * len(step.parameters)
                if "b7" not in step.parameters:
                    sizes.append(known.square / known.dimension)
    # of some ten chi-squares over their dimension the mean is 1, to a tenth or two
    assert len(sizes) > 6
    assert np.mean(sizes) == pytest.approx(1.0, abs=0.5)
