"""tie_variance = "exact" against numerical derivatives of the whole chain of models."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from flightscene import (
    BAARDA,
    EXACT,
    PROPAGATED,
    TAU,
    Flight,
    fly,
    pair_of,
)
from idealmodel import ideal, ideal_pair, spoiled

from anaplot.adjustment.correlatedrows import correlated_units, residual_weight
from anaplot.adjustment.significance import noncentrality
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.grosserrors import model_gross_errors
from anaplot.orientation.idealmodel import ideal_model
from anaplot.orientation.model import orient
from anaplot.orientation.patterns import pattern
from anaplot.orientation.residuals import residual_system, residuals_at
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import bridge_strip, pooled_sigma_um, stereopair
from anaplot.photogrammetry.block import Block, ImagePoint, Photo, Strip
from anaplot.photogrammetry.rotation import rotation_matrix

MODELS = 3
STEP = 0.02  # mm
# central differences of sixth order
STENCIL = ((1, 45.0 / 60.0), (2, -9.0 / 60.0), (3, 1.0 / 60.0))


@dataclass(frozen=True)
class Chain:
    """A strip: what is measured in each model, every photo once or in each of its models."""

    flight: Flight
    points: tuple[tuple[str, ...], ...]
    once: bool

    @staticmethod
    def flown(seed: int, columns: str, *, once: bool) -> "Chain":
        flight = fly(seed, photos=MODELS + 1, tilt=6.0, kappa=25.0)
        points = []
        for k in range(MODELS):
            under = [f"{k}{p}" for p in columns] + [f"{k + 1}{p}" for p in columns]
            points.append((*under, f"{k}ma", f"{k}mc") if "b" not in columns else tuple(under))
        return Chain(flight, tuple(points), once)

    def measured(self) -> list[np.ndarray]:
        """(n, 4) xl, yl, xr, yr of every model."""
        images = self.flight.images
        return [
            np.array([images[k][p] + images[k + 1][p] for p in self.points[k]])
            for k in range(MODELS)
        ]

    def again(self, k: int) -> frozenset[str]:
        """Points of model k whose right ray is the left one of the next model."""
        if not self.once or not 0 <= k < MODELS - 1:
            return frozenset()
        return frozenset(self.points[k]) & frozenset(self.points[k + 1])

    def oriented(self, measured, precision, start=0, before=None) -> list[ModelSolution]:
        models = [] if before is None else [before]
        for k in range(start, MODELS):
            left, right = ({p: (at[j], at[j + 1]) for p, at in zip(
                self.points[k], measured[k].tolist(), strict=True)} for j in (0, 2))  # fmt: skip
            pair = stereopair(
                (str(k), str(k + 1)),
                left,
                right,
                (self.flight.cameras[k], self.flight.cameras[k + 1]),
                preceding=models[-1] if models else None,
                base=70.0,
                once=self.again(k - 1),
            )
            models.append(orient(pair, precision, BAARDA))
        return models


def seen_from_right(model: ModelSolution) -> np.ndarray:
    points = np.array([p[1:] for p in model.points])
    centre = np.add(model.centre, model.base)
    return ((points - centre) @ rotation_matrix(*model.rotation)).ravel()


def seen_from_left(model: ModelSolution, before: ModelSolution) -> np.ndarray:
    points = np.array([p[1:] for p in model.points]) - model.centre
    return (points @ rotation_matrix(*before.rotation)).ravel()


def shown(models: list[ModelSolution]) -> np.ndarray:
    before, model = models[-2:]
    parallaxes = [row.residual * 1e-3 for row in model.table]
    return np.array([
        *seen_from_right(model),
        *seen_from_left(model, before),
        *parallaxes,
        np.linalg.norm(model.base),
    ])  # fmt: skip


def derivatives(chain: Chain):
    """Jacobian of the last model's points, parallaxes and unknowns by every measurement."""
    measured = chain.measured()
    clean = chain.oriented(measured, PROPAGATED)
    columns, keys = [], []
    for k in range(MODELS):
        for i, point in enumerate(chain.points[k]):
            for j in range(4):
                if j < 2 and point in chain.again(k - 1):
                    continue  # moved with the right ray of the model before
                slope = 0.0
                for times, weight in STENCIL:
                    for sign in (1.0, -1.0):
                        moved = [m.copy() for m in measured]
                        moved[k][i, j] += sign * times * STEP
                        if j >= 2 and point in chain.again(k):
                            at = chain.points[k + 1].index(point), j - 2
                            moved[k + 1][at] = moved[k][i, j]
                        models = chain.oriented(moved, PROPAGATED, k, clean[k - 1] if k else None)
                        slope = slope + sign * weight * shown(models) / STEP
                columns.append(slope)
                keys.append((k, point, j))
    return np.array(columns).T, keys


