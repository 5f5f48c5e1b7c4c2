"""Calibrated cameras as files: `adjust --write-camera`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path

from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.cameracalibration import CalibratedCamera, calibrated_cameras
from anaplot.errors import InputError
from anaplot.exchange.camerafile import write_camera
from anaplot.photogrammetry.block import Block, Camera
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.lens import LENS_PARAMETERS
from anaplot.report.document import Document, say
from anaplot.textfiles.wholefile import all_or_nothing, check_place
from anaplot.textfiles.wording import hint, place, quoted

__all__ = ["calibration_file", "camera_files_asked", "with_moved_points", "write_cameras"]


def camera_files_asked(
    block: Block,
    files: str | os.PathLike[str] | Sequence[str] | None,
    chosen: AdditionalParameters | None,
) -> dict[str, Path]:
    """Return the files by camera that `--write-camera` asks for, before hours of adjusting.

    Raises
    ------
    InputError
        Nothing is calibrated camera by camera; no such camera, one twice, or none is named and
        there are several; a file is there already, or no place for it; nothing of a camera is
        calibrated, or it cannot be held by its file.
    """
    if not files:
        return {}
    texts = [files] if isinstance(files, str | os.PathLike) else list(files)
    measured = frozenset(columns_of(block.image_points).photo.values)
    used = list(dict.fromkeys(p.camera for p in block.photos if p.id in measured))
    alone = len(used) == 1
    cameras = {camera.id: camera for camera in block.cameras}
    if chosen is None or not chosen.set.lens or not (
        chosen.scope == "camera" or (chosen.scope == "block" and alone)
    ):  # fmt: skip
        raise InputError("--write-camera goes with --calibrate (or --additional physical:camera)")
    out: dict[str, Path] = {}
    for text in [os.fspath(one) for one in texts]:
        camera, file = _named(text, used)
        if camera in out:
            raise InputError(f"--write-camera: camera {quoted(camera)} stands twice")
        path = Path(file)
        if path in out.values():
            raise InputError(f"--write-camera: {place(path)} stands twice")
        if not file or os.path.lexists(path):
            why = "exists already and is not overwritten" if file else "no file is named"
            raise InputError(f"--write-camera {quoted(text)}: {why}")
        check_place(path)
        _check_held_by_file(cameras[camera], _calibrated(chosen, camera))
        out[camera] = path
    return out


def _named(text: str, used: Sequence[str]) -> tuple[str, str]:
    """Return camera and file of CAMERA=FILE; names of cameras may have = in them."""
    named = max((one for one in used if text.startswith(f"{one}=")), key=len, default=None)
    if named is not None:
        return named, text[len(named) + 1 :]
    if len(used) == 1 and "=" not in text:
        return used[0], text
    raise InputError(
        f"--write-camera {quoted(text)}: of which camera? Written as CAMERA=FILE"
        f"{hint(text.partition('=')[0], used)}"
    )


def _calibrated(chosen: AdditionalParameters, camera: str) -> set[str]:
    """Return the parameters of a camera's lens that are free or have a value of their own."""
    free = {name for name in chosen.set.names if (camera, name) not in chosen.still}
    return free | {p.parameter for p in chosen.priors if p.group in (None, camera) and p.value}


def _check_held_by_file(camera: Camera, calibrated: Set[str]) -> None:
    if not calibrated:
        raise InputError(f"--write-camera: nothing of camera {quoted(camera.id)} is calibrated")
    if calibrated & set(LENS_PARAMETERS[3:]):
        _refuse_beside_distortion(camera)


def _refuse_beside_distortion(camera: Camera) -> None:
    """Refuse a lens for a camera whose file corrects the distortion already."""
    if _corrects(camera.calibration):
        raise InputError(
            f"camera {quoted(camera.id)}: image coordinates are without the [distortion] of "
            f"{quoted(camera.file or '')}, the lens found is what is left: a file states one of "
            "them"
        )


def _corrects(calibration: CameraCalibration | None) -> bool:
    return calibration is not None and calibration.corrects


def write_cameras(files: Mapping[str, Path], block: AdjustedBlock) -> tuple[CalibratedCamera, ...]:
    """Write calibrated cameras, all of them or none, and return them.

    Raises
    ------
    InputError
        A file cannot hold what was found, or cannot be written.
    """
    if not files:
        return ()
    found = {one.stated.id: one for one in calibrated_cameras(block)}
    with all_or_nothing():
        for camera, path in files.items():
            name = block.problem.block.name
            remark = f"calibrated by the adjustment of block {name}"
            write_camera(path, calibration_file(found[camera]), remark)
    return tuple(found[camera] for camera in files)


def with_moved_points(document: Document, written: Sequence[CalibratedCamera]) -> Document:
    """Return a document that says which written principal points are no longer the rows' own."""
    moved = [one for one in written if one.stated.pixels is None and any(one.offset)]
    if not moved:
        return document
    lines = [
        say(
            "note: camera {}: image_points.csv counts from the old principal point: {:+.4f}, "
            "{:+.4f} mm go into the file alone, for the next inner orientation",
            one.stated.id,
            *one.offset,
        ).of("remark")
        for one in moved
    ]
    told = [{"camera": one.stated.id, "offset": list(one.offset)} for one in moved]
    answer = document.answer | {"principal_points_in_file_alone": told}
    return replace(document, answer=answer, page=(*document.page, *lines))


def calibration_file(found: CalibratedCamera) -> CameraCalibration:
    """Return what a camera file says of a calibrated camera.

    Raises
    ------
    InputError
        The camera's file has corrected the image coordinates by a table of distortion already.
    """
    stated, camera = found.stated, found.camera
    base = stated.calibration or CameraCalibration(stated.id, stated.c, format=stated.format)
    made = replace(base, c=camera.c, lens=camera.lens)
    x, y = base.symmetry_point or base.principal_point
    if camera.lens is not None:
        _refuse_beside_distortion(stated)
        made = replace(made, symmetry_point=None)
    elif _corrects(base) and any(found.offset):
        # the distortion stays where it is while the principal point moves
        if camera.pixels is not None:
            x, y = x - found.offset[0], y - found.offset[1]
        made = replace(made, symmetry_point=(x, y))
    if camera.pixels is not None:
        return replace(
            made,
            format=None,
            pixels=camera.pixels,
            pixel_um=camera.pixel_um,
            principal_px=camera.principal_px,
        )
    x, y = base.principal_point
    return replace(made, principal_point=(x + found.offset[0], y + found.offset[1]))
