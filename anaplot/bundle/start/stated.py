"""Stated orientations of photos, compared with those that the measurements lead to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.pull import MOST_TURNED, turned
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.similarity import robust_similarity

__all__ = ["led_from_stated", "stated_remarks"]

_NAMED = 5  # photos that are named at most


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
        off = _off_stated(problem, state.centres + state.origin, state)
        if np.isnan(off.position).any() or np.isnan(off.rotation).any():
            return False
        if any(wrong.any() for wrong in off.wrong):
            return False
    return turned(problem, start, found) <= MOST_TURNED


def stated_remarks(problem: Problem, state: BlockState) -> list[str]:
    """Say which stated orientations are grossly wrong: observed ones are tested instead.

    Parameters
    ----------
    problem, state
        The bundle, and its minimum.
    """
    centres = state.centres + state.origin
    laid = state
    if problem.datum != "control":
        # the system is that of the stated orientations only where the search began from them
        known = np.isfinite(problem.position).all(axis=1)
        fitted = robust_similarity(centres[known], problem.position[known])
        if fitted is None:
            return []
        centres = fitted[0].apply(centres)
        laid = _turned_by(state, fitted[0].rotation, fitted[0].scale)
    off = _off_stated(problem, centres, laid)
    position, rotation = off.wrong
    position &= ~np.isfinite(problem.position_sigma).any(axis=1)
    rotation &= ~np.isfinite(problem.rotation_sigma).any(axis=1)
    wrong = np.flatnonzero(position | rotation).tolist()
    if not wrong:
        return []
    said = []
    for k in wrong[:_NAMED]:
        by = [f"{off.position[k]:.3g} m"] if position[k] else []
        by += [f"{np.degrees(off.rotation[k]):.3g} degrees"] if rotation[k] else []
        said.append(f"photo {problem.photos[k]} by {' and '.join(by)}")
    more = f" and {len(wrong) - _NAMED} more" if len(wrong) > _NAMED else ""
    return [f"stated orientations are grossly wrong: {', '.join(said)}{more}"]


def _turned_by(state: BlockState, rotation: Array, scale: float) -> BlockState:
    """Return a state whose rotations and distances are those of another system."""
    return BlockState(
        scale * state.centres @ rotation.T,
        rotation @ state.rotations,
        scale * state.points @ rotation.T,
        state.own,
        state.shared,
        state.origin,
    )


def _off_stated(problem: Problem, centres: Array, state: BlockState) -> _OffStated:
    """Compare (photos, 3) centres in the ground system, and the rotations of a state."""
    position = np.linalg.norm(centres - problem.stated_centres, axis=1)
    rotation = np.full(len(centres), np.nan)
    for k in np.flatnonzero(np.isfinite(problem.rotation).all(axis=1)).tolist():
        between = rotation_matrix(*problem.rotation[k].tolist()).T @ state.rotations[k]
        rotation[k] = np.arccos(np.clip((np.trace(between) - 1.0) / 2.0, -1.0, 1.0))
    away = np.linalg.norm(state.points[problem.point] - state.centres[problem.photo], axis=1)
    order = np.lexsort((away, problem.photo))
    ends = np.searchsorted(problem.photo[order], np.arange(len(centres) + 1))
    reach = away[order][(ends[:-1] + ends[1:] - 1) // 2]
    return _OffStated(position, rotation, reach)
