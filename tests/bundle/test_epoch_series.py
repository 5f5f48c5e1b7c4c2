"""More than two epochs: a dense adjustment, pairs, what moved when, size and power, the command."""

from __future__ import annotations

import csv
import json
from collections import Counter
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from bundleblocks import make_scene
from epochblocks import compare_epochs, epoch, heights_only, layout, rescaled, stable_names, written
from scipy.optimize import least_squares
from wild import text_of, wild, words

import anaplot
from anaplot.adjustment.hypothesis import f_power
from anaplot.bundle.epochs.common import stable_points
from anaplot.bundle.epochs.displacements import compare_series
from anaplot.bundle.epochs.displacementtests import epoch_tests, pair_tests
from anaplot.bundle.epochs.moves import chosen_points
from anaplot.bundle.epochs.seriestests import series_tests
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.cli import main
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import PointPrior, TestSettings
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.givenmovement import GivenMovement
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.report.comparecommand import compare
from anaplot.report.epochdocument import series_document

pytestmark = pytest.mark.slow

BAARDA = TestSettings(kind="baarda")
MOVED = {"p13": (0.0, 0.25, 0.4)}


def exact(block):
    """Hold control free of error."""
    return replace(block, control=tuple(replace(c, sigma=(0.0,) * 3) for c in block.control))


def without(block, *points):
    """Take points out of an epoch."""
    return replace(
        block, image_points=tuple(r for r in block.image_points if r.point not in points)
    )


@lru_cache(maxsize=1)
def four():
    """Four epochs; one point moves between the second and the third, and stays there."""
    made = (epoch(11), epoch(12), epoch(13, moved=MOVED), epoch(14, moved=MOVED))
    return tuple(exact(block) for block in made)


# --- against an adjustment of its own -------------------------------------------------------


def own_adjustment(blocks):
    """Adjust epochs by a general minimiser; coordinates that control gives are one unknown each.

    Returns the number of the unknown of (point, axis, epoch), the unknowns, their dense inverse and
    v'Pv.
    """
    base = layout()
    number, start, given = {}, [], {}
    photos = {}
    for k, block in enumerate(blocks):
        for photo in block.photos:
            photos[photo.id, k] = len(start)
            start += [*base.centres[photo.id], 0.0, 0.0, 0.0]
    for k, block in enumerate(blocks):
        control = {c.point: c for c in block.control}
        for row in block.image_points:
            for axis in range(3):
                row_of = control.get(row.point)
                shared = row_of is not None and row_of.xyz[axis] is not None
                key = (row.point, axis, "control" if shared else k)
                if key not in number:
                    number[key] = len(start)
                    start.append(base.points[row.point][axis])
                    if shared:
                        given[number[key]] = (row_of.xyz[axis], row_of.sigma[axis])
                number[row.point, axis, k] = number[key]
    rays = [(k, row) for k, block in enumerate(blocks) for row in block.image_points]
    turned = np.array([base.rotations[row.photo] for _, row in rays])
    of_photo = np.array([photos[row.photo, k] for k, row in rays])
    of_point = np.array([[number[row.point, a, k] for a in range(3)] for k, row in rays])
    measured = np.array([(row.x, row.y) for _, row in rays])
    known = np.array(list(given))
    values, sigmas = np.array(list(given.values())).T

    def residuals(x):
        poses = x[of_photo[:, None] + np.arange(6)]
        which, back = np.unique(of_photo, return_inverse=True)
        small = np.array([rotation_matrix(*x[at + 3 : at + 6]) for at in which])[back]
        seen = project(poses[:, :3], turned @ small, np.full(len(rays), 150.0), x[of_point])
        return np.concatenate(
            [((seen.xy - measured) / 0.005).ravel(), (x[known] - values) / sigmas]
        )

    found = least_squares(residuals, np.array(start), x_scale="jac", xtol=1e-12, ftol=1e-14)
    return number, found.x, np.linalg.inv(found.jac.T @ found.jac), 2.0 * found.cost