CHAINS = [
    Chain.flown(3, "acd", once=False),
    Chain.flown(3, "acd", once=True),
    Chain.flown(8, "abcde", once=True),
]


@pytest.mark.slow
@pytest.mark.parametrize("chain", CHAINS, ids=["each anew", "once", "once, five ties"])
def test_covariances_are_those_of_the_whole_chain(chain):
    jacobian, keys = derivatives(chain)
    before, model = chain.oriented(chain.measured(), EXACT)[-2:]
    n = len(model.points)
    points, here = jacobian[: 3 * n], jacobian[3 * n : 6 * n]
    parallaxes, length = jacobian[6 * n : -1], jacobian[-1]
    ties = model.exact.ties

    def agree(found, expected):
        assert np.abs(found - expected).max() < 2e-9 * np.abs(expected).max()

    agree(ties.covariance, points @ points.T)
    right = [keys.index((MODELS - 1, p.point, j)) for p in model.points for j in (2, 3)]
    agree(ties.with_right, points[:, right])
    # the left photo is held: what its rotation has gathered in the strip is no error here
    by_point = np.einsum("kai,kbi->kab", *2 * [here.reshape(n, 3, -1)])
    turned = rotation_matrix(*before.rotation)
    agree(model.q_points, turned @ by_point @ turned.T)
    agree(model.q_vv, parallaxes @ parallaxes.T)
    # the unknowns are those of the right photo with the left one held: their axes are not the
    # strip's, but a length is the same in all
    b, size = np.array(model.base), np.linalg.norm(model.base)
    by_unknowns = np.array([size / b[0], b[0] * b[1] / size, b[0] * b[2] / size])
    agree(by_unknowns @ model.q_gg[:3, :3] @ by_unknowns, length @ length)


def test_covariances_of_one_model_are_those_of_its_measurements():
    chain = CHAINS[0]
    measured = chain.measured()[0]

    def first(values) -> ModelSolution:
        left, right = (dict(zip(chain.points[0], values[:, j : j + 2].tolist(), strict=True))
                       for j in (0, 2))  # fmt: skip
        cameras = (chain.flight.cameras[0], chain.flight.cameras[1])
        pair = stereopair(("0", "1"), left, right, cameras, preceding=None, base=70.0)
        return orient(pair, EXACT, BAARDA)

    columns, step = [], 0.002
    for at in np.ndindex(*measured.shape):
        further, nearer = measured.copy(), measured.copy()
        further[at] += step
        nearer[at] -= step
        change = seen_from_right(first(further)) - seen_from_right(first(nearer))
        columns.append(change / (2.0 * step))
    expected = np.array(columns).T @ np.array(columns)
    found = first(measured).exact.ties.covariance
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def noisy_models(columns="acd", *, seed=5, precision=EXACT, test=BAARDA):
    """Three models of a tilted strip with noise, and the pair of the last."""
    flight = fly(seed, photos=4, tilt=4.0, kappa=10.0, noise=0.005)
    models = []
    for k in range(3):
        points = [f"{i}{p}" for i in (k, k + 1) for p in columns]
        pair = pair_of(flight, k, models[-1] if models else None, points=points, base=70.0)
        models.append(orient(pair, precision, test))
    return models, pair


