"""A block as AICON's .phc, .ior, .eor, .obc and .scale in a new folder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from decimal import Decimal
from math import sqrt
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.door import Exported, Exporting, Note
from anaplot.exchange.formats.gathered import not_held, poses_of, whole_name
from anaplot.photogrammetry.block import Block
from anaplot.textfiles.names import MAX_NAME
from anaplot.textfiles.wholefile import create_folder
from anaplot.textfiles.wording import quoted

__all__ = ["CONTROL", "write_aicon"]

CONTROL = "-control.obc"
"""How the name of the control ends beside that of the .phc."""


def write_aicon(exporting: Exporting, target: Path) -> Exported:
    """Write a block; all of it, or nothing.

    Raises
    ------
    InputError
        A name that the files cannot hold, several cameras, a control point without all
        coordinates, or a file that cannot be written.
    """
    block = exporting.block
    if len(block.cameras) > 1:
        raise InputError(f"{len(block.cameras)} cameras: these files have one")
    holds = ("distances", "image sigmas", "control sigmas", "image_um", "control_m")
    notes = not_held(block, holds=holds)
    made = {".phc": "".join(_rays(block, notes)), ".ior": _interior(block)}
    poses = poses_of(exporting)
    if poses:
        made[".eor"] = "".join(
            f"{_name('photo', photo)} {_mm(position)} {' '.join(map(repr, angles))}\n"
            for photo, position, angles in poses
        )
    adjusted = exporting.adjusted
    if adjusted is not None:
        made[".obc"] = "".join(
            f"{_name('point', row.point)} {_mm(row.xyz)} "
            f"{_mm(sqrt(max(0.0, row.covariance[k][k])) for k in range(3))}\n"
            for row in adjusted.points
        )
    control = "".join(_control(block))
    if control:
        made[CONTROL] = control
    bars = "".join(_bars(block, notes))
    if bars:
        made[".scale"] = bars
    files = ((f"{target.name}{suffix}", text.encode()) for suffix, text in made.items())
    return Exported(create_folder(target, files), tuple(notes))


def _name(what: str, name: str) -> str:
    if name[0] in "%;":
        raise InputError(f"{what} {quoted(name)} begins as a comment does in AICON's files")
    return whole_name(what, name, MAX_NAME, "AICON")


def _mm(metres: Iterable[float]) -> str:
    return " ".join(_shifted(value, 3) for value in metres)


def _shifted(value: float, digits: int) -> str:
    """Return a number times a power of ten, with all its digits."""
    text = f"{Decimal(repr(value)).scaleb(digits):f}"
    return text if "." in text else f"{text}.0"


def _rays(block: Block, notes: list[Note]) -> Iterator[str]:
    half = again = 0
    seen: set[tuple[str, str]] = set()
    for row in block.image_points:
        if (row.photo, row.point) in seen:
            again += 1
            continue
        seen.add((row.photo, row.point))
        half += row.use in ("x", "y")
        sigma = _shifted(row.sigma_um or block.precision.image_um, -3)
        names = f"{_name('photo', row.photo)} {_name('point', row.point)}"
        active = int(row.use == "xy")
        yield f"{names} {row.x!r} {row.y!r} {sigma} {sigma} 0 0 0 {active} 0\n"
    if half:
        notes.append(Note("not held", half, "rays of which one coordinate counts: inactive"))
    if again:
        text = "rays of points measured again in another model: left out"
        notes.append(Note("not held", again, text))


def _interior(block: Block) -> str:
    # coordinates are ideal: nothing is left to be corrected
    return f"1 {-block.cameras[0].c!r} {' '.join(['0.0'] * 10)}\n"


def _control(block: Block) -> Iterator[str]:
    for row in block.control:
        if row.use != "control":
            continue
        xyz = [value for value in row.xyz if value is not None]
        if len(xyz) < 3:
            raise InputError(f"control point {quoted(row.point)}: X, Y and Z, or nothing")
        yield f"{_name('point', row.point)} {_mm(xyz)} {_mm(block.sigma_of(row))}\n"


def _bars(block: Block, notes: list[Note]) -> Iterator[str]:
    left = 0
    for one in block.conditions:
        if one.kind != "distance" or one.value is None:
            continue
        if one.use != "control":
            left += 1
            continue
        first, second = (_name("point", name) for name in one.points)
        yield f"{first} {second} {_mm((one.value, one.sigma))}\n"
    if left:
        notes.append(Note("not held", left, "distances that do not take part"))