def test_three_epochs_are_those_of_a_dense_adjustment() -> None:
    blocks = [heights_only(epoch(seed), "p13") for seed in (1, 2, 3)]
    # a control point that one epoch gives up, points that are not everywhere
    blocks[1] = replace(blocks[1], control=blocks[1].control[1:])
    blocks = [without(blocks[0], "p7"), without(blocks[1], "p7", "p9"), blocks[2]]
    series = compare_series(blocks)
    number, x, q, vtpv = own_adjustment(blocks)
    assert series.alone_in == ((), (), ("p7",))
    assert series.vtpv == pytest.approx(vtpv, rel=1e-5)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        pair = series.between(first, second)
        b = np.zeros((3 * len(pair.points), len(x)))
        for k, name in enumerate(pair.points):
            for axis in range(3):
                b[3 * k + axis, number[name, axis, second]] += 1.0
                b[3 * k + axis, number[name, axis, first]] -= 1.0
        np.testing.assert_allclose(pair.d, b @ x, atol=1e-5)  # its derivatives are numerical
        np.testing.assert_allclose(pair.cofactors, b @ q @ b.T, rtol=2e-3, atol=1e-7)
        assert ("p9" in pair.points) == (1 not in (first, second))
        assert pair.given[pair.points.index("p13")].tolist() == [False, False, True]
    # the given-up point is one in epochs 1 and 3 and its own in 2
    name = blocks[0].control[0].point
    assert name in series.between(0, 1).points
    assert name not in series.between(0, 2).points
    tested = series_tests(series)
    [point] = [p for p in tested.points if p.point == name]
    assert point.verdict.known.dimension == 3
    assert point.epochs == (1, 2, 3)
    [height] = [p for p in tested.points if p.point == "p13"]
    assert height.verdict.known.dimension == 4
    assert tested.everything.known.dimension == sum(
        p.verdict.known.dimension for p in tested.points
    )
    by_hand = np.array([m.point == "p8" for m in series.moves]).repeat(3)
    r = series.d[by_hand] @ np.linalg.solve(
        series.cofactors[np.ix_(by_hand, by_hand)], series.d[by_hand]
    )
    [p8] = [p for p in tested.points if p.point == "p8"]
    assert p8.verdict.known.square == pytest.approx(r)
    # whatever differences a composite hypothesis is written in
    pairs = series.between(0, 1), series.between(0, 2)
    ways = [pair.d[3 * pair.points.index("p8") :][:3] for pair in pairs]
    number8 = [number["p8", axis, k] for k in range(3) for axis in range(3)]
    to_first = np.kron([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]], np.eye(3))
    q8 = to_first @ q[np.ix_(number8, number8)] @ to_first.T
    d8 = np.concatenate(ways)
    assert d8 @ np.linalg.solve(q8, d8) == pytest.approx(r, rel=1e-4)


@pytest.mark.parametrize(
    ("options", "near"),
    [
        ({}, 1e-9),
        ({"separate": True}, 1e-9),
        # another unit of length, that of the first epoch's free network
        ({"stable": stable_names()}, 1e-3),
        ({"separate": True, "stable": stable_names()}, 1e-3),
    ],
)
def test_pairs_are_those_of_two_epochs(options, near) -> None:
    blocks = four()[:3]
    series = compare_series(blocks, **options)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        two = compare_epochs(blocks[first], blocks[second], **options)
        pair = series.between(first, second)
        assert pair.points == two.points
        assert pair.common == two.common
        np.testing.assert_allclose(pair.d, two.d, rtol=near, atol=near * 0.02)
        scale = np.abs(two.cofactors).max()
        np.testing.assert_allclose(pair.cofactors, two.cofactors, rtol=near, atol=near * scale)
        np.testing.assert_allclose(pair.places, two.places, atol=0.5)
        assert pair.alone == (series.alone[first], series.alone[second])
    if "stable" in options:
        assert series.agreement.dimension == 2 * (3 * len(stable_names()) - 7)


@pytest.mark.parametrize(
    "options", [{}, {"separate": True}, {"stable": stable_names()}, {"additional": "ebner"}]
)
def test_photos_may_be_numbered_and_named_otherwise(options) -> None:
    if "additional" in options:
        options = {"additional": additional_parameters(options["additional"])}
    one, two, three, _ = four()
    numbers = [photo.id for photo in three.photos]
    to = dict(zip(numbers, numbers[::-1], strict=True))
    camera = three.cameras[0]
    other = replace(
        three,
        photos=tuple(replace(p, id=to[p.id]) for p in three.photos[::-1]),
        strips=tuple(replace(s, photos=tuple(to[p] for p in s.photos)) for s in three.strips),
        image_points=tuple(replace(r, photo=to[r.photo]) for r in three.image_points),
    )
    if "additional" not in options:
        other = replace(
            other,
            cameras=(replace(camera, id="another"),),
            photos=tuple(replace(p, camera="another") for p in other.photos),
        )
    plain, named = (compare_series((one, two, last), **options) for last in (three, other))
    assert plain.moves == named.moves
    np.testing.assert_allclose(named.d, plain.d, atol=1e-6)
    np.testing.assert_allclose(named.cofactors, plain.cofactors, rtol=1e-4, atol=1e-8)
    assert named.redundancy == plain.redundancy


