"""Calibrated cameras as files: `adjust --write-camera`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.cameracalibration import CalibratedCamera, calibrated_cameras
from anaplot.errors import InputError
from anaplot.exchange.camerafile import write_camera
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.textfiles.wholefile import all_or_nothing
from anaplot.textfiles.wording import hint, place, quoted

__all__ = ["calibration_file", "camera_files_asked", "write_cameras"]


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
        there are several; a file is there already.
    """
    if not files:
        return {}
    texts = [files] if isinstance(files, str | os.PathLike) else list(files)
    measured = {row.photo for row in block.image_points}
    used = list(dict.fromkeys(p.camera for p in block.photos if p.id in measured))
    alone = len(used) == 1
    if chosen is None or not chosen.set.lens or not (
        chosen.scope == "camera" or (chosen.scope == "block" and alone)
    ):  # fmt: skip
        raise InputError("--write-camera goes with --calibrate (or --additional physical:camera)")
    out: dict[str, Path] = {}
    for text in [os.fspath(one) for one in texts]:
        named, equals, rest = text.partition("=")
        if equals and named in used:
            camera, file = named, rest
        elif alone:
            camera, file = used[0], text
        else:
            raise InputError(
                f"--write-camera {quoted(text)}: of which camera? Written as CAMERA=FILE"
                f"{hint(named, used)}"
            )
        if camera in out:
            raise InputError(f"--write-camera: camera {quoted(camera)} stands twice")
        path = Path(file)
        if path in out.values():
            raise InputError(f"--write-camera: {place(path)} stands twice")
        if not file or os.path.lexists(path):
            why = "exists already and is not overwritten" if file else "no file is named"
            raise InputError(f"--write-camera {quoted(text)}: {why}")
        out[camera] = path
    return out


def write_cameras(files: Mapping[str, Path], block: AdjustedBlock) -> None:
    """Write calibrated cameras, all of them or none.

    Raises
    ------
    InputError
        A file cannot hold what was found, or cannot be written.
    """
    if not files:
        return
    found = {one.stated.id: one for one in calibrated_cameras(block)}
    with all_or_nothing():
        for camera, path in files.items():
            name = block.problem.block.name
            remark = f"calibrated by the adjustment of block {name}"
            write_camera(path, calibration_file(found[camera]), remark)


def calibration_file(found: CalibratedCamera) -> CameraCalibration:
    """Return what a camera file says of a calibrated camera.

    Raises
    ------
    InputError
        The camera's file has corrected the image coordinates by a table of distortion already.
    """
    stated, camera = found.stated, found.camera
    base = stated.calibration or CameraCalibration(stated.id, stated.c, format=stated.format)
    corrects = base.radial is not None or any(base.decentring)
    if camera.lens is not None and corrects:
        raise InputError(
            f"camera {quoted(stated.id)}: image coordinates are without the [distortion] of "
            f"{quoted(stated.file or '')}, the lens found is what is left: a file states one of "
            "them"
        )
    made = replace(base, c=camera.c, lens=camera.lens)
    if camera.lens is not None:
        made = replace(made, symmetry_point=None)
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
