"""`anaplot inner --apply`: points measured on plates become rows of a block's image_points.csv.

The way from plate to image is the session's (`session/plates.py`): the inner orientation found,
then the camera's refinement. What the inner orientation does not know exactly is common to all
points of its photo: it is told, and no part of a point's sigma.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import (
    block_files,
    image_points_digest,
    read_declared,
    with_image_points,
    write_image_points,
)
from anaplot.exchange.blocktoml import with_photos
from anaplot.exchange.fiducialfile import FiducialMeasurements
from anaplot.exchange.imagepointscsv import outside
from anaplot.exchange.lockfile import sessions_kept_out
from anaplot.exchange.platepointscsv import (
    PlatePoint,
    PlatePoints,
    read_plate_points,
    refuse_in_two_files,
)
from anaplot.photogrammetry.airandearth import AirAndEarth
from anaplot.photogrammetry.block import Block, Camera, ImagePoint
from anaplot.photogrammetry.inner import InnerOrientation
from anaplot.photogrammetry.inneradvice import odd_scale
from anaplot.photogrammetry.measuredimage import measured_rays
from anaplot.report.columns import counted
from anaplot.report.journalnote import session_of
from anaplot.session.plates import PlateSystem
from anaplot.textfiles.wording import place, plain, quoted, typed_path

__all__ = ["CarriedPhoto", "Measured", "OrientedPhoto", "carried", "merged", "points_of", "write"]


_AS_IT_IS = "--as-given applies it as it is"


class OrientedPhoto(NamedTuple):
    """The inner orientation of a photo, and the file with its fiducials."""

    file: FiducialMeasurements
    inner: InnerOrientation


class Measured(NamedTuple):
    """A block and what is to become part of it.

    Attributes
    ----------
    folder
        The block's.
    block
        As it stands there: what block.toml declares, and image_points.csv.
    digest
        Of its image_points.csv; None where there is none.
    files
        Points measured on plates.
    """

    folder: Path
    block: Block
    digest: str | None
    files: tuple[PlatePoints, ...]

    @property
    def photos(self) -> tuple[str, ...]:
        """Photos with points, in the order in which they first stand in the files."""
        return tuple(dict.fromkeys(p.measured.photo for file in self.files for p in file.points))


class CarriedPhoto(NamedTuple):
    """What was carried into the image of one photo.

    Attributes
    ----------
    photo
        Name.
    inner
        Its inner orientation.
    rows
        Of image_points.csv.
    carried_um
        Largest standard deviation [um] of an image coordinate that comes from the fiducials; None
        where it is not known.
    replaced
        Its rows that stood in the block before.
    """

    photo: str
    inner: InnerOrientation
    rows: tuple[ImagePoint, ...]
    carried_um: float | None
    replaced: tuple[ImagePoint, ...]


def points_of(folder: Path, files: Iterable[Path], camera_file: Path) -> Measured:
    """Read a block and files of points that are to become part of it; nothing is written.

    Parameters
    ----------
    folder
        The block's.
    files
        Of points measured on plates.
    camera_file
        With which a new block could be made, for the message where there is none.

    Raises
    ------
    InputError
        There is no block, or something is wrong in it or in a file.
    """
    toml = block_files(folder)[0]
    if not os.path.lexists(toml):
        raise InputError(
            f"{place(folder)}: no block; anaplot new {typed_path(folder)} --camera "
            f"{typed_path(camera_file)} --strip FIRST-LAST makes one"
        )
    digest = image_points_digest(folder)
    block = with_image_points(folder, read_declared(folder))
    if block.in_pixels:
        raise InputError(
            f"{place(block_files(folder)[1])}: is in pixels: its cameras have no fiducials"
        )
    read = tuple(read_plate_points(path, block) for path in files)
    refuse_in_two_files(read)
    return Measured(folder, block, digest, read)


def carried(
    measured: Measured, oriented: Mapping[str, OrientedPhoto], *, as_given: bool = False
) -> tuple[CarriedPhoto, ...]:
    """Return the image points of all points measured on plates.

    Parameters
    ----------
    measured
        The block and the points.
    oriented
        Inner orientations by photo.
    as_given
        Take inner orientations that their tests do not accept, too.

    Raises
    ------
    InputError
        A photo has no fiducials, or those of another camera, or its inner orientation is flagged,
        has another scale than the unit or is seen from another side than the others of its file,
        or a point lies outside the format; with file and line.
    """
    if not as_given:
        _check_sides(oriented)
    known = {photo.id for photo in measured.block.photos}
    done: dict[str, list[tuple[list[ImagePoint], float | None]]] = {}
    for file in measured.files:
        for photo, points in file.by_photo():
            if photo not in oriented:
                raise file.table.fail(
                    points[0].row, "photo", f"no fiducials of photo {quoted(photo)} are given"
                )
            at = oriented[photo]
            camera = _camera_of(measured.block, photo, known)
            _check_camera(measured, camera, at.file)
            if not as_given:
                _check_accepted(photo, at, oriented)
            done.setdefault(photo, []).append(
                _in_image(file, points, at, camera, measured.block.air)
            )
    before: dict[str, list[ImagePoint]] = {}
    for row in measured.block.image_points:
        before.setdefault(row.photo, []).append(row)
    return tuple(
        CarriedPhoto(
            photo,
            oriented[photo].inner,
            tuple(row for rows, _ in parts for row in rows),
            max((um for _, um in parts if um is not None), default=None),
            tuple(before.get(photo, ())),
        )
        for photo, parts in done.items()
    )


def merged(
    measured: Measured, photos: Sequence[CarriedPhoto], *, replace: bool = False
) -> tuple[ImagePoint, ...]:
    """Return the rows of image_points.csv with those of some photos put in.

    Rows of other photos stay as they are.

    Parameters
    ----------
    measured
        The block.
    photos
        What is put in.
    replace
        Put them in place of the rows that these photos have, instead of refusing to.

    Raises
    ------
    InputError
        One of the photos has rows already, or a session has measured it: whatever stands in the
        file, opening the block brings its rows back.
    """
    _check_session(measured, [photo.photo for photo in photos if photo.replaced])
    for photo in photos:
        if photo.replaced and not replace:
            there = counted(len(photo.replaced), "row")
            raise InputError(
                f"{place(block_files(measured.folder)[1])}: photo {quoted(photo.photo)} has "
                f"{there} already; --replace puts the new ones in their place"
            )
    new = {photo.photo for photo in photos}
    kept = (row for row in measured.block.image_points if row.photo not in new)
    return (*kept, *(row for photo in photos for row in photo.rows))


def _check_session(measured: Measured, photos: Sequence[str]) -> None:
    """Refuse to put rows in the place of those that a session has accepted."""
    folder = measured.folder
    found = session_of(folder, measured.block) if photos else None
    if found is None or found.state is None:
        return
    for model in found.state.models:
        for photo in model.photos:
            if photo in photos:
                raise InputError(
                    f"{place(block_files(folder)[1])}: photo {quoted(photo)} was measured in the "
                    f"console (model {plain(model.name)}), which brings its rows back: what was "
                    "measured elsewhere belongs into a block of its own"
                )


def write(measured: Measured, rows: Sequence[ImagePoint]) -> None:
    """Write image_points.csv whole, unless somebody else has written it meanwhile.

    Raises
    ------
    InputError
        The block is open elsewhere, the file has changed or cannot be written; it is as it was.
    """
    folder = measured.folder
    with sessions_kept_out(folder):
        if image_points_digest(folder) != measured.digest:
            path = block_files(folder)[1]
            raise InputError(f"{place(path)}: has changed meanwhile, nothing is written")
        write_image_points(folder, rows, _with_photos_of(measured.block, rows))


def _with_photos_of(block: Block, rows: Iterable[ImagePoint]) -> Block:
    """Return a block with the photos that only its rows name; they are of its only camera."""
    names = (row.photo for row in rows)
    return replace(block, photos=with_photos(block.photos, names, block.cameras[0].id))


def _camera_of(block: Block, photo: str, known: set[str]) -> Camera:
    return block.camera_of(photo) if photo in known else block.cameras[0]


def _check_camera(measured: Measured, camera: Camera, file: FiducialMeasurements) -> None:
    """Refuse fiducials of a camera that the block states otherwise."""
    if camera.calibration is not None:
        if camera.calibration == file.camera:
            return
        what = f"says something else than the camera file {quoted(camera.file or '')}"
    else:
        here = camera.id, camera.c, camera.lens
        there = file.camera.id, file.camera.c, file.camera.lens
        sizes = camera.format, file.camera.format
        if here == there and (None in sizes or sizes[0] == sizes[1]):
            return
        what = f"is not the camera {quoted(camera.id)}, c = {camera.c:g} mm, with its lens"
    toml = place(block_files(measured.folder)[0])
    raise InputError(f"{place(file.camera_file)}: {what} of {toml}")


def _check_accepted(photo: str, at: OrientedPhoto, others: Mapping[str, OrientedPhoto]) -> None:
    """Refuse an inner orientation that its tests do not accept."""
    inner = at.inner
    odd = odd_scale(inner, at.file.unit)
    if not (inner.flagged or inner.refused):
        if odd is not None:
            raise at.file.fail(photo, f"{odd} {_AS_IT_IS}")
        return
    if inner.flagged:
        names = ", ".join(dict.fromkeys(row.point for row in inner.flagged))
        why = f"its test flags {plain(names, 60)}"
    else:
        why = f"sigma0 {inner.sigma0_um:.1f} um exceeds its limit of {inner.overall:.1f} um"
    count = sum(bool(one.inner.flagged or one.inner.refused) for one in others.values()) - 1
    more = f" (and {count} more photo{'s' if count > 1 else ''})" if count else ""
    raise at.file.fail(
        photo,
        f"{why}{more}: measure again, or leave out what is wrong; {_AS_IT_IS}",
    )


def _check_sides(oriented: Mapping[str, OrientedPhoto]) -> None:
    """Refuse photos of one file of which some are seen from the other side than most."""
    by_file: dict[int, dict[bool, list[str]]] = {}
    for photo, at in oriented.items():
        sides = by_file.setdefault(id(at.file), {False: [], True: []})
        sides[at.inner.placement.mirrored].append(photo)
    for sides in by_file.values():
        few, most = sorted((sides[True], sides[False]), key=len)  # of as many the mirrored
        if few:
            seen = "mirrored" if few is sides[True] else "not mirrored"
            raise oriented[few[0]].file.fail(
                few[0],
                f"is {seen} and {quoted(most[0])} of the same file is the other way: were "
                f"fiducials measured in another order? {_AS_IT_IS}",
            )


def _in_image(
    file: PlatePoints,
    points: Sequence[PlatePoint],
    at: OrientedPhoto,
    camera: Camera,
    air: AirAndEarth | None,
) -> tuple[list[ImagePoint], float | None]:
    """Return rows of image_points.csv, and the largest standard deviation from the fiducials."""
    transformation = at.inner.transformation
    plate = np.array([(point.measured.x, point.measured.y) for point in points])
    image = PlateSystem(transformation, at.file.camera, air).to_images(plate)
    scale = _scale(transformation.jacobian(plate))
    reach_x, reach_y = camera.reach()
    rows = []
    seen = measured_rays(camera, image).tolist()
    for point, (x, y), (u, v), um in zip(points, image, seen, scale.tolist(), strict=True):
        if not (abs(u) <= reach_x and abs(v) <= reach_y):
            raise outside(file.table, point.row, camera, u, v)
        row = point.measured
        sigma = row.sigma_um if point.sigma is None else round(point.sigma * um, 4)
        rows.append(ImagePoint(row.photo, row.point, x, y, sigma, row.model, row.use, row.reason))
    deviations = at.inner.carried_um(plate)
    return rows, None if deviations is None else float(deviations.max())


def _scale(jacobian: Array) -> Array:
    """Return (n,) micrometres in the image of one unit on the plate: the mean of its axes."""
    return np.asarray(1e3 * np.sqrt(np.abs(np.linalg.det(jacobian))))
