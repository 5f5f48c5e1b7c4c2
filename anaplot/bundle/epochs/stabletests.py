"""Tests of what displacements hang on: the points that hold the datum, and each epoch's sigma0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from anaplot.bundle.epochs.apart import Agreement
from anaplot.bundle.epochs.located import Located, free_one_by_one
from anaplot.bundle.epochs.series import EpochDifferences, EpochSeries
from anaplot.bundle.epochs.variances import doubtful_epochs
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict

__all__ = [
    "DatumTests",
    "agreement_test",
    "datum_tests",
    "held_points",
    "located_stable",
    "refuted_datum",
]


class DatumTests(NamedTuple):
    """What displacements hang on.

    Attributes
    ----------
    agreement, located_stable
        As `EpochTests` has them.
    remarks
        Sentences for a person: those of the displacements, epochs whose sigma0 is too large, and a
        refuted datum.
    """

    agreement: Verdict | None
    located_stable: tuple[Located, ...]
    remarks: tuple[str, ...]


def datum_tests(found: EpochDifferences | EpochSeries, alpha: float) -> DatumTests:
    """Test the points that hold the datum, and sigma0 of each epoch by itself.

    Parameters
    ----------
    found
        The displacements.
    alpha
        Significance of each test.
    """
    without = found.joint and found.own_parameters is not None
    remarks = [*found.remarks, *doubtful_epochs(found.alone, alpha, without=without)]
    located: tuple[Located, ...] = ()
    agreement = agreement_test(found.agreement, alpha, by_known=found.by_known)
    if found.agreement is not None and agreement is not None and agreement.rejected:
        located = located_stable(found.agreement, agreement)
        remarks.append(refuted_datum(located, control=found.datum == "control"))
    return DatumTests(agreement, located, tuple(remarks))


def held_points(datum: str) -> str:
    """Return what the points that hold the datum are called, by `EpochSeries.datum`."""
    return "common control" if datum == "control" else "stable points"


def agreement_test(agreement: Agreement | None, alpha: float, *, by_known: bool) -> Verdict | None:
    """Test "the points that hold the datum have not moved"; None where nothing is left to agree in.

    Parameters
    ----------
    agreement
        How well they agree.
    alpha
        Significance.
    by_known
        Whether tests go by the a-priori sigma0.
    """
    if agreement is None or not agreement.dimension > 0:
        return None
    variance = VarianceFactor(agreement.vtpv, agreement.redundancy, by_known)
    return variance.test(agreement.square, agreement.dimension, alpha)


def located_stable(agreement: Agreement, verdict: Verdict) -> tuple[Located, ...]:
    """Name the points that explain a refuted datum, as long as three others are left."""
    test = verdict.decisive
    if test is None:
        return ()
    d, points = agreement.d, agreement.points
    each = len(d) // len(points)
    owners = [row // each for row in range(len(d))]
    # three points fit each other up to two conditions: which of them moved does not show
    freed = free_one_by_one(
        owners, d, agreement.information, test, rank=agreement.dimension, least=3 * each
    )
    return tuple(Located(points[step.owner], step.square, step.rest) for step in freed)


def refuted_datum(located: Sequence[Located], *, control: bool) -> str:
    """Return the remark on points that hold the datum and have moved."""
    most = ", ".join(step.point for step in located[:8])
    what = "common control has moved, or is not what it was" if control else (
        "stable points have moved"
    )  # fmt: skip
    cure = "leave out of --stable what is named"
    if control:
        cure = "remove from control.csv what is named, or let others hold it (--stable)"
    return (
        f"the {what} ({most or 'which of them does not show'}): every displacement hangs on a "
        "refuted datum" + (f": {cure}" if most else "")
    )
