"""block.toml: a block's settings, cameras, strips and photos, to and from text."""

from __future__ import annotations

import math
from pathlib import Path
from typing import cast

from anaplot.errors import InputError
from anaplot.exchange.tomlfile import TomlFile, TomlTable
from anaplot.exchange.wording import hint, quoted
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    Photo,
    Precision,
    Strip,
    TestKind,
    TestSettings,
    TieVariance,
)

__all__ = ["BLOCK_FORMAT", "format_block_toml", "parse_block_toml"]

BLOCK_FORMAT = 1

_ANGLES = ("omega", "phi", "kappa")
_UNITS = {"deg": math.pi / 180.0, "gon": math.pi / 200.0, "rad": 1.0}


def parse_block_toml(text: str, path: Path) -> Block:
    """Return the block that a block.toml declares, without its measured points.

    Parameters
    ----------
    text
        Content of the file.
    path
        Its name, for messages.

    Raises
    ------
    InputError
        Anything but a complete block of format 1, with file, line and key.
    """
    root = TomlFile(path, text).root
    _check_format(root)
    root.only("format", "name", "precision", "test", "camera", "strip", "photo")
    name = root.name("name")
    precision = _precision(root.table("precision", "[precision]"))
    test = _test(root.table("test", "[test]"))
    cameras = _cameras(root)
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


def format_block_toml(block: Block) -> str:
    """Return the text of a block.toml; numbers are written so that they are read back exactly."""
    lines = [
        f"format = {BLOCK_FORMAT}",
        f"name = {_text(block.name)}",
        "",
        "[precision]",
        f"image_um = {_number(block.precision.image_um)}",
        f"tie_variance = {_text(block.precision.tie_variance)}",
        f"control_m = {_number(block.precision.control_m)}",
        "",
        "[test]",
        f"kind = {_text(block.test.kind)}",
        f"alpha = {_number(block.test.alpha)}",
        f"power = {_number(block.test.power)}",
    ]
    for camera in block.cameras:
        lines += ["", "[[camera]]", f"id = {_text(camera.id)}", f"c = {_number(camera.c)}"]
        if camera.format is not None:
            lines.append(f"format = {_numbers(camera.format)}")
    for strip in block.strips:
        photos = ", ".join(_text(photo) for photo in strip.photos)
        lines += ["", "[[strip]]", f"id = {_text(strip.id)}", f"photos = [{photos}]"]
        if strip.base is not None:
            lines.append(f"base = {_number(strip.base)}")
    for photo in block.photos:
        lines += ["", "[[photo]]", f"id = {_text(photo.id)}", f"camera = {_text(photo.camera)}"]
        if photo.position is not None:
            lines.append(f"position = {_numbers(photo.position)}")
        if photo.rotation is not None:
            lines.append(f"rotation = {_angles(photo.rotation)}")
        if photo.position_sigma is not None:
            lines.append(f"position_sigma = {_numbers(photo.position_sigma)}")
        if photo.rotation_sigma is not None:
            lines.append(f"rotation_sigma = {_angles(photo.rotation_sigma)}")
    return "\n".join(lines) + "\n"


def _check_format(root: TomlTable) -> None:
    # First of all: the keys of a newer format are not unknown keys but unread news.
    number = root.integer("format")
    if number > BLOCK_FORMAT:
        raise root.fail(
            "format", f"written by a newer version of anaplot: this one reads format {BLOCK_FORMAT}"
        )
    if number != BLOCK_FORMAT:
        raise root.fail("format", f"format must be {BLOCK_FORMAT}")


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
            table.choice("tie_variance", ("paper", "propagated"), default.tie_variance),
        ),
        control_m=control_m,
    )


def _test(table: TomlTable) -> TestSettings:
    table.only("kind", "alpha", "power")
    default = TestSettings()
    return TestSettings(
        kind=cast(TestKind, table.choice("kind", ("tau", "baarda"), default.kind)),
        alpha=table.fraction("alpha", default.alpha),
        power=table.fraction("power", default.power),
    )


def _cameras(root: TomlTable) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    tables: dict[str, TomlTable] = {}
    for table in root.tables("camera"):
        table.only("id", "c", "format")
        camera = table.name("id")
        _refuse_second("camera", camera, table, tables)
        c = table.positive("c")
        size: tuple[float, float] | None = None
        if "format" in table:
            width, height = table.numbers("format", 2)
            if width <= 0.0 or height <= 0.0:
                raise table.fail("format", "format must hold two numbers greater than 0")
            size = width, height
        cameras[camera] = Camera(id=camera, c=c, format=size)
    if not cameras:
        raise root.fail(None, "no camera: a block needs at least one [[camera]]")
    return cameras


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
            rotation=_rotation(table, "rotation"),
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


def _rotation(table: TomlTable, key: str) -> tuple[float, float, float] | None:
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
    sigma = _triple(table, key) if of == "position" else _rotation(table, key)
    if sigma is not None and min(sigma) <= 0.0:
        raise table.fail(key, f"{key} must hold numbers greater than 0")
    return sigma


def _text(value: str) -> str:
    if not value.isprintable():
        raise InputError(f"the name {quoted(value)} holds a character that cannot be printed")
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _number(value: float) -> str:
    return repr(float(value))


def _numbers(values: tuple[float, ...]) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def _angles(values: tuple[float, float, float]) -> str:
    pairs = [f"{name} = {_number(value)}" for name, value in zip(_ANGLES, values, strict=True)]
    return f'{{ {", ".join(pairs)}, unit = "rad" }}'
