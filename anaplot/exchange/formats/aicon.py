"""AICON: .phc with .eor, .ior, .obc and .scale (`exchange/formats/aiconfiles.py`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.formats.aiconfiles import (
    ImageRow,
    Interior,
    read_bars,
    read_interior,
    read_objects,
    read_poses,
    read_rays,
)
from anaplot.exchange.formats.aiconwriter import CONTROL, write_aicon
from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gathered import (
    check_order,
    check_with,
    head_of,
    image_sigma,
    named,
    stated_camera,
)
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.textfiles.wording import place, plain, reason

__all__ = ["INACTIVE", "read", "recognises", "write"]

INACTIVE = "inactive in the .phc"
"""Why a ray does not count that was switched off there."""

_FILES = {"orientations": ".eor", "camera": ".ior", "scale": ".scale", "objects": ".obc"}
_WORDS = (*_FILES, "control")
_SIGNS = {"subtract": 1.0, "add": -1.0}
_LOOK = 2000  # bytes that are looked at


def recognises(source: Path) -> bool:
    """Return whether a source is a .phc, or a folder with one."""
    try:
        if source.is_dir():
            return len(named(source, ".phc")) == 1
        if source.suffix.lower() != ".phc":
            return False
        head = head_of(source, _LOOK).splitlines()
        rows = [line.split() for line in head if line.strip() and line.strip()[0] not in "#%;*"]
        return bool(rows) and len(rows[0]) >= 4 and float(rows[0][2]) == float(rows[0][2])
    except (OSError, ValueError):
        return False


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a project.

    Raises
    ------
    InputError
        What is wrong, with file and line.
    """
    check_with(options.files, _WORDS)
    check_order(options.order, _SIGNS)
    files = _files(source, options)
    notes: list[Note] = []
    rows = read_rays(files["rays"], notes)
    camera, interior = _camera(files.get("camera"), options, notes)
    for row in rows:
        if max(abs(row.x), abs(row.y)) > max(camera.reach()):
            raise row.line.fail(f"{row.x:g}, {row.y:g} mm lies outside what the camera can have")
    rays = _rays(rows, interior, options.order, notes)
    camera_of = dict.fromkeys((row.photo for row in rows), camera)
    points, told = image_points_of(rays, camera_of, pixels=False)
    notes += told
    off = sum(not row.active for row in rows)
    if off:
        notes.append(Note("assumed", off, "inactive rays: use = off"))
    sigma, said = _sigma(rows, options)
    notes += said
    poses = read_poses(files["orientations"], notes) if "orientations" in files else {}
    stray = [name for name in poses if name not in camera_of]
    if stray:
        text = "orientations of images without points"
        notes.append(Note("dropped", len(stray), text, tuple(stray[:4])))
    known = {row.point for row in rows}
    block = Block(
        source.stem or "aicon",
        Precision(sigma, "exact"),
        TestSettings(),
        (camera,),
        tuple(Photo(name, camera.id, *poses.get(name, (None, None))) for name in camera_of),
        (),
        points,
        _control(files, notes),
        _bars(files.get("scale"), known, notes),
    )
    notes.append(Note("changed", None, "object coordinates and lengths from mm to m"))
    return Imported(block, tuple(notes), (f"from {files['rays'].name}, AICON",))


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a block as a folder of these files; raises InputError."""
    return write_aicon(exporting, target)


def _files(source: Path, options: ImportOptions) -> dict[str, Path]:
    """Return the files by what is in them; raises InputError."""
    if not source.is_dir():
        return {"rays": source} | dict(options.files)
    try:
        rays = named(source, ".phc")
        if len(rays) != 1:
            count = f"{len(rays)} files .phc" if rays else "no file .phc"
            raise InputError(f"{place(source)}: {count}: name one of them")
        files = {"rays": rays[0]}
        ends = {word: (suffix, suffix) for word, suffix in _FILES.items()}
        for word, (suffix, end) in (ends | {"control": (".obc", CONTROL)}).items():
            wanted = f"{rays[0].stem}{end}".lower()
            same = [one for one in named(source, suffix) if one.name.lower() == wanted]
            if same:
                files[word] = same[0]
    except OSError as error:
        raise InputError(f"{place(source)}: cannot be read: {reason(error)}") from None
    return files | dict(options.files)


def _camera(
    path: Path | None, options: ImportOptions, notes: list[Note]
) -> tuple[Camera, Interior | None]:
    given, told = stated_camera(options)
    notes += told
    if path is None:
        if given is None:
            raise InputError(
                "the camera constant is not known: --with camera=FILE.ior, --c or --camera FILE"
            )
        return given, None
    interior = read_interior(path)
    if given is not None:
        raise InputError(f"{place(path)}: beside --c or --camera, which state the camera")
    return Camera("camera", interior.c), interior


def _rays(
    rows: list[ImageRow], interior: Interior | None, order: str | None, notes: list[Note]
) -> list[MeasuredRay]:
    xy = np.array([(row.x, row.y) for row in rows])
    if interior is not None:
        ideal = interior.ideal(xy, _SIGNS[order or "subtract"])
        most = 1000.0 * float(np.abs(ideal - (xy - interior.principal)).max())
        moved = bool(any(interior.principal))
        if most > 0.0 or moved:
            x, y = interior.principal
            text = f"rays are ideal coordinates: moved by {x:g}, {y:g} mm to the principal point"
            shown = f"{text}, corrected for distortion by at most {most:.4g} um"
            notes.append(Note("changed", len(rows), shown))
        if most > 0.0 and order is None:
            text = "the distortion is subtracted from what was measured (--order add)"
            notes.append(Note("assumed", None, text))
        xy = ideal
    elif order is not None:
        raise InputError("--order: there is no .ior")
    return [
        MeasuredRay(
            row.photo,
            row.point,
            x,
            y,
            row.sigma_um,
            "xy" if row.active else "off",
            None if row.active else INACTIVE,
        )
        for row, (x, y) in zip(rows, xy.tolist(), strict=True)
    ]


def _sigma(rows: list[ImageRow], options: ImportOptions) -> tuple[float, list[Note]]:
    """Return the a-priori sigma of the block [um]: the middle one of those stated."""
    stated = sorted(row.sigma_um for row in rows if row.sigma_um is not None)
    if options.sigma_um is not None or not stated:
        return image_sigma(options)
    return stated[len(stated) // 2], []


def _control(files: dict[str, Path], notes: list[Note]) -> tuple[ControlPoint, ...]:
    if "objects" in files and "control" not in files:
        count = len(read_objects(files["objects"]))
        text = f"object points of {plain(files['objects'].name, 60)}: results, not control"
        notes.append(Note("dropped", count, f"{text} (--with control=FILE)"))
    if "control" not in files:
        return ()
    control = tuple(ControlPoint(*row) for row in read_objects(files["control"]))
    name = plain(files["control"].name, 60)
    notes.append(Note("assumed", len(control), f"object points of {name} are control"))
    return control


def _bars(path: Path | None, known: set[str], notes: list[Note]) -> tuple[ObjectCondition, ...]:
    if path is None:
        return ()
    bars = read_bars(path)
    here = [bar for bar in bars if bar.first in known and bar.second in known]
    if len(here) < len(bars):
        text = "scale bars with an end that is in no image"
        notes.append(Note("dropped", len(bars) - len(here), text))
    return tuple(
        ObjectCondition("distance", (bar.first, bar.second), bar.length, bar.sigma) for bar in here
    )
