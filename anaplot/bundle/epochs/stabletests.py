"""Tests of the points that hold the datum: whether they have moved."""

from __future__ import annotations

from collections.abc import Sequence

from anaplot.bundle.epochs.apart import Agreement
from anaplot.bundle.epochs.located import Located, free_one_by_one
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict

__all__ = ["agreement_test", "located_stable", "refuted_datum"]


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
    limit = test.critical * test.dimension * test.sigma**2
    d, information = agreement.d, agreement.information
    total = float(d @ information @ d)
    each = len(d) // len(points)
    owners = [row // each for row in range(len(d))]
    # three points fit each other up to two conditions: which of them moved does not show
    freed = free_one_by_one(owners, d, information, total, limit, least=3 * each)
    return tuple(Located(points[step.owner], step.square, step.rest) for step in freed)


def refuted_datum(located: Sequence[Located]) -> str:
    """Return the remark on stable points that have moved."""
    most = ", ".join(step.point for step in located[:8])
    return (
        f"the stable points have moved ({most or 'which of them does not show'}): every "
        "displacement hangs on a refuted datum"
        + (": leave out of --stable what is named" if most else "")
    )
