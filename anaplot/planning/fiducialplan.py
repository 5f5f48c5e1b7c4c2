"""Where fiducials lie on a plate, as far as it is known before they are measured."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from math import sqrt

from anaplot.photogrammetry.camera import CameraCalibration

__all__ = ["Places", "expected_fiducials", "predicted_fiducial"]

Places = Mapping[str, tuple[float, float]]

_SPREAD = 1.0  # mm^2; measured fiducials nearer together say nothing of the rotation


def expected_fiducials(calibration: CameraCalibration) -> dict[str, tuple[float, float]]:
    """Return where a camera's fiducials lie in its fiducial system [mm].

    Where only distances are calibrated, the first runs along x and the second along y, each
    halved by the origin; if they share a fiducial, the corners of a frame are meant. Further
    fiducials follow from two distances each; those that do not are left out.
    """
    if calibration.fiducials:
        return {mark.id: (mark.x, mark.y) for mark in calibration.fiducials}
    out: dict[str, tuple[float, float]] = {}
    if len(calibration.distances) >= 2:
        along_x, along_y = calibration.distances[:2]
        width, height = along_x.mm / 2.0, along_y.mm / 2.0
        ends = {along_x.first: (-width, 0.0), along_x.second: (width, 0.0)}
        shared = next((end for end in (along_y.first, along_y.second) if end in ends), None)
        if shared is None:
            out = {**ends, along_y.first: (0.0, -height), along_y.second: (0.0, height)}
        else:
            # the first distance is an edge of the frame, the lower one when the second begins there
            y = -height if shared == along_y.first else height
            out = {name: (x, y) for name, (x, _) in ends.items()}
            other = along_y.second if shared == along_y.first else along_y.first
            out[other] = (ends[shared][0], -y)
    waiting = [name for name in calibration.fiducial_names() if name not in out]
    while waiting:
        found = {
            name: place for name in waiting if (place := _third_corner(calibration, out, name))
        }
        if not found:
            break
        out.update(found)
        waiting = [name for name in waiting if name not in found]
    return out


def _third_corner(
    calibration: CameraCalibration, known: Places, name: str
) -> tuple[float, float] | None:
    """Return a fiducial's place from its distances to two known ones; of both, the free one."""
    reach = [
        (complex(*known[other]), d.mm)
        for d in calibration.distances
        for other, one in ((d.first, d.second), (d.second, d.first))
        if one == name and other in known
    ]
    for (a, ra), (b, rb) in combinations(reach, 2):
        apart = abs(b - a)
        along = (ra**2 - rb**2 + apart**2) / (2.0 * apart)
        if abs(along) >= ra:
            continue
        foot, side = a + (b - a) / apart * along, (b - a) / apart * 1j * sqrt(ra**2 - along**2)
        place = max(
            (foot + side, foot - side),
            key=lambda z: min(abs(z - complex(*xy)) for xy in known.values()),
        )
        return place.real, place.imag
    return None


def predicted_fiducial(
    expected: Places, nominal: Places, measured: Places, name: str
) -> tuple[float, float]:
    """Predict the plate coordinates [mm] of a fiducial.

    Parameters
    ----------
    expected
        Fiducials in the fiducial system [mm].
    nominal
        The same on the plate [mm], if it lay in its nominal place; at least the one predicted.
    measured
        Plate coordinates [mm] of fiducials measured so far.
    name
        The fiducial to be predicted.

    Returns
    -------
    tuple of float
        Its nominal place while no other is measured, shifted after the first one, and from the
        second on by the Helmert transformation of those measured. The plate may be seen from
        behind: that shows from the third one on.
    """
    known = [other for other in measured if other in expected and other != name]
    if name in measured and len(known) < 2:
        return measured[name]
    if not known or name not in expected:
        return nominal[name]
    image = [complex(*expected[other]) for other in known]
    plate = [complex(*measured[other]) for other in known]
    n = len(known)
    image_mean, plate_mean = sum(image) / n, sum(plate) / n
    spread = sum(abs(z - image_mean) ** 2 for z in image)
    if n == 1 or spread < _SPREAD:
        start = sum(complex(*nominal[other]) for other in known) / n
        place = complex(*nominal[name]) + plate_mean - start
        return place.real, place.imag
    away = [w - plate_mean for w in plate]
    upright = [z - image_mean for z in image]
    wanted = complex(*expected[name]) - image_mean
    straight, missed = _turned(upright, away, spread)
    place = plate_mean + straight * wanted
    if n > 2:
        behind = [z.conjugate() for z in upright]
        mirrored, missed_mirrored = _turned(behind, away, spread)
        if missed_mirrored < missed:
            place = plate_mean + mirrored * wanted.conjugate()
    return place.real, place.imag


def _turned(image: list[complex], plate: list[complex], spread: float) -> tuple[complex, float]:
    """Return the factor that turns and scales one set of places into another, and the misfit."""
    factor = sum(z.conjugate() * w for z, w in zip(image, plate, strict=True)) / spread
    return factor, sum(abs(w - factor * z) ** 2 for z, w in zip(image, plate, strict=True))
