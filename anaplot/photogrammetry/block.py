"""The block's frozen dataclasses: what a person declares and measures, and nothing computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

from anaplot.aliases import TestKind
from anaplot.photogrammetry.airandearth import AirAndEarth
from anaplot.photogrammetry.camera import BrownLens, CameraCalibration, pixel_size
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.photogrammetry.imagepoint import ImagePoint, Use, image_points
from anaplot.photogrammetry.imagepoints import ImagePoints
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.photogrammetry.posterior import Posterior
from anaplot.photogrammetry.prioroffsets import PriorOffsets

__all__ = [
    "Block",
    "Camera",
    "ControlPoint",
    "ControlUse",
    "ImagePoint",
    "ImagePoints",
    "Measuring",
    "PatternPoint",
    "Photo",
    "PointPrior",
    "Precision",
    "Strip",
    "TestSettings",
    "TieVariance",
    "Use",
    "calibrated_camera",
    "image_points",
    "in_pixels",
]

ControlUse = Literal["control", "check", "off"]

TieVariance = Literal["paper", "propagated", "exact"]


@dataclass(frozen=True, slots=True)
class Camera:
    """A metric camera.

    Attributes
    ----------
    id
        Name by which photos refer to it.
    c
        Camera constant [mm].
    format
        Width along x and height along y [mm], or None when not stated.
    calibration
        Content of the camera's file: fiducials, principal point, distortion; or None.
    file
        Name of that file as block.toml gives it, or None.
    pixels
        Width and height of its images [px], or None: then nothing is measured in pixels.
    pixel_um
        Size of a pixel [um], or None: not stated. It counts as 1, and lengths are shown in px.
    principal_px
        Principal point [px] from the upper left corner of the upper left pixel, y down; None: the
        middle of the image.
    lens
        What stands between ideal image coordinates and measured ones, or None.
    lever_arm
        Where the antenna is whose positions are stated, seen from the projection centre, in the
        axes of the image [m]; None: they are those of the projection centre.
    """

    id: str
    c: float
    format: tuple[float, float] | None = None
    calibration: CameraCalibration | None = None
    file: str | None = None
    pixels: tuple[int, int] | None = None
    pixel_um: float | None = None
    principal_px: tuple[float, float] | None = None
    lens: BrownLens | None = None

    @property
    def pixel_mm(self) -> float:
        """Size of a pixel [mm]; a thousandth where none is stated."""
        return pixel_size(self.pixel_um)

    @property
    def lens_parameters(self) -> tuple[float, ...]:
        """(10,) c, x0, y0, k1, k2, k3, p1, p2, b1, b2 as block.toml states them [mm, 1]."""
        lens = (0.0,) * 7 if self.lens is None else self.lens.coefficients
        return (self.c, 0.0, 0.0, *lens)

    lever_arm: tuple[float, float, float] | None = None

    def reach(self) -> tuple[float, float]:
        """Return the largest abs(x) and abs(y) [mm] that a coordinate in this camera can have.

        Without a format, coordinates up to 4 c are believed.
        """
        if self.format is None:
            return 4.0 * self.c, 4.0 * self.c
        return self.format[0] / 2.0, self.format[1] / 2.0


def in_pixels(
    camera: Camera,
    pixels: tuple[int, int],
    pixel_um: float | None = None,
    principal_px: tuple[float, float] | None = None,
) -> Camera:
    """Return a camera whose images have pixels; their size is its format."""
    made = replace(camera, pixels=pixels, pixel_um=pixel_um, principal_px=principal_px)
    return replace(made, format=(pixels[0] * made.pixel_mm, pixels[1] * made.pixel_mm))


def calibrated_camera(calibration: CameraCalibration, file: str | None = None) -> Camera:
    """Return a camera as its file states it, with the lens and the pixels that stand there."""
    of = calibration
    camera = Camera(of.id, of.c, of.format, calibration, file, lens=of.lens)
    if of.pixels is None:
        return camera
    return in_pixels(camera, of.pixels, of.pixel_um, of.principal_px)


@dataclass(frozen=True, slots=True)
class Photo:
    """A photograph and what is known beforehand of its exterior orientation.

    Attributes
    ----------
    id, camera
        Names of the photo and of its camera.
    position, position_sigma
        Projection centre [m] in the ground system and its standard deviations, or None; that of
        the antenna where the camera has a lever arm.
    rotation, rotation_sigma
        omega, phi, kappa [rad] and their standard deviations [rad], or None.
    time
        When it was taken [s], from anywhere; or None.
    """

    id: str
    camera: str
    position: tuple[float, float, float] | None = None
    rotation: tuple[float, float, float] | None = None
    position_sigma: tuple[float, float, float] | None = None
    rotation_sigma: tuple[float, float, float] | None = None
    time: float | None = None


@dataclass(frozen=True, slots=True)
class Strip:
    """Photos in flight order.

    Attributes
    ----------
    id
        Name of the strip.
    photos
        Names of its photos, in the order of flight.
    base
        Nominal base of the first model [mm at photo scale], a positive magnitude, or None for
        the mean x-parallax.
    """

    id: str
    photos: tuple[str, ...]
    base: float | None = None

    def models(self) -> tuple[tuple[str, str], ...]:
        """Return the (left, right) pairs of consecutive photos."""
        return tuple(zip(self.photos, self.photos[1:], strict=False))


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """A ground control or check point.

    Attributes
    ----------
    point
        Name.
    xyz
        Ground coordinates [m]; None where a coordinate is not known.
    sigma
        Standard deviations [m]; 0 means free of error, None the block's default.
    use
        "control", "check" or "off".
    """

    point: str
    xyz: tuple[float | None, float | None, float | None]
    sigma: tuple[float | None, float | None, float | None] = (None, None, None)
    use: ControlUse = "control"


@dataclass(frozen=True, slots=True)
class PointPrior:
    """What is known of a point beforehand, and is no control: `use` = prior.

    Attributes
    ----------
    point
        Name; the point may be control or a check point as well.
    xyz
        Expected ground coordinates [m]; None where nothing is known.
    sigma
        Their standard deviations [m], positive.
    """

    point: str
    xyz: tuple[float | None, float | None, float | None]
    sigma: tuple[float | None, float | None, float | None]


@dataclass(frozen=True, slots=True)
class Precision:
    """A-priori precision.

    Attributes
    ----------
    image_um
        A-priori sigma0 [um]: the standard deviation of an image x coordinate.
    tie_variance
        "paper": model coordinates of ties count as free of error; "propagated": they do not;
        "exact": neither, and tests know how the errors of ties are correlated.
    control_m
        Standard deviation [m] of control coordinates that state none.
    """

    image_um: float = 5.0
    tie_variance: TieVariance = "paper"
    control_m: float = 0.05


@dataclass(frozen=True, slots=True)
class TestSettings:
    """The test that flags rows.

    Attributes
    ----------
    kind
        "tau" (Pope: sigma from the adjustment itself) or "baarda" (a-priori sigma0).
    alpha
        Two-sided significance of one row's test.
    power
        Power that smallest detectable errors refer to.
    """

    __test__ = False  # not a test class, whatever a test runner may think of its name

    kind: TestKind = "tau"
    alpha: float = 0.001
    power: float = 0.80


class PatternPoint(NamedTuple):
    """A point of a pattern of one's own.

    Attributes
    ----------
    label
        Its name in the pattern.
    x, y
        Where it lies in the left photo [mm].
    tie
        Whether a model shares it with the preceding one.
    """

    label: str
    x: float
    y: float
    tie: bool


@dataclass(frozen=True, slots=True)
class Measuring:
    """With what the block is measured, where nothing else is asked for.

    Attributes
    ----------
    profile
        Name or file of the instrument's profile, or None.
    pattern
        Name or file of the point pattern of new models, or None for the usual one.
    points
        What stands in that file, where a new one is to be written; None: it is there.
    """

    profile: str | None = None
    pattern: str | None = None
    points: tuple[PatternPoint, ...] | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Block:
    """A block as declared in its folder.

    Attributes
    ----------
    name
        Name of the block.
    precision, test
        Settings.
    cameras, photos, strips
        In file order.
    image_points, control
        Rows of image_points.csv and control.csv, in file order; the former, whatever sequence of
        rows is given, as `ImagePoints`.
    conditions
        Rows of distances.csv, then those of conditions.csv.
    priors
        Rows of control.csv that are priors of points, in file order.
    measuring
        With what it is measured.
    air
        What of air and earth is taken off where plates become image coordinates, or None.
    given
        What an earlier adjustment says of its points and photos, or None: no part of the folder.
    in_pixels
        Whether image_points.csv has x_px, y_px instead of x, y.
    offsets
        What the stated positions and angles of its photos have in common, or None.
    ground
        The coordinate system that the ground coordinates come from, or None: not stated.
    """

    name: str
    precision: Precision
    test: TestSettings
    cameras: tuple[Camera, ...]
    photos: tuple[Photo, ...]
    strips: tuple[Strip, ...]
    image_points: Sequence[ImagePoint] = field(default=(), repr=False)
    control: tuple[ControlPoint, ...] = field(default=(), repr=False)
    conditions: tuple[ObjectCondition, ...] = field(default=(), repr=False)
    priors: tuple[PointPrior, ...] = field(default=(), repr=False)
    measuring: Measuring = Measuring()
    air: AirAndEarth | None = None
    given: Posterior | None = field(default=None, repr=False, compare=False)
    in_pixels: bool = False
    offsets: PriorOffsets | None = None
    ground: GroundSystem | None = None
    _camera_of: dict[str, Camera] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.image_points, ImagePoints):
            object.__setattr__(self, "image_points", ImagePoints(self.image_points))
        # asked for with every measurement; the first of photos, and of cameras, of one name
        known = {camera.id: camera for camera in reversed(self.cameras)}
        of_photo = {p.id: known[p.camera] for p in reversed(self.photos) if p.camera in known}
        object.__setattr__(self, "_camera_of", of_photo)

    def camera_of(self, photo: str) -> Camera:
        """Return the camera of a photo; raises KeyError for a photo that is not declared."""
        return self._camera_of[photo]

    def sigma_of(self, control: ControlPoint) -> tuple[float, float, float]:
        """Return a control point's standard deviations [m], the default where it states none."""
        x, y, z = (self.precision.control_m if s is None else s for s in control.sigma)
        return x, y, z
