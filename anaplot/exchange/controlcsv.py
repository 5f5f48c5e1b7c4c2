"""control.csv: ground control and check points, and what is known of points beforehand."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from anaplot.photogrammetry.block import ControlPoint, PointPrior
from anaplot.textfiles.csvtable import csv_text, read_csv
from anaplot.textfiles.kinds import METRES, NAME, SIGMA_OR_FREE, Blank, Word
from anaplot.textfiles.wording import quoted

__all__ = ["USES", "GroundPoints", "format_control", "parse_control", "prior_fault"]

USES = ("control", "check", "prior", "off")

_XYZ = ("X", "Y", "Z")
_SIGMAS = ("sX", "sY", "sZ")


class GroundPoints(NamedTuple):
    """The rows of a control.csv, or of a list of control points.

    Attributes
    ----------
    control, priors
        Control, check points and what is off; and priors.
    commas
        How many numbers of a list had a decimal comma.
    """

    control: tuple[ControlPoint, ...] = ()
    priors: tuple[PointPrior, ...] = ()
    commas: int = 0


def prior_fault(
    xyz: tuple[float | None, ...], sigma: tuple[float | None, ...]
) -> tuple[str, str] | None:
    """Return the column of a prior's row that is wrong, and why; None where it is a prior."""
    for axis, value, s in zip(_XYZ, xyz, sigma, strict=True):
        if value is None or (s is not None and s > 0.0):
            continue
        what = "is blank" if s is None else "is 0"
        return f"s{axis}", f"{what}, but a prior needs a positive standard deviation of its {axis}"
    if all(value is None for value in xyz):
        return "X", "a prior without any coordinate"
    return None


def parse_control(path: Path) -> GroundPoints:
    """Read a control.csv.

    Parameters
    ----------
    path
        The file, with columns point,X,Y,Z and perhaps sX,sY,sZ,use; metres.

    Returns
    -------
    GroundPoints
        The rows in file order. A blank coordinate is not known (None), a blank standard
        deviation the block's default (None), 0 is free of error; those of a prior are positive.
        A point may have a prior beside its control, and any rows that are off.

    Raises
    ------
    InputError
        The first row that is wrong, with file, line and column.
    """
    table = read_csv(
        path,
        {"point": NAME, **dict.fromkeys(_XYZ, Blank(METRES))},
        {**dict.fromkeys(_SIGMAS, Blank(SIGMA_OR_FREE)), "use": Word(*USES)},
    )
    columns = (table[name] for name in ("point", *_XYZ, *_SIGMAS, "use"))
    control: list[ControlPoint] = []
    priors: list[PointPrior] = []
    first: dict[tuple[str, bool], int] = {}
    for row, (point, x, y, z, sx, sy, sz, use) in enumerate(zip(*columns, strict=True)):
        other = row if use == "off" else first.setdefault((point, use == "prior"), row)
        if other != row:
            lines = f"(lines {table.line(other)} and {table.line(row)})"
            raise table.fail(row, None, f"point {quoted(point)} twice {lines}")
        if use != "prior":
            control.append(ControlPoint(point, (x, y, z), (sx, sy, sz), use or "control"))
            continue
        fault = prior_fault((x, y, z), (sx, sy, sz))
        if fault is not None:
            raise table.fail(row, *fault)
        priors.append(PointPrior(point, (x, y, z), (sx, sy, sz)))
    return GroundPoints(tuple(control), tuple(priors))


def format_control(control: Iterable[ControlPoint], priors: Iterable[PointPrior] = ()) -> str:
    """Return control points, then priors, as the text of a control.csv: digits that read back.

    Both keep their order, but a file in which they stood mixed has another one.
    """
    rows = [(point.point, *point.xyz, *point.sigma, point.use) for point in control]
    expected = [(point.point, *point.xyz, *point.sigma, "prior") for point in priors]
    return csv_text(("point", *_XYZ, *_SIGMAS, "use"), (*rows, *expected))
