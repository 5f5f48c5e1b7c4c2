"""block.toml: a block's settings, cameras, strips and photos, to and from text."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

from anaplot.aliases import TestKind
from anaplot.errors import InputError
from anaplot.exchange.airtoml import air_lines, read_air
from anaplot.exchange.camerafile import (
    CONSTANT,
    FRAME,
    LENS,
    PIXELS,
    camera_path,
    check_distortion,
    check_principal_px,
    format_camera,
    lens_lines,
    parse_camera,
    pixel_lines,
    read_camera,
)
from anaplot.exchange.patternfile import is_pattern_file
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    Measuring,
    Photo,
    Precision,
    Strip,
    TestSettings,
    TieVariance,
    calibrated_camera,
    in_pixels,
)
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.groundsystem import Frame, GroundSystem
from anaplot.photogrammetry.photorange import photo_range
from anaplot.photogrammetry.prioroffsets import BoresightScope, OffsetScope, PriorOffsets
from anaplot.photogrammetry.selection import model_name
from anaplot.textfiles.kinds import (
    FRACTION,
    METRES,
    NAME,
    NUMBER,
    PHOTO,
    SIGMA,
    SIGMA_OR_FREE,
    Fields,
    Keys,
    Kind,
    KnownName,
    ListOf,
    Made,
    Number,
    Numbers,
    Text,
    Word,
)
from anaplot.textfiles.tomltable import TomlTable, parse_toml
from anaplot.textfiles.tomltext import toml_number, toml_numbers, toml_text
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = [
    "BLOCK_FORMAT",
    "ROTATION",
    "camera_texts",
    "format_block_toml",
    "measuring_lines",
    "parse_block_toml",
    "read_test",
    "with_photos",
]

BLOCK_FORMAT = 1

_ANGLES = ("omega", "phi", "kappa")
_UNITS = {"deg": math.pi / 180.0, "gon": math.pi / 200.0, "rad": 1.0}


def _rotation(kind: Kind[float]) -> Kind[tuple[float, ...]]:
    """Return the kind of a rotation's table, in radians; its angles are of another kind."""
    keys = Keys({**dict.fromkeys(_ANGLES, kind), "unit": Word(*_UNITS)})
    return Made(keys, lambda found: tuple(found[name] * _UNITS[found["unit"]] for name in _ANGLES))


ROTATION = _rotation(NUMBER)
"""omega, phi, kappa [rad] of a table that names its unit."""

_PRECISION: Fields = {
    "image_um": SIGMA,
    "tie_variance": Word(*get_args(TieVariance)),
    "control_m": SIGMA_OR_FREE,
}
_TEST: Fields = {"kind": Word(*get_args(TestKind)), "alpha": FRACTION, "power": FRACTION}
_CAMERA: Fields = {"id": NAME, "c": CONSTANT}
_FAR = 1e4  # m that an antenna may be away
_LONG = 1e13  # s, or ms, from anywhere
# of a camera in one aircraft: no part of its file
_BESIDE: Fields = {"lever_arm": Numbers(3, Number(-_FAR, _FAR))}
_SIGMAS: Fields = {"position_sigma": Numbers(3, SIGMA), "rotation_sigma": _rotation(SIGMA)}
_PHOTO: Fields = {
    "position": Numbers(3, METRES),
    "rotation": ROTATION,
    **_SIGMAS,
    "time": Number(-_LONG, _LONG),
}
_SCOPE = Word(*get_args(OffsetScope))
_GNSS: Fields = {
    "shift": _SCOPE,
    "drift": _SCOPE,
    "shift_sigma": Numbers(3, SIGMA),
    "drift_sigma": Numbers(3, SIGMA),
}
_IMU: Fields = {
    "boresight": Word(*get_args(BoresightScope)),
    "boresight_sigma": _rotation(SIGMA),
}