@pytest.mark.parametrize("options", [{}, {"separate": True}, {"stable": stable_names()}])
def test_photos_may_be_laid_out_otherwise(options) -> None:
    one, two, _, _ = four()
    base = layout()
    places = {n: p + np.array(MOVED.get(n, (0.0, 0.0, 0.0))) for n, p in base.points.items()}
    # across the others, more of them, turned
    across = {
        f"r{i}{j}": (np.array([400.0 * i, 350.0 * j - 50.0, 1010.0]),
                     rotation_matrix(0.01 * i, -0.01 * j, np.pi / 2))
        for i in range(4)
        for j in range(3)
    }  # fmt: skip
    made = make_scene(across, places, control=one.control, noise_um=5.0, seed=5).block
    tested = series_tests(compare_series((one, two, made), points=("p7", "p8", "p13"), **options))
    assert {p.point: p.moved for p in tested.points} == {"p7": (), "p8": (), "p13": ((2, 3),)}
    assert [each.epoch for each in tested.against if each.explains] == [3]
    [p13] = [p for p in tested.points if p.point == "p13"]
    for d, s, true in zip(p13.steps[1].d, p13.steps[1].s, MOVED["p13"], strict=True):
        assert abs(d - true) < 4.0 * s


def test_separate_movements_share_the_epoch_between_them() -> None:
    series = compare_series(four()[:3], separate=True, points=("p8",))
    d12, d23, d13 = (series.between(*pair).cofactors for pair in ((0, 1), (1, 2), (0, 2)))
    middle = -series.cofactors[:3, 3:]
    np.testing.assert_allclose(middle, middle.T, atol=1e-12)
    assert np.linalg.eigvalsh(middle).min() > 0.0
    np.testing.assert_allclose(d12 + d23 - 2.0 * middle, d13, rtol=1e-9)


# --- what moved, and when -------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [{}, {"separate": True}, {"stable": stable_names()}, {"additional": "ebner"}],
)
def test_a_movement_is_found_at_its_time(options) -> None:
    if "additional" in options:
        options = {"additional": additional_parameters(options["additional"])}
    tested = series_tests(compare_series(four(), **options))
    assert tested.any_moved
    assert tested.located[0].point == "p13"
    by = {p.point: p for p in tested.points}
    assert by["p13"].verdict.rejected
    assert by["p13"].orthogonal.rejected
    assert by["p13"].moved == ((2, 3),)
    assert [name for name, p in by.items() if p.moved] == ["p13"]
    wrong = {
        pair.differences.numbers
        for pair in tested.pairs
        if pair.everything.rejected and pair.located[0].point == "p13"
    }
    assert wrong == {(1, 3), (1, 4), (2, 3), (2, 4)}
    assert {pair.differences.numbers for pair in tested.pairs} - wrong == {(1, 2), (3, 4)}
    step = by["p13"].steps[1]
    assert (step.first, step.second) == (2, 3)
    assert step.length == pytest.approx(np.hypot(0.25, 0.4), abs=5 * step.s_length)


def test_a_point_that_comes_back_and_one_that_was_away() -> None:
    one, two, three, _ = four()
    back = series_tests(compare_series((one, three, two), points=("p8", "p13")))
    assert {p.point: p.moved for p in back.points} == {"p8": (), "p13": ((1, 2), (2, 3))}
    gap = series_tests(compare_series((one, without(two, "p13"), three), points=("p8", "p13")))
    by = {p.point: p for p in gap.points}
    assert by["p13"].epochs == (1, 3)
    assert by["p13"].moved == ((1, 3),)
    compared = [set(pair.differences.points) for pair in gap.pairs]
    assert compared == [{"p8"}, {"p8", "p13"}, {"p8"}]


def test_stable_points_that_move_in_a_later_epoch_are_named() -> None:
    last = epoch(13, moved={"p16": (0.0, 0.5, 0.0)})
    for separate in (False, True):
        series = compare_series(
            (epoch(11), epoch(12), last), stable=stable_names(), points=("p8",), separate=separate
        )
        tested = series_tests(series)
        assert tested.agreement.rejected
        assert tested.located_stable[0].point == "p16"
        assert any("(p16" in remark and "refuted" in remark for remark in tested.remarks)


