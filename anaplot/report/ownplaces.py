"""Where errors are planted: rows of a geometry, chosen by photo, point and axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.errors import InputError
from anaplot.textfiles.wording import quoted

__all__ = ["RowName", "rows_in"]


class RowName(NamedTuple):
    """What a row belongs to.

    Attributes
    ----------
    photo, point
        None: it belongs to none (in a model, of control, of a prior).
    axis
        "x", "y"; of control "X", "Y", "Z"; of a prior the unknown.
    """

    photo: str | None
    point: str | None
    axis: str


def rows_in(names: Sequence[RowName], places: Sequence[str]) -> NDArray[np.bool_]:
    """Return (n,) which rows lie in the places named; all, if none is named.

    Parameters
    ----------
    names
        Of the n rows.
    places
        Names of photos, points and axes, with "photo:", "point:" or "axis:" before them where a
        name means more than one of these. A row must lie in one of the photos, in one of the points
        and in one of the axes, as far as there are such names.

    Raises
    ------
    InputError
        A name that means nothing here or more than one thing, or no row in all of them.
    """
    wanted: dict[str, set[str]] = {}
    for place in places:
        column, name = _meant(names, place)
        wanted.setdefault(column, set()).add(name)
    found = np.array(
        [all(getattr(row, column) in some for column, some in wanted.items()) for row in names]
    )
    if not found.any():
        together = " and ".join(quoted(place) for place in places)
        raise InputError(f"no row lies in {together} together")
    return found


def _meant(names: Sequence[RowName], place: str) -> tuple[str, str]:
    """Return the column that a place speaks of, and the name in it."""
    columns = [column for column in RowName._fields if any(getattr(row, column) for row in names)]
    prefix, colon, name = place.partition(":")
    if colon and prefix in RowName._fields:
        if not any(getattr(row, prefix) == name for row in names):
            raise InputError(f"no row lies in {prefix} {quoted(name)}")
        return prefix, name
    fitting = [c for c in columns if any(getattr(row, c) == place for row in names)]
    if not fitting:
        kinds = " or ".join((", ".join(columns[:-1]), columns[-1]))
        raise InputError(f"no row lies in {quoted(place)}: name a {kinds}")
    if len(fitting) > 1:
        ways = " or ".join(quoted(f"{column}:{place}") for column in fitting)
        raise InputError(f"{quoted(place)} is a {' and a '.join(fitting)}: write {ways}")
    return fitting[0], place
