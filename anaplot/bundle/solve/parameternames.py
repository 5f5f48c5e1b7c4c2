"""What additional parameters are called, column by column, and in which unit they are read."""

from __future__ import annotations

from typing import Literal, NamedTuple

from anaplot.bundle.solve.problem import Problem

__all__ = ["ParameterName", "parameter_names"]


class ParameterName(NamedTuple):
    """An additional parameter; as text "parameter:block:k1".

    Attributes
    ----------
    owner
        The group of photos it belongs to.
    unknown
        Its name.
    unit
        "mm", or "" for a number.
    factor
        Its value in that unit, over what is adjusted.
    kind
        "parameter".
    held
        Whether it is no unknown, while other groups have it.
    """

    owner: str
    unknown: str
    unit: str
    factor: float
    kind: Literal["parameter"] = "parameter"
    held: bool = False

    @property
    def text(self) -> str:
        """As programs read it."""
        return f"{self.kind}:{self.owner}:{self.unknown}"


def parameter_names(problem: Problem) -> tuple[ParameterName, ...]:
    """Return all additional parameters, in the order of their columns.

    Those of a lens are its coefficients (c, x0, y0 in mm, the others numbers), those of other sets
    their effect [mm].
    """
    if problem.additional is None:
        return ()
    labels = problem.additional.set.names
    units, still = problem.lens_units, problem.additional_still
    return tuple(
        ParameterName(
            group,
            label,
            "mm" if units is None or label in ("c", "x0", "y0") else "",
            1.0 if units is None else float(units[k, j]),
            held=still is not None and bool(still[k, j]),
        )
        for k, group in enumerate(problem.additional_groups)
        for j, label in enumerate(labels)
    )
