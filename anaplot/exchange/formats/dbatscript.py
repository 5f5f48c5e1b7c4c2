"""A script of DBAT: which tables it reads, their columns and standard deviations, its camera."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.camerafile import MAX_PIXELS, camera_path
from anaplot.exchange.formats.pixeltables import CONTROL_COLUMNS, IMAGE_COLUMNS, NAME_COLUMNS
from anaplot.exchange.formats.xmlstream import Element, elements
from anaplot.photogrammetry.block import Camera, in_pixels
from anaplot.textfiles.wording import place, plain, quoted

__all__ = ["Script", "Table", "read_script"]


class Table(NamedTuple):
    """A table that a script names.

    Attributes
    ----------
    path
        Its file.
    columns
        What its columns are.
    sigma_px
        Standard deviation [px] of all its rows, or None.
    keep, remove
        Points that alone are taken, or are left out; None where there is no such filter.
    """

    path: Path
    columns: tuple[str, ...]
    sigma_px: float | None
    keep: frozenset[str] | None
    remove: frozenset[str]


class Script(NamedTuple):
    """What a script reads: tables and the camera."""

    images: list[Table]
    control: list[Table]
    check: list[Table]
    names: list[Table]
    camera: Camera | None


def read_script(path: Path, *, camera: bool) -> Script:
    """Read a script.

    Parameters
    ----------
    path
        The file.
    camera
        Whether its camera is wanted.

    Raises
    ------
    InputError
        What is wrong, with file and line; a lens, which has no place here.
    """
    inputs = list(elements(path, "document", {"document/input"}))
    if not inputs:
        raise InputError(f"{place(path)}: no script of DBAT: it has no input")
    found = inputs[0]
    made = {
        name: _tables(found.child(name), path.parent, columns)
        for name, columns in (
            ("image_pts", IMAGE_COLUMNS),
            ("ctrl_pts", CONTROL_COLUMNS),
            ("check_pts", CONTROL_COLUMNS),
            ("images", NAME_COLUMNS),
        )
    }
    if not made["image_pts"]:
        raise _fault(found, "names no table of image points")
    cameras = found.child("cameras")
    all_of = [] if cameras is None else _all(cameras, "camera")
    if camera and len(all_of) > 1:
        raise _fault(all_of[1], "a second camera: one is read (--camera FILE)")
    return Script(
        made["image_pts"],
        made["ctrl_pts"],
        made["check_pts"],
        made["images"],
        _camera(all_of[0]) if camera and all_of else None,
    )


def _all(node: Element, name: str) -> list[Element]:
    return [child for child in node.children if child.name == name]


def _fault(node: Element, message: str) -> InputError:
    return node.at.fail(f"{plain(node.name, 60)}: {message}")


def _tables(node: Element | None, folder: Path, usual: tuple[str, ...]) -> list[Table]:
    if node is None:
        return []
    keep: frozenset[str] | None = None
    remove: frozenset[str] = frozenset()
    for one in _all(node, "filter"):
        ids = frozenset(part.strip() for part in one.attributes.get("id", "").split(","))
        if one.text.strip() == "keep":
            keep = ids if keep is None else keep & ids
        elif one.text.strip() == "remove":
            remove |= ids
        else:
            raise _fault(one, f"{quoted(one.text.strip())}: only keep and remove are known")
    out = []
    for file in _all(node, "file"):
        stated = file.attributes.get("format")
        columns = usual if stated is None else tuple(part.strip() for part in stated.split(","))
        stray = next((name for name in columns if name not in usual), None)
        if stray is not None:
            raise _fault(file, f"column {quoted(stray)} of its format is not known")
        sigma = file.attributes.get("sxy")
        px = None if sigma is None else _numbers(file, sigma, 1)[0]
        if px is not None and not px > 0.0:
            raise _fault(file, f"sxy must be greater than 0, not {px:g}")
        out.append(Table(_file(file, folder), columns, px, keep, remove))
    return out


def _file(node: Element, folder: Path) -> Path:
    """Return the path of a file inside the folder, in a sub-folder or beside the script."""
    name = node.text.strip().replace("\\", "/")
    try:
        path = camera_path(folder, name)
    except ValueError as error:
        raise _fault(node, str(error)) from None
    if Path(name).is_absolute():
        raise _fault(node, f"{quoted(name)} leads out of the folder")
    beside = folder / Path(name).name
    return beside if not path.exists() and beside.exists() else path


def _numbers(node: Element, text: str, count: int) -> list[float]:
    values = node.at.numbers_of([part.strip() for part in text.split(",")], node.name)
    if len(values) != count:
        raise _fault(node, f"{len(values)} numbers instead of {count}")
    return values


def _camera(node: Element) -> Camera:
    def numbers(name: str, count: int) -> list[float]:
        found = node.child(name)
        if found is None:
            raise _fault(node, f"states no {name}")
        return _numbers(found, found.text, count)

    unit = node.child("unit")
    if unit is not None and unit.text.strip() != "mm":
        raise _fault(unit, f"{quoted(unit.text.strip())}: only mm is known")
    for name, usual in (("K", 0.0), ("P", 0.0), ("skew", 0.0), ("aspect", 1.0)):
        found = node.child(name)
        if found is not None:
            values = _numbers(found, found.text, found.text.count(",") + 1)
            if any(value != usual for value in values):
                raise _fault(found, "is not read: state the camera by --camera FILE")
    c = numbers("cc", 1)[0]
    width, height = numbers("image", 2)
    sensor, principal = numbers("sensor", 2), numbers("pp", 2)
    size = int(width), int(height)
    if not all(0 < a <= MAX_PIXELS and a == b for a, b in zip(size, (width, height), strict=True)):
        raise _fault(node, "image must state its width and height in whole pixels")
    if not (c > 0.0 and sensor[0] > 0.0):
        raise _fault(node, "cc and sensor must be greater than 0")
    um = float(f"{1000.0 * sensor[0] / width:.12g}")
    if abs(1000.0 * sensor[1] / height - um) > 1e-6 * um:
        raise _fault(node, "its pixels are not square: state the camera by --camera FILE")
    # 1, 1 is the middle of the upper left pixel
    at = principal[0] / um * 1000.0 - 0.5, principal[1] / um * 1000.0 - 0.5
    return in_pixels(Camera("camera", c), size, um, (round(at[0], 9), round(at[1], 9)))
