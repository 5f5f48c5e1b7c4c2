"""Whether the a-priori sigma of a block can be right, before its gross errors are sought by it."""

from __future__ import annotations

from math import sqrt

import numpy as np

from anaplot.adjustment.partners import WEAK
from anaplot.adjustment.scale import LARGEST, LEAST_REDUNDANCY, robust_scale, scale_error
from anaplot.adjustment.significance import critical_normal
from anaplot.bundle.errors.before import BlockBefore
from anaplot.bundle.errors.blockrows import BlockRows
from anaplot.bundle.imagesigma import doubt_of
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import counted_misclosures

__all__ = ["check_common_scale", "check_scale_at"]


def check_common_scale(subject: BlockRows, first: BlockBefore, alpha: float) -> None:
    """Complain, before anything is rejected, where nearly all residuals are off alike.

    Parameters
    ----------
    subject, first
        The block, and its first adjustment.
    alpha
        Significance of one row.

    Raises
    ------
    ScaleError
        They are.
    """
    v, r = first.v, first.r
    doubt = doubt_of(v, r, subject.apriori.value)
    if doubt is not None:
        largest = float((np.abs(v[r > WEAK]) / np.sqrt(r[r > WEAK])).max())
        raise scale_error(subject.apriori, doubt.factor, largest / critical_normal(alpha))


def check_scale_at(subject: BlockRows, state: BlockState, first: BlockBefore, alpha: float) -> None:
    """Complain where most residuals at a robust state are too large: no few errors make them so.

    Parameters
    ----------
    subject, first
        The block, and its first adjustment.
    state
        The robust state.
    alpha
        Significance of one row.

    Raises
    ------
    ScaleError
        They are; see `adjustment.scale`.
    """
    problem = subject.problem
    out = problem.redundancy - first.redundancy
    if out + float(first.r.sum()) < LEAST_REDUNDANCY:
        return
    e = np.abs(counted_misclosures(problem, state)[0])
    e = e.ravel() if problem.off is None else e[~problem.off]
    # about what a row of the block keeps of its error; other rows say nothing of image coordinates
    root = sqrt(problem.redundancy / problem.observations)
    scale = robust_scale(e / root, np.ones(len(e)))
    if scale is not None and scale > LARGEST:
        r = first.r
        w = np.abs(first.v[r > WEAK]) / np.sqrt(r[r > WEAK])
        raise scale_error(subject.apriori, scale, float(w.max()) / critical_normal(alpha))
