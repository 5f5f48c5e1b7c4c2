"""What additional parameters and offsets are called, one after the other, and their units."""

from __future__ import annotations

from typing import Literal, NamedTuple

from anaplot.bundle.solve.problem import Problem

__all__ = ["ParameterName", "offset_names", "parameter_names"]


class ParameterName(NamedTuple):
    """What photos share; as text "parameter:block:k1", or "offset:s1:shift_X".

    Attributes
    ----------
    owner
        The group of photos it belongs to.
    unknown
        Its name.
    unit
        Of parameters "mm", or "" for a number; of offsets m, m/s, m/photo, rad.
    factor
        Its value in that unit, over what is adjusted.
    kind
        "parameter", additional in the image; "offset" of stated positions and angles.
    held
        Whether it is no unknown: a parameter that other groups have, an offset of which nothing is
        observed.
    """

    owner: str
    unknown: str
    unit: str
    factor: float
    kind: Literal["parameter", "offset"] = "parameter"
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


def offset_names(problem: Problem) -> tuple[ParameterName, ...]:
    """Return what the photos' stated positions and angles have in common, in its order."""
    laid = problem.offsets
    if laid is None:
        return ()
    there = laid.observed(problem.prior_sigma).tolist()
    return tuple(
        ParameterName(one.group, f"{one.kind}_{one.axis}", one.unit, 1.0, "offset", not seen)
        for one, seen in zip(laid.names, there, strict=True)
    )
