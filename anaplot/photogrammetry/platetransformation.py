"""From the plotter's plate to the photograph's fiducial system, and back.

Every kind is a case of one form. The plate coordinates are first brought into axes that lie as
the image's do, (xi, eta) = f0 + F (x, y), so that a product of coordinates means the same however
the plate lies in its holder; then

    x = (a0 + a1 xi + a2 eta + a3 xi eta) / (1 + c1 xi + c2 eta), and y alike.

Here is what a transformation is; where places lead by it, `anaplot.photogrammetry.plateform` says.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot, pi, remainder, sin, tau
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

from anaplot.aliases import Array

if TYPE_CHECKING:
    from anaplot.photogrammetry.plateform import PlateForm

__all__ = [
    "TITLES",
    "TRANSFORMATIONS",
    "Placement",
    "PlateTransformation",
    "TransformationName",
    "random_placement",
]


TransformationName = Literal["distances", "scales", "helmert", "affine", "bilinear", "projective"]

TRANSFORMATIONS: tuple[TransformationName, ...] = get_args(TransformationName)
"""Names of all transformations that measured fiducials may determine."""

TITLES: dict[str, str] = {
    "identity": "the identity",
    "distances": "the two-parameter similarity",
    "scales": "scales along x and y",
    "helmert": "the Helmert transformation",
    "affine": "the affine transformation",
    "bilinear": "the bilinear transformation",
    "projective": "the projective transformation",
}
"""What a person calls them."""

_LARGEST = 1e15  # of a number in a transformation: no product of them overflows

Row4 = tuple[float, float, float, float]


class Placement(NamedTuple):
    """How a photograph lies on the plate, and what its film has done since exposure.

    Attributes
    ----------
    x, y
        Plate coordinates [mm] of the origin of the fiducial system.
    rotation
        Direction of the photograph's x axis on the plate [rad], from the plate's x towards its y,
        in (-pi, pi].
    shear
        How far the angle from x to y has opened beyond a right angle [rad].
    scale_x, scale_y
        Plate millimetres for one millimetre along the photograph's x and y.
    mirrored
        Whether the plate shows the photograph from behind.
    """

    x: float
    y: float
    rotation: float = 0.0
    shear: float = 0.0
    scale_x: float = 1.0
    scale_y: float = 1.0
    mirrored: bool = False

    @property
    def shrinkage_ppm(self) -> tuple[float, float]:
        """Film shrinkage along x and y, parts per million; negative where the film has grown."""
        return (1.0 - self.scale_x) * 1e6, (1.0 - self.scale_y) * 1e6

    def transformation(self) -> PlateTransformation:
        """Return the affine transformation of a plate that lies so.

        Raises
        ------
        ValueError
            Scales that are not positive, or a shear of a right angle or more.
        """
        if not (self.scale_x > 0.0 and self.scale_y > 0.0 and abs(self.shear) < pi / 2):
            raise ValueError(f"not a placement: {self}")
        side = -1.0 if self.mirrored else 1.0
        across = self.rotation + side * (pi / 2 + self.shear)
        # columns: one millimetre along the photograph's x and y, seen on the plate
        a, c = self.scale_x * cos(self.rotation), self.scale_x * sin(self.rotation)
        b, d = self.scale_y * cos(across), self.scale_y * sin(across)
        determinant = a * d - b * c
        f = (d / determinant, -b / determinant, -c / determinant, a / determinant)
        return PlateTransformation(
            "affine",
            (
                (-(f[0] * self.x + f[1] * self.y), f[0], f[1]),
                (-(f[2] * self.x + f[3] * self.y), f[2], f[3]),
            ),
        )


@dataclass(frozen=True, slots=True)
class PlateTransformation:
    """A transformation plate -> image and its exact inverse; without arguments, the identity.

    "Image" is the camera's fiducial system here; `refinement` goes on from there.

    Attributes
    ----------
    kind
        Which terms are in use; "identity" where the plate is the image.
    frame
        (f0, F) by rows: plate [mm] to (xi, eta).
    numerator
        a0, a1, a2, a3 of x and of y [mm].
    denominator
        c1, c2.

    Raises
    ------
    ValueError
        A number is not finite, or the frame is singular.
    """

    kind: TransformationName | Literal["identity"] = "identity"
    frame: tuple[tuple[float, float, float], tuple[float, float, float]] = (
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
    )
    numerator: tuple[Row4, Row4] = ((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))
    denominator: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        numbers = (*self.frame[0], *self.frame[1], *self.numerator[0], *self.numerator[1])
        # a comparison that what is not a number fails too
        if not all(abs(number) <= _LARGEST for number in (*numbers, *self.denominator)):
            raise ValueError("a transformation of numbers that are not finite, or far too large")
        (_, a, b), (_, c, d) = self.frame
        if not abs(a * d - b * c) > 1e-12 * (hypot(a, b) * hypot(c, d)):
            raise ValueError("a transformation that folds the plate into a line")

    @property
    def form(self) -> PlateForm:
        """The same as arrays, which says of many places where they lead."""
        from anaplot.photogrammetry.plateform import PlateForm  # what no place is asked of has none

        return PlateForm.of(self.frame, self.numerator, self.denominator)

    def to_image(self, plate: Array) -> Array:
        """Return image coordinates in the fiducial system.

        Parameters
        ----------
        plate
            (n, 2) plate coordinates [mm].

        Returns
        -------
        ndarray
            (n, 2) [mm]; infinite or NaN on the vanishing line of a projective transformation.
        """
        return self.form.to_image(plate)

    def jacobian(self, plate: Array) -> Array:
        """Return (n, 2, 2) derivatives of `to_image` at (n, 2) plate coordinates [mm]."""
        return self.form.jacobian(plate)

    def to_plate(self, image: Array) -> Array:
        """Return plate coordinates, the inverse of `to_image`.

        Parameters
        ----------
        image
            (n, 2) coordinates [mm] in the fiducial system.

        Raises
        ------
        NotComputableError
            A place to which no place of the plate belongs.
        """
        return self.form.to_plate(image)

    def placement(self) -> Placement:
        """Return how the photograph lies on the plate, at the origin of the fiducial system.

        For kinds with product or projective terms this is the placement of the affine
        transformation that touches them there.

        Raises
        ------
        NotComputableError
            The origin has no place on the plate.
        """
        (x, y), ((ax, bx), (ay, by)) = self.form.origin()
        mirrored = ax * by - ay * bx < 0.0
        rotation, across = atan2(ay, ax), atan2(by, bx)
        opening = rotation - across if mirrored else across - rotation
        shear = remainder(opening - pi / 2, tau)
        return Placement(
            x, y, pi if rotation == -pi else rotation, shear, hypot(ax, ay), hypot(bx, by), mirrored
        )


def random_placement(seed: int) -> PlateTransformation:
    """Lay a photograph on a plate as a hand would; `to_plate` leads from image to plate.

    It lies up to 2 mm beside the zero point, turned by up to .02 rad, and the film has shrunk or
    grown by up to 500 ppm along x and y each.

    Parameters
    ----------
    seed
        The same seed gives the same placement.
    """
    from numpy.random import default_rng

    draw = default_rng(seed).uniform(-1.0, 1.0, 5).tolist()
    return Placement(
        x=2.0 * draw[0],
        y=2.0 * draw[1],
        rotation=0.02 * draw[2],
        scale_x=1.0 - 500.0 * 1e-6 * draw[3],
        scale_y=1.0 - 500.0 * 1e-6 * draw[4],
    ).transformation()