@pytest.mark.parametrize("k", [0.05, 100.0])
def test_what_has_moved_is_the_same_in_every_unit_of_an_estimated_sigma0(k) -> None:
    blocks = [rescaled(exact(epoch(11 + n, moved=MOVED if n == 2 else None)), k) for n in range(3)]
    series = compare_series(blocks, points=("p8", "p13", "p18", "p23"))
    assert not series.by_known
    assert np.sqrt(series.vtpv / series.redundancy) == pytest.approx(1.0 / k, rel=0.2)
    assert [(p.point, p.moved) for p in series_tests(series).points if p.moved] == [
        ("p13", ((2, 3),))
    ]


# --- size and power -------------------------------------------------------------------------


def drawn(series, runs, seed, *, movement=None):
    """Yield the series with displacements of fresh noise, and `movement` (3 m,) on top."""
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(series.cofactors)
    shift = 0.0 if movement is None else movement
    for _ in range(runs):
        yield replace(
            series,
            d=root @ rng.normal(size=len(root)) + shift,
            vtpv=float(rng.chisquare(series.redundancy)),
        )


@pytest.mark.parametrize("by_known", [True, False])
def test_without_movement_the_level_is_kept(by_known) -> None:
    runs, alpha = 200, 0.1
    series = replace(compare_series(four()[:3], points=("p7", "p8", "p9")), by_known=by_known)
    found = Counter()
    for fresh in drawn(series, runs, 1978):
        tested = series_tests(fresh, alpha=alpha)
        pairs = [pair.everything.rejected for pair in tested.pairs]
        found["all"] += tested.everything.rejected
        found["overall"] += tested.any_moved
        found["points"] += any(p.verdict.rejected for p in tested.points)
        found["pairs"] += any(pairs)
        found["against"] += any(one.verdict.rejected for one in tested.against)
        found["components"] += any(p.orthogonal.rejected for p in tested.points)
        assert all(bool(p.moved) == bool(p.verdict.rejected) for p in tested.points)
    # binomial, within 3.3 deviations: exact for one test, and for components that are independent
    room = 3.3 * np.sqrt(runs * alpha * (1.0 - alpha))
    assert abs(found["all"] - alpha * runs) < room
    if by_known:
        assert abs(found["components"] - alpha * runs) < room
    # Bonferroni: at most
    for family in ("overall", "points", "pairs", "components", "against"):
        assert found[family] < alpha * runs + room


def test_power_is_that_of_the_noncentral_distribution() -> None:
    runs, alpha = 200, 0.05
    series = compare_series(four()[:3], points=("p7", "p8", "p9"))
    movement = np.zeros(len(series.d))
    row = next(k for k, m in enumerate(series.moves) if m.point == "p8" and m.first == 1)
    movement[3 * row : 3 * row + 3] = (0.05, -0.05, 0.13)
    mine = np.array([m.point == "p8" for m in series.moves]).repeat(3)
    noncentrality = movement[mine] @ np.linalg.solve(
        series.cofactors[np.ix_(mine, mine)], movement[mine]
    )
    power = f_power(float(noncentrality), alpha / 3, 6, series.redundancy)
    assert 0.3 < power < 0.9  # or nothing would be shown
    rejected, right = 0, 0
    for fresh in drawn(series, runs, 55, movement=movement):
        [p8] = [p for p in series_tests(fresh, alpha=alpha).points if p.point == "p8"]
        rejected += bool(p8.verdict.rejected)
        right += (2, 3) in p8.moved
    assert abs(rejected - power * runs) < 3.3 * np.sqrt(runs * power * (1.0 - power))
    # where a movement is seen, it is seen when it was
    assert right > 0.9 * rejected


