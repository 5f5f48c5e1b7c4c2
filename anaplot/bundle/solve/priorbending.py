"""What is not linear in a prior whose datum is weak.

A covariance is linear at the values it belongs to. Shift, rotation and scale that are common to all
given coordinates may be far weaker than their shape, and to that covariance a turned block is a
bent one: of a movement s with effects G and covariance (G'WG)^-1 the second order, s_i s_j H_ij / 2
with the products H of the generators, is measured by the shape's own weights, W less what is
weighed of the movements.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from anaplot.aliases import Array
from anaplot.bundle.solve.givenprior import GivenPrior
from anaplot.errors import InputError
from anaplot.photogrammetry.similarity import similarity_effects

__all__ = ["MOST_BENT", "check_linear", "prior_bending"]


MOST_BENT = 0.1
"""Standard deviations of the shape by which it is bent: beyond, results are only about right."""

_REFUSED = 1.0  # the same from which they are wrong, and their standard deviations too small
_OPEN = 1e-12  # eigenvalue over the largest of movements that the prior does not hold at all
_GENERATORS = np.array(
    [
        [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
        [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    ]
)


def prior_bending(prior: GivenPrior) -> float:
    """Return by how much movements as likely as not bend the shape, in its standard deviations.

    The root mean square over the movements; only places of points and photos are looked at.
    """
    rows = np.flatnonzero(prior.axis < 3)
    owners, of = np.unique(
        np.column_stack((prior.of_point[rows], prior.owner[rows])), axis=0, return_inverse=True
    )
    of = of.reshape(-1)
    if len(owners) < 3:
        return 0.0
    at = np.full((len(owners), 3), np.nan)
    axis = prior.axis[rows]
    at[of, axis] = prior.value[rows]
    # what is not given lies in the middle
    at = np.nan_to_num(at - [np.nanmean(part) if np.isfinite(part).any() else 0.0 for part in at.T])
    extent = max(float(np.abs(at).max()), 1e-9)
    effects = (similarity_effects(at) / np.array([1.0] * 3 + [extent] * 4))[of, axis]
    covariance = prior.covariance[np.ix_(rows, rows)]
    size = prior.sigma[rows]
    lower = np.linalg.cholesky(covariance / size[:, None] / size)

    def whitened(values: Array) -> Array:
        out: Array = solve_triangular(lower, values / size[:, None], lower=True)
        return out

    moved = whitened(effects)
    base, singular, right = np.linalg.svd(moved, full_matrices=False)
    held = singular > np.sqrt(_OPEN) * singular[0]
    base = base[:, held]
    root = (right[held].T / singular[held])[3:]
    spread = root @ root.T
    products = np.einsum("iab,jbc->ijac", _GENERATORS, _GENERATORS)
    products = 0.5 * (products + products.transpose(1, 0, 2, 3)) / extent**2
    bent = np.einsum("ijac,oc->oaij", products, at)[of, axis].reshape(len(rows), 16)
    bent = whitened(bent)
    bent = bent - base @ (base.T @ bent)
    each = (bent.T @ bent).reshape(4, 4, 4, 4)
    # of normally distributed movements
    mean = np.einsum("ij,kl,ijkl", spread, spread, each)
    mixed = np.einsum("ik,jl,ijkl", spread, spread, each)
    return float(np.sqrt(max(0.25 * (float(mean) + 2.0 * float(mixed)), 0.0)))


def check_linear(prior: GivenPrior) -> None:
    """Refuse a prior that is far from linear in its own datum.

    Raises
    ------
    InputError
        It is.
    """
    bending = prior_bending(prior)
    if bending > _REFUSED:
        raise InputError(
            f"{prior.source}: its datum is too weak to be carried on: movements as likely as its "
            f"covariance says bend the shape of what is given by {bending:.2g} of its standard "
            f"deviations, at most {_REFUSED:g} goes; adjust both blocks together, or with better "
            "control first"
        )
