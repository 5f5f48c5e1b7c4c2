"""The tables of an adjusted block, declared once for JSON, CSV and text.

Lengths in metres, angles in radians, residuals and detectable errors in micrometres; people read
angles in degrees and effects on the ground in millimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import pi
from typing import Any, TypeAlias

from anaplot.adjustment.tested import Observation
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.comparedconditions import compared_conditions
from anaplot.bundle.solve.externalreliability import ExternalReliability, LargestEffect
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.parametercorrelations import ORIENTATION_PAIRS, photo_correlations
from anaplot.bundle.solve.photochecks import photo_checks, photo_overlaps
from anaplot.report.document import (
    Column,
    Table,
    for_programs,
    name,
    number,
    table,
    whole,
)

__all__ = [
    "EFFECT",
    "XYZ",
    "check_table",
    "condition_table",
    "control_table",
    "is_fine",
    "overlap_table",
    "parameter_table",
    "photo_correlation_table",
    "photo_table",
    "point_prior_table",
    "point_table",
    "prior_table",
    "vector",
    "with_rejected_control",
    "with_rejected_priors",
]

_DEGREES = 180.0 / pi
_UNITS = {"X": "m", "Y": "m", "Z": "m", "omega": "rad", "phi": "rad", "kappa": "rad"}
XYZ = ("X", "Y", "Z")


def vector(key: str, title: str, width: int) -> Column:
    """Return a column of vectors in metres, of which people read the length in millimetres."""
    return Column(key, title, width, 2, unit="m", scale=1e3, parts=XYZ)


def _mark(word: str) -> Callable[[bool], str]:
    return lambda marked: word if marked else ""


EFFECT = (
    vector("largest_effect", "LARGEST [mm]", 14),
    name("largest_effect_at", "AT"),
    number("standardized_effect", "LENGTH", 2, 8),
)
_FLAGGED = name("flagged", form=_mark("<< CHECK"), look=bool)
_OFF = name("off", gap=1, form=_mark("off"), look=bool)


def _effect(row: Observation[ObservationName], found: LargestEffect | None) -> tuple[Any, ...]:
    """Return the largest effect on a point [m], which point that is, and delta0 sqrt((1-r)/r)."""
    most = (None, None) if found is None else (found.effect_m, found.point)
    return (*most, row.effect)


_PHOTOS = (
    name("photo", "PHOTO", 5),
    number("X", "X", 3, 15, unit="m"),
    number("Y", "Y", 3, 15, unit="m"),
    number("Z", "Z", 3, 12, unit="m"),
    number("omega", "omega", 5, 11, unit="rad", scale=_DEGREES),
    number("phi", "phi", 5, 11, unit="rad", scale=_DEGREES),
    number("kappa", "kappa", 5, 12, unit="rad", scale=_DEGREES),
    *(number(key, key, 3, 8, unit="m") for key in ("sX", "sY", "sZ")),
    *(number(k, k, 5, 9, unit="rad", scale=_DEGREES) for k in ("somega", "sphi", "skappa")),
    whole("rays", "RAYS", 6),
    number("redundancy", "redundancy", 2, 12),
    number("mean_r", "mean r", 3, 8),
    number("least_r", "least", 3, 7),
    number("rms_x_um", "rms vx [um]", 2, 12, unit="um"),
    number("rms_y_um", "rms vy [um]", 2, 12, unit="um"),
    whole("flagged", "flagged", 8),
)
_PHOTO_ORDER = (
    *("photo", "X", "Y", "Z", "sX", "sY", "sZ"),
    *("omega", "phi", "kappa", "somega", "sphi", "skappa"),
)


_FINE = 1e-3  # m: mean standard deviation of points below which tenths of a millimetre are coarse


def is_fine(block: AdjustedBlock) -> bool:
    """Whether a block is determined so well that people read coordinates to a micrometre."""
    found = block.indicators().ai
    return block.sigma is not None and 0.0 < block.sigma * found < _FINE


def _finer(columns: tuple[Column, ...], block: AdjustedBlock) -> tuple[Column, ...]:
    """Return columns whose lengths have six decimals in a block that is so fine."""
    if not is_fine(block):
        return columns
    return tuple(
        replace(one, decimals=6) if one.unit == "m" and one.decimals else one for one in columns
    )


def photo_table(block: AdjustedBlock) -> Table:
    """Return the orientations, and what checks them."""
    rows = (
        (row.photo, *row.position, *row.angles, *row.s_position, *row.s_angles, *checks)
        for row, checks in zip(block.photo_rows(), photo_checks(block), strict=True)
    )
    return table("photos", _finer(_PHOTOS, block), rows, shown=_PHOTO_ORDER, units=">")


_OVERLAPS = (
    name("photo", "PHOTO", 5),
    name("other", "WITH", 4),
    whole("points", "COMMON POINTS", 15),
    number("share", "of its own [%]", 0, 16, scale=100.0),
    number("overlap", "overlap [%]", 0, 13, scale=100.0),
)


def overlap_table(block: AdjustedBlock) -> Table:
    """Return what photos share with their neighbours, for programs; worked out when it is read."""
    return table("overlaps", _OVERLAPS, lambda: photo_overlaps(block))


_PHOTO_CORRELATIONS = (
    name("photo", "PHOTO", 5),
    *(number(f"{a}_{b}", f"{a} {b}", 3, max(8, len(a + b) + 3)) for a, b in ORIENTATION_PAIRS),
)


def photo_correlation_table(block: AdjustedBlock) -> Table:
    """Return the correlations within each orientation, for programs."""
    return Table(
        "photo_correlations",
        _PHOTO_CORRELATIONS,
        lambda: (block.problem.photos, *photo_correlations(block).T),
    )


_POINTS = (
    name("point", "POINT", 5),
    number("X", "X", 4, 15, unit="m"),
    number("Y", "Y", 4, 15, unit="m"),
    number("Z", "Z", 4, 12, unit="m"),
    *(number(key, key, 4, 9, unit="m") for key in ("sX", "sY", "sZ")),
    whole("rays", "RAYS", 6),
)


def point_table(block: AdjustedBlock) -> Table:
    """Return the points."""
    rows = ((row.point, *row.xyz, *row.s_xyz, row.rays) for row in block.point_rows())
    return table("points", _finer(_POINTS, block), rows, units=">")


_CONTROL = (
    name("point", "CONTROL", 7),
    name("axis", gap=1),
    number("v", "v [m]", 4, 10, unit="m"),
    number("r", "r", 3, 6),
    number("w", "w", 2, 8),
    number("mdb", "MDB [m]", 4, 10, unit="m"),
    *for_programs("effect", unit="m", parts=XYZ),
    *EFFECT,
    _FLAGGED,
)


def control_table(block: AdjustedBlock, external: ExternalReliability) -> Table:
    """Return the weighted control coordinates, and what their undetected errors do.

    Those that are switched off stand after them, where there are any.
    """
    rows = (
        (row.point, row.axis, row.residual, row.r, row.w, row.mdb, row.ground,
         *_effect(row, effect), row.flagged)
        for row, effect in zip(block.control_rows(), external.control, strict=True)
    )  # fmt: skip
    weighted = table("control", _CONTROL, rows)
    off = block.off_control()
    return _with_others(weighted, off, _OFF) if off else weighted


_POINT_PRIORS = (name("point", "PRIOR OF", 8), *_CONTROL[1:])


def point_prior_table(block: AdjustedBlock, external: ExternalReliability) -> Table:
    """Return the priors of points, and what their undetected errors do."""
    rows = (
        (row.point, row.axis, row.residual, row.r, row.w, row.mdb, row.ground,
         *_effect(row, effect), row.flagged)
        for row, effect in zip(block.point_prior_rows(), external.point_priors, strict=True)
    )  # fmt: skip
    return table("point_priors", _POINT_PRIORS, rows)


Rejected: TypeAlias = tuple[str, str, float | None]
"""Owner, axis or unknown, and residual of what is no observation any more."""


def with_rejected_control(control: Table, rejected: Iterable[Rejected]) -> Table:
    """Return weighted control, or priors of points, and after it what of it was rejected."""
    return _with_others(control, rejected, _REJECTED)


def with_rejected_priors(priors: Table, rejected: Iterable[Rejected]) -> Table:
    """Return the priors, and after them what of them was rejected."""
    units = ((owner, axis, _UNITS.get(axis, "mm"), v) for owner, axis, v in rejected)
    return _with_others(priors, units, _REJECTED)


_REJECTED = Column("rejected", look=bool)


def _with_others(kept: Table, others: Iterable[tuple[Any, ...]], mark: Column) -> Table:
    """Return a table, and after its rows some of which no more is known; a column marks them."""
    nothing = [None if column.look is None else False for column in kept.columns]
    gone = [(*one, *nothing[len(one) :], True) for one in others]
    rows = [(*row, False) for row in zip(*kept.values, strict=True)]
    return table(kept.key, (*kept.columns, mark), rows + gone)


_PRIORS = (
    name("owner", "PRIOR", 5),
    name("unknown", least=8, gap=1),
    name("", "unit", 3, gap=1, head="  "),
    number("v", "v", 6, 12),
    number("r", "r", 3, 6),
    number("w", "w", 2, 8),
    number("mdb", "MDB", 6, 12),
    *EFFECT,
    _FLAGGED,
)


def prior_table(block: AdjustedBlock, external: ExternalReliability) -> Table:
    """Return the priors [m, rad, mm], and what their undetected errors do."""
    rows = (
        (row.point, row.axis, row.unit, row.residual, row.r, row.w, row.mdb, *_effect(row, effect),
         row.flagged)
        for row, effect in zip(block.prior_rows(), external.priors, strict=True)
    )  # fmt: skip
    return table("priors", _PRIORS, rows)


_CONDITIONS = (
    name("id", "CONDITION", 9),
    name("what", "OF", 2, gap=1),
    name("axis", gap=1),
    name("use", gap=1),
    name("unit", gap=1, head="  "),
    number("v", "v", 6, 12),
    number("r", "r", 3, 6),
    number("w", "w", 2, 8),
    number("mdb", "MDB", 6, 12),
    number("s", "s", 6, 11),
    *EFFECT,
    _FLAGGED,
)


def condition_table(block: AdjustedBlock, external: ExternalReliability) -> Table:
    """Return the rows of the conditions between points [m, rad].

    What takes no part has its residual, what is compared its standard deviation and w by that.
    What is free of error has no redundancy number.
    """
    conditions = block.problem.conditions
    firm = [] if conditions is None else conditions.firm.tolist()
    rows = [
        (row.key[1], row.point, row.axis, "control" if row.use else "rejected", row.unit,
         row.residual, row.r if row.use and not exact else None, row.w, row.mdb, None,
         *_effect(row, effect), row.flagged)
        for row, effect, exact in zip(
            block.condition_rows(), external.conditions, firm, strict=True
        )
    ]  # fmt: skip
    rows += [
        (*one.row, one.use, one.unit, one.difference, None, one.w, None, one.s, None, None, None,
         False)
        for one in compared_conditions(block)
    ]  # fmt: skip
    return table("conditions", _CONDITIONS, rows)


_CHECK = (
    name("point", "CHECK", 5),
    *(number(f"d{axis}", f"d{axis} [m]", 4, 10, unit="m") for axis in XYZ),
    name("", "(adjusted minus given)", gap=3),
)


def check_table(block: AdjustedBlock) -> Table:
    """Return the differences at check points, adjusted minus given."""
    rows = ((point, *found, "") for point, found in block.check_rows())
    return table("check", _finer(_CHECK, block), rows)


_PARAMETERS = (
    name("group", "GROUP", 6),
    name("name", "PARAMETER", 9, gap=1),
    number("value", "value [um]", 3, 12, unit="mm", scale=1e3),
    number("s", "s [um]", 3, 10, unit="mm", scale=1e3),
    Column("coefficient", "coefficient", 14, form="{:.5g}".format),
    Column("s_coefficient", "s", 11, form="{:.2g}".format),
    name("", "unit", gap=1, head=""),
)
_PARAMETERS_OF_NO_LENS = ("group", "name", "value", "s")


def parameter_table(block: AdjustedBlock) -> Table:
    """Return the additional parameters [mm]; of a lens also their coefficients."""
    rows = block.parameter_rows()
    lens = any(row.coefficient is not None for row in rows)
    cells = ((*row, "mm" if row.name in ("c", "x0", "y0") else "") for row in rows)
    shown = None if lens else _PARAMETERS_OF_NO_LENS
    return table("parameters", _PARAMETERS, cells, shown=shown)
