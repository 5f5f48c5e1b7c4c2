"""Whether the a-priori sigma of the image coordinates is in another unit, or wrong."""

from __future__ import annotations

from typing import NamedTuple

from anaplot.adjustment.scale import common_factor
from anaplot.aliases import Array

__all__ = ["SigmaDoubt", "doubt_of"]

_LEAST_UM = 0.01  # nobody measures better: coordinates of a simulation without noise, rounded


class SigmaDoubt(NamedTuple):
    """A doubt of `image_um`.

    Attributes
    ----------
    image_um
        As it is given.
    factor
        By which nearly all residuals are off.
    """

    image_um: float
    factor: float

    @property
    def suggested_um(self) -> float:
        """What the residuals suggest."""
        return self.factor * self.image_um

    @property
    def _off(self) -> str:
        times = f"{self.factor:.0f}" if self.factor >= 100.0 else f"{self.factor:.2g}"
        return (
            f"nearly all residuals in the images are {times} times what image_um = "
            f"{self.image_um:g} of [precision] in block.toml says"
        )

    def of_given(self, *, stated: bool) -> str:
        """Return the doubt as a sentence where the photos by themselves raise none.

        `stated`: whether positions or angles of photos are.
        """
        control, others = "control", ""
        if stated:
            control, others = "what is given", ", a stated position or angle"
        return (
            f"{self._off}, but without {control} the photos agree with it: is a control point "
            f"wrong{others}, or the camera?"
        )

    def __str__(self) -> str:
        """Return the doubt as a sentence."""
        other = ""
        if self.factor > 1.0:
            # these are off everywhere as well, and no test of single observations tells them apart
            other = "; or is the camera, a lens or the inner orientation wrong?"
        return (
            f"{self._off}: is it in another unit than um, or wrong? They suggest "
            f"{self.suggested_um:.2g} um{other}"
        )


def doubt_of(v: Array, r: Array, image_um: float) -> SigmaDoubt | None:
    """Return the doubt that residuals raise; None where they raise none.

    Parameters
    ----------
    v, r
        (m, 2) residuals of the image coordinates in their a-priori sigmas, redundancy numbers.
    image_um
        The a-priori sigma of an image coordinate [um].
    """
    factor = common_factor(v.ravel(), r.ravel())
    if factor is None:
        return None
    doubt = SigmaDoubt(image_um, factor)
    return doubt if doubt.suggested_um >= _LEAST_UM else None
