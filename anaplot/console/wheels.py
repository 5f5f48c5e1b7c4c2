"""The handwheels: how wide the field of view is, and how far one press of a key moves the mark.

The step belongs to the field: a fine one is a fiftieth of its width, about one dot of the picture,
so what is seen is what can be set; a coarse one is ten times that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = ["FIELDS", "Wheels"]

FIELDS = (20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05)  # mm
_STEPS = 50
_COARSER = 10


@dataclass(frozen=True, slots=True)
class Wheels:
    """Field of view and step.

    Attributes
    ----------
    zoom
        Place in `FIELDS`.
    coarse
        Whether the plain keys take coarse steps.
    """

    zoom: int = FIELDS.index(1.0)
    coarse: bool = False

    @property
    def field_mm(self) -> float:
        """Width of the field [mm]."""
        return FIELDS[self.zoom]

    def step_um(self, *, coarse: bool = False) -> int:
        """Return the step [um] of the plain keys, or that of the coarse ones."""
        fine = round(1000.0 * self.field_mm / _STEPS)
        return fine * _COARSER if coarse or self.coarse else fine

    def zoomed(self, by: int) -> Wheels:
        """Return the wheels with a field so many places smaller; either end holds."""
        return replace(self, zoom=min(max(self.zoom + by, 0), len(FIELDS) - 1))

    def toggled(self) -> Wheels:
        """Return the wheels with the other step."""
        return replace(self, coarse=not self.coarse)
