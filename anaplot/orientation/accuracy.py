"""How accurate a measured model is: its orientation, and its points (1983, the trace of Q_gg)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from anaplot.aliases import Array
from anaplot.orientation.idealmodel import trace_in_bases
from anaplot.orientation.results import ModelSolution

__all__ = ["ModelAccuracy", "model_accuracy"]

_ELEMENTS = ("bx", "by", "bz", "omega", "phi", "kappa")


@dataclass(frozen=True, slots=True, eq=False)
class ModelAccuracy:
    """Standard deviations of a model, its left photo held.

    Attributes
    ----------
    sigma_um
        The sigma0 that they are for [um]: the one that the model's test uses; None where that is
        to be estimated and cannot be. Standard deviations are then NaN.
    elements
        Names of the orientation's elements: "bx" [mm] where there is a scale to be taken over,
        "by", "bz" [mm], "omega", "phi", "kappa" [rad].
    deviations
        (u,) their standard deviations.
    correlations
        (u, u) their correlations.
    trace
        Of the cofactors Q_gg of the unknowns, lengths in units of the base.
    points
        (n, 3) standard deviations [mm] of the model coordinates of the model's points.
    """

    sigma_um: float | None
    elements: tuple[str, ...]
    deviations: Array = field(repr=False)
    correlations: Array = field(repr=False)
    trace: float
    points: Array = field(repr=False)

    def of(self, element: str) -> float | None:
        """Return the standard deviation of an element; None where it is held or not known."""
        if self.sigma_um is None or element not in self.elements:
            return None
        return float(self.deviations[self.elements.index(element)])

    @property
    def rms(self) -> Array:
        """(3,) root mean square of the points' standard deviations [mm]; none at infinity."""
        near = self.points[np.isfinite(self.points).all(axis=1)]
        return np.asarray(np.sqrt(np.sum(near**2, axis=0) / max(len(near), 1)))

    @property
    def strongest(self) -> tuple[str, str, float]:
        """The two elements that are correlated most, and how."""
        size = np.triu(np.abs(self.correlations), 1)
        i, j = np.unravel_index(int(np.argmax(size)), size.shape)
        return self.elements[i], self.elements[j], float(self.correlations[i, j])


def model_accuracy(model: ModelSolution) -> ModelAccuracy:
    """Return how accurate a model is.

    By and bz are bx beta_y and bx beta_z; the angles are those of the right photo in the strip's
    system with the left one held. Under tie variance "exact" the errors that the ties bring along
    are in it, else ties count as the weights have them.
    """
    bx, by, bz = model.base
    elements = _ELEMENTS if "bx" in model.unknowns else _ELEMENTS[1:]
    by_unknown = {
        "bx": {"bx": 1.0},
        "by": {"bx": by / bx, "beta_y": bx},
        "bz": {"bx": bz / bx, "beta_z": bx},
        **{angle: {angle: 1.0} for angle in _ELEMENTS[3:]},
    }
    jacobian = np.array(
        [[by_unknown[e].get(unknown, 0.0) for unknown in model.unknowns] for e in elements]
    )
    cofactors = jacobian @ model.q_gg @ jacobian.T
    root = np.sqrt(np.einsum("ii->i", cofactors))
    correlations = np.clip(cofactors / root[:, None] / root, -1.0, 1.0)
    np.einsum("ii->i", correlations)[:] = 1.0
    factor = model.test.factor(model.tested.sigma0)
    sigma = None if factor is None else factor * model.apriori_um
    sigma_mm = np.nan if sigma is None else 1e-3 * sigma
    spread = np.maximum(np.einsum("kaa->ka", model.q_points), 0.0)
    return ModelAccuracy(
        sigma,
        elements,
        sigma_mm * root,
        correlations,
        trace_in_bases(model, abs(bx)),
        sigma_mm * np.sqrt(spread),
    )