def parse_block_toml(text: str, path: Path, camera_files: Mapping[str, str] | None = None) -> Block:
    """Return the block that a block.toml declares, without its measured points.

    Parameters
    ----------
    text
        Content of the file.
    path
        Its name, for messages, and where camera files are looked for that it names.
    camera_files
        Content of camera files by the name that block.toml gives them; these are not looked for.

    Raises
    ------
    InputError
        Anything but a complete block of format 1, with file, line and key.
    """
    root = parse_toml(text, path)
    root.version(BLOCK_FORMAT)
    tables = (
        *("format", "precision", "test", "measuring", "refinement", "ground", "gnss", "imu"),
        *("camera", "strip", "photo"),
    )
    name = root.take({"name": NAME}, also=tables)["name"]
    precision = Precision(**root.table("precision").take({}, _PRECISION))
    test = read_test(root.table("test"))
    pattern = Made(NAME, partial(_pattern, path.parent))
    stated: Fields = {"profile": Text(), "pattern": pattern}
    measuring = Measuring(**root.table("measuring").take({}, stated))
    offsets = _offsets(root.table("gnss"), root.table("imu"))
    cameras = root.each("camera", partial(_camera, path.parent, camera_files or {}))
    ground = _ground(root.table("ground")) if "ground" in root else None
    air = read_air(root.table("refinement"), cameras, ground)
    known = {camera.id for camera in cameras}
    of_photo = Keys({"id": PHOTO, "camera": KnownName("camera", known)}, _PHOTO)
    photos = root.each("photo", partial(_photo, of_photo), least=0)
    only = cameras[0].id if len(cameras) == 1 else None
    declared = {photo.id for photo in photos}
    strips = root.each("strip", partial(_strip, declared, only), least=0)
    if not (photos or strips or only):
        raise root.fail("no photo: with several cameras each photo is declared in a [[photo]]")
    if only is not None:
        photos = with_photos(photos, (name for strip in strips for name in strip.photos), only)
    models: dict[str, tuple[str, str]] = {}
    for pair in (pair for strip in strips for pair in strip.models()):
        if models.setdefault(model_name(*pair), pair) != pair:
            raise root.fail(f"two models would be called {quoted(model_name(*pair))}", "strip")
    return Block(
        name=name,
        precision=precision,
        test=test,
        cameras=cameras,
        photos=photos,
        strips=strips,
        measuring=measuring,
        offsets=offsets,
        ground=ground,
        air=air,
    )


def with_photos(photos: Iterable[Photo], names: Iterable[str], camera: str) -> tuple[Photo, ...]:
    """Return photos and, after them, those of a camera that are only named; none twice."""
    known = {photo.id: photo for photo in photos}
    for name in dict.fromkeys(names):
        if name not in known:
            known[name] = Photo(name, camera)
    return tuple(known.values())


def camera_texts(block: Block) -> dict[str, str]:
    """Return the content of a block's camera files by the name that block.toml gives them."""
    return {
        camera.file: format_camera(camera.calibration)
        for camera in block.cameras
        if camera.file is not None and camera.calibration is not None
    }


def format_block_toml(block: Block) -> str:
    """Return the text of a block.toml; numbers are written so that they are read back exactly."""
    lines = [
        f"format = {BLOCK_FORMAT}",
        f"name = {toml_text(block.name)}",
        "",
        "[precision]",
        f"image_um = {toml_number(block.precision.image_um)}",
        f"tie_variance = {toml_text(block.precision.tie_variance)}",
        f"control_m = {toml_number(block.precision.control_m)}",
        "",
        "[test]",
        f"kind = {toml_text(block.test.kind)}",
        f"alpha = {toml_number(block.test.alpha)}",
        f"power = {toml_number(block.test.power)}",
    ]
    lines += measuring_lines(block.measuring)
    lines += _offset_lines(block.offsets)
    if block.ground is not None:
        lines += [
            "",
            "[ground]",
            f"crs = {toml_text(block.ground.crs)}",
            f"frame = {toml_text(block.ground.frame)}",
            f"origin = {toml_numbers(*block.ground.origin)}",
        ]
    lines += air_lines(block.air)
    for camera in block.cameras:
        lines += ["", "[[camera]]", f"id = {toml_text(camera.id)}", f"c = {toml_number(camera.c)}"]
        if camera.file is not None:
            lines.append(f"file = {toml_text(camera.file)}")
        elif camera.calibration is not None:
            raise InputError(
                f"camera {quoted(camera.id)} cannot be written: its calibration has no file"
            )
        lines += pixel_lines(camera)
        if camera.pixels is None and camera.format is not None:
            lines.append(f"format = {toml_numbers(*camera.format)}")
        if camera.lever_arm is not None:
            lines.append(f"lever_arm = {toml_numbers(*camera.lever_arm)}")
        if camera.lens is not None and camera.file is None:
            lines += ["[camera.lens]", *lens_lines(camera.lens)]
    for strip in block.strips:
        photos = ", ".join(toml_text(photo) for photo in strip.photos)
        lines += ["", "[[strip]]", f"id = {toml_text(strip.id)}", f"photos = [{photos}]"]
        if strip.base is not None:
            lines.append(f"base = {toml_number(strip.base)}")
    for photo in block.photos:
        lines += [
            "",
            "[[photo]]",
            f"id = {toml_text(photo.id)}",
            f"camera = {toml_text(photo.camera)}",
        ]
        if photo.position is not None:
            lines.append(f"position = {toml_numbers(*photo.position)}")
        if photo.rotation is not None:
            lines.append(f"rotation = {_angles(photo.rotation)}")
        if photo.position_sigma is not None:
            lines.append(f"position_sigma = {toml_numbers(*photo.position_sigma)}")
        if photo.rotation_sigma is not None:
            lines.append(f"rotation_sigma = {_angles(photo.rotation_sigma)}")
        if photo.time is not None:
            lines.append(f"time = {toml_number(photo.time)}")
    return "\n".join(lines) + "\n"


