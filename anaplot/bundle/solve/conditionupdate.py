"""What conditions between points change of an adjustment without them.

With B the whitened derivatives of q contrasts (see `anaplot.bundle.solve.conditions`), N the
normal equations of all other observations, G = N^-1 B' and M = I + B G,

    (N + B'B)^-1 = N^-1 - G M^-1 G',    R_BB = M^-1,

R being Q_vv P of the contrasts: q more solutions of the equations whose points are eliminated one
by one, whatever points the conditions tie together. A weight that grows beyond all limits leaves
everything finite but R_BB, which goes to zero as it should.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.conditions import ConditionEquations, Conditions

__all__ = ["ConditionUpdate"]

_Solutions = tuple[Array, Array, Array]  # of photos (n, d, k), of points (p, 3, k), shared (g, k)


@dataclass(frozen=True, eq=False)
class ConditionUpdate:
    """The conditions at a state, and what they change.

    Attributes
    ----------
    equations
        The conditions.
    photos, points, shared
        (n, d, q), (p, 3, q), (g, q): G.
    inner
        (q, q) M^-1, the matrix R of the contrasts.
    """

    equations: ConditionEquations = field(repr=False)
    photos: Array = field(repr=False)
    points: Array = field(repr=False)
    shared: Array = field(repr=False)
    inner: Array = field(repr=False)

    @classmethod
    def of(
        cls, conditions: Conditions, equations: ConditionEquations, gain: _Solutions
    ) -> ConditionUpdate:
        """Return the update by conditions whose G is known.

        Raises
        ------
        NotComputableError
            Conditions free of error depend on each other or on control free of error.
        """
        photos, points, shared = gain
        q = points.shape[2]
        spread = equations.whitened @ points.reshape(-1, q)
        spread = 0.5 * (spread + spread.T)
        conditions.check_firm(equations, spread)
        # scaled to a unit diagonal: what is free of error stands beside what is not
        size = 1.0 / np.sqrt(1.0 + np.diag(spread))
        scaled = (np.eye(q) + spread) * size[:, None] * size
        inner = np.linalg.inv(scaled) * size[:, None] * size
        return cls(equations, photos, points, shared, 0.5 * (inner + inner.T))

    @property
    def gain(self) -> _Solutions:
        """Of G, the parts of photos, points and shared parameters."""
        return self.photos, self.points, self.shared

    @property
    def rows(self) -> Array:
        """(n, n) R of the conditions' rows."""
        contrasts = self.equations.contrasts
        out: Array = contrasts @ (contrasts @ self.inner).T
        return out

    def multipliers(self, points: Array, e: Array | float = 0.0) -> Array:
        """Return (q, k) misclosures that the adjustment leaves, in standard deviations.

        Parameters
        ----------
        points
            (p, 3, k) solutions without the conditions.
        e
            (q, k) misclosures before.
        """
        out: Array = self.inner @ (
            self.equations.whitened @ points.reshape(-1, points.shape[2]) + e
        )
        return out

    def applied(self, found: _Solutions, e: Array | float = 0.0) -> _Solutions:
        """Return k solutions with the conditions, of those without; see `multipliers`."""
        photos, points, shared = found
        left = self.multipliers(points, e)
        return photos - self.photos @ left, points - self.points @ left, shared - self.shared @ left
