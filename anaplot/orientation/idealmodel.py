"""A model of vertical photos and flat ground: what is said of a point pattern is computed with it.

By the code that computes measured models.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import hypot

import numpy as np

from anaplot.orientation.conditionequations import ModelUnknowns
from anaplot.orientation.model import orient
from anaplot.orientation.pair import Stereopair, TieErrors
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.tieerrors import stationary_errors
from anaplot.photogrammetry.block import Precision, TestSettings, TieVariance

__all__ = ["ideal_model", "trace_in_bases"]

_SET = 0.05  # bases: how far from its place a point is set by hand


def ideal_model(
    positions: Mapping[str, tuple[float, float]],
    ties: tuple[str, ...],
    base: float,
    c: float,
    tie_variance: TieVariance = "paper",
    off: frozenset[tuple[str, str]] = frozenset(),
) -> ModelSolution:
    """Orient a model of vertical photos and flat ground.

    Parameters
    ----------
    positions
        x, y in the left photo [mm] by label.
    ties
        Labels of the points shared with a preceding model of the same base.
    base, c
        Base at photo scale and camera constant [mm].
    tie_variance
        Cofactor of the x rows: "paper", "propagated" or "exact".
    off
        Rows (label, axis) that are left out.

    Raises
    ------
    NotComputableError
        The points do not determine the model.
    """
    xl = np.array(list(positions.values()))
    pair = Stereopair(
        left="left",
        right="right",
        points=tuple(positions),
        xl=xl,
        xr=xl - [base, 0.0],
        c_left=c,
        c_right=c,
        ties={label: (*positions[label], -c) for label in ties} or None,
        preceding_bx=base if ties else None,
        base=base,
        off=off,
    )
    if tie_variance == "exact" and ties:
        pair = replace(pair, tie_errors=_in_a_strip(pair, base))
    return orient(pair, Precision(tie_variance=tie_variance), TestSettings(kind="baarda"))


def _in_a_strip(pair: Stereopair, base: float) -> TieErrors:
    """Return how the ties of an ideal model err in a long strip of such models.

    A tie was the point one base further on in the preceding model: the nearest one there, up to
    `_SET` bases away, each for one tie. Where there is none, that model had a point more.
    """
    names, xl = list(pair.points), pair.xl.tolist()
    free = dict(zip(names, xl, strict=True))
    onward: dict[str, str] = {}
    for tie, (x, y, _) in (pair.ties or {}).items():
        away = {name: hypot(px - x - base, py - y) for name, (px, py) in free.items()}
        nearest = min(away, key=away.__getitem__, default="")
        if not nearest or away[nearest] > _SET * base:
            nearest = f"{tie}, next"
            names.append(nearest)
            xl.append((x + base, y))
        free.pop(nearest, None)
        onward[tie] = nearest
    left = np.array(xl)
    model = replace(pair, points=tuple(names), xl=left, xr=left - [base, 0.0])
    return stationary_errors(model, ModelUnknowns(base, 0.0, 0.0, np.eye(3)), onward)


def trace_in_bases(solution: ModelSolution, base: float) -> float:
    """Return the trace of Q_gg of an ideal model, lengths in units of its base [mm]."""
    trace = float(np.trace(solution.q_gg)) * base * base
    if solution.ties:
        # bx itself is a length: bx / b and image coordinates / b shrink alike
        trace += float(solution.q_gg[0, 0]) * (1.0 - base * base)
    return trace
