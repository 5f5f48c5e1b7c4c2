"""The handwheels: how wide the field of view is, and how far one press of a key moves the mark.

The step belongs to the field: a fine one is a fiftieth of its width, about one dot of the picture,
so what is seen is what can be set; a coarse one is ten times that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = ["FIELDS", "TURNS", "Wheels"]

FIELDS = (20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05)  # mm
_STEPS = 50
_COARSER = 10

_FINE = {  # steps of x, y, px, py
    "left": (-1, 0, 0, 0),
    "right": (1, 0, 0, 0),
    "up": (0, 1, 0, 0),
    "down": (0, -1, 0, 0),
    "page_up": (0, 0, 1, 0),
    "page_down": (0, 0, -1, 0),
    "py_more": (0, 0, 0, 1),
    "py_less": (0, 0, 0, -1),
}
_FAR = {
    "far_left": "left",
    "far_right": "right",
    "far_up": "up",
    "far_down": "down",
    "far_px_more": "page_up",
    "far_px_less": "page_down",
    "far_py_more": "py_more",
    "far_py_less": "py_less",
}
TURNS = frozenset(_FINE) | frozenset(_FAR)
"""The actions that turn the handwheels."""


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

    def turned(self, action: str) -> tuple[float, float, float, float]:
        """Return how far one of `TURNS` turns x, y, px and py [mm]."""
        step = self.step_um(coarse=action in _FAR) / 1000.0
        x, y, px, py = _FINE[_FAR.get(action, action)]
        return x * step, y * step, px * step, py * step

    def zoomed(self, by: int) -> Wheels:
        """Return the wheels with a field so many places smaller; either end holds."""
        return replace(self, zoom=min(max(self.zoom + by, 0), len(FIELDS) - 1))

    def toggled(self) -> Wheels:
        """Return the wheels with the other step."""
        return replace(self, coarse=not self.coarse)