def test_weights_and_solution_are_those_of_propagated():
    exact, _ = noisy_models()
    plain, _ = noisy_models(precision=PROPAGATED)
    for one, other in zip(exact, plain, strict=True):
        assert one.base == other.base
        assert one.rotation == other.rotation
        assert one.points == other.points
        assert [r.key for r in one.table] == [r.key for r in other.table]
        for row, same in zip(one.table, other.table, strict=True):
            # another number of columns is made of the same reflections: rounding differs
            assert (row.r, row.residual) == pytest.approx((same.r, same.residual), rel=1e-12)
        assert sum(row.r for row in one.table) == pytest.approx(one.redundancy, abs=1e-9)
    assert [row.expected for row in exact[2].table] != [row.expected for row in plain[2].table]
    transfers = [diagnose(models[2]).transfers for models in (exact, plain)]
    for transfer, same in zip(*transfers, strict=True):
        assert transfer[:2] == same[:2]
        assert transfer[2:] == pytest.approx(same[2:], rel=1e-12)


@pytest.mark.parametrize("test", [BAARDA, TAU])
def test_what_the_table_says_follows_from_s(test):
    models, _ = noisy_models(test=test)
    for model in models:
        f, s = model.redundancy, model.q_vv
        v = np.array([row.residual for row in model.table]) / model.apriori_um
        r = np.array([row.r for row in model.table])
        singular = np.linalg.svd(s, compute_uv=False)
        assert singular[f - 1] > 1e-6 * singular[0] > 1e3 * singular[f : f + 1].sum()
        square = float(v @ np.linalg.pinv(s, rcond=1e-9) @ v)
        assert model.sigma0_um == pytest.approx(model.apriori_um * (square / f) ** 0.5)
        sigma = model.apriori_um if test.kind == "baarda" else model.sigma0_um
        assert [row.expected for row in model.table] == pytest.approx(sigma * np.sqrt(np.diag(s)))
        assert [row.size for row in model.table] == pytest.approx(
            [abs(row.residual) / row.expected for row in model.table]
        )
        delta = noncentrality(test.alpha, 0.80)
        assert [row.mdb for row in model.table] == pytest.approx(
            delta * model.apriori_um * np.sqrt(np.diag(s)) / r
        )
    total = sum(model.redundancy * model.sigma0_um**2 for model in models)
    count = sum(model.redundancy for model in models)
    assert pooled_sigma_um(tuple(models)) == pytest.approx((total / count) ** 0.5)


def test_a_first_model_of_vertical_photos_is_as_without_ties():
    """There F_p is y'' - y', the x coordinates do not enter: S is Q_vv."""
    pair = ideal_pair("13")
    exact, plain = orient(pair, EXACT, BAARDA), orient(pair, PROPAGATED, BAARDA)
    assert exact.q_vv == pytest.approx(plain.q_vv, abs=1e-12)
    assert exact.q_gg == pytest.approx(plain.q_gg, rel=1e-9, abs=1e-12)
    assert [row.effect for row in exact.table] == pytest.approx([row.effect for row in plain.table])


ONWARD = str.maketrans("123", "456")  # a tie's label in the model before


def level_strip(name, count, aside=0.0):
    """The last model, and its pair, of a strip of vertical photos, ties under the right one.

    `aside`: how far all points lie to one side of the flight line [mm].
    """
    places, ties = pattern(name).positions(90.0, 100.0), pattern(name).ties
    places = {label: (x, y + aside) for label, (x, y) in places.items()}
    camera = fly(1).cameras[0]
    model = pair = None
    for k in range(count):
        names = {label: f"{k}-{label}" for label in places}
        if k:
            names.update({tie: f"{k - 1}-{tie.translate(ONWARD)}" for tie in ties})
        left = {names[label]: xy for label, xy in places.items()}
        right = {point: (x - 90.0, y) for point, (x, y) in left.items()}
        pair = stereopair((str(k), str(k + 1)), left, right, (camera, camera),
                          preceding=model, base=90.0)  # fmt: skip
        model = orient(pair, EXACT, BAARDA)
    return model, pair


