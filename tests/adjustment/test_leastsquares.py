"""Least squares: normal case, combined form, rank defects."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.adjustment import lapack
from anaplot.adjustment.leastsquares import RankDefectError, adjust, adjust_combined
from anaplot.errors import NotComputableError


def problem(seed, n=14, u=5):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, u)), rng.normal(size=n), rng.uniform(0.3, 3.0, n)


def names(u):
    return [f"g{k}" for k in range(u)]


@given(st.integers(0, 10**6), st.integers(0, 12), st.integers(1, 6))
def test_projection_trace_and_normal_equations(seed, extra, u):
    B, f, q = problem(seed, u + extra, u)
    a = adjust(B, f, q, unknowns=names(u), condition_limit=1e12)
    P = np.diag(1.0 / q)
    projector = a.q_vv @ P
    assert projector @ projector == pytest.approx(projector, abs=1e-11)
    assert np.trace(projector) == pytest.approx(extra, abs=1e-11)
    assert a.r.sum() == pytest.approx(extra, abs=1e-11)
    assert a.redundancy == extra
    scale = float(np.abs(B).max() * np.abs(a.w).max() * (1.0 / q).max()) + 1.0
    assert np.abs(B.T @ P @ a.w).max() <= 1e-10 * scale


@given(st.integers(0, 10**6), st.integers(0, 12), st.integers(1, 6))
def test_the_complement_is_where_residuals_are(seed, extra, u):
    B, f, q = problem(seed, u + extra, u)
    a = adjust(B, f, q, unknowns=names(u), condition_limit=1e12)
    assert a.complement.shape == (u + extra, extra)
    assert a.complement.T @ a.complement == pytest.approx(np.eye(extra), abs=1e-11)
    assert a.complement @ a.complement.T == pytest.approx(a.projector, abs=1e-11)
    assert a.complement.T @ (f / a.root) == pytest.approx(a.complement.T @ a.closing, abs=1e-11)
    if extra:
        along = a.complement[:, 0]
        assert along * (along @ a.closing) == pytest.approx(a.closing, abs=1e-11)


def test_a_routine_that_lapack_does_not_have_is_no_attribute():
    assert lapack.dposv(np.eye(2), np.array([3.0, 4.0]))[1].tolist() == [3.0, 4.0]
    for name in ("dnone", "_dnone", "__path__"):
        with pytest.raises(AttributeError):
            getattr(lapack, name)


def test_against_the_textbook_formulas():
    B, f, q = problem(3)
    a = adjust(B, f, q, unknowns=names(5))
    P = np.diag(1.0 / q)
    N = B.T @ P @ B
    x = -np.linalg.solve(N, B.T @ P @ f)
    assert a.x == pytest.approx(x, rel=1e-11)
    assert a.w == pytest.approx(B @ x + f, abs=1e-12)
    assert a.q_xx == pytest.approx(np.linalg.inv(N), rel=1e-10)
    assert a.q_vv == pytest.approx(np.diag(q) - B @ np.linalg.inv(N) @ B.T, abs=1e-12)
    assert a.vtpv == pytest.approx(float(a.w @ P @ a.w), rel=1e-12)
    assert a.sigma0 == pytest.approx((a.vtpv / 9) ** 0.5)


def test_residuals_change_by_q_vv_p_times_a_planted_error():
    B, f, q = problem(4)
    a = adjust(B, f, q, unknowns=names(5))
    for k in range(len(f)):
        planted = f.copy()
        planted[k] += 0.1
        b = adjust(B, planted, q, unknowns=names(5))
        assert b.w - a.w == pytest.approx(a.q_vv[:, k] / q[k] * 0.1, abs=1e-13)
        assert (b.w - a.w)[k] == pytest.approx(a.r[k] * 0.1, abs=1e-13)


def test_condition_number_is_that_of_the_column_scaled_weighted_design():
    B, f, q = problem(5)
    B[:, 2] *= 1e7
    a = adjust(B, f, q, unknowns=names(5))
    scaled = B / np.sqrt(q)[:, None]
    scaled /= np.linalg.norm(scaled, axis=0)
    assert a.condition == pytest.approx(np.linalg.cond(scaled), rel=1e-9)


@given(st.integers(0, 10**6), st.integers(2, 6), st.integers(0, 8), st.floats(0.0, 3.0))
def test_a_bound_of_the_condition_number_decides_as_the_number_itself(seed, u, extra, power):
    B, f, q = problem(seed, u + extra, u)
    B[:, -1] = B[:, 0] + 10.0**-power * B[:, -1]
    a = adjust(B, f, q, unknowns=names(u), condition_limit=1e12)
    assert a.condition <= a.at_most * (1.0 + 1e-9)
    for limit in (0.5 * a.condition, 2.0 * a.condition, 0.5 * a.at_most, 2.0 * a.at_most):
        assert a.worse_than(limit) == (a.condition > limit)


def test_a_square_system_has_no_redundancy():
    B, f, q = problem(6, 5, 5)
    a = adjust(B, f, q, unknowns=names(5))
    assert a.redundancy == 0
    assert a.sigma0 is None
    assert a.r == pytest.approx(np.zeros(5), abs=1e-12)


def test_rank_defect_names_the_dependent_unknowns_only():
    B, f, q = problem(7)
    B[:, 3] = 2.0 * B[:, 1]
    with pytest.raises(RankDefectError) as caught:
        adjust(B, f, q, unknowns=["a", "b", "c", "d", "e"])
    assert set(caught.value.undetermined) == {"b", "d"}
    assert caught.value.condition > 1e4
    assert isinstance(caught.value, NotComputableError)
    assert "\n" not in str(caught.value)


def test_an_unknown_without_any_row_is_named():
    B, f, q = problem(8)
    B[:, 4] = 0.0
    with pytest.raises(RankDefectError) as caught:
        adjust(B, f, q, unknowns=["a", "b", "c", "d", "e"])
    assert caught.value.undetermined == ("e",)


def test_fewer_rows_than_unknowns():
    B, f, q = problem(9, 2, 3)
    B[:, 2] = 0.0
    B[0, 2] = 1e-30
    with pytest.raises(RankDefectError) as caught:
        adjust(B, f, q, unknowns=["a", "b", "c"])
    assert caught.value.undetermined
    assert caught.value.condition == float("inf")


@pytest.mark.parametrize("what", ["shape", "nan design", "inf misclosure", "zero cofactor"])
def test_nonsense_is_refused(what):
    B, f, q = problem(10)
    if what == "shape":
        f = f[:-1]
    elif what == "nan design":
        B[0, 0] = np.nan
    elif what == "inf misclosure":
        f[0] = np.inf
    else:
        q[0] = 0.0
    with pytest.raises(ValueError, match=r"shapes disagree|must be"):
        adjust(B, f, q, unknowns=names(5))


@given(st.integers(0, 10**6), st.booleans())
def test_combined_form_against_the_general_dense_solution(seed, correlated):
    rng = np.random.default_rng(seed)
    n, m, u = 9, 15, 4
    A, B, f = rng.normal(size=(n, m)), rng.normal(size=(n, u)), rng.normal(size=n)
    half = rng.normal(size=(m, m)) + 4.0 * np.eye(m)
    Q = half @ half.T if correlated else np.diag(rng.uniform(0.5, 2.0, m))
    got = adjust_combined(
        A, B, f, Q if correlated else np.diag(Q).copy(), unknowns=names(u), condition_limit=1e9
    )
    # minimise v' Q^-1 v under A v + B g + u = 0: one symmetric system for v, g and correlates
    saddle = np.block(
        [
            [np.linalg.inv(Q), np.zeros((m, u)), A.T],
            [np.zeros((u, m)), np.zeros((u, u)), B.T],
            [A, B, np.zeros((n, n))],
        ]
    )
    solved = np.linalg.solve(saddle, np.concatenate((np.zeros(m + u), -f)))
    scale = np.abs(solved).max() + 1.0
    assert got.v == pytest.approx(solved[:m], abs=1e-8 * scale)
    assert got.g == pytest.approx(solved[m : m + u], abs=1e-8 * scale)
    assert got.r.sum() == pytest.approx(n - u, abs=1e-8)
    # residual cofactors by propagation: v = -Q A' (Q_c - B N^-1 B') ... applied to the observations
    inverse = np.linalg.inv(A @ Q @ A.T)
    inner = inverse - inverse @ B @ np.linalg.solve(B.T @ inverse @ B, B.T @ inverse)
    assert got.q_vv == pytest.approx(Q @ A.T @ inner @ A @ Q, abs=1e-7 * np.abs(Q).max())


def test_combined_form_with_diagonal_conditions_is_the_parametric_form_of_the_paper():
    B, f, q = problem(11)
    a = np.linspace(90.0, 160.0, len(f))
    combined = adjust_combined(np.diag(a), B, f, q, unknowns=names(5))
    parametric = adjust(B / a[:, None], f / a, q, unknowns=names(5))
    assert combined.g == pytest.approx(parametric.x, rel=1e-10)
    assert combined.v == pytest.approx(-parametric.w, abs=1e-13)  # w = -A v: PARX = -v
    assert combined.q_vv == pytest.approx(parametric.q_vv, abs=1e-11)
    assert combined.r == pytest.approx(parametric.r, abs=1e-11)


def test_dependent_conditions_are_named():
    A = np.array([[1.0, 2.0], [1.0, 2.0], [2.0, 4.0]])
    with pytest.raises(RankDefectError, match="condition"):
        adjust_combined(A, np.ones((3, 1)), np.zeros(3), np.ones(2), unknowns=["g"])