def test_an_epoch_against_the_others_is_the_freed_adjustment() -> None:
    """Its R is what R falls by when the differences of the others alone are tested."""
    blocks = [heights_only(epoch(seed), "p13") for seed in (1, 2, 3, 4)]
    blocks[1] = replace(blocks[1], control=tuple(c for c in blocks[1].control if c.point != "p1"))
    blocks = [without(blocks[0], "p7"), without(blocks[1], "p9"), *blocks[2:]]
    series = compare_series(blocks, points=("p1", "p7", "p8", "p9", "p13"))
    tested = series_tests(series)
    # p1 is control in the others, the height of p13 in all
    assert [(one.epoch, one.points) for one in tested.against] == [(1, 3), (2, 4), (3, 4), (4, 4)]
    assert [one.verdict.known.dimension for one in tested.against] == [8, 11, 11, 11]
    total = tested.everything.known.square
    for one in tested.against:
        # the rest by itself, from the pairs of epochs that are neighbours without this one
        left = [k for k in range(4) if k != one.epoch - 1]
        rows, seen = [], {}
        for row, move in enumerate(series.moves):
            seen.setdefault(move.point, np.zeros((4, len(series.moves))))
            seen[move.point][move.second] = seen[move.point][move.first]
            seen[move.point][move.second, row] = 1.0
        for point, places in seen.items():
            there = [k for k in left if point in series.names[k]]
            for j, k in pairwise(there):
                # control gives p1 in all but the second: it is one there, and comes back
                one_place = point == "p1" and (1 not in (j, k) or (j == 1 and 0 in left))
                for axis in range(3):
                    if not one_place and (point, axis) != ("p13", 2):
                        rows.append(np.kron(places[k] - places[j], np.eye(3)[axis]))
        b = np.array(rows)
        d = b @ series.d
        rest = d @ np.linalg.solve(b @ series.cofactors @ b.T, d)
        assert one.rest == pytest.approx(rest, rel=1e-6)
        assert one.verdict.known.square == pytest.approx(total - rest, rel=1e-6)
        assert len(rows) == tested.everything.known.dimension - one.verdict.known.dimension


def test_the_odd_epoch_is_found() -> None:
    one, two, three, four_th = four()
    for made, odd in (((one, three, two), 2), ((three, one, two), 1), ((one, two, three), 3)):
        tested = series_tests(compare_series(made, points=("p7", "p8", "p13")))
        assert [each.epoch for each in tested.against if each.explains] == [odd]
        best = max(tested.against, key=lambda each: each.verdict.decisive.statistic)
        assert best.epoch == odd
        assert best.verdict.rejected
    # a movement that is found by a hair: the others have fewer conditions, and their own limit
    series = compare_series((one, two, three), points=("p7", "p8", "p13"))
    whole = series_tests(series).everything.decisive
    hair = np.sqrt(1.05 * whole.critical / whole.statistic)
    tested = series_tests(replace(series, d=hair * series.d))
    assert tested.everything.rejected
    limit = tested.everything.decisive.critical * tested.everything.decisive.dimension
    assert any(each.rest < limit and not each.explains for each in tested.against)
    assert [each.epoch for each in tested.against if each.explains] == [3]
    # two against two: none of them is
    halves = series_tests(compare_series((one, two, three, four_th), points=("p7", "p8", "p13")))
    assert halves.everything.rejected
    assert not any(each.explains for each in halves.against)
    still = series_tests(compare_series((one, two), points=("p7", "p8")))
    assert not any(each.explains for each in still.against)


# --- a given movement -----------------------------------------------------------------------


def given(point, d, first=None, second=None):
    return GivenMovement(point, first, second, d, "moves.csv line 2")


def test_a_given_movement_is_the_hypothesis() -> None:
    blocks = four()[:3]
    rows = (given("p13", MOVED["p13"], 2, 3),)
    plain, against = compare_series(blocks), compare_series(blocks, given=rows)
    np.testing.assert_array_equal(plain.d, against.d)
    w = np.zeros(len(plain.d))
    at = next(k for k, m in enumerate(plain.moves) if m.point == "p13" and m.first == 1)
    w[3 * at : 3 * at + 3] = MOVED["p13"]
    tested = series_tests(against)
    # eq. 58
    r = (plain.d - w) @ np.linalg.solve(plain.cofactors, plain.d - w)
    assert tested.everything.known.square == pytest.approx(r)
    assert not next(p for p in tested.points if p.point == "p13").verdict.rejected
    assert series_tests(plain).everything.rejected
    # between the epochs around it the movement is the same one
    for pair in tested.pairs:
        moved = pair.differences.expected.reshape(-1, 3)[pair.differences.points.index("p13")]
        assert tuple(moved) == (MOVED["p13"] if pair.differences.numbers[1] == 3 else (0, 0, 0))
    # two epochs alone need not say which
    two = epoch_tests(compare_epochs(*blocks[1:], given=(given("p13", MOVED["p13"]),)))
    assert not two.any_moved
    [p13] = [p for p in two.points if p.point == "p13"]
    assert [c.expected for c in p13.coordinates] == list(MOVED["p13"])
    assert not p13.scheffe
    # what is given and has not been is found as well
    wrong = epoch_tests(compare_epochs(*blocks[:2], given=(given("p13", MOVED["p13"]),)))
    assert wrong.any_moved
    assert wrong.located[0].point == "p13"


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (given("p13", (0.0, 0.0, 1.0)), "from and to are needed: there are 3 epochs"),
        (
            given("p13", (0.0, 0.0, 1.0), 1, 3),
            "no movement from 1 to 3: .* as 1 to 2, 2 to 3: give each of these$",
        ),
        (given("p1", (0.0, 0.0, 1.0), 1, 2), "point p1 is not compared: it holds the datum$"),
        (given("p8", (0.0, 0.0, 1.0), 1, 2), "control gives Z of point p8 in both epochs"),
    ],
)
def test_a_given_movement_that_cannot_be(row, said) -> None:
    blocks = [heights_only(block, "p8") for block in four()[:3]]
    with pytest.raises(InputError, match=f"^moves.csv line 2: .*{said}"):
        compare_series(blocks, given=(row,))