def test_an_undetected_error_moves_no_function_of_the_unknowns_further_than_its_effect():
    # vertical photos: an error of the image is one of its row alone
    _, pair = level_strip("9/3", 3)
    model = orient(pair, EXACT, BAARDA)
    step = 1e-4

    def unknowns(point, axis, size):
        found = orient(spoiled(pair, point, axis, size), EXACT, BAARDA)
        bx, by, bz = found.base
        return np.array([bx, by / bx, bz / bx, *found.rotation[::-1]])

    root = np.linalg.cholesky(model.q_gg)
    function = np.random.default_rng(3).standard_normal(6)
    for row in model.table:
        change = unknowns(row.point, row.axis, step) - unknowns(row.point, row.axis, -step)
        moved = np.linalg.solve(root, change / (2.0 * step)) * row.mdb / model.apriori_um
        assert row.effect == pytest.approx(np.linalg.norm(moved), rel=1e-3)
        assert abs(function @ moved) <= row.effect * np.linalg.norm(function) * 1.001


def test_correlated_ties_make_x_rows_vary_more_than_their_weights_say():
    """The reason for the choice: with three ties by more than a quarter of the variance."""
    for name, most in (("6/3", 1.29), ("9/3", 1.27), ("13/5", 1.12)):
        exact = ideal(pattern(name), 90.0, 100.0, 152.0, "exact")
        plain = ideal(pattern(name), 90.0, 100.0, 152.0, "propagated")
        ratio = np.diag(exact.q_vv) / np.diag(plain.q_vv)
        assert ratio.min() == pytest.approx(1.0, abs=0.01)
        assert ratio.max() == pytest.approx(most, abs=0.01)


@pytest.mark.parametrize("name", ["6/3", "8/4", "9/3", "10/5", "10d/5", "13/3", "15/5"])
def test_the_stationary_state_is_that_of_a_long_strip(name):
    model, pair = level_strip(name, 12)
    found = ideal(pattern(name), 90.0, 100.0, pair.c_left, "exact")
    assert found.q_vv == pytest.approx(model.q_vv, abs=1e-8)


def test_the_stationary_state_of_a_strip_beside_the_flight_line_is_that_of_a_long_one():
    model, pair = level_strip("9/3", 12, aside=17.0)
    places = dict(zip(pattern("9/3").labels, map(tuple, pair.xl.tolist()), strict=True))
    found = ideal_model(places, pattern("9/3").ties, 90.0, pair.c_left, "exact")
    assert found.q_vv == pytest.approx(model.q_vv, abs=1e-8)


def test_ties_without_their_covariance_are_refused():
    with pytest.raises(ValueError, match="without their covariance"):
        orient(ideal_pair("6/3"), EXACT, BAARDA)


def test_by_the_weight_of_the_misclosures_an_error_shows_largest_in_its_own_row():
    elsewhere = 0
    for seed in range(8):
        models, _ = noisy_models(seed=seed)
        model = models[-1]
        system = residual_system(model)
        w = np.abs(system.matrix) / np.sqrt(system.r)[:, None]
        assert (w.max(axis=0) <= np.diag(w) * (1.0 + 1e-9)).all()
        table = np.abs(model.tested.influence) / np.sqrt(np.diag(model.q_vv))[:, None]
        elsewhere += int((table.argmax(axis=0) != np.arange(len(table))).sum())
    assert elsewhere >= 8  # in the table it does not: about one in five


@pytest.mark.parametrize("size", [0.15, 1.0])
@pytest.mark.parametrize("seeds", [(4,), pytest.param(range(6), marks=pytest.mark.slow)])
def test_the_advice_names_the_erroneous_row_where_the_largest_sigf_stands_elsewhere(size, seeds):
    elsewhere = 0
    for seed in seeds:
        flight = fly(seed, photos=4, tilt=2.0, kappa=0.0)
        before = None
        for k in range(3):
            points = [f"{i}{p}" for i in (k, k + 1) for p in "acd"]
            pair = pair_of(flight, k, before, points=points, base=70.0)
            before = orient(pair, EXACT, BAARDA)
        for row in before.table:
            wrong = orient(spoiled(pair, row.point, row.axis, size), EXACT, BAARDA)
            suspects = diagnose(wrong).suspects
            if not suspects:
                continue  # nothing is flagged
            largest = max(wrong.table, key=lambda one: one.size or 0.0)
            elsewhere += largest.key != row.key
            assert suspects[0] == row.key
            first, words = diagnose(wrong).advice[0].split(": ")
            assert first == f"remeasure {row.point} ({row.axis})"
            # the odds do not contradict it
            assert not words.startswith("1 to ")
    assert elsewhere >= len(seeds)


