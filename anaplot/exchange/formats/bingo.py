"""BINGO: image file, geoin and itera (`exchange/formats/bingofiles.py`)."""

from __future__ import annotations

from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.bingofiles import (
    ORDERS,
    XYZ,
    Geoin,
    Itera,
    PhotoRows,
    known_cameras,
    looks_like_images,
    read_geoin,
    read_images,
    read_itera,
    turned_by,
)
from anaplot.exchange.formats.bingowriter import write_bingo
from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gathered import check_order, check_with, image_sigma, stated_camera
from anaplot.exchange.formats.knownpoints import Sight, meant_order
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of
from anaplot.exchange.formats.sourcelines import SourceLine
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.rotation import rotation_angles
from anaplot.textfiles.wording import place, quoted, reason

__all__ = ["read", "recognises", "write"]

_FILES = ("geoin", "itera")
_MOST = 500  # files of a folder that are looked at


def recognises(source: Path) -> bool:
    """Return whether a source is an image file of BINGO, or a folder with one and a geoin."""
    try:
        if source.is_dir():
            found = _of_folder(source)
            return "geoin" in found and "images" in found
        return source.suffix.lower() != ".im" and looks_like_images(source)
    except (OSError, ValueError, InputError):
        return False


def read(source: Path, options: ImportOptions) -> Imported:
    """Read image coordinates, and control and orientations where there are any.

    Raises
    ------
    InputError
        What is wrong, with file and line.
    """
    check_with(options.files, _FILES)
    check_order(options.order, ORDERS)
    try:
        files = _of_folder(source) if source.is_dir() else {"images": source}
    except OSError as error:
        raise InputError(f"{place(source)}: cannot be read: {reason(error)}") from None
    files |= dict(options.files)
    if "images" not in files:
        raise InputError(f"{place(source)}: no image file: name it, and --with geoin=FILE")
    notes: list[Note] = []
    photos = read_images(files["images"], notes)
    geoin = read_geoin(files["geoin"], notes) if "geoin" in files else Geoin({}, [], [])
    cameras, shifts = _cameras(photos, geoin, options, notes)
    camera_of = {photo.photo: cameras[photo.camera] for photo in photos}
    rays = _rays(photos, camera_of, shifts, notes)
    points, told = image_points_of(rays, camera_of, pixels=False)
    notes += told
    itera = read_itera(files["itera"], notes) if "itera" in files else Itera({}, {}, {})
    known = dict(geoin.control) | itera.points
    poses = _poses(itera, Sight(points, camera_of, itera.positions, known), options.order, notes)
    sigma, said = image_sigma(options)
    notes += said
    if geoin.control:
        text = "control points have the block's control_m: standard deviations are not read"
        notes.append(Note("assumed", len(geoin.control), text))
    block = Block(
        source.stem or "bingo",
        Precision(sigma, "exact"),
        TestSettings(),
        tuple({camera.id: camera for camera in cameras.values()}.values()),
        tuple(
            Photo(photo.photo, camera_of[photo.photo].id, *poses.get(photo.photo, (None, None)))
            for photo in photos
        ),
        (),
        points,
        (
            *(ControlPoint(name, xyz) for name, xyz in geoin.control),
            *(ControlPoint(name, xyz, use="check") for name, xyz in geoin.check),
        ),
    )
    return Imported(block, tuple(notes), (f"from {files['images'].name}, BINGO",))


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a block as a folder with image file, geoin and itera; raises InputError."""
    return write_bingo(exporting, target)


def _poses(
    itera: Itera, sight: Sight, stated: str | None, notes: list[Note]
) -> dict[str, tuple[XYZ, XYZ]]:
    """Return positions [m] and omega, phi, kappa [rad], turned as known points say."""
    if not itera.angles:
        if stated is not None:
            raise InputError("--order: there are no orientations")
        return {}
    ways = {
        order: {name: turned_by(order, *angles) for name, angles in itera.angles.items()}
        for order in ORDERS
    }
    meant, why = meant_order(sight, ways, stated=stated, usual=ORDERS[0])
    if why is not None:
        text = f"rotations in gon are {meant}, image to ground (--order): {why}"
        notes.append(Note("assumed", len(itera.angles), text))
    stray = [name for name in itera.angles if name not in sight.camera_of]
    if stray:
        text = "orientations of photos without image points"
        notes.append(Note("dropped", len(stray), text, tuple(stray[:4])))
    return {
        name: (itera.positions[name], rotation_angles(rotation))
        for name, rotation in ways[meant].items()
    }


def _of_folder(folder: Path) -> dict[str, Path]:
    """Return the files of a folder by what is in them; raises InputError for two of a kind."""
    found: dict[str, Path] = {}
    entries = sorted(one for one in folder.iterdir() if one.is_file())[:_MOST]
    kinds = {path: next((w for w in _FILES if w in path.name.lower()), None) for path in entries}
    cameras = {
        name for path, kind in kinds.items() if kind == "geoin" for name in known_cameras(path)
    }
    for path, named in kinds.items():
        kind = named
        if kind is None and looks_like_images(path, cameras):
            kind = "images"
        if kind is None:
            continue
        if kind in found:
            both = f"{quoted(found[kind].name)} and {quoted(path.name)}"
            raise InputError(f"{place(folder)}: {both}: name the image file and the others")
        found[kind] = path
    return found


def _cameras(
    photos: list[PhotoRows], geoin: Geoin, options: ImportOptions, notes: list[Note]
) -> tuple[dict[str, Camera], dict[str, tuple[float, float]]]:
    """Return the camera and the principal point of every camera that photos name."""
    given, said = stated_camera(options)
    notes += said
    cameras: dict[str, Camera] = {}
    shifts: dict[str, tuple[float, float]] = {}
    for photo in photos:
        name = photo.camera
        if name in cameras:
            continue
        own = geoin.cameras.get(name)
        if own is None and len(geoin.cameras) == 1:
            ((other, own),) = geoin.cameras.items()
            notes.append(Note("assumed", None, f"camera {name} is the only CAPA, {other}"))
        if given is not None:
            cameras[name] = given
            if own is not None:
                notes.append(Note("dropped", None, f"CAPA of camera {name}: another is stated"))
        elif own is None:
            raise photo.line.fail(
                f"camera {quoted(name)} has no CAPA: --with geoin=FILE, --c or --camera FILE"
            )
        else:
            cameras[name] = Camera(name, own[0])
            shifts[name] = own[1], own[2]
    return cameras, shifts


def _rays(
    photos: list[PhotoRows],
    camera_of: dict[str, Camera],
    shifts: dict[str, tuple[float, float]],
    notes: list[Note],
) -> list[MeasuredRay]:
    rays = []
    for photo in photos:
        x0, y0 = shifts.get(photo.camera, (0.0, 0.0))
        reach = camera_of[photo.photo].reach()
        for line, point, x, y in photo.points:
            _check(line, x - x0, y - y0, reach)
            rays.append(MeasuredRay(photo.photo, point, x - x0, y - y0))
    moved = {name: shift for name, shift in shifts.items() if any(shift)}
    count = sum(len(photo.points) for photo in photos if photo.camera in moved)
    if count:
        most = max(max(map(abs, shift)) for shift in moved.values())
        text = f"rays moved to the principal point, by at most {most:g} mm"
        notes.append(Note("changed", count, text))
    return rays


def _check(line: SourceLine, x: float, y: float, reach: tuple[float, float]) -> None:
    if abs(x) > reach[0] or abs(y) > reach[1]:
        raise line.fail(f"{x:g}, {y:g} mm lies outside what the camera can have: they must be mm")
