"""Stated orientations of photos, compared with those that the measurements lead to."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.sorting import order_of
from anaplot.bundle.start.pull import MOST_TURNED, turn_cosines, turned
from anaplot.bundle.start.subblock import SubBlock
from anaplot.photogrammetry.similarity import Similarity, robust_similarity
from anaplot.textfiles.wording import first_of

__all__ = ["led_from_stated", "stated_remarks", "without_stated"]

_NAMED = 5  # photos that are named at most
_ASKED = 60  # photos whose stated rotations are compared with each other


class _OffStated(NamedTuple):
    """(photos,) how far positions [m] and rotations [rad] are off; NaN where nothing is stated."""

    position: Array
    rotation: Array
    reach: Array  # median distance of the points of a photo [m]

    @property
    def wrong(self) -> tuple[Bools, Bools]:
        """(photos,) which positions and rotations show the points in quite another direction."""
        return self.position > MOST_TURNED * self.reach, self.rotation > MOST_TURNED


def led_from_stated(problem: Problem, start: BlockState, found: BlockState) -> bool:
    """Whether all photos were oriented as the block states it, and still are, nearly.

    Parameters
    ----------
    problem
        The bundle.
    start, found
        Approximate values, and the minimum to which they lead.
    """
    for state in (start, found):
        off = _off_stated(problem, _in_ground(state))
        if np.isnan(off.position).any() or np.isnan(off.rotation).any():
            return False
        if any(wrong.any() for wrong in off.wrong):
            return False
    return turned(problem, start, found) <= MOST_TURNED


def without_stated(problem: Problem) -> Problem | None:
    """Return a bundle whose photos lie nowhere but where that is observed; None: as it does."""
    stated = problem.position, problem.rotation
    sigmas = problem.position_sigma, problem.rotation_sigma
    leading = [
        np.isfinite(values) & ~np.isfinite(sigma).any(axis=1, keepdims=True)
        for values, sigma in zip(stated, sigmas, strict=True)
    ]
    if not any(one.any() for one in leading):
        return None
    position, rotation = (
        np.where(one, np.nan, values) for values, one in zip(stated, leading, strict=True)
    )
    return replace(problem, position=position, rotation=rotation)


def stated_remarks(problem: Problem, state: BlockState) -> list[str]:
    """Say which stated orientations are grossly wrong: observed ones are tested instead.

    Parameters
    ----------
    problem, state
        The bundle, and its minimum.
    """
    laid = _in_ground(state)
    if problem.datum != "control":
        # the system is that of the stated orientations only where the search began from them
        fitted = _laid_onto_stated(problem, laid)
        if fitted is None:
            return []
        laid.transform(fitted)
    off = _off_stated(problem, laid)
    position, rotation = off.wrong
    position &= ~np.isfinite(problem.position_sigma).any(axis=1)
    rotation &= ~np.isfinite(problem.rotation_sigma).any(axis=1)
    wrong = np.flatnonzero(position | rotation).tolist()
    if not wrong:
        return []
    said = []
    for k in wrong:
        by = [f"{off.position[k]:.3g} m"] if position[k] else []
        by += [f"{np.degrees(off.rotation[k]):.3g} degrees"] if rotation[k] else []
        said.append(f"photo {problem.photos[k]} by {' and '.join(by)}")
    return [f"stated orientations are grossly wrong: {first_of(said, _NAMED)}"]


def _in_ground(state: BlockState) -> SubBlock:
    return SubBlock(state.centres + state.origin, state.rotations, state.points + state.origin)


def _laid_onto_stated(problem: Problem, found: SubBlock) -> Similarity | None:
    """Return the similarity onto what is stated; None where that does not tell one.

    Stated rotations tell the turn, if there are any: centres nearly on a line say nothing of the
    turn about it.
    """
    there = np.isfinite(problem.stated_centres).all(axis=1)
    source, target = found.centres[there], problem.stated_centres[there]
    turn = _common_turn(problem, found)
    if turn is None:
        fitted = robust_similarity(source, target)
        return None if fitted is None else fitted[0]
    if len(source) < 2:
        return None
    seen = source @ turn.T
    middle, its = np.median(seen, axis=0), np.median(target, axis=0)
    reach = np.linalg.norm(seen - middle, axis=1)
    far = reach > 0.0
    scale = float(np.median(np.linalg.norm(target - its, axis=1)[far] / reach[far]))
    if not scale > 0.0:
        return None
    return Similarity(scale, turn, np.median(target - scale * seen, axis=0))


def _common_turn(problem: Problem, found: SubBlock) -> Array | None:
    """Return the (3, 3) turn onto the stated rotations on which most agree; None without any."""
    stated = problem.stated_rotations
    there = np.flatnonzero(np.isfinite(stated[:, 0, 0]))
    if not len(there):
        return None
    some = there[np.linspace(0, len(there) - 1, min(len(there), _ASKED)).astype(np.intp)]
    turns = stated[some] @ found.rotations[some].transpose(0, 2, 1)
    # the trace of one turn times another's inverse falls with the angle between them
    alike = np.median(np.einsum("kij,lij->kl", turns, turns), axis=1)
    chosen: Array = turns[int(np.argmax(alike))]
    return chosen


def _off_stated(problem: Problem, found: SubBlock) -> _OffStated:
    """Compare what is stated with photos and points in its system."""
    position = np.linalg.norm(found.centres - problem.stated_centres, axis=1)
    rotation = np.arccos(
        np.clip(turn_cosines(problem.stated_rotations, found.rotations), -1.0, 1.0)
    )
    away = found.points.take(problem.point, axis=0)
    away -= found.centres.take(problem.photo, axis=0)
    square = np.einsum("ij,ij->i", away, away)[order_of(problem.photo, len(position))]
    ends = np.cumsum(np.bincount(problem.photo, minlength=len(position)))
    reach = np.sqrt([_lower_median(of) for of in np.split(square, ends[:-1])])
    return _OffStated(position, rotation, reach)


def _lower_median(values: Array) -> float:
    """Return the middle one of some values, of two the lower; NaN without any."""
    if not len(values):
        return float("nan")
    middle = (len(values) - 1) // 2
    return float(np.partition(values, middle)[middle])
