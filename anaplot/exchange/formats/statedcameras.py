"""Cameras that a person states for image points whose file says nothing of them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from anaplot.errors import InputError
from anaplot.exchange.camerafile import MAX_PIXELS
from anaplot.exchange.formats.door import ImportOptions, Note
from anaplot.exchange.formats.gathered import stated_camera
from anaplot.photogrammetry.block import Camera
from anaplot.textfiles.wording import plain

__all__ = ["needed_camera", "stated_cameras"]

_OF_CAMERA = "camera:"


def needed_camera(options: ImportOptions, *, pixels: bool) -> tuple[Camera, list[Note]]:
    """Return the camera that --camera, or --c, --pixels and --pixel-um state.

    Parameters
    ----------
    options
        What was stated.
    pixels
        Whether image coordinates are in pixels, of which the camera must know the number.

    Raises
    ------
    InputError
        Too little is stated, or something twice.
    """
    camera, notes = stated_camera(options)
    if camera is None:
        unit = "in mm with --pixel-um, else in pixels" if pixels else "in mm"
        raise InputError(f"the camera constant is not known: --c ({unit}), or --camera FILE")
    if camera.pixels is None:
        if pixels:
            what = "--pixels 4000x3000" if options.camera is None else "the camera file has none"
            raise InputError(f"the size of the images in pixels is not known: {what}")
        return camera, notes
    if max(camera.pixels) > MAX_PIXELS or min(camera.pixels) < 1:
        raise InputError(f"--pixels: from 1 to {MAX_PIXELS}")
    if options.camera is None:
        if camera.pixel_um is None and not pixels:
            raise InputError("--pixels: of image coordinates in mm it needs --pixel-um")
        notes.append(Note("assumed", None, "the principal point is the middle of the images"))
        if camera.pixel_um is None:
            text = f"the camera constant of {options.c:g} is in pixels, without a --pixel-um"
            notes.append(Note("assumed", None, text))
    return camera, notes


def stated_cameras(
    options: ImportOptions, names: Collection[str], *, pixels: bool
) -> tuple[dict[str, Camera], list[Note]]:
    """Return cameras by the names that photos call them.

    Parameters
    ----------
    options
        What was stated: a file of its own for a camera is `--with camera:NAME=FILE`; the others
        begin with the same values, each as a camera of its own.
    names
        How photos call their cameras.
    pixels
        As `needed_camera` has it.

    Raises
    ------
    InputError
        As `needed_camera`, and for a file of a camera that no photo has.
    """
    own = {
        key.removeprefix(_OF_CAMERA): path
        for key, path in options.files.items()
        if key.startswith(_OF_CAMERA)
    }
    stray = next((name for name in own if name not in names), None)
    if stray is not None:
        raise InputError(f"--with camera:{plain(stray, 60)}: no photo has that camera")
    found: dict[str, Camera] = {}
    notes: list[Note] = []
    alike: list[str] = []
    for name in names:
        if name in own:
            mine = replace(options, camera=own[name], c=None, pixels=None, pixel_um=None)
            camera, said = needed_camera(mine, pixels=pixels)
            notes += said
        else:
            camera, said = needed_camera(options, pixels=pixels)
            notes += [] if alike else said
            alike.append(name)
        found[name] = replace(camera, id=name)
    if len(alike) > 1:
        text = "cameras begin with the same values"
        notes.append(Note("assumed", len(alike), text, tuple(alike[:4])))
    return found, notes
