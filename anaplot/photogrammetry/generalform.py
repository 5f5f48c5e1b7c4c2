"""The general form of a plate transformation, by its ten coefficients.

x = (a0 + a1 xi + a2 eta + a3 xi eta) / (1 + c1 xi + c2 eta), and y alike: a0 to a3 of x, a0 to a3
of y, c1, c2.
"""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array

__all__ = ["IDENTITY", "general_form"]

IDENTITY = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""Coefficients of the identity."""


def general_form(terms: Array, at: Array) -> tuple[Array, Array, Array]:
    """Return (n, 2) values, (n, 2, 2) derivatives by place and (n, 2, 10) by coefficient."""
    a, c = terms[:8].reshape(2, 4), terms[8:]
    xi, eta = at.T
    powers = np.column_stack((np.ones_like(xi), xi, eta, xi * eta))
    under = 1.0 + at @ c
    value = (powers @ a.T) / under[:, None]
    by_place = a[None, :, 1:3] + a[None, :, 3:] * at[:, None, ::-1]
    by_place = (by_place - value[:, :, None] * c) / under[:, None, None]
    by_terms = np.zeros((len(at), 2, 10))
    by_terms[:, 0, :4] = by_terms[:, 1, 4:8] = powers / under[:, None]
    by_terms[:, :, 8:] = -value[:, :, None] * at[:, None, :] / under[:, None, None]
    return value, by_place, by_terms
