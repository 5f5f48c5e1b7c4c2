"""A report kept in the block's folder: one more file each time, nothing is written over."""

from __future__ import annotations

import os
from datetime import datetime
from itertools import count
from pathlib import Path

from anaplot.aliases import Progress
from anaplot.bundle.solve.problem import Datum
from anaplot.report.adjustcommand import adjust
from anaplot.report.html.write import Written, tables_folder, write_report
from anaplot.report.reportcommand import block_report
from anaplot.report.reportdatum import adjusted_in_datum
from anaplot.textfiles.wholefile import all_or_nothing, make_folder

__all__ = ["REPORTS", "keep_report"]

REPORTS = "reports"
"""The folder of a block's reports; whoever reads or packs a block passes it by."""


def keep_report(
    folder: Path, *, datum: Datum | None = None, progress: Progress | None = None
) -> Written:
    """Write the report of what a block's files have into its folder `reports`.

    Parameters
    ----------
    folder
        The block folder.
    datum
        As for `adjust`; None: that of control and priors, or where they leave it open a free one.
    progress
        Told of every step, the last time before the page has its name; what it raises ends it.

    Returns
    -------
    Written
        Its page is named by date and time of day here: `2026-05-31-1430.html`.

    Raises
    ------
    AnaplotError
        The block cannot be read or adjusted, or nothing can be written beside it; nothing of the
        report is left behind then.
    """
    ours = adjusted_in_datum(lambda one: adjust(folder, datum=one, progress=progress), datum)
    report = block_report(ours.adjusted, folder, free=ours.line, progress=progress)
    reports = folder / REPORTS
    with all_or_nothing():
        make_folder(reports)
        page = _free(reports, f"{datetime.now().astimezone():%Y-%m-%d-%H%M}")
        return write_report(report, page, progress=progress)


def _free(folder: Path, name: str) -> Path:
    """Return a page of that name that is not there yet, nor anything of one."""
    pages = (folder / f"{name}{'' if k == 1 else f'-{k}'}.html" for k in count(1))
    return next(
        page for page in pages if not any(map(os.path.lexists, (page, tables_folder(page))))
    )
