"""Of rows that are hard to tell apart the one is rejected that needs the smaller error."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.adjustment.batch import reject_stepwise
from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.partners import WEAK, Proposals, likeliest
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.strategies import STRATEGIES, find_gross_errors

N, U = 20, 4


def inseparable(seed: int, loose: int, firm: int, ratio: float) -> np.ndarray:
    """R of a design in which an unknown of their own leaves two rows a single condition.

    The redundancy number of `loose` is about ratio^2 of that of `firm`; rounding is in its favour.
    """
    rng = np.random.default_rng(seed)
    design = np.hstack((rng.normal(size=(N, U)), np.zeros((N, 1))))
    design[[loose, firm], U] = 1.0, ratio
    q, _ = np.linalg.qr(design)
    matrix = np.eye(N) - q @ q.T
    # w of the row grows by a hundred millionth
    matrix[loose, loose] = matrix[loose, firm] ** 2 / matrix[firm, firm] * (1.0 - 2e-8)
    return matrix


def residuals(matrix: np.ndarray, errors: np.ndarray, names: tuple = ()) -> DenseResiduals:
    e = matrix @ errors
    named = names or tuple(range(N))
    return DenseResiduals(named, e, np.diag(matrix), float(e @ e), N - U - 1, matrix)


rows = st.permutations(range(N))
ratios = st.sampled_from([3e-4, 1e-3, 3e-3, 0.03, 0.09])


@pytest.mark.slow
@given(st.integers(0, 10**6), rows, ratios)
@pytest.mark.parametrize("strategy", [name for name in STRATEGIES if name != "modified"])
def test_the_row_that_hardly_shows_its_error_is_never_rejected(
    strategy: str, seed: int, order: list[int], ratio: float
) -> None:
    loose, firm, other = order[:3]
    matrix = inseparable(seed, loose, firm, ratio)
    errors = np.random.default_rng(seed).normal(size=N) * 0.1
    errors[[firm, other]] += 40.0, 60.0
    found = find_gross_errors(residuals(matrix, errors), strategy)
    assert loose not in found.rows
    if firm in found.rows:
        assert (firm, loose) in {(tie.rejected, tie.kept) for tie in found.hard_to_tell}


@pytest.mark.parametrize("strategy", ["baarda", "tau"])
def test_many_runs_at_once_choose_as_one_by_one(strategy: str) -> None:
    rng = np.random.default_rng(7)
    for seed in range(60):
        loose, firm, other = rng.permutation(N)[:3].tolist()
        matrix = inseparable(seed, loose, firm, [1e-3, 0.03, 0.3][seed % 3])
        errors = rng.normal(size=N)
        errors[[firm, other]] += 40.0, 60.0
        one = Elimination(residuals(matrix, errors))
        many = reject_stepwise(matrix, errors[None], strategy, 0.001)
        chosen: set[int] = set()
        while len(chosen) < many.sum():
            size = np.abs(one.w)
            best = int(np.nanargmax(size))
            columns = one.column(best)[None]
            w, r = one.w[None], one.r[None]
            row = int(likeliest(w, r, columns, np.array([best]))[0])
            one.add(row)
            chosen.add(row)
        assert chosen == set(np.flatnonzero(many[0]).tolist())


@pytest.mark.slow
def test_a_single_error_is_found_in_its_row_or_in_a_better_partner() -> None:
    """Without noise nothing is larger than the row in error, but what cannot be told from it."""
    for seed in range(25):
        matrix = inseparable(seed, 3, 7, 0.05)
        for row in (3, 5, 7):
            errors = np.zeros(N)
            errors[row] = 1e4
            if matrix[row, row] * 1e4**2 < 100.0:
                continue
            for strategy in ("baarda", "search", "huber", "danish"):
                found = find_gross_errors(residuals(matrix, errors), strategy)
                assert found.rows == ((7 if row == 3 else row),)


def chosen(w: list[float], r: list[float], correlation: list[float], row: int = 0) -> int:
    """What is chosen in place of a row."""
    column = np.array(correlation) * np.sqrt(np.array(r) * r[row])
    found = likeliest(np.array([w]), np.array([r]), column[None], np.array([row], dtype=np.intp))
    return int(found[0])


def test_of_partners_the_likelier_one() -> None:
    r = [1e-7, 0.1, 0.3, 0.3]
    assert chosen([9.0, 9.0, -9.0, 9.0], r, [1.0, -1.0, 1.0, 1.0]) == 2
    assert chosen([9.0, 9.0, 9.0, 9.0], r, [1.0, -1.0, 0.89, 0.5]) == 1
    assert chosen([9.0, np.nan, np.nan, np.nan], r, [1.0, 1.0, 1.0, 1.0]) == 0
    # w^2 + log r decides where noise parts them
    assert chosen([9.0, 8.95], [0.05, 0.5], [1.0, 0.99]) == 1
    assert chosen([9.0, 8.80], [0.05, 0.5], [1.0, 0.99]) == 0
    # rounding is no evidence: w is known to 1e-13 / r only
    assert chosen([9000.0, 8999.99], [1e-8, 0.5], [1.0, 1.0]) == 1
    assert chosen([9.0, 9.0, 9.0], [0.3, 0.3, 0.3], [1.0, 1.0, 1.0], row=2) == 0


@given(
    st.lists(st.floats(1e-6, 1.0), min_size=2, max_size=8),
    st.integers(0, 7),
    st.floats(3.3, 1e3),
)
def test_of_what_cannot_be_told_apart_the_largest_redundancy_number(
    r: list[float], row: int, w: float
) -> None:
    found = chosen([w] * len(r), r, [1.0] * len(r), row % len(r))
    assert r[found] >= max(r) * (1.0 - 1e-5)


def test_what_is_weak_goes_with_its_measurement() -> None:
    """x of a ray shows 0.4 per cent of its error, y is sound: the ray goes, not x alone."""
    design = np.zeros((12, 3))
    design[:, 0] = 1.0
    design[:6, 1] = np.arange(6.0)
    design[7, 2], design[8, 2] = 15.0, 1.0  # row 7 nearly determines an unknown of its own
    q, _ = np.linalg.qr(design)
    matrix = np.eye(12) - q @ q.T
    assert TWO_ROWS < matrix[7, 7] < WEAK
    names = tuple(("image", "photo", f"p{k // 2}", "xy"[k % 2]) for k in range(12))
    errors = np.zeros(12)
    errors[7] = 400.0
    errors[8] = -400.0 / 15.0  # seen as an error of row 7, not of its partner
    e = matrix @ errors
    system = DenseResiduals(names, e, np.diag(matrix), float(e @ e), 9, matrix)
    assert Proposals(names).measured_with(7) == [6, 7]
    for strategy in ("baarda", "search", "odds"):
        found = find_gross_errors(system, strategy)
        # 8 can be told from 7 by nothing, and shows far more of its error
        assert 7 not in found.rows
        assert 8 in found.rows


TWO_ROWS = 1e-3


def test_a_weak_row_without_partner_takes_its_measurement_along() -> None:
    """Many rows check a little of row 1 each, none is like it."""
    rng = np.random.default_rng(4)
    design = np.zeros((24, 3))
    design[:, 0] = 1.0
    design[1, 2] = 16.0
    design[2:, 2] = rng.choice([-1.0, 1.0], 22) * 0.3
    design[:, 1] = rng.normal(size=24)
    q, _ = np.linalg.qr(design)
    matrix = np.eye(24) - q @ q.T
    r = np.diag(matrix)
    rho = np.abs(matrix[:, 1]) / np.sqrt(r * r[1])
    assert TWO_ROWS < r[1] < WEAK
    assert np.sort(rho)[-2] < 0.9
    names = tuple(("image", "photo", f"p{k // 2}", "xy"[k % 2]) for k in range(24))
    errors = np.zeros(24)
    errors[1] = 200.0
    e = matrix @ errors
    system = DenseResiduals(names, e, r, float(e @ e), 21, matrix)
    for strategy in ("baarda", "tau", "search", "odds"):
        found = find_gross_errors(system, strategy)
        assert set(found.rows) == {0, 1}
        assert {rejection.order for rejection in found.rejected} == {1}
        alone = find_gross_errors(
            DenseResiduals(tuple(range(24)), e, r, float(e @ e), 21, matrix), strategy
        )
        assert alone.rows == (1,)


def leverage(weight: float) -> tuple[np.ndarray, tuple]:
    """R of rows of which row 1 nearly determines an unknown of its own; names of rays."""
    rng = np.random.default_rng(4)
    design = np.zeros((24, 3))
    design[:, 0] = 1.0
    design[1, 2] = weight
    design[2:, 2] = rng.choice([-1.0, 1.0], 22) * 0.3
    design[:, 1] = rng.normal(size=24)
    q, _ = np.linalg.qr(design)
    names = tuple(("image", "photo", f"p{k // 2}", "xy"[k % 2]) for k in range(24))
    return np.eye(24) - q @ q.T, names


@pytest.mark.parametrize("strategy", ["baarda", "search", "odds", "l1"])
def test_the_less_of_an_error_is_seen_the_more_conspicuous_it_must_be(strategy: str) -> None:
    matrix, names = leverage(400.0)
    r = np.diag(matrix)
    assert 5e-6 < r[1] < 5e-5
    for w, gone in ((3.6, False), (6.0, True)):
        e = matrix[:, 1] * w / np.sqrt(r[1])
        system = DenseResiduals(names, e, r, float(e @ e), 21, matrix)
        found = find_gross_errors(system, strategy)
        assert (1 in found.rows) == gone
        assert (0 in found.rows) == gone


def test_rows_of_one_measurement() -> None:
    names = (("image", "a", "1", "x"), ("image", "a", "1", "y"), ("image", "a", "2", "x"), "b", ())
    assert Proposals(names).measured_with(1) == [0, 1]
    assert Proposals(names).measured_with(2) == [2]
    assert Proposals(names).measured_with(3) == [3]
    assert Proposals(names).measured_with(4) == [4]
