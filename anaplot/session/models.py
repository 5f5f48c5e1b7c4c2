"""The models of a session: pure functions of its state, remembered."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from anaplot.errors import NotComputableError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import UNKNOWNS, orient
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import Diagnosis, ModelSolution
from anaplot.orientation.strip import stereopair
from anaplot.orientation.stripgeometry import StripGeometry, extended
from anaplot.photogrammetry.block import Block, Camera, Precision, TestSettings
from anaplot.session.state import ModelState, SessionState

__all__ = [
    "Models",
    "diagnosis_of",
    "geometry_of",
    "preceding_models",
    "solve",
    "solve_after",
    "solve_behind",
    "solved_or_none",
    "without_redundancy",
]

Models = tuple[ModelState, ...]


class _Same:
    """Objects that are known again as the very same ones: a model's hash is that of all in it."""

    __slots__ = ("parts",)

    def __init__(self, *parts: Any) -> None:
        self.parts = parts

    def __hash__(self) -> int:
        return hash(tuple(map(id, self.parts)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Same):
            return NotImplemented
        return all(a is b for a, b in zip(self.parts, other.parts, strict=True))


def preceding_models(models: Models, model: ModelState) -> Models:
    """Return the accepted models of the strip before a model, first to last."""
    return _preceding(_Same(models), model.strip, model.left)


@lru_cache(maxsize=64)
def _preceding(asked: _Same, strip: str, left: str) -> Models:
    (models,) = asked.parts
    found: list[ModelState] = []
    count = -1
    # They stand one before the other: one pass finds them all, and another one that there are no
    # more. A strip has every photo once, so the walk ends.
    while count < len(found):
        count = len(found)
        for model in reversed(models):
            if model.right == left and model.strip == strip:
                found.append(model)
                left = model.left
    return tuple(reversed(found))


def solve(state: SessionState, model: ModelState) -> ModelSolution:
    """Orient a model of a session from its measurements and the accepted models before it.

    Raises
    ------
    NotComputableError
        The measurements do not determine it (yet); says why.
    """
    return solve_behind(state.block, preceding_models(state.models, model), model)


def solve_behind(block: Block, before: Models, model: ModelState) -> ModelSolution:
    """Orient a model, given those before it in its strip.

    Parameters
    ----------
    block
        What was declared.
    before
        From `preceding_models`.
    model
        The model.

    Raises
    ------
    NotComputableError
        The measurements do not determine it (yet); says why.
    """
    if not before:
        return solve_after(block, model, None, None)
    preceding = _last_of(_Same(block, before))
    if isinstance(preceding, NotComputableError):
        raise _again(preceding)
    return solve_after(block, model, before[-1], preceding)


# A model is asked for again and again while it is measured, and those before it are the same.
@lru_cache(maxsize=64)
def _last_of(asked: _Same) -> ModelSolution | NotComputableError:
    """Return the solution of the last of some models, each behind the one before."""
    block, models = asked.parts
    before: ModelState | None = None
    solution: ModelSolution | None = None
    for one in models:
        found = _solved(_Same(block, one, before, solution))
        if isinstance(found, NotComputableError):
            return found
        before, solution = one, found
    assert solution is not None  # there is a model
    return solution


def without_redundancy(before: Models, model: ModelState) -> bool:
    """Whether a model has no more rows than unknowns, so that none of them can be tested.

    It is counted without being oriented: from as few points that takes longest. True wherever it
    is not determined for want of rows, too.

    Parameters
    ----------
    before
        The models before it in its strip.
    model
        The model.
    """
    off, most = model.off, len(UNKNOWNS) - (not before)
    rows = sum((m.point, "y") not in off for m in model.measured) if off else len(model.measured)
    if rows > most:
        return False
    ties = {m.point for one in before[-1:] for m in one.measured}
    rows += sum(m.point in ties and (m.point, "x") not in off for m in model.measured)
    return rows <= most


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
    found = _solved(_Same(block, model, before, preceding))
    if isinstance(found, NotComputableError):
        raise _again(found)
    return found


def _again(error: NotComputableError) -> NotComputableError:
    """Return an error anew: the one that is remembered would keep whoever it was raised to."""
    again = type(error).__new__(type(error), *error.args)
    again.__dict__.update(error.__dict__)
    return again


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
            solution = solve_after(block, one, before, solution)
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


# A chain, without recursion: the preceding solution is remembered too, and known as the same.
@lru_cache(maxsize=1024)
def _solved(asked: _Same) -> ModelSolution | NotComputableError:
    block, *observed = asked.parts
    return _solve(*_observed(block, *observed), block.precision, block.test)


# A model that is equal only, as after an undo, is known by what was measured.
@lru_cache(maxsize=1024)
def _solve(
    model: ModelState,
    cameras: tuple[Camera, Camera],
    base: float | None,
    preceding: ModelSolution | None,
    once: frozenset[str],
    precision: Precision,
    test: TestSettings,
) -> ModelSolution | NotComputableError:
    try:
        return orient(_pair(model, cameras, base, preceding, once), precision, test)
    except NotComputableError as error:
        return _again(error)


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
