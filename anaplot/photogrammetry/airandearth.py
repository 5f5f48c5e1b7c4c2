"""What displaces an image before the lens: refraction in the air, and the earth's curvature.

Both are radial about the nadir, which near vertical photographs have in the principal point. A ray
from the ground at height h bends on its way up to the camera at height H, and arrives further from
the nadir than the straight line would by K tan a. From Snell's law in a plane-parallel atmosphere,

    K = mean of n from h to H - n(H),

where n - 1 is proportional to the density of the air (Gladstone and Dale): by the hydrostatic
equation the mean density is (P(h) - P(H)) / (g (H - h)), so that K is closed in the pressure and
density of the standard atmosphere (ISO 2533:1975). It agrees within 3 % to 9 km with Saastamoinen's
(1974) K = 13e-6 (H - h) (1 - .02 (2 H + h)), heights in km. In the image,

    refraction  dr = K (r + r^3 / c^2), outwards,
    curvature   dr = (H - h) r^3 / (2 R c^2), inwards,

the latter since a point at the distance D from the nadir lies D^2 / (2 R) below the plane of the
map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp

__all__ = ["HIGHEST", "LOWEST", "AirAndEarth", "refraction_constant"]

LOWEST, HIGHEST = -500.0, 20_000.0
"""Heights [m] of the standard atmosphere here."""

_RADIUS = 6_371_000.0  # m, of the earth
_G = 9.80665  # m / s^2
_GAS = 287.05287  # J / (kg K), of dry air
_SEA_KELVIN, _LAPSE = 288.15, 0.0065  # at sea level; K / m up to the tropopause
_SEA_PASCAL = 101_325.0
_TROPOPAUSE = 11_000.0  # m; above it the temperature stays
_REFRACTIVITY = 2.77e-4 / 1.225  # n - 1 by density [m^3 / kg]: visible light, 15 degrees, sea level


@dataclass(frozen=True, slots=True)
class AirAndEarth:
    """What of air and earth is taken off the image coordinates of near vertical photographs.

    Attributes
    ----------
    flying_height, ground_height
        Above sea level [m].
    refraction, earth_curvature
        Whether it is taken off.
    """

    flying_height: float
    ground_height: float
    refraction: bool = False
    earth_curvature: bool = False

    def parts(self) -> list[tuple[str, AirAndEarth]]:
        """Return what is taken off, each by itself and with its name."""
        parts = (
            ("refraction", replace(self, earth_curvature=False)),
            ("earth curvature", replace(self, refraction=False)),
        )
        return [(what, one) for what, one in parts if one.refraction or one.earth_curvature]

    def radial(self, c: float) -> tuple[float, float]:
        """Return the terms of dr in r [1] and r^3 [mm^-2], in a camera of constant `c` [mm]."""
        linear = cubic = 0.0
        if self.refraction:
            linear = refraction_constant(self.flying_height, self.ground_height)
            cubic = linear / c**2
        if self.earth_curvature:
            cubic -= (self.flying_height - self.ground_height) / (2.0 * _RADIUS * c**2)
        return linear, cubic


def refraction_constant(flying_height: float, ground_height: float) -> float:
    """Return K [rad]: a ray under the angle a from the nadir is bent by K tan a.

    Parameters
    ----------
    flying_height, ground_height
        Above sea level [m], from `LOWEST` to `HIGHEST`, the first above the second.
    """
    above, density = _air(flying_height)
    below, _ = _air(ground_height)
    mean = (below - above) / (_G * (flying_height - ground_height))
    return _REFRACTIVITY * (mean - density)


def _air(height: float) -> tuple[float, float]:
    """Return pressure [Pa] and density [kg / m^3] of the standard atmosphere."""
    kelvin = _SEA_KELVIN - _LAPSE * min(height, _TROPOPAUSE)
    pascal = _SEA_PASCAL * (kelvin / _SEA_KELVIN) ** (_G / (_LAPSE * _GAS))
    if height > _TROPOPAUSE:
        pascal *= exp(-_G * (height - _TROPOPAUSE) / (_GAS * kelvin))
    return pascal, pascal / (_GAS * kelvin)
