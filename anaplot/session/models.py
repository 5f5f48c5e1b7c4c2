"""The models of a session: pure functions of its state, remembered."""

from __future__ import annotations

from functools import lru_cache

from anaplot.errors import NotComputableError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.orientation.results import Diagnosis, ModelSolution
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Block
from anaplot.session.state import ModelState, SessionState

__all__ = ["diagnosis_of", "preceding_models", "solve", "strip_solutions"]


def preceding_models(state: SessionState, model: ModelState) -> tuple[ModelState, ...]:
    """Return the accepted models of the strip before a model, first to last."""
    found: list[ModelState] = []
    left = model.left
    while (before := state.preceding(model.strip, left)) is not None and before not in found:
        found.insert(0, before)
        left = before.left
    return tuple(found)


def solve(state: SessionState, model: ModelState) -> ModelSolution:
    """Orient a model of a session from its measurements and the accepted models before it.

    Raises
    ------
    NotComputableError
        The measurements do not determine it (yet); says why.
    """
    return _solve(state.block, preceding_models(state, model), model)


@lru_cache(maxsize=256)
def _solve(block: Block, before: tuple[ModelState, ...], model: ModelState) -> ModelSolution:
    preceding = _solve(block, before[:-1], before[-1]) if before else None
    strip = next(s for s in block.strips if s.id == model.strip)
    used = model.used
    pair = stereopair(
        model.photos,
        {m.point: (m.xl, m.yl) for m in used},
        {m.point: (m.xr, m.yr) for m in used},
        (block.camera_of(model.left), block.camera_of(model.right)),
        preceding=preceding,
        base=strip.base,
        off=frozenset((point, axis) for point, axis in model.off),
    )
    return orient(pair, block.precision, block.test)


@lru_cache(maxsize=256)
def diagnosis_of(solution: ModelSolution, power: float) -> Diagnosis:
    """Return what is said of a model beyond its table, remembered."""
    return diagnose(solution, power)


def strip_solutions(state: SessionState, strip: str) -> tuple[ModelSolution, ...]:
    """Return the solutions of a strip's accepted models, as far as they are computable."""
    out = []
    for model in state.models:
        if model.strip == strip:
            try:
                out.append(solve(state, model))
            except NotComputableError:
                break
    return tuple(out)
