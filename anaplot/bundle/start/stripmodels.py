"""The models of all strips of a block as arrays: which rays each of them has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.selection import model_name

__all__ = ["StripModels", "strip_models"]


@dataclass(frozen=True, slots=True, eq=False)
class StripModels:
    """Models, strip by strip in the order of flight, and the points measured in both photos.

    Attributes
    ----------
    strips
        The models of each strip of the block.
    photos
        (m, 2) left and right photos; -1 for what is not in the bundle.
    base
        (m,) nominal bases of their strips [mm]; NaN where none is stated.
    ends
        (m + 1,) where the points of each model begin, and the last ends.
    points
        (k,) points of the models, in the order of the left photo's rows.
    left, right
        (k, 2) image coordinates [mm].
    counts
        (k, 2) whether x, and y, of the right ray counts.
    before
        (k,) the same point among those of the strip's preceding model, or -1.
    """

    strips: tuple[range, ...]
    photos: Index
    base: Array
    ends: Index
    points: Index
    left: Array
    right: Array
    counts: Bools
    before: Index

    def of(self, model: int) -> slice:
        """Return where the points of a model are."""
        return slice(int(self.ends[model]), int(self.ends[model + 1]))


def strip_models(problem: Problem) -> StripModels:
    """Return the models of the strips of a bundle.

    As `points_of` and `rows_off` select them: a point is taken from the row of its own model, else
    from the row without a model.
    """
    at = {name: k for k, name in enumerate(problem.photos)}
    strips: list[range] = []
    pairs: list[tuple[str, str]] = []
    base: list[float] = []
    for strip in problem.block.strips:
        mine = strip.models()
        strips.append(range(len(pairs), len(pairs) + len(mine)))
        pairs += mine
        base += [np.nan if strip.base is None else strip.base] * len(mine)
    names = [model_name(*pair) for pair in pairs]
    photos = np.array([[at.get(name, -1) for name in pair] for pair in pairs], dtype=np.intp)
    photos = photos.reshape(-1, 2)
    named = _names_of_rows(problem, names)
    key, left = _selected(problem, photos[:, 0], *named)
    other_key, right = _selected(problem, photos[:, 1], *named)
    key, here, there = np.intersect1d(key, other_key, assume_unique=True, return_indices=True)
    model, points = np.divmod(key, len(problem.points))
    order = np.lexsort((problem.source[left[here]], model))
    left, right = left[here[order]], right[there[order]]
    # where a point of the model before is: the keys are in order, the points of a model are not
    found = np.searchsorted(key, key - len(problem.points))
    again = (found < len(key)) & ~np.isin(model, [strip.start for strip in strips])
    again[again] &= key[found[again]] == key[again] - len(problem.points)
    place = np.argsort(order)
    before = np.full(len(key), -1)
    before[place[again]] = place[found[again]]
    off = problem.off
    return StripModels(
        strips=tuple(strips),
        photos=photos,
        base=np.array(base),
        ends=np.searchsorted(model, np.arange(len(photos) + 1)),
        points=points[order],
        left=problem.ideal[left],
        right=problem.ideal[right],
        counts=np.ones((len(right), 2), dtype=bool) if off is None else ~off[right],
        before=before,
    )


def _names_of_rows(problem: Problem, names: list[str]) -> tuple[Index, Index]:
    """Return the model that each ray names, and the name of each model, as numbers.

    -1 of a ray that names none.
    """
    number: dict[str | None, int] = {None: -1}
    of_model = [number.setdefault(name, len(number)) for name in names]
    models = columns_of(problem.block.image_points).model
    of_row = models.each(lambda model: number.get(model, 0)).listed()
    return np.array(of_row, dtype=np.intp)[problem.source], np.array(of_model, dtype=np.intp)


def _selected(
    problem: Problem, photos: Index, of_ray: Index, of_model: Index
) -> tuple[Index, Index]:
    """Return the points of a photo of each model, and their rays.

    Parameters
    ----------
    problem
        The bundle.
    photos
        (models,) left or right photos.
    of_ray, of_model
        What they are named, see `_names_of_rows`.

    Returns
    -------
    tuple
        Model times points plus point, ascending, and the ray of each.
    """
    by_photo = np.argsort(problem.photo, kind="stable")
    starts = np.searchsorted(problem.photo[by_photo], np.arange(len(problem.photos) + 1))
    count = np.where(photos < 0, 0, starts[photos + 1] - starts[photos])
    model = np.repeat(np.arange(len(photos)), count)
    first = np.cumsum(count) - count
    ray = by_photo[np.arange(len(model)) - (first - starts[photos])[model]]
    own = of_ray[ray] == of_model[model]
    use = own | (of_ray[ray] < 0)
    model, ray, own = model[use], ray[use], own[use]
    key = model * len(problem.points) + problem.point[ray]
    # the last of its own rows comes before the first of those without a model
    row = problem.source[ray]
    order = np.lexsort((np.where(own, -1 - row, row), key))
    key, ray = key[order], ray[order]
    chosen = np.append(True, key[1:] != key[:-1])[: len(key)]
    return key[chosen], ray[chosen]
