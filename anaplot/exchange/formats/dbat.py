"""DBAT: its scripts and tables (`exchange/formats/pixeltables.py`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.dbatscript import Script, Table, read_script
from anaplot.exchange.formats.dbatwriter import write_dbat
from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gathered import check_with, head_of
from anaplot.exchange.formats.pixeltables import (
    CONTROL_COLUMNS,
    IMAGE_COLUMNS,
    NAME_COLUMNS,
    PixelRow,
    pixel_block,
    read_control_table,
    read_image_names,
    read_image_table,
    shift_of,
)
from anaplot.exchange.formats.statedcameras import needed_camera
from anaplot.photogrammetry.block import ControlPoint, ControlUse
from anaplot.textfiles.wording import place, quoted

__all__ = ["read", "recognises", "write"]

_LOOK = 1 << 16  # bytes that are looked at
_FILES = ("control", "check", "images", "more")


def recognises(source: Path) -> bool:
    """Return whether a source is a script of DBAT, a folder with one, or a table it names so."""
    try:
        if source.is_dir():
            return len(_scripts(source)) == 1
    except (OSError, ValueError):
        return False
    head = head_of(source, _LOOK)
    if "<document" in head and "dbat_script_version" in head:
        return True
    first = head.lstrip("\ufeff \n").split("\n", 1)[0].lower()
    names = [part.strip() for part in first.lstrip("# ").split(",")]
    return first.startswith("#") and names[:4] in (
        ["id", "image", "x", "y"],
        ["id", "im", "x", "y"],
    )


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a script with its tables, or a table of image points; raises InputError."""
    check_with(options.files, _FILES)
    notes: list[Note] = []
    stated = any(one is not None for one in (options.camera, options.c, options.pixels))
    if source.is_dir():
        scripts = _scripts(source)
        if len(scripts) != 1:
            raise InputError(
                f"{place(source)}: {len(scripts) or 'no'} script of DBAT (.xml): name a file"
            )
        source = scripts[0]
    if source.suffix.lower() == ".xml":
        script = read_script(source, camera=not stated)
        for word in options.files:
            raise InputError(f"--with {word}: the script says what is read")
    else:
        script = _of_files(source, options)
    camera = script.camera
    if camera is None:
        camera, told = needed_camera(options, pixels=True)
        notes += told
    shift = shift_of(options, notes)
    rows = list(_rows(script.images))
    names: dict[str, str] = {}
    for table in script.names:
        if table.path.exists():
            names |= read_image_names(table.path)
        else:
            text = f"names of images: no file {quoted(str(table.path.name))}"
            notes.append(Note("dropped", None, text))
    labelled: dict[Path, int] = {}
    control = [
        *_control(script.control, "control", labelled),
        *_control(script.check, "check", labelled),
    ]
    if labels := sum(labelled.values()):
        notes.append(Note("dropped", labels, "labels of control points: ids serve"))
    _refuse_twice(control)
    block = pixel_block(source.stem, camera, rows, names, control, options, shift, notes)
    return Imported(block, tuple(notes), (f"from {source.name}, DBAT",))


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a block as a folder with a script and its tables; raises InputError."""
    return write_dbat(exporting, target)


def _scripts(folder: Path) -> list[Path]:
    paths = sorted(folder.glob("*.xml"))
    return [path for path in paths if "dbat_script_version" in head_of(path, _LOOK)]


def _of_files(source: Path, options: ImportOptions) -> Script:
    def tables(word: str, columns: tuple[str, ...]) -> list[Table]:
        path = options.files.get(word)
        return [] if path is None else [Table(path, columns, None, None, frozenset())]

    images = [Table(source, IMAGE_COLUMNS, None, None, frozenset())]
    images += tables("more", IMAGE_COLUMNS)
    control, check = tables("control", CONTROL_COLUMNS), tables("check", CONTROL_COLUMNS)
    return Script(images, control, check, tables("images", NAME_COLUMNS), None)


def _rows(tables: Iterable[Table]) -> Iterator[PixelRow]:
    for table in tables:
        for row in read_image_table(table.path, table.columns, table.sigma_px):
            if _taken(table, row.point):
                yield row


def _control(
    tables: Iterable[Table], use: ControlUse, labelled: dict[Path, int]
) -> Iterator[ControlPoint]:
    for table in tables:
        points, labels = read_control_table(table.path, use, table.columns)
        taken = [point for point in points if _taken(table, point.point)]
        labelled[table.path] = labels
        yield from taken


def _taken(table: Table, point: str) -> bool:
    return point not in table.remove and (table.keep is None or point in table.keep)


def _refuse_twice(control: list[ControlPoint]) -> None:
    seen: set[str] = set()
    for row in control:
        if row.point in seen:
            raise InputError(f"point {quoted(row.point)} is control or check point twice")
        seen.add(row.point)
