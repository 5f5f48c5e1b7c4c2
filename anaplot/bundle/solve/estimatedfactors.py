"""Factors of stated standard deviations, where the variances of groups were estimated."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["EstimatedFactors"]


class EstimatedFactors(NamedTuple):
    """Estimated standard deviations over stated ones; those of image coordinates are ray by ray.

    Attributes
    ----------
    control, expected, position, rotation, additional
        Of weighted control, of priors of points, on positions, on rotations and on additional
        parameters; 1 where there are none, of held ones what they are held at.
    control_degrees
        Degrees of freedom that the variance of control is estimated with; None where it is none.
    """

    control: float = 1.0
    expected: float = 1.0
    position: float = 1.0
    rotation: float = 1.0
    additional: float = 1.0
    control_degrees: float | None = None

    def times(self, others: EstimatedFactors) -> EstimatedFactors:
        """Return the factors of both together."""
        return EstimatedFactors(
            self.control * others.control,
            self.expected * others.expected,
            self.position * others.position,
            self.rotation * others.rotation,
            self.additional * others.additional,
            others.control_degrees or self.control_degrees,
        )

    @property
    def check(self) -> float:
        """That of check points: they are control held back, and err as it was seen to, if it was.

        Where a variance is held nothing was seen of it, and they err as they state.
        """
        return 1.0 if self.control_degrees is None else self.control
