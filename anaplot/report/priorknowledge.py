"""A block's prior knowledge and the factors of its variance, as a part of its document."""

from __future__ import annotations

from math import sqrt
from typing import Any

from anaplot.bundle.hypotheses.priorknowledge import BlockPrior, PriorGroup
from anaplot.report.columns import counted
from anaplot.report.components import WITHIN, within
from anaplot.report.document import Document, for_programs, name, number, say, table, whole

__all__ = ["prior_document"]

_ESTIMATOR = {
    "known": "known variance factors",
    "common": "one common unknown variance factor",
    "separate": "separate unknown variance factors",
}
_COLUMNS = (
    name("group", "group"),
    whole("observations", "n", 8),
    number("redundancy", "r", 2, 11),
    number("vtpv", "v'Pv", 2, 11),
    number("variance_factor", "s^2/s0^2", 3, 11),
    *for_programs("variance_factor_interval", parts=("from", "to")),
    number("sigma_factor", "s/s0", 3, 9),
    *WITHIN,
)


def prior_document(found: BlockPrior) -> Document:
    """Return the document of image coordinates and prior knowledge, and of control beside it.

    Each has their number, their share of the redundancy, their v'Pv with the stated variances and
    the factor of these, with its 95 % confidence interval (null when it is known, common or held).
    """
    of = [("image coordinates", found.image), ("prior knowledge", found.prior)]
    if found.control is not None:
        of.append(("control", found.control))
    groups = table(
        "prior_estimate",
        _COLUMNS,
        (
            (title, one.observations, one.redundancy, one.vtpv, one.factor, one.interval,
             sqrt(one.factor), *within(one.interval)[1])
            for title, one in of
        ),
    )  # fmt: skip
    answer = {
        "estimator": found.estimator,
        "iterations": found.iterations,
        "converged": found.converged,
        "image_coordinates": _group(found.image),
        "prior_knowledge": _group(found.prior),
        **({} if found.control is None else {"control": _group(found.control)}),
        "remarks": list(found.remarks),
    }
    head = say(
        "PRIOR KNOWLEDGE, {}; {}",
        _ESTIMATOR[found.estimator],
        counted(found.iterations, "adjustment"),
    )
    notes = (say("  note: {}", remark).of("remark") for remark in found.remarks)
    return Document(answer, (head.of("heading"), groups, *notes), (groups,))


def _group(group: PriorGroup) -> dict[str, Any]:
    return {
        "observations": group.observations,
        "redundancy": group.redundancy,
        "vtpv": group.vtpv,
        "variance_factor": group.factor,
        "variance_factor_interval": None if group.interval is None else list(group.interval),
        "sigma_factor": sqrt(group.factor),
    }
