"""Tests of what displacements hang on: the points that hold the datum, and each epoch's sigma0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from anaplot.bundle.epochs.apart import Agreement
from anaplot.bundle.epochs.located import Located, free_one_by_one
from anaplot.bundle.epochs.series import EpochDifferences, EpochSeries
from anaplot.bundle.epochs.variances import doubtful_epochs
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict

__all__ = ["DatumTests", "agreement_test", "datum_tests", "located_stable", "refuted_datum"]


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


def datum_tests(
    found: EpochDifferences | EpochSeries,
    stable: Sequence[str],
    variance: VarianceFactor,
    alpha: float,
) -> DatumTests:
    """Test the points that hold the datum, and sigma0 of each epoch by itself.

    Parameters
    ----------
    found
        The displacements.
    stable
        The points that hold the datum, where no control does.
    variance
        Of the adjustment that displacements are tested by.
    alpha
        Significance of each test.
    """
    agreement = agreement_test(found.agreement, variance, alpha, joint=found.joint)
    without = found.joint and found.own_parameters is not None
    remarks = [*found.remarks, *doubtful_epochs(found.alone, alpha, without=without)]
    located: tuple[Located, ...] = ()
    if found.agreement is not None and agreement is not None and agreement.rejected:
        located = located_stable(found.agreement, agreement, stable)
        remarks.append(refuted_datum(located))
    return DatumTests(agreement, located, tuple(remarks))


def agreement_test(
    agreement: Agreement | None, variance: VarianceFactor, alpha: float, *, joint: bool
) -> Verdict | None:
    """Test "the stable points have not moved"; None where nothing is left to agree in.

    Parameters
    ----------
    agreement
        How well they agree.
    variance
        Of the adjustment that displacements are tested by.
    alpha
        Significance.
    joint
        Whether the quadratic form is a part of v'Pv.
    """
    if agreement is None or not agreement.dimension > 0:
        return None
    square, dimension = agreement.square, agreement.dimension
    left = variance.without(square, dimension) if joint else variance
    return left.test(square, dimension, alpha)


def located_stable(
    agreement: Agreement, verdict: Verdict, points: Sequence[str]
) -> tuple[Located, ...]:
    """Name the stable points that explain a refuted datum, as long as three others are left."""
    test = verdict.decisive
    if test is None:
        return ()
    d = agreement.d
    each = len(d) // len(points)
    owners = [row // each for row in range(len(d))]
    # three points fit each other up to two conditions: which of them moved does not show
    freed = free_one_by_one(
        owners, d, agreement.information, test, rank=agreement.dimension, least=3 * each
    )
    return tuple(Located(points[step.owner], step.square, step.rest) for step in freed)


def refuted_datum(located: Sequence[Located]) -> str:
    """Return the remark on stable points that have moved."""
    most = ", ".join(step.point for step in located[:8])
    return (
        f"the stable points have moved ({most or 'which of them does not show'}): every "
        "displacement hangs on a refuted datum"
        + (": leave out of --stable what is named" if most else "")
    )