AWAY = (0.0, 0.3, 0.6)


@lru_cache(maxsize=1)
def given_up():
    """Three epochs; control gives p1 in the first and the last, from where it is away between."""
    middle = epoch(12, moved={"p1": AWAY})
    middle = replace(middle, control=tuple(c for c in middle.control if c.point != "p1"))
    return exact(epoch(11)), exact(middle), exact(epoch(13))


@pytest.mark.parametrize("separate", [False, True])
def test_what_control_gives_again_has_come_back_as_given(separate) -> None:
    points = ("p1", "p7", "p8")
    back = tuple(-w for w in AWAY)
    for rows in (
        (given("p1", AWAY, 1, 2),),
        (given("p1", AWAY, 1, 2), given("p1", back, 2, 3)),
        (given("p1", back, 2, 3), given("p1", AWAY, 1, 2)),
    ):
        found = compare_series(given_up(), points=points, given=rows, separate=separate)
        np.testing.assert_array_equal(found.expected.reshape(-1, 3)[:2], [AWAY, back])
        tested = series_tests(found)
        assert not tested.any_moved
        for pair in tested.pairs:
            assert not pair.everything.rejected
            assert not any(p.verdict.rejected for p in pair.points)
        [p1] = [p for p in tested.points if p.point == "p1"]
        assert [step.expected for step in p1.steps] == [AWAY, back]
    # and from there on it stays
    last = replace(epoch(14), name="last", control=given_up()[2].control)
    four_epochs = (*given_up(), last)
    rows = (given("p1", AWAY, 1, 2),)
    found = compare_series(four_epochs, points=points, given=rows, separate=separate)
    assert found.expected.reshape(-1, 3)[:3].tolist() == [list(AWAY), list(back), [0.0] * 3]
    # what is against it cannot be
    for rows, said in (
        ((given("p1", AWAY, 1, 2), given("p1", AWAY, 2, 3)), "epochs 1 and 3: .* by -0.3 m"),
        ((given("p1", back, 2, 3),), "epochs 1 and 3: .* from 2 to 3 it moves by 0 m"),
        ((given("p1", AWAY, 3, 4),), "both epochs: it cannot move"),
    ):
        with pytest.raises(InputError, match=f"^moves.csv line 2: control gives Y .*{said}"):
            compare_series(four_epochs, points=points, given=rows, separate=separate)


def test_sums_of_given_movements_may_be_rounded() -> None:
    one, two, three = given_up()
    four_epochs = (one, two, replace(two, name="later", image_points=epoch(
        14, moved={"p1": AWAY}).image_points), three)  # fmt: skip
    rows = (
        given("p1", (0.1, 0.0, 0.0), 1, 2),
        given("p1", (0.2, 0.0, 0.0), 2, 3),
        given("p1", (-0.3, 0.0, 0.0), 3, 4),
    )
    found = compare_series(four_epochs, points=("p1",), given=rows)
    assert found.expected.reshape(-1, 3).sum(axis=0).tolist() == [0.0, 0.0, 0.0]


def test_what_control_gives_again_is_named_as_moved_back() -> None:
    tested = series_tests(compare_series(given_up(), points=("p1", "p7", "p8")))
    assert {p.point: p.moved for p in tested.points} == {
        "p1": ((1, 2), (2, 3)), "p7": (), "p8": ()
    }  # fmt: skip
    # gone and come back before control gives it again: there it has not moved
    one, two, three = given_up()
    bare = replace(epoch(14), control=two.control)
    tested = series_tests(compare_series((one, two, exact(bare), three), points=("p1",)))
    [p1] = tested.points
    assert p1.epochs == (1, 2, 3, 4)
    assert p1.moved == ((1, 2), (2, 3))


