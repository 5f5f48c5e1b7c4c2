"""A report as files: the page, the whole of tables that it cuts, and its drawings."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from html import unescape
from pathlib import Path
from typing import NamedTuple

from anaplot.aliases import Progress
from anaplot.drawing.standalone import is_standalone, standalone
from anaplot.errors import InputError
from anaplot.report.ascsv import csv_text
from anaplot.report.html.parts import Report, drawings_in
from anaplot.report.html.render import html_of, is_report
from anaplot.report.html.views import MOST_ROWS, of_every_row, page_view
from anaplot.textfiles.inputfile import real_path
from anaplot.textfiles.wholefile import (
    all_or_nothing,
    check_place,
    make_folder,
    write_together,
)
from anaplot.textfiles.wording import place, quoted, reason

__all__ = ["Written", "check_report", "tables_folder", "write_report"]

_HEAD = 4096  # bytes of a file that say whether it is a report


class Written(NamedTuple):
    """What was written.

    Attributes
    ----------
    page
        The page, and `size` its bytes.
    cut
        Files of tables that the page does not show whole.
    figures
        Files of drawings.
    """

    page: Path
    size: int
    cut: tuple[Path, ...]
    figures: tuple[Path, ...]


def tables_folder(path: Path) -> Path:
    """Return the folder beside a page that has the whole of the tables it cuts."""
    return path.with_name(path.name + ".tables")


def check_report(path: Path, figures: Path | None = None) -> None:
    """Refuse files that could not be written, before anything is computed.

    Raises
    ------
    InputError
        There is no folder for the page, or something that is no earlier report has its name; or
        the folder for tables, or for figures, holds what no report has written, or is one of these.
    """
    check_place(path)
    folder = tables_folder(path)
    if figures is not None and real_path(figures) in (real_path(path), real_path(folder)):
        raise InputError(f"{place(figures)}: is the page or has its tables, no folder for figures")
    try:
        if os.path.lexists(path) and not _earlier(path):
            raise InputError(f"{place(path)}: exists already, is no report, and is not overwritten")
        if os.path.lexists(folder):
            if not folder.is_dir():
                raise InputError(f"{place(folder)}: exists already and is not overwritten")
            other = _no_table(folder, path)
            if other is not None:
                raise InputError(
                    f"{place(folder)}: holds {quoted(other)}, which no report has written"
                )
        if (
            figures is not None
            and os.path.lexists(figures)
            and not (figures.is_dir() and _figures_alone(figures, path))
        ):
            raise InputError(f"{place(figures)}: is neither a new folder nor one of figures alone")
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be written: {reason(error)}") from error


def _earlier(path: Path) -> bool:
    """Return whether a file is a report that was written before."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return is_report(file.read(_HEAD))


def _no_table(folder: Path, page: Path) -> str | None:
    """Return what a folder holds that is no table of an earlier page; None: nothing."""
    names = sorted(each.name for each in folder.iterdir())
    text = unescape(page.read_text(encoding="utf-8")) if names and page.is_file() else ""
    return next((name for name in names if f"/{of_every_row(name)}" not in text), None)


def _figures_alone(folder: Path, page: Path) -> bool:
    """Return whether a folder is empty, or holds nothing but figures beside an earlier page."""
    files = list(folder.iterdir())
    return not files or (page.is_file() and all(map(_figure, files)))


def _figure(path: Path) -> bool:
    if path.suffix != ".svg" or not path.is_file():
        return False
    with path.open("rb") as file:
        return is_standalone(file.read(_HEAD))


def write_report(
    report: Report,
    path: str | os.PathLike[str],
    figures: str | os.PathLike[str] | None = None,
    *,
    most_rows: int = MOST_ROWS,
    progress: Progress | None = None,
) -> Written:
    """Write a report, all of it or nothing.

    Parameters
    ----------
    report
        The report.
    path
        The page; an earlier report of this name is replaced, nothing else is.
    figures
        A folder for its drawings, each as a file; None: they are in the page alone.
    most_rows
        How many rows a table may have that the page shows whole. Of a longer one it shows what
        needs a look; the whole stands in the folder PATH.tables then.
    progress
        Told before every file; may raise to end it.

    Raises
    ------
    InputError
        Something could not be written; an earlier report is as it was.
    """
    page = Path(path)
    folder = None if figures is None else Path(figures)
    check_report(page, folder)
    beside = tables_folder(page)
    view = page_view(report, most_rows=most_rows, beside=beside.name)
    html = html_of(view).encode()
    files = {beside / f"{key}.csv": csv_text(table).encode() for key, table in view.cut.items()}
    drawings = {} if folder is None else dict(_drawings(report, folder))
    gone = _stale(beside, files)
    with all_or_nothing():
        for where, some in ((beside, files), (folder, drawings)):
            if some and where is not None:
                make_folder(where)
        write_together(_one_by_one(files | drawings | {page: html}, progress))
    for name in gone:
        # of an earlier report: nothing of this page says what it is
        with contextlib.suppress(OSError):
            name.unlink()
    return Written(page, len(html), tuple(files), tuple(drawings))


def _one_by_one(
    files: Mapping[Path, bytes], progress: Progress | None
) -> Iterator[tuple[Path, bytes]]:
    for one in files.items():
        if progress is not None:
            progress("the page", 0.0)
        yield one


def _stale(folder: Path, files: Mapping[Path, bytes]) -> list[Path]:
    """Return the tables of an earlier report that this one does not write anew."""
    return [path for path in folder.glob("*.csv") if path not in files] if folder.is_dir() else []


def _drawings(report: Report, folder: Path) -> Iterator[tuple[Path, bytes]]:
    for drawing in drawings_in(report.all_sections):
        yield folder / f"{drawing.key}.svg", standalone(drawing).encode()
