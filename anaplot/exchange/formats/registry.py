"""The formats by their names; their modules are loaded when they are used."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol, cast

from anaplot.errors import InputError
from anaplot.textfiles.wording import hint, place, quoted

if TYPE_CHECKING:
    from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions

__all__ = ["FORMATS", "Format", "FormatModule", "format_of", "module_of", "recognised"]


class FormatModule(Protocol):
    """What the module of a format offers: the first two where it reads, `write` where it writes."""

    def recognises(self, source: Path) -> bool:
        """Return whether a file or folder is of this format, from little of it; never raises."""

    def read(self, source: Path, options: ImportOptions) -> Imported:
        """Read a source; raises InputError that names file and line, or place in the file."""

    def write(self, exporting: Exporting, target: Path) -> Exported:
        """Write a block as a new file or folder; raises InputError, and then nothing is there."""


class Format(NamedTuple):
    """A format.

    Attributes
    ----------
    kind
        Its name on the command line.
    title
        Whose files, and which.
    reads, writes
        Whether there is a way in, and out.
    import_options, export_options
        Options of the door that it has a use for.
    adjusted
        Whether what it writes is adjusted first; "control": where there is control.
    starts_from
        Files under `source/`: where one of them is there, nothing is adjusted.
    """

    kind: str
    title: str
    reads: bool = True
    writes: bool = True
    import_options: tuple[str, ...] = ()
    export_options: tuple[str, ...] = ()
    adjusted: bool | Literal["control"] = False
    starts_from: tuple[str, ...] = ()


_STATED = ("camera", "c", "pixels", "pixel_um")

_OPENSFM = ("sigma_px", "pixel_um", "crs", "control_m", "position_m", "order", "files")

_ALL: tuple[Format, ...] = (
    Format(
        "colmap",
        "COLMAP model",
        import_options=("sigma_px", "pixel_um"),
        adjusted=True,
        starts_from=tuple(
            f"{part}.{ending}"
            for ending in ("bin", "txt")
            for part in ("cameras", "images", "points3D")
        ),
    ),
    Format("opensfm", "an OpenSfM model", import_options=_OPENSFM, adjusted="control"),
    Format("odm", "an OpenDroneMap project", import_options=_OPENSFM, adjusted="control"),
    Format(
        "pixels",
        "image points of any program, as a table",
        import_options=(*_STATED, "sigma_um", "sigma_px", "unit", "columns", "order", "files"),
        export_options=("unit",),
    ),
    Format(
        "blocksexchange",
        "BlocksExchange XML (iTwin Capture, ContextCapture, Metashape)",
        import_options=("sigma_px", "crs"),
        adjusted=True,
    ),
    Format(
        "metashape",
        "Metashape's camera XML with markers",
        import_options=("sigma_px", "crs"),
    ),
    Format(
        "patb",
        "PAT-B .im, .con, .ori and -99 files",
        import_options=(*_STATED, "sigma_um", "sigma_classes", "unit", "order", "files"),
        export_options=("unit", "order"),
        adjusted=True,
    ),
    Format(
        "bingo",
        "BINGO's image file, geoin and itera",
        import_options=(*_STATED, "sigma_um", "order", "files"),
        export_options=("order",),
        adjusted=True,
    ),
    Format(
        "dbat",
        "DBAT's scripts and tables",
        import_options=(*_STATED, "sigma_px", "order", "files"),
    ),
    Format(
        "photomodeler",
        "PhotoModeler's 2D export",
        writes=False,
        import_options=(*_STATED, "sigma_px", "order", "files"),
    ),
    Format(
        "aicon",
        "AICON's .phc, .ior, .eor, .obc and .scale",
        import_options=(*_STATED, "sigma_um", "order", "files"),
        adjusted=True,
    ),
    Format(
        "bal",
        "a BAL problem",
        import_options=("sigma_px",),
        adjusted=True,
        starts_from=("problem.txt",),
    ),
    Format(
        "geojson",
        "photo centres and points as GeoJSON",
        reads=False,
        export_options=("ellipses",),
        adjusted=True,
    ),
    Format("csv", "results as tables", reads=False, adjusted=True),
    Format("parquet", "results as tables for data frames", reads=False, adjusted=True),
)

FORMATS = {one.kind: one for one in _ALL}
"""Formats by kind, in the order in which a source is looked at."""


def format_of(kind: str) -> Format:
    """Return a format by its name; raises InputError with the nearest."""
    found = FORMATS.get(kind)
    if found is None:
        near = hint(kind, FORMATS, listing=False)
        raise InputError(f"no format {quoted(kind)}{near}; there are {', '.join(FORMATS)}")
    return found


def module_of(kind: str) -> FormatModule:
    """Return the module of a format; raises InputError as `format_of`."""
    name = format_of(kind).kind.replace("-", "")
    return cast("FormatModule", import_module(f"anaplot.exchange.formats.{name}"))


def recognised(source: Path) -> Format:
    """Return the format of a source that says what it is.

    Raises
    ------
    InputError
        No format knows it, or several do.
    """
    readable = [one for one in FORMATS.values() if one.reads]
    found = [one for one in readable if module_of(one.kind).recognises(source)]
    if len(found) == 1:
        return found[0]
    kinds = ", ".join(one.kind for one in found or readable)
    if not found:
        raise InputError(
            f"{place(source)}: of no known format: name it ({kinds}; any table is pixels)"
        )
    raise InputError(f"{place(source)}: may be {kinds}: name it")
