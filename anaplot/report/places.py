"""The values of a column in some places of it."""

from __future__ import annotations

from collections.abc import Sequence

from anaplot.report.document import Later, Values, is_array

__all__ = ["at_places"]


def at_places(values: Values, places: Sequence[int]) -> Values:
    """Return the values of a column in some places; what is made where it is read, there only."""
    if isinstance(places, range) and places.step == 1:
        return values[places.start : places.stop]
    if isinstance(values, Later):
        return values.of(places)
    return values[places] if is_array(values) else [values[k] for k in places]
