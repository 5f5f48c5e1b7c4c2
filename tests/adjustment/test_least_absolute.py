"""The least absolute sum of residuals: by a linear programme, by re-weighting, from R alone."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import csr_array

from anaplot.adjustment.leastabsolute import (
    design_of,
    least_absolute,
    least_absolute_residuals,
)
from anaplot.adjustment.leftout import ReducedSystem
from anaplot.adjustment.residualsystem import DenseResiduals
from anaplot.adjustment.strategies import find_gross_errors


def residuals(design: np.ndarray, errors: np.ndarray, *, known: bool = True) -> DenseResiduals:
    q = np.linalg.svd(design, full_matrices=False)[0]
    matrix = np.eye(len(design)) - q @ q.T
    e = matrix @ errors
    return DenseResiduals(
        tuple(range(len(e))),
        e,
        np.diag(matrix).copy(),
        float(e @ e),
        len(e) - design.shape[1],
        matrix,
        csr_array(design) if known else None,
    )


def test_the_middle_of_many_numbers_is_their_median() -> None:
    numbers = np.random.default_rng(1).normal(size=31) ** 3
    for most_rows in (100, 0):
        found = least_absolute(csr_array(np.ones((31, 1))), numbers, most_rows)
        np.testing.assert_allclose(found.residuals, numbers - np.median(numbers), atol=1e-8)


@pytest.mark.parametrize("most_rows", [100, 0])
def test_units_of_the_unknowns_and_those_that_no_row_has_do_not_matter(most_rows: int) -> None:
    rng = np.random.default_rng(3)
    design, e = rng.normal(size=(24, 3)), rng.normal(size=24)
    expected = least_absolute(csr_array(design), e, most_rows).residuals
    other = np.column_stack((np.zeros(24), design * (1e-3, 1e-6, 1e6)))
    found = least_absolute(csr_array(other), e, most_rows).residuals
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_no_other_set_of_rows_is_met_with_a_smaller_sum() -> None:
    rng = np.random.default_rng(2)
    design, e = rng.normal(size=(9, 3)), rng.normal(size=9)
    least = min(
        float(np.abs(e - design @ np.linalg.solve(design[list(rows)], e[list(rows)])).sum())
        for rows in combinations(range(9), 3)
    )
    for most_rows in (100, 0):
        assert least_absolute(csr_array(design), e, most_rows).total == pytest.approx(least)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [1.0, 1e6])
def test_re_weighting_reaches_the_optimum_of_the_programme(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    n, u = 240, 60
    design = rng.normal(size=(n, u)) * (rng.random((n, u)) < 0.15) * 10.0 ** rng.uniform(-3, 3, u)
    design = np.column_stack((design, design[:, 0] + design[:, 1]))  # as with a free datum
    e = rng.normal(size=n)
    e[rng.choice(n, 20, replace=False)] += 18.0
    exact = least_absolute(csr_array(design), e * scale)
    again = least_absolute(csr_array(design), e * scale, 0)
    assert exact.iterations is None
    assert again.iterations is not None
    assert again.total == pytest.approx(exact.total, rel=1e-8)
    np.testing.assert_allclose(again.residuals, exact.residuals, atol=1e-9 * scale)


def test_from_the_residual_matrix_alone() -> None:
    rng = np.random.default_rng(3)
    design, errors = rng.normal(size=(40, 12)), rng.normal(size=40)
    errors[7] = 30.0
    known = least_absolute_residuals(residuals(design, errors))
    alone = least_absolute_residuals(residuals(design, errors, known=False))
    np.testing.assert_allclose(alone, known, atol=1e-9)


def test_a_prior_that_is_no_row_counts() -> None:
    # one unknown seen by all rows, its prior value 0 with a sigma of 1 / 3
    n, weight = 12, 9.0
    design = np.ones((n, 1))
    matrix = np.eye(n) - design @ design.T / (n + weight)
    errors = np.random.default_rng(4).normal(size=n) + 5.0
    e = matrix @ errors
    of = DenseResiduals(tuple(range(n)), e, np.diag(matrix).copy(), float(errors @ e), n, matrix)
    every = csr_array(np.vstack((design, [[np.sqrt(weight)]])))
    expected = least_absolute(every, np.append(errors, 0.0)).residuals[:n]
    np.testing.assert_allclose(least_absolute_residuals(of), expected, atol=1e-8)


def test_of_correlated_rows_what_is_left_is_explained_by_the_least_errors() -> None:
    rng = np.random.default_rng(8)
    n = 30
    root = np.eye(n) + 0.25 * rng.normal(size=(n, n)) / np.sqrt(n)
    weight = np.linalg.inv(root @ root.T)
    design = rng.normal(size=(n, 6))
    normal = design.T @ weight @ design
    matrix = weight - weight @ design @ np.linalg.solve(normal, design.T @ weight)
    values = np.linalg.eigvalsh(matrix)
    errors = np.zeros(n)
    errors[[4, 20]] = 30.0, -20.0
    # as far as no eigenvalue lies between 0 and 1 nothing but these two errors explains it all
    matrix /= values[values > 1e-9].min()
    e = matrix @ errors
    of = DenseResiduals(
        tuple(range(n)), e, np.diag(matrix).copy(), float(errors @ e), n - 6, matrix
    )
    np.testing.assert_allclose(least_absolute_residuals(of), errors, atol=1e-6)
    assert design_of(matrix) is None
    assert design_of(residuals(design, errors).matrix) is not None


def test_rows_left_out_for_good_count_nothing() -> None:
    rng = np.random.default_rng(5)
    design, errors = rng.normal(size=(40, 12)), rng.normal(size=40)
    errors[[7, 9]] = 30.0, -500.0
    rest = np.delete(np.arange(40), 9)
    expected = least_absolute(csr_array(design[rest]), errors[rest]).residuals
    for known in (True, False):
        left = ReducedSystem(residuals(design, errors, known=known), [9])
        np.testing.assert_allclose(least_absolute_residuals(left)[rest], expected, atol=1e-7)


def test_the_strategy_finds_masked_errors_and_brings_back_the_others() -> None:
    rng = np.random.default_rng(6)
    design, errors = rng.normal(size=(60, 15)), rng.normal(size=60) * 0.5
    planted = {3, 17, 30, 31, 44}
    errors[list(planted)] += 20.0
    found = find_gross_errors(residuals(design, errors), "l1")
    assert set(found.rows) == planted
    assert {step.action for step in found.steps} <= {"reject", "drop"}
    assert all(abs(found.at_end.w[row]) > 3.29 for row in planted)


@pytest.mark.parametrize("strategy", ["l1", "search", "odds"])
def test_where_no_optimum_is_reached_the_search_begins_with_w_and_says_so(
    strategy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(system: object) -> np.ndarray:
        raise ArithmeticError("no least absolute sum in 200 adjustments")

    monkeypatch.setattr("anaplot.adjustment.strategies.least_absolute_residuals", fails)
    q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(30, 6)))
    matrix = np.eye(30) - q @ q.T
    e = matrix[:, 7] * 30.0
    system = DenseResiduals(tuple(range(30)), e, np.diag(matrix), float(e @ e), 24, matrix)
    found = find_gross_errors(system, strategy)
    assert found.rows == (7,)
    assert "no least absolute sum in 200 adjustments: begun with w" in found.remarks
