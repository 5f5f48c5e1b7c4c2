"""What a calibration certificate says of a metric camera: data, and nothing computed."""

from __future__ import annotations

from dataclasses import dataclass
from math import fsum
from typing import NamedTuple, Self

__all__ = [
    "BrownLens",
    "CameraCalibration",
    "Fiducial",
    "FiducialDistance",
    "RadialPolynomial",
    "RadialTable",
    "pixel_size",
]


def pixel_size(pixel_um: float | None) -> float:
    """Return the size of a pixel [mm]; a thousandth where none is stated [um]."""
    return 1e-3 * (1.0 if pixel_um is None else pixel_um)


class Fiducial(NamedTuple):
    """A fiducial mark and its calibrated coordinates [mm] in the fiducial system."""

    id: str
    x: float
    y: float


class FiducialDistance(NamedTuple):
    """The calibrated distance [mm] between the fiducials `first` and `second`."""

    first: str
    second: str
    mm: float


@dataclass(frozen=True, slots=True)
class BrownLens:
    """A lens as computer vision states it: from ideal to measured coordinates (COLMAP's OPENCV).

    Attributes
    ----------
    k1, k2, k3, p1, p2, b1, b2
        On coordinates divided by c, about the principal point; p1 and p2 with y down
        (`photogrammetry/lens.py`).
    """

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    b1: float = 0.0
    b2: float = 0.0

    @property
    def coefficients(self) -> tuple[float, ...]:
        """(7,) k1, k2, k3, p1, p2, b1, b2."""
        return self.k1, self.k2, self.k3, self.p1, self.p2, self.b1, self.b2


@dataclass(frozen=True, slots=True)
class RadialPolynomial:
    """Radial distortion dr = K0 r + K1 r^3 + K2 r^5 + K3 r^7, r and dr in mm.

    Attributes
    ----------
    k
        K0, K1, K2, K3 [1, mm^-2, mm^-4, mm^-6].
    """

    k: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class RadialTable:
    """Radial distortion as a certificate lists it.

    Attributes
    ----------
    radius
        Measured radii [mm], increasing, none negative.
    dr_um
        Distortion at each [um]; 0 at radius 0.
    diagonals_um
        Distortions of the half-diagonals at each [um], whose mean `dr_um` is; none where a radius
        has one distortion.
    """

    radius: tuple[float, ...]
    dr_um: tuple[float, ...]
    diagonals_um: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def of_diagonals(cls, radius: tuple[float, ...], um: tuple[tuple[float, ...], ...]) -> Self:
        """Return the table of distortions of one or several half-diagonals at each radius."""
        mean = tuple(fsum(row) / len(row) for row in um)
        return cls(radius, mean, um if any(len(row) > 1 for row in um) else ())

    def spread(self) -> tuple[float, float] | None:
        """Return how far half-diagonals are off their mean [um] at most, and at which radius [mm].

        None where there is one half-diagonal only.
        """
        if not self.diagonals_um:
            return None
        off = [
            max(abs(one - mean) for one in row)
            for mean, row in zip(self.dr_um, self.diagonals_um, strict=True)
        ]
        most = max(off)
        return most, self.radius[off.index(most)]


@dataclass(frozen=True, slots=True)
class CameraCalibration:
    """A camera's calibration.

    Fiducials are known by their coordinates, or only by distances between them, or not at all.
    With distances only, the first runs along +x and the second along +y, each from its first to
    its second fiducial; the origin is the fiducial centre.

    Attributes
    ----------
    id
        Name of the camera.
    c
        Camera constant [mm].
    principal_point
        Its coordinates [mm] in the fiducial system.
    format
        Width along x and height along y [mm], or None.
    fiducials
        Calibrated fiducials, in file order.
    distances
        Calibrated distances between fiducials, in file order.
    distance_sigma_um
        Standard deviation [um] of a calibrated distance.
    radial
        Radial distortion, or None. Its sign: dr is subtracted from the measured radius to give
        the ideal one.
    decentring
        P1, P2 [mm^-1]; dx = P1 (r^2 + 2 x^2) + 2 P2 x y and dy = P2 (r^2 + 2 y^2) + 2 P1 x y are
        subtracted likewise.
    symmetry_point
        About which point [mm] of the fiducial system all distortion is, or None: the principal
        point.
    lens
        What stands between ideal coordinates and those that are measured about the principal
        point, instead of `radial` and `decentring`; or None.
    pixels, pixel_um, principal_px
        Of a camera whose images have pixels, as `Camera` has them; they are its format then.
    """

    id: str
    c: float
    principal_point: tuple[float, float] = (0.0, 0.0)
    format: tuple[float, float] | None = None
    fiducials: tuple[Fiducial, ...] = ()
    distances: tuple[FiducialDistance, ...] = ()
    distance_sigma_um: float = 2.0
    radial: RadialPolynomial | RadialTable | None = None
    decentring: tuple[float, float] = (0.0, 0.0)
    symmetry_point: tuple[float, float] | None = None
    lens: BrownLens | None = None
    pixels: tuple[int, int] | None = None
    pixel_um: float | None = None
    principal_px: tuple[float, float] | None = None

    @property
    def distorts(self) -> bool:
        """Whether a lens or a distortion is stated."""
        return self.lens is not None or self.corrects

    @property
    def corrects(self) -> bool:
        """Whether a distortion is stated, which image coordinates are without."""
        return self.radial is not None or any(self.decentring)

    def fiducial_names(self) -> tuple[str, ...]:
        """Return the names of all fiducials, in the order in which the certificate names them."""
        if self.fiducials:
            return tuple(mark.id for mark in self.fiducials)
        ends = (end for d in self.distances for end in (d.first, d.second))
        return tuple(dict.fromkeys(ends))
