"""A strip on its control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri

from anaplot.errors import NotComputableError
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import bridge_strip
from anaplot.orientation.stripfit import (
    StripFit,
    _Shape,
    _sigmas,
    _starts,
    fit_models,
    fit_strip,
)
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    Precision,
    TestSettings,
    TieVariance,
)
from anaplot.photogrammetry.imagepoint import ImagePoint
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.similarity import (
    Similarity,
    moved_similarity,
    similarity_effects,
)
from anaplot.planning.synthetic import synthetic_strip

SCALE = 12.5  # m per mm
SHIFT = np.array([681_234.5, 5_412_345.25, 1_900.0])
ROTATION = rotation_matrix(0.03, -0.04, 2.1)


@pytest.fixture(scope="module")
def block() -> Block:
    made = synthetic_strip(6, seed=1).block
    return replace(made, test=TestSettings(kind="baarda"), precision=Precision(control_m=0.05))


def model_points(seed: int = 1) -> dict[str, tuple[float, float, float]]:
    rng = np.random.default_rng(seed)
    at = np.column_stack(
        [rng.uniform(-90, 450, 40), rng.uniform(-90, 90, 40), rng.uniform(-160, -145, 40)]
    )
    return {f"p{k}": tuple(row) for k, row in enumerate(at.tolist())}


def ground_of(points: dict[str, tuple[float, float, float]]) -> np.ndarray:
    return SCALE * np.array(list(points.values())) @ ROTATION.T + SHIFT


def controlled(block: Block, ground: np.ndarray, names: list[str], **more: object) -> Block:
    at = dict(zip(model_points(), ground.tolist(), strict=True))
    return replace(
        block, control=tuple(ControlPoint(name, tuple(at[name]), **more) for name in names)
    )


NAMES = [f"p{k}" for k in range(0, 40, 4)]


def fitted(block: Block, **options: object) -> StripFit:
    return fit_strip(block, "1", model_points(), 92.0, **options)


def test_an_errorless_strip_is_found_again(block: Block) -> None:
    points = model_points()
    found = fitted(controlled(block, ground_of(points), NAMES))
    assert found.similarity.scale == pytest.approx(SCALE, rel=1e-10)
    assert found.similarity.rotation == pytest.approx(ROTATION, abs=1e-9)
    assert np.array([row[1:] for row in found.ground]) == pytest.approx(ground_of(points), abs=1e-5)
    assert found.rms == pytest.approx((0.0, 0.0, 0.0), abs=1e-5)
    assert found.tested.redundancy == 30 - 7
    assert sum(found.tested.r) == pytest.approx(23.0)


@pytest.mark.parametrize("degree", [2, 3])
def test_a_bent_and_twisted_strip(block: Block, degree: int) -> None:
    points = model_points()
    straight = fitted(controlled(block, ground_of(points), NAMES))
    ground = ground_of(points)
    # a cubic bend along the strip in height, a conformal quadratic one in plan
    middle = ground.mean(axis=0)
    plan = (ground - middle)[:, :2] @ np.array([1.0, 1j])
    axis = ROTATION[:2, 0] @ np.array([1.0, 1j])
    z = plan / axis / 3000.0
    bent = ground.copy()
    shift = (0.8 - 0.5j) * z**2 * axis
    bent[:, 0] += shift.real
    bent[:, 1] += shift.imag
    bent[:, 2] += 1.5 * z.real**2 + 0.6 * z.real * z.imag + (degree == 3) * 0.9 * z.real**3
    found = fitted(controlled(block, bent, NAMES), degree=degree)
    assert found.tested.redundancy == 30 - 7 - 4 * (degree - 1)
    # the strip's axis is found from its points: not quite the one of the bend
    assert max(found.rms) < 0.05
    assert max(fitted(controlled(block, bent, NAMES)).rms) > 0.2
    unbent = np.array([row[1:] for row in found.ground]) - np.array(
        [row[1:] for row in straight.ground]
    )
    assert unbent == pytest.approx(bent - ground, abs=0.15)


def test_an_error_shows_by_its_redundancy_number(block: Block) -> None:
    ground = ground_of(model_points())
    right = fitted(controlled(block, ground, NAMES))
    wrong = controlled(block, ground, NAMES)
    x, y, z = wrong.control[3].xyz
    wrong = replace(
        wrong,
        control=tuple(
            replace(c, xyz=(x, y, z + 2.0)) if c.point == NAMES[3] else c for c in wrong.control
        ),
    )
    found = fitted(wrong)
    at = list(found.tested.keys).index((NAMES[3], "Z"))
    change = found.tested.residual[at] - right.tested.residual[at]
    assert change == pytest.approx(-2.0 * right.tested.r[at], rel=1e-4)
    named = {point.point for point in found.points if point.flagged}
    assert NAMES[3] in named
    point = next(p for p in found.points if p.point == NAMES[3])
    assert point.w is not None
    assert point.w < -3.29
    assert point.r == pytest.approx(np.mean(right.tested.r[at - 2 : at + 1]), rel=1e-6)
    # put aside, it is compared all the same
    aside = fitted(wrong, without=[NAMES[3]])
    point = next(p for p in aside.points if p.point == NAMES[3])
    assert (point.used, point.r, point.w, point.flagged) == (False, None, None, False)
    assert point.difference == pytest.approx((0.0, 0.0, -2.0), abs=1e-4)


def test_points_in_plan_and_heights_apart(block: Block) -> None:
    points = model_points()
    ground = dict(zip(points, ground_of(points).tolist(), strict=True))
    level = rotation_matrix(0.002, -0.003, 2.1)
    ground = dict(
        zip(
            points,
            (SCALE * np.array(list(points.values())) @ level.T + SHIFT).tolist(),
            strict=True,
        )
    )
    control = [ControlPoint(n, (*ground[n][:2], None)) for n in ("p1", "p2", "p3")]
    control += [ControlPoint(n, (None, None, ground[n][2])) for n in ("p5", "p6", "p7", "p8")]
    found = fitted(replace(block, control=tuple(control)))
    assert found.tested.redundancy == 3
    at = {name: place for name, *place in found.ground}
    assert at["p20"] == pytest.approx(ground["p20"], abs=1e-4)
    assert found.points[0].difference[2] is None


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([], "0 control coordinates are measured, degree 1 needs 7"),
        (["p0", "p1"], "6 control coordinates"),
        (["nowhere"], "0 control coordinates"),
    ],
)
def test_too_little_control(block: Block, names: list[str], words: str) -> None:
    ground = dict(zip(model_points(), ground_of(model_points()).tolist(), strict=True))
    control = tuple(ControlPoint(n, tuple(ground.get(n, (0.0, 0.0, 0.0)))) for n in names)
    with pytest.raises(NotComputableError, match=words):
        fitted(replace(block, control=control))


@pytest.mark.parametrize("count", [4, 5, 10])
def test_interchanged_control_is_named(block: Block, count: int) -> None:
    names = NAMES[:count]
    made = controlled(block, ground_of(model_points()), names)
    first, second, *others = made.control
    control = (replace(first, xyz=second.xyz), replace(second, xyz=first.xyz), *others)
    try:
        said = fitted(replace(made, control=control)).remarks
    except NotComputableError as error:
        # was "not determined: Y0, kappa" of what is not undetermined at all
        said = (str(error),)
    (told,) = said
    assert (
        "control point p0 and control point p4 interchanged? With their coordinates exchanged all "
        f"{count} agree with the strip to "
    ) in told
    assert fitted(made).remarks == ()


def test_control_that_contradicts_the_strip_is_named_where_nothing_fits(block: Block) -> None:
    rng = np.random.default_rng(20)
    ground = ground_of(model_points())
    ground[[0, 4]] += 1500.0 * rng.normal(size=(2, 3))
    made = controlled(block, ground, NAMES[:5])
    with pytest.raises(NotComputableError, match="without p0, p4 the other 3 control points agree"):
        fitted(made)


@pytest.mark.parametrize("seed", range(4))
def test_gross_errors_do_not_keep_a_strip_from_its_control(block: Block, seed: int) -> None:
    # undamped steps ended nowhere
    rng = np.random.default_rng(seed)
    ground = ground_of(model_points())
    for name in rng.choice(NAMES, 3, replace=False).tolist():
        ground[int(name[1:])] += 300.0 * rng.normal(size=3)
    found = fitted(controlled(block, ground, NAMES, sigma=(0.05,) * 3))
    # B' P v = 0, with the residuals as they are told and derivatives of the similarity
    at = {name: np.array(xyz) for name, *xyz in found.ground}
    middle = np.mean(list(at.values()), axis=0)
    parts = []
    for row in found.tested:
        weighted = row.w * np.sqrt(row.r)
        effects = similarity_effects((at[row.key[0]] - middle)[None])[0]["XYZ".index(row.key[1])]
        parts.append(effects * weighted**2 / row.residual)
    gradient = np.sum(parts, axis=0)
    assert np.abs(gradient).max() < 1e-6 * np.abs(parts).sum(axis=0).max()


@pytest.mark.parametrize(("noise", "words"), [(0.0, ""), (0.005, "known to"), (0.03, "known to")])
@pytest.mark.parametrize("degree", [1, 2])
def test_control_on_a_line_determines_no_inclination(
    block: Block, degree: int, noise: float, words: str
) -> None:
    """What noise puts beside the line holds the strip, and means nothing."""
    rng = np.random.default_rng(3)
    line = {
        f"p{k}": (20.0 * k, *np.add(rng.normal(0.0, noise, 2), (0.0, -150.0)).tolist())
        for k in range(12)
    }
    at = np.array([(20.0 * k, 0.0, -150.0) for k in range(12)])
    ground = SCALE * at @ ROTATION.T + SHIFT
    control = tuple(
        ControlPoint(name, tuple(at)) for name, at in zip(line, ground.tolist(), strict=True)
    )
    strip = {**line, "left": (100.0, 90.0, -150.0), "right": (100.0, -90.0, -150.0)}
    with pytest.raises(NotComputableError, match=f"strip 1: .*{words}"):
        fit_strip(replace(block, control=control), "1", strip, 92.0, degree=degree)
    # one point beside the line holds a similarity
    beside = tuple((SCALE * np.array([100.0, 90.0, -150.0]) @ ROTATION.T + SHIFT).tolist())
    held = replace(block, control=(*control, ControlPoint("left", beside)))
    if degree == 1:
        assert fit_strip(held, "1", strip, 92.0).similarity.scale == pytest.approx(SCALE, rel=1e-3)


@pytest.mark.slow
def test_noise_keeps_the_size_of_its_test(block: Block) -> None:
    # 200 strips of 30 rows at alpha .001: 6 expected, more than 16 once in 3000 times
    ground = ground_of(model_points())
    sigma = np.hypot(
        0.05,
        SCALE * block.precision.image_um * 1e-3 * np.array([1.0, 1.0, block.cameras[0].c / 92.0]),
    )
    rng = np.random.default_rng(5)
    flagged = sum(
        int(
            fitted(
                controlled(block, ground + rng.normal(0.0, sigma, ground.shape), NAMES)
            ).tested.flagged.sum()
        )
        for _ in range(200)
    )
    assert flagged <= 16


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_points_move_with_the_similarity_as_they_are_bent(degree: int) -> None:
    rng = np.random.default_rng(degree)
    ground = ground_of(model_points())
    shape = _Shape(Similarity(1.0, np.eye(3), np.zeros(3)), ground, degree)
    free = rng.normal(0.0, 200.0, 4 * (degree - 1))

    def laid(at: np.ndarray) -> np.ndarray:
        return at + shape.bend(at) @ free

    for axis, step in enumerate(np.eye(3)):
        numeric = (laid(ground + step) - laid(ground - step)) / 2.0
        assert shape.slopes(ground, free)[:, :, axis] == pytest.approx(numeric, abs=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_control_near_a_line_lets_a_twist_grow_large_and_it_is_found(
    block: Block, seed: int
) -> None:
    """The similarity moves points that are bent: without that no step led down any more."""
    rng = np.random.default_rng(seed)
    source = np.column_stack(
        ([0.0, 90.0, 180.0, 270.0, 360.0], rng.normal(0.0, 0.5, 5), rng.uniform(-160, -145, 5))
    )
    source[[0, 4], 1] = 60.0  # two in one row, the others on a line: next to nothing holds a twist
    target = SCALE * source @ ROTATION.T + SHIFT + rng.normal(0.0, 3.0, (5, 3))
    names = [f"k{k}" for k in range(5)]
    control = tuple(
        ControlPoint(name, tuple(at)) for name, at in zip(names, target.tolist(), strict=True)
    )
    points = dict(zip(names, map(tuple, source.tolist()), strict=True))
    found = fit_strip(replace(block, control=control), "1", points, 92.0, degree=2)
    assert sum(row.r for row in found.tested) == pytest.approx(found.tested.redundancy)
    # a minimum: no unknown would bring the sum of squares down by anything
    start = _starts("1", source, target)[0]
    shape, sigma = _Shape(start, source, 2), _sigmas(block, "1", control, 92.0, start.scale)
    free = np.array(list(found.polynomials.values()))

    def square(step: np.ndarray) -> float:
        moved = moved_similarity(found.similarity, shape.middle, step)
        off = shape.lay(moved, free + step[7:], source) - target
        return float(((off / sigma) ** 2).sum())

    least = square(np.zeros(11))
    assert least == pytest.approx(found.tested.sigma0**2 * found.tested.redundancy)
    for step in np.diag([1e-3] * 3 + [1e-6] * 4 + [1e-3] * 4):
        ahead, back = square(step), square(-step)
        assert (ahead - back) ** 2 / (8.0 * (ahead + back - 2.0 * least)) < 1e-6 * least


class LongStrip:
    """A strip of eleven models, which bends by its errors, with control at its edges."""

    def __init__(self, tie_variance: TieVariance) -> None:
        self.made = synthetic_strip(12, seed=3)
        self._block = replace(
            self.made.block,
            test=TestSettings(kind="baarda", alpha=0.001),
            precision=Precision(image_um=5.0, control_m=0.05, tie_variance=tie_variance),
        )
        self.true = {
            p.point: np.array(p[1:])
            for model in self._models(self._measured(None))
            for p in model.points
        }
        at = np.array(list(self.true.values()))
        self.control = tuple(
            list(self.true)[int(np.argmin(np.hypot(at[:, 0] - x, at[:, 1] - y)))]
            for x in np.linspace(0.0, at[:, 0].max(), 6)
            for y in (-80.0, 80.0)
        )
        assert len(set(self.control)) == 12

    def _measured(self, rng: np.random.Generator | None) -> Block:
        rows = [
            ImagePoint(photo, point, *np.add(xy, 0.0 if rng is None else rng.normal(0.0, 5e-3, 2)))
            for photo, points in self.made.truth.items()
            for point, xy in points.items()
        ]
        return replace(self._block, image_points=tuple(rows))

    def _models(self, block: Block) -> tuple[ModelSolution, ...]:
        return bridge_strip(block, block.strips[0]).models

    def fitted(
        self, rng: np.random.Generator, degree: int, wrong: tuple[str, float] = ("", 0.0)
    ) -> StripFit:
        """Measure it, and lay it on its control, of which the height of one point may be wrong."""
        control = tuple(
            ControlPoint(
                name,
                tuple(
                    SCALE * self.true[name]
                    + rng.normal(0.0, 0.05, 3)
                    + (0.0, 0.0, wrong[1] * (name == wrong[0]))
                ),
            )
            for name in self.control
        )
        block = replace(self._measured(rng), control=control)
        return fit_models(block, "1", self._models(block), degree=degree)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tie_variance", "degree"), [("paper", 1), ("exact", 1), ("exact", 2), ("propagated", 3)]
)
def test_a_strip_that_its_errors_bend_accuses_no_control(
    tie_variance: TieVariance, degree: int
) -> None:
    """Taken for rigid, four of ten good coordinates were flagged at alpha .01."""
    strip, rng = LongStrip(tie_variance), np.random.default_rng(8)
    found = [strip.fitted(rng, degree) for _ in range(40)]
    total = sum(one.tested.sigma0**2 * one.tested.redundancy for one in found)
    freedom = sum(one.tested.redundancy for one in found)
    # v'Pv is chi-square; either bound is exceeded once in 100 000 times
    assert chdtri(freedom, 1.0 - 1e-5) < total < chdtri(freedom, 1e-5)
    # at most .036 of strips have a flag among 36 rows: more than 8 of 40 once in 100 000 times
    assert sum(bool(one.tested.flagged.any()) for one in found) <= 8
    assert all(one.remarks == () for one in found)


def test_wrong_control_is_found_in_a_strip_that_its_errors_bend() -> None:
    strip, rng = LongStrip("exact"), np.random.default_rng(5)
    for name in strip.control[::4]:
        found = strip.fitted(rng, 1, (name, 3.0))
        worst = max(found.tested, key=lambda row: abs(row.w))
        assert worst.key == (name, "Z")
        # what it is off from what the others let one expect is the error, and r of it the residual
        assert -worst.residual / worst.r == pytest.approx(3.0, abs=4.0 * worst.mdb / 4.13)
        assert worst.r < 1.0


def test_a_point_at_infinity_is_nowhere_on_the_ground() -> None:
    strip = LongStrip("exact")
    block = replace(
        strip._measured(np.random.default_rng(1)),
        control=tuple(
            ControlPoint(name, tuple(SCALE * strip.true[name])) for name in strip.control
        ),
    )
    models = list(strip._models(block))
    known = fit_models(block, "1", models)
    gone = models[3].names[1]
    for k, model in enumerate(models):
        if gone in model.names:
            coordinates = model.coordinates.copy()
            coordinates[:, model.names.index(gone)] = np.inf
            models[k] = replace(model, of_coordinates=lambda there=coordinates: there)
    found = fit_models(block, "1", models)
    assert {row[0] for row in known.ground} - {row[0] for row in found.ground} == {gone}
    assert found.similarity.scale == pytest.approx(known.similarity.scale, rel=1e-4)


def test_as_many_coordinates_as_unknowns_leave_nothing_to_test(block: Block) -> None:
    points = model_points()
    level = SCALE * np.array(list(points.values())) @ rotation_matrix(0.002, -0.003, 2.1).T + SHIFT
    ground = dict(zip(points, level.tolist(), strict=True))
    control = [ControlPoint(n, (*ground[n][:2], None)) for n in ("p1", "p2")]
    control += [ControlPoint(n, (None, None, ground[n][2])) for n in ("p5", "p6", "p7")]
    found = fitted(replace(block, control=tuple(control)))
    assert found.tested.redundancy == 0
    assert {(point.w, point.flagged) for point in found.points} == {(None, False)}


@pytest.mark.parametrize("c", [15.0, 1500.0])
def test_a_strip_is_weighted_by_its_own_camera(block: Block, c: float) -> None:
    names = [f"p{k}" for k in range(0, 40, 3)]
    held = controlled(block, ground_of(model_points()), names, sigma=(0.05,) * 3)
    with_another = replace(held, cameras=(Camera("other", c), *held.cameras))
    ours, theirs = (fit_strip(one, "1", model_points(), 92.0) for one in (held, with_another))
    assert [row.r for row in theirs.tested] == [row.r for row in ours.tested]