def measuring_lines(measuring: Measuring) -> list[str]:
    """Return the lines of a [measuring] table; none where nothing is stated."""
    stated = {"profile": measuring.profile, "pattern": measuring.pattern}
    lines = [f"{key} = {toml_text(value)}" for key, value in stated.items() if value is not None]
    return ["", "[measuring]", *lines] if lines else []


def _offset_lines(offsets: PriorOffsets | None) -> list[str]:
    """Return the lines of the tables [gnss] and [imu]; none where nothing is stated."""
    if offsets is None:
        return []
    gnss, imu = [], []
    for key in ("shift", "drift"):
        if (scope := getattr(offsets, key)) is not None:
            gnss.append(f"{key} = {toml_text(scope)}")
            if (sigma := getattr(offsets, f"{key}_sigma")) is not None:
                gnss.append(f"{key}_sigma = {toml_numbers(*sigma)}")
    if offsets.boresight is not None:
        imu.append(f"boresight = {toml_text(offsets.boresight)}")
        if offsets.boresight_sigma is not None:
            imu.append(f"boresight_sigma = {_angles(offsets.boresight_sigma)}")
    return [*(["", "[gnss]", *gnss] if gnss else []), *(["", "[imu]", *imu] if imu else [])]


def _offsets(gnss: TomlTable, imu: TomlTable) -> PriorOffsets | None:
    """Return what the tables [gnss] and [imu] say; None where they say nothing."""
    found: dict[str, Any] = {}
    for table, fields in ((gnss, _GNSS), (imu, _IMU)):
        found |= table.take({}, fields)
        for key in fields:
            of = key.removesuffix("_sigma")
            if key in table and of not in table:
                raise table.fail(f"{key} without {of}", key)
    return PriorOffsets(**found) if found else None


def read_test(table: TomlTable) -> TestSettings:
    """Return the settings of a [test] table, each the default where it is left out."""
    settings = TestSettings(**table.take({}, _TEST))
    if not settings.alpha < settings.power:
        raise table.fail(
            f"power = {settings.power:g} must be greater than alpha = {settings.alpha:g}",
            "power" if "power" in table else "alpha",
        )
    return settings


def _ground(table: TomlTable) -> GroundSystem:
    """Return the ground's coordinate system; whether there is such a one is not asked here."""
    stated = table.take({"crs": NAME, "frame": Word(*get_args(Frame)), "origin": Numbers(3)})
    if stated["frame"] == "local" and not abs(stated["origin"][1]) <= 90.0:
        raise table.fail("the second is a latitude, from -90 to 90 degrees", "origin")
    return GroundSystem(**stated)


def _pattern(folder: Path, name: str) -> str:
    """Return the name of a point pattern; one that is a file may not lead out of the folder."""
    if is_pattern_file(name):
        camera_path(folder, name)
    return name


