"""block.toml: a block's settings, cameras, strips and photos, to and from text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import cast, get_args

from anaplot.aliases import TestKind
from anaplot.errors import InputError
from anaplot.exchange.camerafile import (
    camera_path,
    format_camera,
    frame_format,
    parse_camera,
    read_camera,
)
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    Photo,
    Precision,
    Strip,
    TestSettings,
    TieVariance,
)
from anaplot.textfiles.tomlfile import TomlFile, TomlTable
from anaplot.textfiles.tomltext import toml_number, toml_numbers, toml_text
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "BLOCK_FORMAT",
    "camera_texts",
    "format_block_toml",
    "parse_block_toml",
    "read_rotation",
    "read_test",
]

BLOCK_FORMAT = 1

_ANGLES = ("omega", "phi", "kappa")
_UNITS = {"deg": math.pi / 180.0, "gon": math.pi / 200.0, "rad": 1.0}


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
    root = TomlFile(path, text).root
    root.version(BLOCK_FORMAT)
    root.only("format", "name", "precision", "test", "camera", "strip", "photo")
    name = root.name("name")
    precision = _precision(root.table("precision", "[precision]"))
    test = read_test(root.table("test", "[test]"))
    cameras = _cameras(root, path.parent, camera_files or {})
    photos = _photos(root, cameras)
    strips = _strips(root, photos)
    return Block(
        name=name,
        precision=precision,
        test=test,
        cameras=tuple(cameras.values()),
        photos=tuple(photos.values()),
        strips=tuple(strips.values()),
    )


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
    for camera in block.cameras:
        lines += ["", "[[camera]]", f"id = {toml_text(camera.id)}", f"c = {toml_number(camera.c)}"]
        if camera.file is not None:
            lines.append(f"file = {toml_text(camera.file)}")
        elif camera.calibration is not None:
            raise InputError(
                f"camera {quoted(camera.id)} cannot be written: its calibration has no file"
            )
        if camera.format is not None:
            lines.append(f"format = {toml_numbers(*camera.format)}")
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
    return "\n".join(lines) + "\n"


def _precision(table: TomlTable) -> Precision:
    table.only("image_um", "tie_variance", "control_m")
    default = Precision()
    control_m = table.number("control_m", default.control_m)
    if control_m < 0.0:
        raise table.fail("control_m", f"control_m = {control_m:g} must not be negative")
    return Precision(
        image_um=table.positive("image_um", default.image_um),
        tie_variance=cast(
            TieVariance,
            table.choice("tie_variance", get_args(TieVariance), default.tie_variance),
        ),
        control_m=control_m,
    )


def read_test(table: TomlTable) -> TestSettings:
    """Return the settings of a [test] table, each the default where it is left out."""
    table.only("kind", "alpha", "power")
    default = TestSettings()
    settings = TestSettings(
        kind=cast(TestKind, table.choice("kind", ("tau", "baarda"), default.kind)),
        alpha=table.fraction("alpha", default.alpha),
        power=table.fraction("power", default.power),
    )
    if not settings.alpha < settings.power:
        raise table.fail(
            "power" if "power" in table else "alpha",
            f"power = {settings.power:g} must be greater than alpha = {settings.alpha:g}",
        )
    return settings


def _cameras(root: TomlTable, folder: Path, files: Mapping[str, str]) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    tables: dict[str, TomlTable] = {}
    for table in root.tables("camera"):
        camera = _camera(table, folder, files)
        _refuse_second("camera", camera.id, table, tables)
        cameras[camera.id] = camera
    if not cameras:
        raise root.fail(None, "no camera: a block needs at least one [[camera]]")
    return cameras


def _camera(table: TomlTable, folder: Path, files: Mapping[str, str]) -> Camera:
    table.only("id", "c", "format", "file")
    if "file" not in table:
        return Camera(id=table.name("id"), c=table.positive("c"), format=frame_format(table))
    file = table.text("file")
    try:
        path = camera_path(folder, file)
    except ValueError as error:
        raise table.fail("file", f"file: {error}") from None
    calibration = parse_camera(files[file], path) if file in files else read_camera(path)
    # What stands in both places must be the same: nobody could say which of the two is meant.
    name = table.name("id") if "id" in table else calibration.id
    if name != calibration.id:
        raise _differs(table, "id", quoted(name), quoted(calibration.id), file)
    c = table.positive("c", calibration.c)
    if c != calibration.c:
        raise _differs(table, "c", repr(c), repr(calibration.c), file)
    size = frame_format(table)
    if size is not None and calibration.format is not None and size != calibration.format:
        raise _differs(table, "format", repr(list(size)), repr(list(calibration.format)), file)
    return Camera(name, c, size or calibration.format, calibration, file)


def _differs(table: TomlTable, key: str, here: str, there: str, file: str) -> InputError:
    return table.fail(key, f"{key} = {here}, but {quoted(file)} says {there}")


def _photos(root: TomlTable, cameras: dict[str, Camera]) -> dict[str, Photo]:
    photos: dict[str, Photo] = {}
    tables: dict[str, TomlTable] = {}
    for table in root.tables("photo"):
        table.only("id", "camera", "position", "rotation", "position_sigma", "rotation_sigma")
        photo = table.name("id", photo=True)
        _refuse_second("photo", photo, table, tables)
        camera = table.name("camera")
        if camera not in cameras:
            raise table.fail(
                "camera",
                f"photo {quoted(photo)}: unknown camera {quoted(camera)}{hint(camera, cameras)}",
            )
        photos[photo] = Photo(
            id=photo,
            camera=camera,
            position=_triple(table, "position"),
            rotation=read_rotation(table, "rotation"),
            position_sigma=_sigma(table, "position"),
            rotation_sigma=_sigma(table, "rotation"),
        )
    if not photos:
        raise root.fail(None, "no photo: a block needs at least one [[photo]]")
    return photos


def _strips(root: TomlTable, photos: dict[str, Photo]) -> dict[str, Strip]:
    strips: dict[str, Strip] = {}
    tables: dict[str, TomlTable] = {}
    for table in root.tables("strip"):
        table.only("id", "photos", "base")
        strip = table.name("id")
        _refuse_second("strip", strip, table, tables)
        names = table.names("photos", photo=True)
        seen: set[str] = set()
        for index, photo in enumerate(names):
            if photo not in photos:
                raise table.fail(
                    "photos",
                    f"strip {quoted(strip)}: unknown photo {quoted(photo)}{hint(photo, photos)}",
                    index,
                )
            if photo in seen:
                raise table.fail(
                    "photos", f"strip {quoted(strip)}: photo {quoted(photo)} twice", index
                )
            seen.add(photo)
        if len(names) < 2:
            raise table.fail("photos", f"strip {quoted(strip)} has fewer than 2 photos")
        base: float | None = None
        if "base" in table:
            # The sign comes from the data: only the magnitude is taken.
            base = abs(table.number("base"))
            if base == 0.0:
                raise table.fail("base", f"strip {quoted(strip)}: base must not be 0")
        strips[strip] = Strip(id=strip, photos=names, base=base)
    if not strips:
        raise root.fail(None, "no strip: a block needs at least one [[strip]]")
    return strips


def _refuse_second(what: str, name: str, table: TomlTable, tables: dict[str, TomlTable]) -> None:
    if name in tables:
        first = tables[name].line("id")
        also = "" if first is None else f" (first in line {first})"
        raise table.fail("id", f"{what} {quoted(name)} twice{also}")
    tables[name] = table


def _triple(table: TomlTable, key: str) -> tuple[float, float, float] | None:
    if key not in table:
        return None
    first, second, third = table.numbers(key, 3)
    return first, second, third


def read_rotation(table: TomlTable, key: str) -> tuple[float, float, float] | None:
    """Return omega, phi, kappa [rad] of a rotation's table, or None when it is left out."""
    if key not in table:
        return None
    angles = table.table(key, key)
    angles.only(*_ANGLES, "unit")
    to_radians = _UNITS[angles.choice("unit", tuple(_UNITS))]
    omega, phi, kappa = (angles.number(angle) * to_radians for angle in _ANGLES)
    return omega, phi, kappa


def _sigma(table: TomlTable, of: str) -> tuple[float, float, float] | None:
    key = f"{of}_sigma"
    if key not in table:
        return None
    if of not in table:
        raise table.fail(key, f"{key} without {of}")
    sigma = _triple(table, key) if of == "position" else read_rotation(table, key)
    if sigma is not None and min(sigma) <= 0.0:
        raise table.fail(key, f"{key} must hold numbers greater than 0")
    return sigma


def _angles(values: tuple[float, float, float]) -> str:
    pairs = [f"{name} = {toml_number(value)}" for name, value in zip(_ANGLES, values, strict=True)]
    return f'{{ {", ".join(pairs)}, unit = "rad" }}'
