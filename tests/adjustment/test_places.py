"""Many small systems at once: what arrays decide is what the rule decides in each of them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import csr_array

from anaplot.adjustment.doubts import Doubts, Touching
from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.nothingbetter import no_set_better, nothing_better, surely_best
from anaplot.adjustment.places import (
    Places,
    inverse_among,
    plainly_rejected,
    seen_without,
)
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.stepwise import rule_of, step_by_step
from anaplot.adjustment.watch import Watch

ALPHA = 0.001
CRITICAL = critical_normal(ALPHA)


def places_of(seed: int, count: int = 60, k: int = 12, unknowns: int = 3) -> Places:
    """Random designs with noise and up to three errors of any size each."""
    rng = np.random.default_rng(seed)
    e, matrix = np.empty((count, k)), np.empty((count, k, k))
    for at in range(count):
        design = rng.normal(size=(k, unknowns))
        if at % 3 == 1:
            # two rows of one unknown of their own: hard to tell apart
            own = np.zeros((k, 1))
            own[:2, 0] = 1.0, rng.normal()
            design = np.hstack((design, own))
        q, _ = np.linalg.qr(design)
        matrix[at] = np.eye(k) - q @ q.T
        errors = rng.normal(size=k)
        wrong = rng.choice(k, rng.integers(0, 4), replace=False)
        errors[wrong] += rng.uniform(-60.0, 60.0, len(wrong))
        e[at] = matrix[at] @ errors
    r = np.einsum("cii->ci", matrix).copy()
    vtpv, rows = 1000.0 + np.einsum("ci,ci->c", e, e), np.arange(count * k).reshape(count, k)
    names = [("image", f"f{row // 2}", "xy"[row % 2]) for row in range(count * k)]
    return Places(np.arange(count), rows, e, r, matrix, np.ones((count, k)), vtpv, 500, names)


@pytest.mark.parametrize("seed", range(4))
def test_plain_places_are_cleaned_as_the_rule_cleans_them(seed: int) -> None:
    places = places_of(seed)
    suspects = np.random.default_rng(seed + 9).random(places.e.shape) < 0.95
    found = plainly_rejected(places, suspects, CRITICAL)
    assert sum(steps is not None for steps in found) > 25
    assert sum(steps is None for steps in found) > 3
    assert max(len(steps) for steps in found if steps is not None) > 1
    for at, steps in enumerate(found):
        if steps is None:
            continue
        state = Elimination(places.place(at).system)
        rule = rule_of("baarda", ALPHA)
        wanted = list(step_by_step(state, rule, suspects[at], 12, Watch(), together=False))
        assert [step.rows for step in steps] == [step.rows for step in wanted]
        for mine, its in zip(steps, wanted, strict=True):
            assert mine.action == its.action
            assert mine[2:] == pytest.approx(its[2:], rel=1e-9)


def test_places_without_rows_are_those_of_an_elimination() -> None:
    places = places_of(2, count=12)
    out = np.random.default_rng(5).random(places.e.size) < 0.15
    out[places.rows[7]] = False
    left = places.without(out)
    assert left.r[7] == pytest.approx(places.r[7], abs=0.0)
    for at in range(12):
        gone = np.flatnonzero(out[places.rows[at]])
        state = Elimination(places.place(at).system)
        for row in gone.tolist():
            state.add(row)
        kept = np.setdiff1d(np.arange(places.e.shape[1]), gone)
        found = left.place(at).system
        assert found.e[kept] == pytest.approx(state.e[kept], abs=1e-9)
        assert found.r[kept] == pytest.approx(state.r[kept], abs=1e-9)
        assert found.vtpv == pytest.approx(state.vtpv, rel=1e-9)
        assert not found.e[gone].any()
        assert not found.matrix[gone].any()
        assert not found.matrix[:, gone].any()
        columns = np.array([state.column(row)[kept] for row in kept.tolist()])
        assert found.matrix[np.ix_(kept, kept)] == pytest.approx(columns, abs=1e-9)


def test_inverses_among_chosen_rows_are_those_of_the_parts() -> None:
    places = places_of(1, count=9)
    chosen = np.random.default_rng(3).random(places.e.shape) < 0.3
    chosen[4] = False
    found = inverse_among(places.matrix, chosen)
    for at in range(9):
        mine = np.flatnonzero(chosen[at])
        part = np.linalg.inv(places.matrix[at][np.ix_(mine, mine)])
        assert found[at][np.ix_(mine, mine)] == pytest.approx(part, rel=1e-9)
        assert np.count_nonzero(found[at]) == np.count_nonzero(part)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_better_where_no_set_of_one_more_or_less_is(seed: int) -> None:
    places, cost = places_of(seed, count=40, k=9), CRITICAL**2
    said = {True: 0, False: 0}
    for at in range(40):
        system = places.place(at).system
        values: dict[tuple[int, ...], float] = {(): system.vtpv}
        for size in (1, 2, 3):
            for rows in combinations(range(9), size):
                part = system.matrix[np.ix_(rows, rows)]
                if np.linalg.cond(part) < 1e7:
                    e = system.e[list(rows)]
                    values[rows] = system.vtpv - float(e @ np.linalg.solve(part, e))
        for size in (1, 2):
            mine = min((rows for rows in values if len(rows) == size), key=values.__getitem__)
            best = min(
                values[rows] + cost * (len(rows) - size)
                for rows in values
                if 1 <= len(rows) <= size + 1
            )
            sure = nothing_better(system, mine, CRITICAL)
            assert sure == (best >= values[mine] - 1e-9 * system.vtpv)
            said[sure] += 1
            other = next(rows for rows in values if len(rows) == size and rows != mine)
            assert not nothing_better(system, other, CRITICAL)
        assert not nothing_better(system, (0, 1, 2), CRITICAL)
    assert min(said.values()) > 5


@pytest.mark.parametrize("seed", range(4))
def test_what_is_seen_of_many_places_at_once_is_true_of_each(seed: int) -> None:
    places = places_of(seed, count=200, k=30)
    w = np.abs(places.e) / np.sqrt(places.r)
    out = (w >= np.sort(w, axis=1)[:, -2:-1]) & (w > CRITICAL)
    out[:5] = w[:5] <= np.sort(w[:5], axis=1)[:, 1:2]
    sure = surely_best(places, out, CRITICAL)
    each = [
        nothing_better(places.place(at).system, tuple(np.flatnonzero(out[at])), CRITICAL)
        for at in range(200)
    ]
    assert not (sure & ~np.array(each)).any()
    assert sure.sum() > 20


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_where_surely_no_set_is_better_none_is(seed: int) -> None:
    count, k = 60, 10
    places, cost = places_of(seed, count=count, k=k, unknowns=1), CRITICAL**2
    places = places._replace(e=places.e + 40.0 * places.matrix[:, 3] - 60.0 * places.matrix[:, 8])
    sets = [np.array(list(combinations(range(k), size))) for size in range(1, k - 1)]
    sure = 0
    for at in range(count):
        e, matrix = places.e[at], places.matrix[at]
        best, least = (), 0.0
        for rows in sets:
            parts = matrix[rows[:, :, None], rows[:, None, :]]
            good = np.linalg.det(parts) > 1e-7
            parts, rows = parts[good], rows[good]
            z = np.linalg.solve(parts, e[rows][:, :, None])[:, :, 0]
            values = cost * rows.shape[1] - np.einsum("ci,ci->c", z, e[rows])
            if len(rows) and values.min() < least:
                best, least = tuple(rows[values.argmin()].tolist()), float(values.min())
        system = places.place(at).system
        sure += no_set_better(system, best, CRITICAL)
        for some in ((3, 8), (3, 5, 8), (0, 3), (0, 3, 8)):
            assert some == best or not no_set_better(system, some, CRITICAL)
        assert not no_set_better(system, tuple(range(7)), CRITICAL)
    assert sure > 10


def test_doubts_are_the_bounds_of_larger_places_that_share_a_photo() -> None:
    rng = np.random.default_rng(5)
    k, photos = 50, 9
    seen = rng.random((k, photos)) < 0.3
    far = rng.random(k) < 0.05
    top, reach = rng.uniform(3.0, 60.0, k), rng.uniform(0.1, 0.5, k)
    top[rng.random(k) < 0.1] = 0.0
    doubts = Doubts(top, reach, Touching(csr_array(seen.astype(float)), far))
    blocks = doubts.blocks(CRITICAL, 0.1)
    for sizes in (top, top / 2.0, np.zeros(k), np.where(rng.random(k) < 0.5, np.nan, top)):
        one_by_one = [0.0 if np.isnan(w) else doubts.of(i, w) for i, w in enumerate(sizes.tolist())]
        np.testing.assert_allclose(doubts.of_all(sizes), one_by_one, atol=1e-12)
    for i in range(k):
        for size in (top[i], top[i] / 2.0, 0.0):
            wanted = sum(
                reach[i] * reach[j] * top[j]
                for j in range(k)
                if j != i and top[j] > size and (far[i] or far[j] or (seen[i] & seen[j]).any())
            )
            assert doubts.of(i, size) == pytest.approx(wanted, abs=1e-12)
        mine = doubts.of(i, top[i])
        if blocks[i]:
            assert mine > 0.1
            assert top[i] - CRITICAL <= mine
    assert 5 < blocks[top > 0.0].sum() < k


def test_rows_that_nothing_checks_leave_the_others_as_they_are() -> None:
    places = places_of(2)
    matrix, e = places.matrix.copy(), places.e.copy()
    # row 3 alone has an unknown of its own, rows 3 and 5 are out
    matrix[:, 3], matrix[:, :, 3], e[:, 3] = 0.0, 0.0, 0.0
    gone = np.zeros(e.shape, dtype=bool)
    gone[:, [3, 5]] = True
    with pytest.raises(np.linalg.LinAlgError):
        inverse_among(matrix, gone)
    inverse, r = seen_without(matrix, gone)
    assert np.all(r[:, 3] == 0.0)
    assert r[:, 5] == pytest.approx(matrix[:, 5, 5], rel=1e-9)
    assert inverse[:, 5, 5] == pytest.approx(1.0 / matrix[:, 5, 5], rel=1e-9)
    out = np.zeros(len(places.names), dtype=bool)
    out[places.rows[:, [3, 5]]] = True
    one = out.copy()
    one[places.rows[:, 3]] = False
    there = places._replace(matrix=matrix, e=e)
    without, same = there.without(out), there.without(one)
    assert without.matrix == pytest.approx(same.matrix, abs=1e-12)
    assert without.e == pytest.approx(same.e, abs=1e-9)
    assert without.vtpv == pytest.approx(same.vtpv, rel=1e-12)
