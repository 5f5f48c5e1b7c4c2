"""Of every photo a number, as bars: the weakest first."""

from __future__ import annotations

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.rulesofthumb import LEAST_RI
from anaplot.drawing.charts.bars import bars
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.plot import Head
from anaplot.report.columns import counted

__all__ = ["photo_redundancy"]

_MOST = 24


def photo_redundancy(block: AdjustedBlock) -> Drawing | None:
    """Return the mean redundancy numbers of the photos' image coordinates, the weakest first.

    None where no image coordinate counts.
    """
    problem = block.problem
    n = len(problem.photos)
    counts = np.bincount(problem.photo, (~block.rejected).sum(axis=1), n)
    total = np.bincount(problem.photo, block.cofactors.r.sum(axis=1), n)
    there = np.flatnonzero(counts > 0.0)
    if not len(there):
        return None
    r = total[there] / counts[there]
    order = np.argsort(r, kind="stable")[:_MOST]
    names = [problem.photos[there[k]] for k in order.tolist()]
    weak = int(np.count_nonzero(r < LEAST_RI))
    title = "Redundancy number by photo"
    numbers = (
        f"{counted(len(there), 'photo')}, mean {r.mean():.2f}, smallest {r[order[0]]:.2f} in photo "
        f"{names[0]}; {weak} below {LEAST_RI:g}"
    )
    notes: tuple[str, ...] = ()
    if len(order) < len(there):
        notes = (f"The {len(order)} weakest of {len(there)} photos are drawn.",)
    return bars(
        Head("photo-redundancy", title, f"{numbers}."),
        names,
        r[order],
        f"{title}: {numbers}.",
        x_title="mean redundancy number of x and y",
        what="photo",
        bound=LEAST_RI,
        bound_label=f"rule of 1978: at least {LEAST_RI:g}",
        marked=r[order] < LEAST_RI,
        marked_label=f"photo below {LEAST_RI:g}",
        notes=notes,
    )