# --- refusals -------------------------------------------------------------------------------


def test_refusals() -> None:
    one, two, three, _ = four()
    with pytest.raises(InputError, match="epochs 1 and 3 have the same image measurements"):
        compare_series((one, two, replace(one, name="copy")))
    empty = replace(one, image_points=())
    for some in ((empty, empty, empty), (empty, one, empty)):
        with pytest.raises(InputError, match=r"^epoch 1: block synthetic: no image points$"):
            compare_series(some)
    with pytest.raises(InputError, match="one epoch has nothing to be compared with"):
        compare_series((one,))
    row = three.control[0]
    shifted = replace(row, xyz=(row.xyz[0] + 0.03, *row.xyz[1:]))
    with pytest.raises(InputError, match=r"in the first epoch and .* in the third"):
        compare_series((one, two, replace(three, control=(shifted, *three.control[1:]))))
    alien = replace(
        three,
        image_points=tuple(replace(r, point="q" + r.point) for r in three.image_points),
        control=tuple(replace(c, point="q" + c.point) for c in three.control),
    )
    with pytest.raises(InputError, match="epoch 3 has no point in common with the others"):
        compare_series((one, two, alien))
    with pytest.raises(InputError, match="point p999 is not in two epochs"):
        compare_series((one, two, three), points=("p999",))
    with pytest.raises(InputError, match="point p1 holds the datum"):
        compare_series((one, two, three), points=("p1",))
    every_photo = additional_parameters("ebner:photo")
    with pytest.raises(InputError, match="every photo cannot be common to all epochs: block or"):
        compare_series((one, two, three), additional=every_photo, common_parameters=True)
    with pytest.raises(ValueError, match="3 epochs are not two"):
        compare_series((one, two, three), points=("p8",)).as_two()


def test_more_displacements_than_can_be_compared_are_refused() -> None:
    names = [f"q{k}" for k in range(22)]
    common = stable_points((), 46)
    assert len(chosen_points([names] * 46, common, names[:15])) == 15
    said = "22770 displacements .* of 46 epochs; 20000 can .*--points.*, or compare fewer epochs"
    with pytest.raises(InputError, match=said):
        chosen_points([names] * 46, common, names)
    # a point counts in the epochs that it is in
    gaps = [names if k % 2 else names[:10] for k in range(46)]
    assert len(chosen_points(gaps, common, ())) == 22


# --- the command ----------------------------------------------------------------------------


