"""Made-up cameras: a certificate with eight fiducials and a little distortion, a usual format."""

from __future__ import annotations

from dataclasses import replace

from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.camera import CameraCalibration, Fiducial, RadialPolynomial

__all__ = ["SYNTHETIC_CAMERA_FILE", "usual_format", "with_calibration"]

SYNTHETIC_CAMERA_FILE = "camera.toml"

_CORNER, _SIDE = 0.92, 0.98  # of half the format
_LARGEST_UM = 12.0  # of the distortion, in the corner of the format
_ZERO = 0.87  # part of half the format's diagonal at whose radius the distortion is zero
# what the makers of the frame missed by [um]
_MISSED = ((-3, 2), (1, -4), (4, 1), (-2, -1), (2, 5), (-5, 3), (0, -2), (3, -3))


def with_calibration(camera: Camera) -> Camera:
    """Return a camera with a made-up certificate.

    Parameters
    ----------
    camera
        With a format.

    Returns
    -------
    Camera
        Fiducials 1 to 4 in the corners, 5 to 8 in the middle of the sides, a principal point some
        micrometres off, radial distortion of a dozen micrometres in the corners.

    Raises
    ------
    ValueError
        The camera has no format.
    """
    if camera.format is None:
        raise ValueError(f"camera {camera.id} has no format")
    half_x, half_y = camera.format[0] / 2.0, camera.format[1] / 2.0
    a, b = _CORNER, _SIDE
    places = ((-a, -a), (a, a), (-a, a), (a, -a), (-b, 0.0), (b, 0.0), (0.0, b), (0.0, -b))
    fiducials = tuple(
        Fiducial(
            str(k + 1),
            round(half_x * x + dx * 1e-3, 3),
            round(half_y * y + dy * 1e-3, 3),
        )
        for k, ((x, y), (dx, dy)) in enumerate(zip(places, _MISSED, strict=True))
    )
    corner = (half_x**2 + half_y**2) ** 0.5
    zero = _ZERO * corner
    # dr = K1 r (r^2 - zero^2): negative about the centre, positive in the corner
    k1 = _LARGEST_UM * 1e-3 / (corner * (corner**2 - zero**2))
    calibration = CameraCalibration(
        id=camera.id,
        c=camera.c,
        principal_point=(0.012, -0.008),
        format=camera.format,
        fiducials=fiducials,
        radial=RadialPolynomial((-k1 * zero**2, k1, 0.0, 0.0)),
    )
    return replace(camera, calibration=calibration, file=SYNTHETIC_CAMERA_FILE)


def usual_format(camera: Camera) -> tuple[float, float]:
    """Return a photo's width and height [mm], usual for its constant where they are not stated."""
    return camera.format or (1.5 * camera.c, 1.5 * camera.c)
