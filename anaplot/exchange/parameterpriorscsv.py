"""An a-priori calibration: a CSV file with parameter,value and perhaps sigma,group."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from anaplot.textfiles.csvtable import read_csv
from anaplot.textfiles.kinds import NAME, NUMBER, Blank, Number

__all__ = ["KnownParameter", "read_parameter_priors"]


class KnownParameter(NamedTuple):
    """A row of the file; a blank sigma or group is None."""

    parameter: str
    value: float
    sigma: float | None
    group: str | None


def read_parameter_priors(path: Path) -> tuple[KnownParameter, ...]:
    """Read what is known of additional parameters.

    Parameters
    ----------
    path
        The file: columns parameter and value, and perhaps sigma (0: held, blank: no weight) and
        group (camera, strip or photo; blank: all).

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line.
    """
    table = read_csv(
        path,
        {"parameter": NAME, "value": NUMBER},
        {"sigma": Blank(Number(0.0)), "group": Blank(NAME)},
    )
    if not len(table):
        raise table.fail(None, None, "no rows")
    table.refuse_twice("parameter", "group")
    columns = (table[name] for name in ("parameter", "value", "sigma", "group"))
    return tuple(KnownParameter(*row) for row in zip(*columns, strict=True))