def _camera(folder: Path, files: Mapping[str, str], table: TomlTable) -> Camera:
    if "file" not in table:
        more: Fields = {"format": FRAME, **PIXELS, **_BESIDE}
        stated = table.take(_CAMERA, more, also=("file", "lens"))
        lens = table.get("lens", LENS) if "lens" in table else None
        arm = stated.pop("lever_arm", None)
        camera = Camera(stated["id"], stated["c"], lens=lens, lever_arm=arm)
        camera = _with_pixels(table, camera, stated)
        if camera.format is None:
            check_distortion(table, CameraCalibration(camera.id, camera.c, lens=lens))
        return camera
    beside: Fields = {**_CAMERA, "format": FRAME, **PIXELS, **_BESIDE}
    stated = table.take({"file": Text()}, beside, also=("lens",))
    arm = stated.pop("lever_arm", None)
    file = stated["file"]
    path = table.get("file", Made(Text(), partial(camera_path, folder)))
    calibration = parse_camera(files[file], path) if file in files else read_camera(path)
    # What stands in both places must be the same: nobody could say which of the two is meant.
    for key in ("id", "c", "format", *PIXELS):
        here, there = stated.get(key), getattr(calibration, key)
        if here is not None and there is not None and here != there:
            raise table.fail(f"{_shown(here)}, but {quoted(file)} says {_shown(there)}", key)
    if "lens" in table:
        raise table.fail(f"beside file: {quoted(file)} states the lens", "lens")
    camera = replace(calibrated_camera(calibration, file), lever_arm=arm)
    of_file = {key: value for key in PIXELS if (value := getattr(calibration, key)) is not None}
    return _with_pixels(table, camera, of_file | stated)


def _with_pixels(table: TomlTable, camera: Camera, stated: Mapping[str, Any]) -> Camera:
    """Return a camera with its pixels, which are its format."""
    if "pixels" not in stated:
        stray = next((key for key in ("pixel_um", "principal_px") if key in stated), None)
        if stray is not None:
            raise table.fail(f"{stray} without pixels", stray)
        return replace(camera, format=stated.get("format", camera.format))
    if "format" in stated:
        raise table.fail("beside pixels, which state it: only one of them", "format")
    check_principal_px(table, stated, camera.c)
    return in_pixels(camera, stated["pixels"], stated.get("pixel_um"), stated.get("principal_px"))


def _shown(value: object) -> str:
    if isinstance(value, str):
        return quoted(value)
    return repr(list(value)) if isinstance(value, tuple) else repr(value)


def _photo(keys: Keys, table: TomlTable) -> Photo:
    photo = Photo(**table.taken(keys))
    for key in _SIGMAS:
        of = key.removesuffix("_sigma")
        if key in table and of not in table:
            raise table.fail(f"{key} without {of}", key)
    return photo


def _strip(photos: Collection[str], only: str | None, table: TomlTable) -> Strip:
    """Return a strip; photos that are not declared belong to the block's only camera."""
    # The sign of the base comes from the data: only the magnitude is taken.
    base: Fields = {"base": Made(NUMBER, abs)}
    name: Kind[str] = PHOTO if only is not None else KnownName("photo", photos)
    if "first" in table or "last" in table:
        if "photos" in table:
            raise table.fail("photos beside first and last: only one of them", "photos")
        ends = table.take({"id": NAME, "first": PHOTO, "last": PHOTO}, base)
        try:
            named = photo_range(ends["first"], ends["last"])
        except ValueError as error:
            raise table.fail(plain(str(error), 200), "first") from None
        for photo in named if only is None else ():
            if photo not in photos:
                raise table.fail(f"unknown photo {quoted(photo)}{hint(photo, photos)}", "first")
        strip = Strip(ends["id"], named, ends.get("base"))
    else:
        strip = Strip(**table.take({"id": NAME, "photos": ListOf(name, "photos")}, base))
    seen: set[str] = set()
    for index, photo in enumerate(strip.photos):
        if photo in seen:
            raise table.fail(f"photo {quoted(photo)} twice", "photos", index)
        seen.add(photo)
    if len(strip.photos) < 2:
        raise table.fail("fewer than 2 photos", "photos")
    if strip.base == 0.0:
        raise table.fail("must not be 0", "base")
    return strip


def _angles(values: tuple[float, float, float]) -> str:
    pairs = [f"{name} = {toml_number(value)}" for name, value in zip(_ANGLES, values, strict=True)]
    return f'{{ {", ".join(pairs)}, unit = "rad" }}'
