"""Variance components of a block as a part of its document."""

from __future__ import annotations

from math import sqrt
from typing import Any

from anaplot.bundle.hypotheses.components import BlockComponents
from anaplot.report.columns import counted, fitted
from anaplot.report.document import Column, Document, for_programs, name, number, say, table, whole

__all__ = ["WITHIN", "components_document", "within"]


def _sigma(value: tuple[float, str]) -> str:
    sigma, unit = value
    return f"{sigma:.2f} um" if unit == "um" else f"{sigma:.4f} m"


# the ends of an interval; people read those of a standard deviation's factor
WITHIN = (
    Column("", "from", 9, form=lambda v: fitted(v, 3, 6), none="", head="  from, to (95 %)"),
    Column("", "to", 8, form=lambda v: v if isinstance(v, str) else fitted(v, 3, 7), head=""),
)
_COLUMNS = (
    name("group", "group", 5),
    whole("observations", "n", 8),
    number("redundancy", "r", 2, 11),
    *for_programs("vtpv"),
    number("variance_factor", "s^2/s0^2", 3, 11),
    *for_programs("s_variance_factor"),
    *for_programs("variance_factor_interval", parts=("from", "to")),
    number("sigma_factor", "s/s0", 3, 9),
    *for_programs("sigma_factor_interval", parts=("from", "to")),
    *WITHIN,
    *for_programs("state", "sigma_apriori", "sigma", "unit"),
    Column("", "a priori", 14, form=_sigma),
    Column("", "estimated", 14, form=_sigma),
)


def within(
    interval: tuple[float, float] | None, nothing: str = "-"
) -> tuple[list[float] | None, tuple[Any, Any]]:
    """Return the interval of a standard deviation's factor, and what `WITHIN` shows of it.

    Parameters
    ----------
    interval
        Of the variance's factor.
    nothing
        Stands where there is none.
    """
    if interval is None:
        return None, (None, nothing)
    low, high = (sqrt(limit) for limit in interval)
    return [low, high], (low, high)


def components_document(found: BlockComponents) -> Document:
    """Return the document of variance components.

    Each group has its number of observations, its share of the redundancy, v'Pv of its residuals
    with the variances that are stated (that over the redundancy is the factor), the factor of its
    a-priori variance with its standard deviation and its 95 % confidence interval (null when it is
    held), and both standard deviations where one number says them.
    """
    variances = found.variances
    rows = []
    for c, sigma in zip(variances.components, found.sigmas, strict=True):
        interval, shown = within(c.interval, "-" if c.state == "estimated" else "held")
        sizes = (None,) * 5
        if sigma is not None:
            both = (sigma.apriori, sigma.unit), (sigma.estimated, sigma.unit)
            sizes = (sigma.apriori, sigma.estimated, sigma.unit, *both)  # type: ignore[assignment]
        rows.append(
            (c.name, c.observations, c.redundancy, c.vtpv * c.factor, c.factor, c.deviation,
             c.interval, c.sigma_factor, interval, *shown, c.state, *sizes)
        )  # fmt: skip
    groups = table("components", _COLUMNS, rows)
    remarks = found.remarks()
    answer = {
        "grouping": found.grouping,
        "iterations": variances.iterations,
        "converged": variances.converged,
        "groups": groups,
        "remarks": remarks,
    }
    head = say(
        "VARIANCE COMPONENTS, by {}; {}",
        found.grouping,
        counted(variances.iterations, "adjustment"),
    )
    notes = (say("  note: {}", remark).of("remark") for remark in remarks)
    return Document(answer, (head.of("heading"), groups, *notes), (groups,))
