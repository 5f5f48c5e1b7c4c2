"""A block as a PAT-B project: .im, .con and .ori of one name in a new folder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from decimal import Decimal
from pathlib import Path

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.door import Exported, Exporting, Note
from anaplot.exchange.formats.gathered import (
    Pose,
    check_order,
    not_held,
    poses_of,
    rays_that_count,
    whole_name,
)
from anaplot.exchange.formats.patbfiles import SENSES
from anaplot.photogrammetry.block import Block, ControlPoint, ImagePoint
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.selection import rows_by_photo
from anaplot.textfiles.wholefile import create_folder
from anaplot.textfiles.wording import quoted

__all__ = ["orientation_records", "write_patb"]

_NAME = 15  # characters of a photo or point
_PLACE = 16  # columns of a coordinate


def write_patb(exporting: Exporting, target: Path) -> Exported:
    """Write a block; all of it, or nothing.

    Raises
    ------
    InputError
        A name that the files cannot hold, an unknown option, or a file that cannot be written.
    """
    block, options = exporting.block, exporting.options
    unit = options.unit or "um"
    if unit == "px":
        raise InputError("--unit px: these files have um or mm")
    check_order(options.order, SENSES)
    sense = options.order or SENSES[0]
    rays, notes = rays_that_count(block)
    notes += not_held(block, holds=("image sigmas",))
    groups = _groups(rays, notes)
    made = {"im": _images(block, rays, groups, unit)}
    control = [row for row in block.control if row.use == "control"]
    if control:
        made["con"] = "".join(_control(control))
    poses = _poses(exporting, notes)
    if poses:
        made["ori"] = "".join(orientation_records(poses, sense))
    text = f"{unit} for image coordinates and camera constants"
    notes.append(Note("assumed", None, text))
    files = ((f"{target.name}.{suffix}", content.encode()) for suffix, content in made.items())
    return Exported(create_folder(target, files), tuple(notes))


def orientation_records(poses: Iterable[Pose], sense: str) -> Iterator[str]:
    """Yield a comment and the records of an .ori.

    Parameters
    ----------
    poses
        Name, projection centre [m] and omega, phi, kappa [rad] of each photo.
    sense
        One of `SENSES`.

    Raises
    ------
    InputError
        A name or a coordinate that does not fit its columns.
    """
    yield f"# rotation matrices a11 a12 ... a33: {sense.replace('-', ' ')}\n"
    for photo, position, angles in poses:
        name = whole_name("photo", photo, _NAME, "an .ori")
        places = [f"{value:{_PLACE}.5f}" for value in position]
        if any(len(text) > _PLACE for text in places):
            raise InputError(f"photo {quoted(photo)}: a coordinate is too large for F16.5")
        matrix: Array = rotation_matrix(*angles)
        elements = (matrix if sense == SENSES[0] else matrix.T).ravel()
        texts = [f"{value:16.12f}" for value in np.where(np.abs(elements) < 5e-13, 0.0, elements)]
        yield f"{name:>16}{'':16}{''.join(places)}\n"
        yield f"{''.join(texts[:5])}\n{''.join(texts[5:])}\n"


def _images(
    block: Block, rays: list[ImagePoint], groups: dict[float | None, int], unit: str
) -> str:
    rows = rows_by_photo(rays)
    out = []
    for photo in block.photos:
        name = whole_name("photo", photo.id, _NAME, "an .im")
        out.append(f"{name:>15} {_length(block.camera_of(photo.id).c, unit):>14}\n")
        for row in rows.get(photo.id, ()):
            point = whole_name("point", row.point, _NAME, "an .im")
            group = f" {groups[row.sigma_um]}" if groups else ""
            x, y = _length(row.x, unit), _length(row.y, unit)
            out.append(f"{point:>15} {x:>14} {y:>14}{group}\n")
        out.append(f"{'-99':>15}\n")
    return "".join(out)


def _length(mm: float, unit: str) -> str:
    """Return a length with all its digits; read back it is the same number."""
    value = Decimal(repr(mm)) * (1000 if unit == "um" else 1)
    text = f"{value:f}"
    return text if "." in text else f"{text}.0"


def _groups(rays: list[ImagePoint], notes: list[Note]) -> dict[float | None, int]:
    """Return a number for every standard deviation; none where there is one alone."""
    sigmas = dict.fromkeys(row.sigma_um for row in rays)
    if not any(sigma is not None for sigma in sigmas):
        return {}
    found = {sigma: k for k, sigma in enumerate(sigmas, 1)}
    said = tuple(
        f"{k}: {'image_um' if sigma is None else f'{sigma:g} um'}" for sigma, k in found.items()
    )
    notes.append(Note("not held", len(found), "standard deviations: groups stand for them", said))
    return found


def _control(control: list[ControlPoint]) -> Iterator[str]:
    for row in control:
        (x, y, _), name = row.xyz, whole_name("point", row.point, _NAME, "a .con")
        if (x is None) != (y is None):
            raise InputError(f"control point {quoted(row.point)}: X without Y, or Y without X")
        if x is not None and y is not None:
            yield f"{name:>15} {_metres(x):>18} {_metres(y):>18}\n"
    yield f"{'-99':>15}\n"
    for row in control:
        if row.xyz[2] is not None:
            yield f"{row.point:>15} {_metres(row.xyz[2]):>18}\n"
    yield f"{'-99':>15}\n"


def _metres(value: float) -> str:
    return _length(value, "mm")


def _poses(exporting: Exporting, notes: list[Note]) -> list[Pose]:
    poses = poses_of(exporting)
    lost = len(exporting.block.photos) - len(poses)
    if exporting.adjusted is None and poses and lost:
        notes.append(Note("dropped", lost, "photos without an orientation"))
    return poses