@pytest.mark.parametrize("again", [False, True])
def test_a_row_that_serves_two_models_counts_as_one_measurement(again):
    """The same numbers, pointed once or twice: only the file's rows tell, and EXPD differs."""
    chain = Chain.flown(8, "abcde", once=not again)
    rows = []
    seen = set()
    for k in range(MODELS):
        for photo, point in product((k, k + 1), chain.points[k]):
            x, y = chain.flight.images[photo][point]
            if again:
                rows.append(ImagePoint(str(photo), point, x, y, model=f"{k}/{k + 1}"))
            elif (photo, point) not in seen:
                rows.append(ImagePoint(str(photo), point, x, y))
            seen.add((photo, point))
    names = tuple(str(k) for k in range(MODELS + 1))
    block = Block(
        name="strip",
        precision=EXACT,
        test=BAARDA,
        cameras=tuple(chain.flight.cameras),
        photos=tuple(Photo(name, name) for name in names),
        strips=(Strip("1", names, 70.0),),
        image_points=tuple(rows),
    )
    models = bridge_strip(block, block.strips[0]).models
    expected = chain.oriented(chain.measured(), EXACT)
    for model, other in zip(models, expected, strict=True):
        by_name = {row.key: row.expected for row in other.table}
        assert {row.key: row.expected for row in model.table} == pytest.approx(by_name, rel=1e-9)


@pytest.mark.parametrize("columns", ["abcde", "ace"])
def test_weight_units_and_sigma0_are_those_of_the_covariance(columns):
    model = noisy_models(columns)[0][-1]
    exact = model.exact
    sigma, design = exact.misclosures, exact.adjusted.basis * exact.adjusted.root[:, None]
    scale = np.abs(exact.weight).max()
    assert exact.weight == pytest.approx(residual_weight(sigma, design), abs=1e-10 * scale)
    assert exact.units == pytest.approx(correlated_units(sigma), rel=1e-11)
    v = exact.adjusted.closing
    assert exact.vtpv == pytest.approx(v @ np.linalg.pinv(exact.left, rcond=1e-10) @ v, rel=1e-8)


def test_rows_from_outside_are_those_of_the_solution():
    models, pair = noisy_models("abcde")
    solution = models[-1]
    own, seen = residual_system(solution), residuals_at(pair, EXACT, solution)
    assert seen.names == own.names
    assert seen.redundancy == own.redundancy
    assert seen.vtpv == pytest.approx(own.vtpv, rel=1e-6)
    assert seen.e == pytest.approx(own.e, abs=1e-6)
    assert seen.matrix == pytest.approx(own.matrix, abs=1e-8)
    assert own.vtpv == pytest.approx(solution.redundancy * (solution.sigma0_um / 5.0) ** 2)
    assert ((own.r > 0.0) & (own.r < 1.0)).all()


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["baarda", "search", "danish", "odds"])
def test_strategies_reject_the_erroneous_row_of_correlated_ones(strategy):
    rejected = 0
    for seed in range(3):
        flight = fly(seed, photos=4, tilt=2.0, kappa=0.0)
        before = None
        for k in range(3):
            points = [f"{i}{p}" for i in (k, k + 1) for p in ("a", "c", "d")] + [f"{k}ma", f"{k}mc"]
            pair = pair_of(flight, k, before, points=points, base=70.0)
            before = orient(pair, EXACT, BAARDA)
        for row in before.table[::3]:
            cleaned = model_gross_errors(
                spoiled(pair, row.point, row.axis, 0.3), EXACT, BAARDA, strategy
            )
            assert [one.name for one in cleaned.rejected] == [row.key]
            rejected += 1
    assert rejected > 10
