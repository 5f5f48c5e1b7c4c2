"""The mistakes that a simulated operator makes, and whether a model can show them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Axis
from anaplot.errors import NotComputableError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import WrongPointsError, orient
from anaplot.orientation.ownpattern import PointPattern
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Block
from anaplot.planning.modelplan import Candidates, plan_positions
from anaplot.plotter.device.hand import Offsets

__all__ = [
    "SMALLEST",
    "Kind",
    "ModelMistakes",
    "Planted",
    "Plot",
    "PointsOfModel",
    "plant_mistakes",
    "with_sizes",
]

Kind = Literal[
    "gross parallax",
    "x error",
    "wrong point",
    "swapped pair",
    "pair swapped alike",
    "wrong fiducial",
    "transfer error",
    "wrong lateral tie",
    "wrong control point",
    "none",
]
Truth = Mapping[str, Mapping[str, tuple[float, float]]]

SMALLEST = 10.0
"""A detectable mistake is at least this many sigma0 sqrt(q/r)."""

_TRIES = 20
_CLEAR = 4.0  # standard deviations by which a wrong row must stand out from all right ones

_DETECTABLE: tuple[Kind, ...] = ("gross parallax", "swapped pair", "wrong point", "x error")


class Planted(NamedTuple):
    """One mistaken observation.

    Attributes
    ----------
    model, point, photo, axis
        Where it is; for a wrong fiducial `point` is the fiducial.
    size_um
        Size in the image [um].
    kind
        What the operator did.
    detectable
        Whether this model's table can show it.
    shows_in
        The model in which it shows: this one, a later one, or None (only the block's bundle).
    """

    model: str
    point: str
    photo: str
    axis: Axis
    size_um: float
    kind: Kind
    detectable: bool
    shows_in: str | None


@dataclass(frozen=True, slots=True)
class Plot:
    """All mistakes of a strip: what is planted, and the offsets that make the hand do it."""

    planted: tuple[Planted, ...]
    offsets: Mapping[tuple[str, str, str], Offsets]


class PointsOfModel(NamedTuple):
    """What is measured in a model.

    Attributes
    ----------
    photos
        (left, right).
    points
        Names.
    ties
        Those that the preceding model has.
    """

    photos: tuple[str, str]
    points: tuple[str, ...]
    ties: frozenset[str]


class ModelMistakes(NamedTuple):
    """A model in which mistakes are planted.

    Attributes
    ----------
    photos, name
        (left, right), and as "left/right".
    points
        What is measured in it.
    ties
        Points of it that the preceding model has.
    smallest
        (point, axis) -> size of the smallest mistake that its table shows for certain [mm].
    """

    photos: tuple[str, str]
    name: str
    points: tuple[str, ...]
    ties: frozenset[str]
    smallest: Mapping[tuple[str, str], float]


def plant_mistakes(
    block: Block, truth: Truth, candidates: Candidates, pattern: PointPattern, seed: int
) -> Plot:
    """Choose the mistakes of a synthetic strip.

    Every model gets one mistake that its table can show, the kinds taking turns, and one that no
    table of this model can show: an x error at a point that is no tie, or a pair swapped alike in
    both photos. Without noise, whoever re-measures the most suspicious row finds the first kind
    beside what the preceding model has handed on: errors that mask each other are not planted.

    Parameters
    ----------
    block
        With one strip.
    truth
        True image coordinates [mm].
    candidates
        What plans are made from.
    pattern
        The point pattern that is measured.
    seed
        Of the generator.
    """
    rng = np.random.default_rng([seed, 2])
    models = list(with_sizes(block, truth, _planned(block, truth, candidates, pattern)))
    turn = int(rng.integers(3))
    planted: list[Planted] = []
    offsets: dict[tuple[str, str, str], Offsets] = {}
    used: set[tuple[str, str]] = set()
    before: ModelSolution | None = None
    carried: set[str] = set()
    for k, model in enumerate(models):
        following = models[k + 1] if k + 1 < len(models) else None
        kind = _DETECTABLE[(turn + k) % 4]
        if kind == "x error" and not model.ties:
            kind = "gross parallax"
        hidden: Kind = "x error" if k % 2 == 0 or following is None else "pair swapped alike"
        spoiled = {point for name, point in used if name == model.name}
        # the hidden mistake comes first: the other one must not sit on its points
        entries, moved = _hidden(hidden, model, following, truth, rng)
        more: list[Planted] = []
        also: dict[str, Offsets] = {}
        for attempt in range(2 * _TRIES):
            choice: Kind = kind if attempt < _TRIES else "gross parallax"
            more, also = _detectable(choice, model, truth, spoiled | set(moved), rng)
            repaired = _repaired(block, truth, model, before, moved, also, carried)
            if repaired is not None:
                break
        else:
            more, also = [], {}
            repaired = _repaired(block, truth, model, before, moved, also, carried)
        before, carried = repaired, set(moved)
        planted += [*entries, *more]
        for point, offset in (moved | also).items():
            offsets[(*model.photos, point)] = offset
            if following is not None:
                used.add((following.name, point))
    order = {model.name: k for k, model in enumerate(models)}
    planted.sort(key=lambda p: order[p.model])
    return Plot(tuple(planted), offsets)


def _repaired(
    block: Block,
    truth: Truth,
    model: ModelMistakes,
    before: ModelSolution | None,
    hidden: Mapping[str, Offsets],
    shown: Mapping[str, Offsets],
    carried: set[str],
) -> ModelSolution | None:
    """Do the operator's job without noise; None when an innocent row would be accused.

    Parameters
    ----------
    before
        The preceding model with the errors left in it.
    hidden, shown
        Mistakes that this model cannot show, and those that it is to show.
    carried
        Ties whose coordinates from the preceding model are wrong.
    """
    left, right = model.photos
    wrong = dict(hidden) | dict(shown)
    off: set[tuple[str, str]] = set()
    names = model.points
    for _ in range(2 * len(names)):
        none = Offsets()
        at = {name: wrong.get(name, none) for name in names}
        pair = stereopair(
            model.photos,
            {n: (truth[left][n][0] + at[n].dxl, truth[left][n][1] + at[n].dyl) for n in names},
            {n: (truth[right][n][0] + at[n].dxr, truth[right][n][1] + at[n].dyr) for n in names},
            (block.camera_of(left), block.camera_of(right)),
            preceding=before,
            base=block.strips[0].base,
            off=frozenset(off),
        )
        try:
            solution = orient(pair, block.precision, block.test)
        except WrongPointsError as error:
            point = error.suspects[0]
            if wrong.pop(point, None) is None:
                return None
            continue
        except NotComputableError:
            return None
        suspects = diagnose(solution).suspects
        if not suspects:
            return None if wrong.keys() & shown.keys() else solution
        guilty = carried | (wrong.keys() & shown.keys())
        others = [row.size or 0.0 for row in solution.table if row.point not in guilty]
        accused = next(row for row in solution.table if row.key == suspects[0])
        if accused.point not in guilty or (accused.size or 0.0) < max(others, default=0.0) + _CLEAR:
            return None
        if accused.point in shown:
            wrong.pop(accused.point, None)
        else:
            off.add(accused.key)
    return None


def _planned(
    block: Block, truth: Truth, candidates: Candidates, pattern: PointPattern
) -> Iterator[PointsOfModel]:
    """Yield what is measured in the models of the first strip, as they will be planned."""
    strip = block.strips[0]
    before: Mapping[str, tuple[float, float]] = {}
    for left, right in strip.models():
        plan = plan_positions(
            block,
            (left, right),
            pattern,
            nominal_base=strip.base,
            preceding=before,
            candidates=candidates,
        )
        names = tuple(p.point for p in plan)
        yield PointsOfModel((left, right), names, frozenset(n for n in names if n in before))
        before = {name: truth[right][name] for name in names}


def with_sizes(
    block: Block, truth: Truth, models: Iterable[PointsOfModel]
) -> Iterator[ModelMistakes]:
    """Yield models with the smallest sizes of mistakes that show in them.

    Parameters
    ----------
    block
        With the models' strip as its first one.
    truth
        True image coordinates [mm].
    models
        What is measured in the models of the first strip, from its first one on.
    """
    before: ModelSolution | None = None
    for (left, right), names, ties in models:
        pair = stereopair(
            (left, right),
            {name: truth[left][name] for name in names},
            {name: truth[right][name] for name in names},
            (block.camera_of(left), block.camera_of(right)),
            preceding=before,
            base=block.strips[0].base,
        )
        before = orient(pair, block.precision, block.test)
        sizes = _smallest_sizes(block, before)
        yield ModelMistakes((left, right), f"{left}/{right}", names, ties, sizes)


def _smallest_sizes(block: Block, model: ModelSolution) -> dict[tuple[str, str], float]:
    """Return for every row of a table without mistakes the smallest that it surely shows [mm]."""
    sigma = block.precision.image_um * 1e-3
    return {
        row.key: SMALLEST * sigma * sqrt(q / max(row.r, 1e-9))
        for row, q in zip(model.table, model.q_l.tolist(), strict=True)
    }


def _detectable(
    kind: Kind, model: ModelMistakes, truth: Truth, spoiled: set[str], rng: np.random.Generator
) -> tuple[list[Planted], dict[str, Offsets]]:
    names = [point for point in model.points if point not in spoiled]
    if kind == "x error":
        ties = sorted(model.ties - spoiled)
        if ties:
            return _x_error(model, ties[int(rng.integers(len(ties)))], None, True, rng)
        kind = "gross parallax"
    if kind == "swapped pair":
        pair = _closest_pair(model, truth, names)
        if pair is not None:
            return _swapped(model, truth, pair)
        kind = "wrong point"
    point = names[int(rng.integers(len(names)))]
    smallest = model.smallest[point, "y"]
    size = _sign(rng) * smallest * float(rng.uniform(1.1, 3.0))
    if kind == "wrong point":
        # some other detail nearby: a millimetre or two away in any direction
        size = _sign(rng) * max(abs(size), float(rng.uniform(0.4, 2.0)))
        aside = float(rng.uniform(-2.0, 2.0))
    else:
        kind, aside = "gross parallax", 0.0
    entry = Planted(model.name, point, model.photos[1], "y", size * 1e3, kind, True, model.name)
    return [entry], {point: Offsets(dxr=aside, dyr=size)}


def _x_error(
    model: ModelMistakes,
    point: str,
    shows_in: str | None,
    detectable: bool,
    rng: np.random.Generator,
) -> tuple[list[Planted], dict[str, Offsets]]:
    smallest = model.smallest.get((point, "x"), 0.1)
    size = _sign(rng) * smallest * float(rng.uniform(1.1, 2.0))
    where = model.name if detectable else shows_in
    entry = Planted(
        model.name, point, model.photos[1], "x", size * 1e3, "x error", detectable, where
    )
    return [entry], {point: Offsets(dxr=size)}


def _hidden(
    kind: Kind,
    model: ModelMistakes,
    following: ModelMistakes | None,
    truth: Truth,
    rng: np.random.Generator,
) -> tuple[list[Planted], dict[str, Offsets]]:
    """Make a mistake that this model cannot show; it shows where its points become ties."""
    later = [] if following is None else sorted(following.ties - model.ties)
    if kind == "pair swapped alike":
        pair = _closest_pair(model, truth, later, least_dx=0.5)
        if pair is not None and following is not None:
            entries, _ = _swapped(model, truth, pair)
            first, second = pair
            offsets = {}
            for point, other in ((first, second), (second, first)):
                (xl, yl), (xr, yr) = (_moved(truth[p], point, other) for p in model.photos)
                offsets[point] = Offsets(dxl=xl, dyl=yl, dxr=xr, dyr=yr)
            hidden = [
                e._replace(
                    axis="x",
                    kind=kind,
                    detectable=False,
                    shows_in=following.name,
                    size_um=offsets[e.point].dxr * 1e3,
                )
                for e in entries
            ]
            return hidden, offsets
    free = [point for point in model.points if point not in model.ties]
    choice = later or free
    point = choice[int(rng.integers(len(choice)))]
    return _x_error(model, point, following.name if following and later else None, False, rng)


def _swapped(
    model: ModelMistakes, truth: Truth, pair: tuple[str, str]
) -> tuple[list[Planted], dict[str, Offsets]]:
    """Two neighbours interchanged in the right photo."""
    entries, offsets = [], {}
    for point, other in (pair, pair[::-1]):
        dx, dy = _moved(truth[model.photos[1]], point, other)
        offsets[point] = Offsets(dxr=dx, dyr=dy)
        entries.append(
            Planted(
                model.name, point, model.photos[1], "y", dy * 1e3, "swapped pair", True, model.name
            )
        )
    return entries, offsets


def _closest_pair(
    model: ModelMistakes, truth: Truth, names: list[str], least_dx: float = 0.0
) -> tuple[str, str] | None:
    """Return the two points that are easiest to mix up and yet differ enough [mm] to show."""
    right = truth[model.photos[1]]
    best: tuple[float, str, str] | None = None
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            dx, dy = _moved(right, first, second)
            needed = max(model.smallest[first, "y"], model.smallest[second, "y"])
            distance = dx * dx + dy * dy
            if abs(dx) < least_dx or abs(dy) < needed:
                continue
            if best is None or distance < best[0]:
                best = (distance, first, second)
    return None if best is None else best[1:]


def _moved(
    points: Mapping[str, tuple[float, float]], point: str, other: str
) -> tuple[float, float]:
    return points[other][0] - points[point][0], points[other][1] - points[point][1]


def _sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0
