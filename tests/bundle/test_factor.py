"""The multifrontal factor and its selected inverse against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anaplot.bundle.solve.dissection import dissect
from anaplot.bundle.solve.factor import Factor, NotPositiveError, sparsity_pattern


def system(seed: int, n: int, d: int, g: int, reach: float, leaf: int):
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 10.0, (n, 2))
    near = np.linalg.norm(places[:, None] - places[None], axis=2) <= reach
    np.fill_diagonal(near, True)
    dense = np.zeros((n * d + g, n * d + g))
    for i in range(n):
        for j in range(i):
            if near[i, j]:
                dense[i * d : i * d + d, j * d : j * d + d] = rng.normal(size=(d, d))
    dense[n * d :, :] = rng.normal(size=(g, n * d + g))
    dense = np.tril(dense, -1)
    dense = dense + dense.T
    dense += np.diag(np.abs(dense).sum(axis=1) + 1.0)
    indptr = np.concatenate(([0], np.cumsum(near.sum(axis=1))))
    order = dissect(places, indptr, np.nonzero(near)[1], leaf)
    i, j = np.nonzero(near)
    keep = order.position[i] >= order.position[j]
    rows, columns = i[keep], j[keep]
    pattern = sparsity_pattern(order, rows, columns, d, g)
    blocks = np.array(
        [dense[r * d : r * d + d, c * d : c * d + d] for r, c in zip(rows, columns, strict=True)]
    )
    border = dense[: n * d, n * d :].reshape(n, d, g)
    return dense, pattern, blocks, border, dense[n * d :, n * d :]


@pytest.mark.slow
@given(
    st.integers(0, 10_000),
    st.integers(1, 60),
    st.sampled_from([(6, 0), (6, 3), (2, 0), (8, 1)]),
    st.sampled_from([1.0, 2.5, 20.0]),
    st.sampled_from([1, 5, 100]),
)
@settings(max_examples=40)
def test_factor_and_selected_inverse_equal_the_dense_ones(seed, n, sizes, reach, leaf) -> None:
    d, g = sizes
    dense, pattern, blocks, border, corner = system(seed, n, d, g, reach, leaf)
    factor = Factor(pattern, blocks, border, corner)
    inverse = np.linalg.inv(dense)
    right = np.random.default_rng(seed).normal(size=(n * d + g, 2))
    for _ in range(2):  # before and after the selected inverse has changed the factor's form
        x, y = factor.solve(right[: n * d].reshape(n, d, 2), right[n * d :])
        got = np.concatenate((x.reshape(n * d, 2), y))
        np.testing.assert_allclose(got, inverse @ right, atol=1e-12)
        selected = factor.selected_inverse()
    for r, c, block in zip(pattern.rows, pattern.columns, selected.blocks, strict=True):
        wanted = inverse[r * d : r * d + d, c * d : c * d + d]
        np.testing.assert_allclose(block, wanted, atol=1e-13)
    np.testing.assert_allclose(
        selected.border.reshape(n * d, g), inverse[: n * d, n * d :], atol=1e-13
    )
    np.testing.assert_allclose(selected.corner, inverse[n * d :, n * d :], atol=1e-13)


def test_the_order_is_a_permutation_and_every_border_lies_above() -> None:
    _, pattern, *_ = system(3, 60, 6, 0, 1.5, 5)
    assert sorted(pattern.order) == list(range(60))
    assert len(pattern.plans) > 5


def test_a_singular_matrix_names_a_photo() -> None:
    _, pattern, blocks, border, corner = system(5, 12, 6, 0, 3.0, 5)
    own = pattern.diagonal[7]
    blocks[own] = 0.0
    blocks[(pattern.rows == 7) ^ (pattern.columns == 7)] = 0.0
    with pytest.raises(NotPositiveError) as caught:
        Factor(pattern, blocks, border, corner)
    assert caught.value.photo == 7
