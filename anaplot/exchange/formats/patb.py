"""PAT-B: .im, .con and .ori, and the -99 files in use (`exchange/formats/patbfiles.py`).

Ours are image coordinates in mm and a rotation from image to ground.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gathered import (
    check_order,
    check_with,
    head_of,
    image_sigma,
    named,
    number,
    stated_camera,
)
from anaplot.exchange.formats.knownpoints import Sight, meant_order
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of
from anaplot.exchange.formats.patbfiles import (
    SENSES,
    CameraLine,
    ImageFile,
    Orientation,
    PhotoRows,
    PointRow,
    is_end,
    read_camera_lines,
    read_control,
    read_images,
    read_orientations,
    unit_of_project,
)
from anaplot.exchange.formats.patbwriter import write_patb
from anaplot.exchange.formats.sourcelines import value_of
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    Photo,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix
from anaplot.textfiles.wording import hint, place, plain, quoted

__all__ = ["read", "recognises", "write"]

_FILES = ("control", "orientations", "camera", "project")
_SUFFIXES = {".im": "images", ".con": "control", ".ori": "orientations", ".pro": "project"}
_LOOK = 20_000  # bytes that are looked at
_LARGE_C = 2000.0  # no camera constant in mm is larger
_NARROWEST, _WIDEST = 0.004, 4.0  # image coordinates over the camera constant, of any camera
_LARGE_XY = 500.0  # no image coordinate in mm is larger, some in um are


class _Cameras(NamedTuple):
    cameras: tuple[Camera, ...]
    of_photo: dict[str, str]
    shift: tuple[float, float]
    notes: list[Note]


def recognises(source: Path) -> bool:
    """Return whether a source is an image file of this family, a .pro beside one, or a folder."""
    try:
        if source.is_dir():
            return len(named(source, ".im")) == 1
        if source.suffix.lower() == ".pro":
            return any(one.stem == source.stem for one in named(source.parent, ".im"))
        return _looks_like_images(source)
    except (OSError, ValueError, InputError):
        return False


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a project; raises InputError."""
    check_with(options.files, _FILES)
    check_order(options.order, SENSES)
    files = _files(source, options)
    images = read_images(files["images"])
    notes: list[Note] = []
    unit, c_unit = _units(images, options, files.get("project"), notes)
    lens = read_camera_lines(files["camera"]) if "camera" in files else None
    found = _cameras(images, options, lens, c_unit)
    notes += found.notes
    cameras = {camera.id: camera for camera in found.cameras}
    camera_of = {photo: cameras[name] for photo, name in found.of_photo.items()}
    rays = _rays(images, options, found, unit, notes)
    points, told = image_points_of(rays, camera_of, pixels=False)
    notes += told
    control = _control(files.get("control"), images, notes)
    places = {
        row.point: (x, y, z)
        for row in control
        for x, y, z in (row.xyz,)
        if x is not None and y is not None and z is not None
    }
    sight = Sight(points, camera_of, {}, places)
    stated = _orientations(files.get("orientations"), options, sight, notes)
    strips = _strips(images, notes)
    sigma, said = image_sigma(options)
    notes += said
    photos = tuple(
        Photo(one.photo, found.of_photo[one.photo], *_posed(stated.get(one.photo)))
        for one in images.photos
    )
    block = Block(
        source.stem or source.name or "patb",
        Precision(sigma, "exact"),
        TestSettings(),
        found.cameras,
        photos,
        strips,
        points,
        control,
    )
    kind = "-99 files" if images.header else "PAT-B"
    comments = (f"from {files['images'].name}, {kind}, image coordinates in {unit}",)
    return Imported(block, tuple(notes), comments)


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a block as a folder with .im, .con and .ori; raises InputError."""
    return write_patb(exporting, target)


def _posed(
    found: Orientation | None,
) -> tuple[tuple[float, float, float] | None, tuple[float, float, float] | None]:
    return (None, None) if found is None else (found.position, found.rotation)


def _looks_like_images(source: Path) -> bool:
    head = head_of(source, _LOOK).splitlines()[:3]
    rows = [line.split() for line in head if line.strip() and not line.lstrip().startswith("#")]
    if len(rows) < 2:
        return False
    values = [[value_of(field) for field in row] for row in rows]
    if len(rows[0]) == 4:  # the header of the -99 files in use, then a photo with a 0
        return None not in values[0] and len(rows[1]) == 2 and values[1][1] == 0.0
    c = values[0][1] if len(rows[0]) == 2 else None
    named = source.suffix.lower() == ".im"
    return c is not None and (named or c >= 10.0) and (is_end(rows[1][0]) or len(rows[1]) >= 3)


def _files(source: Path, options: ImportOptions) -> dict[str, Path]:
    """Return the files of a project by what is in them; raises InputError."""
    files: dict[str, Path] = {}
    try:
        if source.is_dir():
            images = named(source, ".im")
            if len(images) != 1:
                names = ", ".join(plain(one.name, 60) for one in images[:5])
                count = f"{len(images)} files .im ({names})" if images else "no file .im"
                raise InputError(f"{place(source)}: {count}: name one of them")
            files = _beside(images[0])
        elif source.suffix.lower() == ".pro":
            files = _beside(source)
            if "images" not in files:
                raise InputError(f"{place(source)}: no file .im of this name beside it")
        else:
            files = {"images": source}
    except OSError as error:
        raise InputError(f"{place(source)}: cannot be read: {plain(str(error), 100)}") from None
    return files | dict(options.files)


def _beside(path: Path) -> dict[str, Path]:
    """Return the files of the same name, by what is in them."""
    same = [one for one in path.parent.iterdir() if one.stem == path.stem]
    return {_SUFFIXES[one.suffix.lower()]: one for one in same if one.suffix.lower() in _SUFFIXES}


def _units(
    images: ImageFile, options: ImportOptions, project: Path | None, notes: list[Note]
) -> tuple[str, str]:
    """Return the units of image coordinates and of camera constants: mostly the same."""
    largest_c = max(number(one.line, one.c, "the camera constant") for one in images.photos)
    most = max((_largest(row) for one in images.photos for row in one.points), default=0.0)
    unit: str | None = options.unit
    if unit == "px":
        raise InputError("--unit px: these files have um or mm")
    if unit is None and project is not None:
        unit = unit_of_project(project)
        if unit is not None:
            notes.append(Note("assumed", None, f"{unit}, the only unit that the .pro names"))
    if unit is None:
        unit = "um" if most > _LARGE_XY else "mm"
        text = f"image coordinates are in {unit}: the largest is {most:g} (--unit)"
        notes.append(Note("assumed", None, text))
    alike = largest_c == 0.0 or most == 0.0 or _NARROWEST < most / largest_c <= _WIDEST
    c_unit = unit if alike else "mm" if unit == "um" else "um"
    if c_unit == "mm" and largest_c > _LARGE_C:
        c_unit = "um"
    if c_unit != unit:
        text = f"camera constants are in {c_unit}, unlike the coordinates: the largest is"
        notes.append(Note("assumed", None, f"{text} {largest_c:g}"))
    return unit, c_unit


def _largest(row: PointRow) -> float:
    return max(abs(number(row.line, text, "x and y")) for text in (row.x, row.y))


def _cameras(
    images: ImageFile, options: ImportOptions, lens: CameraLine | None, c_unit: str
) -> _Cameras:
    """Return a camera for every camera constant."""
    given, notes = stated_camera(options)
    if given is not None and lens is not None:
        raise InputError("--with camera: beside --c or --camera, which state it")
    if lens is not None:
        given = Camera("camera", lens.c, lens.format)
    by_c: dict[float, list[PhotoRows]] = {}
    for photo in images.photos:
        c = number(photo.line, photo.c, "the camera constant", c_unit)
        if c < 0.0:
            raise photo.line.fail(f"the camera constant must be greater than 0, not {photo.c}")
        if c == 0.0:
            if given is None:
                raise photo.line.fail(
                    "the camera constant is 0: state it (--c, --camera FILE or --with camera=FILE)"
                )
            c = given.c
        elif given is not None and abs(c - given.c) > 1e-9 * c:
            raise photo.line.fail(f"the camera constant is {c:g} mm, but {given.c:g} mm is stated")
        by_c.setdefault(c, []).append(photo)
    ids = ["camera"] if len(by_c) == 1 else [str(k) for k in range(1, len(by_c) + 1)]
    made = []
    for name, c in zip(ids, by_c, strict=True):
        made.append(Camera(name, c) if given is None or given.c != c else given)
    if len(made) > 1:
        constants = tuple(f"{camera.c:g}" for camera in made)
        notes.append(
            Note("assumed", len(made), "cameras, one for every camera constant [mm]", constants)
        )
    of_photo = {
        photo.photo: camera.id
        for camera, photos in zip(made, by_c.values(), strict=True)
        for photo in photos
    }
    shift = (0.0, 0.0) if lens is None else lens.principal
    return _Cameras(tuple(made), of_photo, shift, notes)


def _rays(
    images: ImageFile, options: ImportOptions, found: _Cameras, unit: str, notes: list[Note]
) -> list[MeasuredRay]:
    cameras = {camera.id: camera for camera in found.cameras}
    rays: list[MeasuredRay] = []
    groups: set[str] = set()
    x0, y0 = found.shift
    for photo in images.photos:
        camera = cameras[found.of_photo[photo.photo]]
        for row in photo.points:
            x = number(row.line, row.x, "x and y", unit) - x0
            y = number(row.line, row.y, "x and y", unit) - y0
            reach = camera.reach()
            if abs(x) > reach[0] or abs(y) > reach[1]:
                what = "4 c" if camera.format is None else "the format"
                raise row.line.fail(
                    f"{x:g}, {y:g} mm lies outside {what} of camera {quoted(camera.id)} "
                    f"(c = {camera.c:g} mm): is {unit} the unit?"
                )
            sigma = None
            if row.group is not None:
                groups.add(row.group)
                sigma = options.sigma_classes.get(row.group)
            rays.append(MeasuredRay(photo.photo, row.point, x, y, sigma))
    unknown = sorted(set(options.sigma_classes) - groups)
    if unknown:
        raise InputError(f"--sigma-class {plain(unknown[0], 60)}: no such group{hint('', groups)}")
    plain_groups = tuple(sorted(groups - set(options.sigma_classes)))
    if plain_groups:
        text = "groups of image points have the same sigma as the others (--sigma-class GROUP=UM)"
        notes.append(Note("assumed", len(plain_groups), text, plain_groups))
    if x0 or y0:
        text = f"rays moved to the principal point, by {x0:g}, {y0:g} mm"
        notes.append(Note("changed", len(rays), text))
    if images.beside:
        notes.append(Note("dropped", images.beside, "rows with further columns: these"))
    if images.header:
        notes.append(Note("dropped", None, "the header of four numbers"))
    return rays


def _control(path: Path | None, images: ImageFile, notes: list[Note]) -> tuple[ControlPoint, ...]:
    if path is None:
        return ()
    rows, told = read_control(path, codes=images.header)
    if told is not None:
        notes.append(Note("assumed", None, f"control: {told}"))
    if rows:
        text = "control points have the block's control_m: the file states no standard deviation"
        groups = sorted({group for row in rows for group in row.groups})
        more = f", whatever their group ({', '.join(groups[:6])})" if groups else ""
        notes.append(Note("assumed", len(rows), text + more))
    measured = {row.point for photo in images.photos for row in photo.points}
    idle = [row.point for row in rows if row.point not in measured]
    if idle:
        notes.append(Note("assumed", len(idle), "control points are in no photo", tuple(idle[:4])))
    return tuple(ControlPoint(row.point, row.xyz) for row in rows)


def _orientations(
    path: Path | None, options: ImportOptions, sight: Sight, notes: list[Note]
) -> dict[str, Orientation]:
    """Return orientations by photo, turned as the control says where nobody does."""
    if path is None:
        if options.order is not None:
            raise InputError("--order: there are no orientations")
        return {}
    rows, sense, said = read_orientations(path, options.order)
    photos = sight.camera_of
    matrices = {row.photo: rotation_matrix(*row.rotation) for row in rows}
    turned = {name: matrix.T for name, matrix in matrices.items()}
    other = SENSES[1 - SENSES.index(sense)]
    sight = sight._replace(positions={row.photo: row.position for row in rows})
    ways = {sense: matrices, other: turned}
    meant, why = meant_order(sight, ways, stated=sense if said else None, usual=SENSES[0])
    if why is not None:
        notes.append(Note("assumed", None, f"matrices of the .ori are {meant} (--order): {why}"))
    if meant != sense:
        rows = [row._replace(rotation=rotation_angles(turned[row.photo])) for row in rows]
    stray = [row.photo for row in rows if row.photo not in photos]
    if stray:
        text = "orientations of photos without image points"
        notes.append(Note("dropped", len(stray), text, tuple(stray[:4])))
    return {row.photo: row for row in rows if row.photo in photos}


def _strips(images: ImageFile, notes: list[Note]) -> tuple[Strip, ...]:
    """Return the strips that negative numbers end."""
    if not any(photo.last for photo in images.photos):
        return ()
    runs: list[list[str]] = [[]]
    for photo in images.photos:
        runs[-1].append(photo.photo)
        if photo.last:
            runs.append([])
    if runs[-1]:
        notes.append(Note("assumed", len(runs[-1]), "photos after the last end of a strip are one"))
    single = [run[0] for run in runs if len(run) == 1]
    if single:
        notes.append(Note("dropped", len(single), "strips of one photo", tuple(single[:4])))
    runs = [run for run in runs if len(run) > 1]
    return tuple(Strip(str(k), tuple(run)) for k, run in enumerate(runs, 1))