def test_the_command(tmp_path, capsys) -> None:
    folders = written(tmp_path, epoch(11), epoch(12), epoch(13, moved=MOVED))
    table, all_tables = tmp_path / "moves.csv", tmp_path / "tables"
    assert main(["compare", *folders, "--csv", str(table), "--to", str(all_tables)]) == 0
    text = capsys.readouterr().out
    lines = text.splitlines()
    assert [line.split()[1:2] for line in lines if line.startswith("  p13 ")][-1] == ["2-3"]
    # a pair without a mark has its line among the tests alone
    assert {"1-3", "2-3"} <= set(lines)
    assert "1-2" not in lines
    assert sum(line.startswith("    from 1 to 2 ") for line in lines) == 1
    assert "  the pair of epochs with nothing marked: --csv and --json have them all" in lines
    assert lines[-1].startswith("  ANYTHING MOVED: yes")
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    moved = {
        (r["from"], r["to"]) for r in rows if r["point"] == "p13" and r["moved_bonferroni"] == "1"
    }
    assert moved == {("1", "3"), ("2", "3")}
    assert {(r["from"], r["to"]) for r in rows} == {("1", "2"), ("1", "3"), ("2", "3")}
    with (all_tables / "points.csv").open(encoding="utf-8", newline="") as file:
        points = {r["point"]: r for r in csv.DictReader(file)}
    assert points["p13"]["moved"] == "2-3"
    assert points["p8"]["moved"] == ""
    assert main(["compare", *folders, "--json", "--fail-on-flag"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["epochs"] == ["synthetic"] * 3
    by = {p["point"]: p for p in found["points"]}
    assert by["p13"]["moved"] == [{"from": 2, "to": 3}]
    assert by["p13"]["steps"][1]["dZ"] == pytest.approx(
        next(float(r["dZ"]) for r in rows if r["point"] == "p13" and r["epochs"] == "2-3")
    )
    assert [(pair["from"], pair["to"]) for pair in found["pairs"]] == [(1, 2), (1, 3), (2, 3)]
    assert found["pairs"][0]["alpha"] == pytest.approx(0.05 / 3)
    assert found["overall"]["families"] == [
        "all points",
        "common control",
        "points",
        "pairs of epochs",
        "single epochs",
    ]
    assert found["given_movement"] is False
    with (all_tables / "epochs.csv").open(encoding="utf-8", newline="") as file:
        epochs = list(csv.DictReader(file))
    assert [(r["epoch"], r["explains"]) for r in epochs] == [("1", "0"), ("2", "0"), ("3", "1")]
    assert "    explains it: without epoch 3 the rest is accepted" in lines
    for one, row in zip(found["against_others"], epochs, strict=True):
        assert one["all"]["estimated"]["alpha"] == pytest.approx(0.05 / 3)
        assert one["all"]["estimated"]["statistic"] == pytest.approx(float(row["statistic"]))
    called = anaplot.compare(*folders)
    assert called.to_dict() == found
    assert called.tables == ("displacements", "points", "epochs")
    assert main(["compare", *folders, "--given-movement", str(tmp_path / "w.csv")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "w.csv: file not found" in said.err
    (tmp_path / "w.csv").write_text(
        "point,from,to,dX,dY,dZ\np13,2,3,0,0.25,0.4\n", encoding="utf-8"
    )
    assert main(["compare", *folders, "--given-movement", str(tmp_path / "w.csv")]) == 0
    text = capsys.readouterr().out
    assert "every point has moved as given" in text
    assert "250.00" in next(x for x in text.splitlines()[::-1] if "p13" in x and "400.00" in x)
    assert "MOVED OTHERWISE THAN GIVEN" in text
    assert main(["compare", folders[0]]) == 2
    assert "EPOCH2" in capsys.readouterr().err


def test_columns_of_the_command_never_touch() -> None:
    found = series_tests(compare_series(four()[:3], points=("p7", "p8", "p13")))
    usual, large = text_of(series_document(found)), text_of(series_document(wild(found)))
    assert words(usual) == words(large)


def test_what_takes_no_part_is_listed_by_epoch() -> None:
    blocks = list(four()[:3])
    rows = list(blocks[2].image_points)
    rows[0] = replace(rows[0], use="off")
    blocks[2] = replace(blocks[2], image_points=tuple(rows))
    found = compare(*blocks, points="p7,p8")
    assert [row["epoch"] for row in found.document.answer["off"]] == [3]
    assert f"switched off in epoch 3: {rows[0].point} in photo {rows[0].photo} (xy)" in str(found)


def test_priors_of_points_take_no_part_and_are_listed() -> None:
    blocks = list(four()[:3])
    prior = PointPrior("p8", (None, None, 50.0), (None, None, 0.5))
    blocks[1] = replace(blocks[1], priors=(prior,))
    said = "priors of points (use prior in control.csv) of epoch 2 take no part"
    for some in (blocks, blocks[:2]):
        found = compare(*some, points="p7,p8")
        assert found.document.answer["without_priors"] == [2]
        assert said in str(found)
        plain = compare(*four()[: len(some)], points="p7,p8")
        assert "without_priors" not in plain.document.answer
        assert found.document.answer == plain.document.answer | {"without_priors": [2]}
    # a block that they hold alone
    held = tuple(PointPrior(c.point, c.xyz, (0.02,) * 3) for c in blocks[2].control)
    blocks[2] = replace(blocks[2], control=(), priors=held)
    with pytest.raises(
        NotComputableError, match=r"^epoch 3: .*priors of points take no part.*--st"
    ):
        compare(*blocks)
    with pytest.raises(NotComputableError, match=r"^epoch 3: ") as bare:
        compare(*blocks[:2], replace(blocks[2], priors=()))
    assert "priors" not in str(bare.value)


def test_pairs_share_the_significance() -> None:
    series = compare_series(four()[:3], points=("p7", "p8"))
    tested = series_tests(series, alpha=0.03)
    for pair in tested.pairs:
        first, second = pair.differences.numbers
        assert pair.alpha == pytest.approx(0.01)
        alone = pair_tests(series.between(first - 1, second - 1), alpha=0.01)
        assert alone.everything == pair.everything
        assert alone.points == pair.points
