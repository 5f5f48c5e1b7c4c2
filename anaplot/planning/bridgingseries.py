"""Reliability models over a series of bridging distances (Gruen 1980, Figures 3 to 9, Table 2)."""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.modelvalues import MODEL_TOLERANCE, beyond_model
from anaplot.aliases import Array
from anaplot.bundle.errors.papermodels import PaperModel, paper_models
from anaplot.bundle.errors.snooping import ObservationClass, classify
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.planning.blockplan import BlockPlan

__all__ = ["AtBridging", "SeriesClass", "bridging_series"]


class AtBridging(NamedTuple):
    """A class of observations in the block of one bridging distance.

    Attributes
    ----------
    bridging
        Bases from control to control.
    number
        Observations in the class.
    mean_root
        Mean of sqrt(q_vv) over them, in units of the a-priori sigma.
    curve
        The paper's value at this distance; None where it prints no curve.
    beyond
        Observations whose sqrt(q_vv) is farther than 25 % from the value of Table 2; None where
        that has none.
    beyond_root
        Mean of sqrt(q_vv) over those; None without any.
    """

    bridging: float
    number: int
    mean_root: float
    curve: float | None
    beyond: int | None
    beyond_root: float | None


class SeriesClass(NamedTuple):
    """A class as Table 2 forms them, over all bridging distances.

    Attributes
    ----------
    name
        As the paper has it: R, with C before it for control; O or I for outer and inner rays;
        the number of rays, 4 for four and more.
    axis
        "x" or "y", or "xy" where the paper takes both together.
    at
        What it is in each block that has the class.
    mean_root
        Mean of the blocks' means.
    paper
        The value that the paper recommends for such blocks; None where it has none.
    """

    name: str
    axis: str
    at: tuple[AtBridging, ...]
    mean_root: float
    paper: float | None


def bridging_series(
    plans: Sequence[BlockPlan], blocks: Sequence[AdjustedBlock]
) -> tuple[SeriesClass, ...]:
    """Return the classes of Table 2 over blocks that differ in their bridging distance.

    Parameters
    ----------
    plans
        The plans.
    blocks
        Their blocks, evaluated.
    """
    at: dict[_Name, list[AtBridging]] = {}
    paper: dict[_Name, float | None] = {}
    for plan, block in zip(plans, blocks, strict=True):
        model = _paper_model(plan)
        printed = {} if model is None else paper_models(model._replace(bridging=None))
        curves = {} if model is None else paper_models(model)
        for name, (kind, r) in _classes(block).items():
            paper[name] = printed.get(kind)
            curve = curves.get(kind) if kind.control else None
            at.setdefault(name, []).append(_at(plan.bridging, r, paper[name], curve))
    return tuple(
        SeriesClass(
            *name, tuple(rows), float(np.mean([row.mean_root for row in rows])), paper[name]
        )
        for name, rows in sorted(at.items(), key=lambda item: (item[0].kind[0] == "C", item[0]))
    )


class _Name(NamedTuple):
    kind: str
    axis: str


def _classes(block: AdjustedBlock) -> dict[_Name, tuple[ObservationClass, Array]]:
    """Return the classes of Table 2: one of their kinds, and their redundancy numbers."""
    found: dict[_Name, tuple[ObservationClass, Array]] = {}
    for kind, (rays, axis) in classify(block.problem).items():
        name = _name(kind)
        r = np.maximum(block.cofactors.r[rays, axis], 0.0)
        before = found.get(name)
        found[name] = kind, r if before is None else np.concatenate([before[1], r])
    return found


def _name(kind: ObservationClass) -> _Name:
    """Return how the paper names a class: x and y of few outer rays differ, others it pools."""
    where = "" if kind.rays <= 2 else "I" if kind.inner else "O"
    apart = kind.rays <= 3 and not kind.inner
    return _Name(f"{'C' * kind.control}R{where}{kind.rays}", kind.axis if apart else "xy")


def _paper_model(plan: BlockPlan) -> PaperModel | None:
    regular = isclose(plan.overlap, 0.6) and isclose(plan.sidelap, 0.6) and not plan.cross_strips
    if not regular or plan.control != "perimeter":
        return None
    return PaperModel(plan.side, plan.twin, plan.bridging)


def _at(bridging: float, r: Array, paper: float | None, curve: float | None) -> AtBridging:
    roots = np.sqrt(r)
    beyond = None if paper is None else beyond_model(r, paper, MODEL_TOLERANCE)
    return AtBridging(
        bridging,
        len(r),
        float(roots.mean()),
        curve,
        None if beyond is None else int(beyond.sum()),
        float(roots[beyond].mean()) if beyond is not None and beyond.any() else None,
    )
