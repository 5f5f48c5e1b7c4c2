"""Rows whose misclosures are correlated: their weights, and the units to compare them in."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment import lapack
from anaplot.aliases import Array

__all__ = ["correlated_units", "residual_weight", "whitener"]


def whitener(covariance: Array) -> Array:
    """Return L^-1 of a covariance L L'; LinAlgError where it is not positive definite."""
    # not dtrtrs: OpenBLAS wakes its threads for it, however small the matrix is
    factor, info = lapack.dpotrf(covariance, lower=1, clean=1)
    if info:
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    inverse, _ = lapack.dtrtri(factor, lower=1)
    return np.asarray(inverse)


def residual_weight(sigma: Array, design: Array) -> Array:
    """Return W = Sigma^-1 - Sigma^-1 B (B' Sigma^-1 B)^-1 B' Sigma^-1, (n, n) of rank n - u."""
    root = whitener(sigma)
    triangle, factors, _, _ = lapack.dgeqrf(root.dot(design))
    q, _, _ = lapack.dorgqr(triangle[:, : len(factors)], factors)
    left = root - q.dot(q.T.dot(root))
    return np.asarray(left.T.dot(left))


def correlated_units(sigma: Array) -> Array:
    """Return (n,) standard deviations of correlated rows, each given all others.

    In these units redundancy numbers of correlated rows lie between 0 and 1, and a misclosure
    left is the deviation from what the other rows let one expect.
    """
    root = whitener(sigma)
    return np.asarray(1.0 / np.sqrt(np.einsum("ij,ij->j", root, root)))
