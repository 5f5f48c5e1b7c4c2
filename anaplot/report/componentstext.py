"""Variance components of a block as text and as JSON."""

from __future__ import annotations

from math import sqrt
from typing import Any

from anaplot.adjustment.variancecomponents import VarianceComponent
from anaplot.bundle.hypotheses.components import BlockComponents, ComponentSigma
from anaplot.report.columns import cell, counted
from anaplot.textfiles.wording import plain

__all__ = ["components_json", "components_printout"]

Json = dict[str, Any]


def components_json(found: BlockComponents) -> Json:
    """Return the JSON value of the key "components".

    Each group has its number of observations, its share of the redundancy, the factor of its
    a-priori variance with its standard deviation and its 95 % confidence interval (null when it is
    held), and both standard deviations where one number says them.
    """
    variances = found.variances
    return {
        "grouping": found.grouping,
        "iterations": variances.iterations,
        "converged": variances.converged,
        "groups": [
            {
                "group": c.name,
                "observations": c.observations,
                "redundancy": c.redundancy,
                "vtpv": c.vtpv,
                "variance_factor": c.factor,
                "s_variance_factor": c.deviation,
                "variance_factor_interval": None if c.interval is None else list(c.interval),
                "sigma_factor": c.sigma_factor,
                "sigma_factor_interval": _roots(c),
                "state": c.state,
                "sigma_apriori": None if sigma is None else sigma.apriori,
                "sigma": None if sigma is None else sigma.estimated,
                "unit": None if sigma is None else sigma.unit,
            }
            for c, sigma in zip(variances.components, found.sigmas, strict=True)
        ],
        "remarks": found.remarks(),
    }


def components_printout(found: BlockComponents) -> str:
    """Return the table of variance components."""
    variances = found.variances
    width = max([5, *(len(plain(c.name)) for c in variances.components)])
    lines = [
        f"VARIANCE COMPONENTS, by {found.grouping}; {counted(variances.iterations, 'adjustment')}",
        f"  {'group':<{width}}  {'n':>6}  {'r':>9}  {'s^2/s0^2':>9}  {'s/s0':>7}  from, to (95 %)  "
        f"{'a priori':>12}  {'estimated':>12}",
    ]
    for c, sigma in zip(variances.components, found.sigmas, strict=True):
        nothing = "-" if c.state == "estimated" else "held"
        roots = _roots(c)
        within = f"{nothing:>15}"
        if roots is not None:
            within = cell(roots[0], 3, 7) + cell(roots[1], 3, 8)
        lines.append(
            f"  {plain(c.name):<{width}}  {c.observations:6d}  {c.redundancy:9.2f}  "
            f"{c.factor:9.3f}  {c.sigma_factor:7.3f}  {within}  {_sigma(sigma, 0)}  "
            f"{_sigma(sigma, 1)}"
        )
    lines += [f"  note: {plain(remark)}" for remark in found.remarks()]
    return "\n".join(lines)


def _roots(component: VarianceComponent) -> list[float] | None:
    """Return the confidence interval of the factor of the standard deviation."""
    interval = component.interval
    return None if interval is None else [sqrt(limit) for limit in interval]


def _sigma(sigma: ComponentSigma | None, which: int) -> str:
    if sigma is None:
        return f"{'-':>12}"
    value = (sigma.apriori, sigma.estimated)[which]
    return f"{value:9.2f} um" if sigma.unit == "um" else f"{value:10.4f} m"
