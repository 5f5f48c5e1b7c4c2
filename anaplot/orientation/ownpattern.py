"""A pattern of points of one's own, measured like those that have names."""

from __future__ import annotations

from dataclasses import dataclass

from anaplot.aliases import Side
from anaplot.orientation.patterns import Pattern

__all__ = ["OwnPattern", "PointPattern"]


@dataclass(frozen=True, slots=True)
class OwnPattern:
    """A pattern of orientation points whose places a person has chosen.

    The largest x of its points is the base for which they were chosen. In a model of another base
    they lie at the same part of it, and at the same y.

    Attributes
    ----------
    name
        What the journal calls it: its file.
    points
        (label, x, y) of every point in the left photo [mm], in the order of measurement.
    ties
        Labels of the points that a model shares with the preceding one.
    """

    name: str
    points: tuple[tuple[str, float, float], ...]
    ties: tuple[str, ...] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of its points in the order of measurement."""
        return tuple(label for label, _, _ in self.points)

    @property
    def usual_base(self) -> float:
        """The base [mm] for which its points were chosen."""
        return max(x for _, x, _ in self.points)

    @property
    def transferred(self) -> tuple[str, ...]:
        """Labels of the points that are looked for in the preceding model."""
        return self.ties

    def positions(
        self,
        base: float,
        d: float,
        twin: tuple[float, float] = (0.0, 0.0),
    ) -> dict[str, tuple[float, float]]:
        """Return where the points lie in the left photo [mm], photos vertical, ground flat.

        Parameters
        ----------
        base
            Base at photo scale [mm].
        d, twin
            Those of a named pattern; here y, and what is doubled, are as the points say.
        """
        scale = base / self.usual_base
        return {label: (scale * x, y) for label, x, y in self.points}

    def under(self, label: str) -> tuple[Side, str]:
        """Return after which photo a new point is named, and how there: always the left one."""
        return "left", label


PointPattern = Pattern | OwnPattern
"""What the points of a model are planned by."""
