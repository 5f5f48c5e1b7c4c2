"""A block's prior knowledge and the factors of its variance, as text and as JSON."""

from __future__ import annotations

from math import sqrt
from typing import Any

from anaplot.bundle.hypotheses.priorknowledge import BlockPrior, PriorGroup
from anaplot.report.columns import cell, counted
from anaplot.textfiles.wording import plain

__all__ = ["prior_json", "prior_printout"]

_VTPV = "v'Pv"
_ESTIMATOR = {
    "known": "known variance factors",
    "common": "one common unknown variance factor",
    "separate": "separate unknown variance factors",
}


def prior_json(found: BlockPrior) -> dict[str, Any]:
    """Return the JSON value of the key "prior_estimate".

    Image coordinates and prior knowledge have their number, their share of the redundancy, their
    v'Pv with the stated variances and the factor of these, with its 95 % confidence interval (null
    when it is known, common or held).
    """
    return {
        "estimator": found.estimator,
        "iterations": found.iterations,
        "converged": found.converged,
        "image_coordinates": _group(found.image),
        "prior_knowledge": _group(found.prior),
        "remarks": list(found.remarks),
    }


def _group(group: PriorGroup) -> dict[str, Any]:
    return {
        "observations": group.observations,
        "redundancy": group.redundancy,
        "vtpv": group.vtpv,
        "variance_factor": group.factor,
        "variance_factor_interval": None if group.interval is None else list(group.interval),
        "sigma_factor": sqrt(group.factor),
    }


def prior_printout(found: BlockPrior) -> str:
    """Return the table of image coordinates and prior knowledge."""
    lines = [
        f"PRIOR KNOWLEDGE, {_ESTIMATOR[found.estimator]}; "
        f"{counted(found.iterations, 'adjustment')}",
        f"  {'group':<17}  {'n':>6}  {'r':>9}  {_VTPV:>9}  {'s^2/s0^2':>9}  "
        f"{'s/s0':>7}  from, to (95 %)",
    ]
    for name, group in (("image coordinates", found.image), ("prior knowledge", found.prior)):
        within = f"{'-':>15}"
        if group.interval is not None:
            within = "".join(
                cell(sqrt(limit), 3, width)
                for limit, width in zip(group.interval, (7, 8), strict=True)
            )
        lines.append(
            f"  {name:<17}  {group.observations:6d}  {group.redundancy:9.2f}  {group.vtpv:9.2f}  "
            f"{group.factor:9.3f}  {sqrt(group.factor):7.3f}  {within}"
        )
    lines += [f"  note: {plain(remark)}" for remark in found.remarks]
    return "\n".join(lines)
