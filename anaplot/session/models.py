"""The models of a session: pure functions of its state, remembered."""

from __future__ import annotations

from functools import lru_cache

from anaplot.errors import NotComputableError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import Diagnosis, ModelSolution
from anaplot.orientation.strip import stereopair
from anaplot.orientation.stripgeometry import StripGeometry, extended
from anaplot.photogrammetry.block import Block, Camera, Precision, TestSettings
from anaplot.session.state import ModelState, SessionState

__all__ = [
    "diagnosis_of",
    "geometry_of",
    "preceding_models",
    "solve",
    "solve_after",
    "solved_or_none",
]


def preceding_models(state: SessionState, model: ModelState) -> tuple[ModelState, ...]:
    """Return the accepted models of the strip before a model, first to last."""
    by_right = {m.right: m for m in state.models if m.strip == model.strip}
    found: list[ModelState] = []
    left = model.left
    # a strip has every photo once: the walk ends
    while (before := by_right.get(left)) is not None:
        found.append(before)
        left = before.left
    return tuple(reversed(found))


def solve(state: SessionState, model: ModelState) -> ModelSolution:
    """Orient a model of a session from its measurements and the accepted models before it.

    Raises
    ------
    NotComputableError
        The measurements do not determine it (yet); says why.
    """
    before: ModelState | None = None
    solution: ModelSolution | None = None
    for one in preceding_models(state, model):
        solution = solve_after(state.block, one, before, solution)
        before = one
    return solve_after(state.block, model, before, solution)


def solved_or_none(state: SessionState, model: ModelState) -> ModelSolution | None:
    """Orient a model of a session; None where its measurements do not determine it (yet)."""
    try:
        return solve(state, model)
    except NotComputableError:
        return None


def solve_after(
    block: Block,
    model: ModelState,
    before: ModelState | None,
    preceding: ModelSolution | None,
) -> ModelSolution:
    """Orient a model from its measurements and the model before it.

    Parameters
    ----------
    block
        What was declared.
    model
        The model.
    before, preceding
        The model before it in its strip, and that one's solution; None for the first.

    Raises
    ------
    NotComputableError
        The measurements do not determine it; says why.
    """
    observed = _observed(block, model, before, preceding)
    return _solve(*observed, block.precision, block.test)


def geometry_of(block: Block, models: tuple[ModelState, ...]) -> StripGeometry | None:
    """Return a strip as far as its models are determined; None where the first is not.

    Parameters
    ----------
    block
        Its cameras, precision and test.
    models
        Consecutive models of one strip, from its first one on.
    """
    before: ModelState | None = None
    solution: ModelSolution | None = None
    geometry: StripGeometry | None = None
    for one in models:
        observed = _observed(block, one, before, solution)
        try:
            solution = _solve(*observed, block.precision, block.test)
        except NotComputableError:
            break
        geometry = _extended(geometry, *observed, solution)
        before = one
    return geometry


_Observed = tuple[
    ModelState, tuple[Camera, Camera], float | None, ModelSolution | None, frozenset[str]
]
"""A model, its cameras, the base of its strip, the solution before it, what was measured once."""


def _observed(
    block: Block, model: ModelState, before: ModelState | None, preceding: ModelSolution | None
) -> _Observed:
    """Return all that a model follows from, but for the block's precision and test."""
    cameras = block.camera_of(model.left), block.camera_of(model.right)
    base = next(s.base for s in block.strips if s.id == model.strip)
    return model, cameras, base, preceding, _measured_once(before, model)


@lru_cache(maxsize=256)
def _extended(
    geometry: StripGeometry | None,
    model: ModelState,
    cameras: tuple[Camera, Camera],
    base: float | None,
    preceding: ModelSolution | None,
    once: frozenset[str],
    solution: ModelSolution,
) -> StripGeometry:
    return extended(geometry, _pair(model, cameras, base, preceding, once), solution)


def _measured_once(before: ModelState | None, model: ModelState) -> frozenset[str]:
    """Return the points whose left rays a model in a mono comparator took over."""
    if before is None or not model.mono:
        return frozenset()
    right = {(m.point, m.xr, m.yr) for m in before.used}
    return frozenset(m.point for m in model.used if (m.point, m.xl, m.yl) in right)


# Keyed by the preceding solution itself, which is remembered too: a chain, without recursion.
@lru_cache(maxsize=1024)
def _solve(
    model: ModelState,
    cameras: tuple[Camera, Camera],
    base: float | None,
    preceding: ModelSolution | None,
    once: frozenset[str],
    precision: Precision,
    test: TestSettings,
) -> ModelSolution:
    return orient(_pair(model, cameras, base, preceding, once), precision, test)


def _pair(
    model: ModelState,
    cameras: tuple[Camera, Camera],
    base: float | None,
    preceding: ModelSolution | None,
    once: frozenset[str],
) -> Stereopair:
    return stereopair(
        model.photos,
        {m.point: (m.xl, m.yl) for m in model.measured},
        {m.point: (m.xr, m.yr) for m in model.measured},
        cameras,
        preceding=preceding,
        base=base,
        off=model.off,
        once=once,
    )


@lru_cache(maxsize=256)
def diagnosis_of(solution: ModelSolution) -> Diagnosis:
    """Return what is said of a model beyond its table, remembered."""
    return diagnose(solution)
