"""Model values of sqrt(q_vv) by classes of observations, as `anaplot plan block --csv` writes them.

Columns rays (1 to 4, 4 for four and more), ray (inner or outer), point (control or new), axis and
mean_root; what else `plan block` writes may stand beside them.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from anaplot.textfiles.csvtable import read_csv
from anaplot.textfiles.kinds import Fields, Number, Text, Word

__all__ = ["ClassValue", "read_model_values"]

_NEEDED: Fields = {
    "rays": Word("1", "2", "3", "4"),
    "ray": Word("inner", "outer"),
    "point": Word("control", "new"),
    "axis": Word("x", "y"),
    "mean_root": Number(0.0, 1.0),
}
_BESIDE = dict.fromkeys(("number", "least", "most", "mean_r", "mdb_um", "untestable"), Text())


class ClassValue(NamedTuple):
    """A class of observations and its model value.

    Attributes
    ----------
    rays
        Photos in which the point is measured; 4 for four and more.
    inner, control
        Whether the ray is measured in more than one model; whether the point is control.
    axis
        "x" or "y".
    root
        Model value of sqrt(q_vv), in units of the a-priori sigma.
    """

    rays: int
    inner: bool
    control: bool
    axis: str
    root: float


def read_model_values(path: Path) -> tuple[ClassValue, ...]:
    """Read model values, class by class.

    Raises
    ------
    InputError
        The first thing that is wrong, with file and line.
    """
    table = read_csv(path, _NEEDED, _BESIDE)
    if not len(table):
        raise table.fail(None, None, "no rows")
    table.refuse_twice("rays", "ray", "point", "axis")
    return tuple(
        ClassValue(int(rays), ray == "inner", point == "control", axis, root)
        for rays, ray, point, axis, root in zip(*(table[name] for name in _NEEDED), strict=True)
    )
