"""One mistake of every kind in a block of strips, each where a stage of the work can show it."""

from __future__ import annotations

from collections.abc import Sequence, Set
from math import hypot

import numpy as np

from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.plotter.device.hand import Offsets
from anaplot.session.modelstate import ModelState
from anaplot.simulation.mistakes import (
    Kind,
    ModelMistakes,
    Planted,
    Plot,
    PointsOfModel,
    Truth,
    _closest_pair,
    _swapped,
    _x_error,
    with_sizes,
)
from anaplot.simulation.wrongfiducial import plant_wrong_fiducial

__all__ = ["plant_in_block"]

_BESIDE = (1.5, 3.0)  # mm: how far off another detail lies that is taken for a point


def plant_in_block(block: Block, truth: Truth, models: Sequence[ModelState], seed: int) -> Plot:
    """Plant a mistake of every kind in a block of at least two strips.

    In the first strip a fiducial of one photo is missed, two points of the first model have their
    names interchanged in one photo, another one is missed in x, which only the second model shows,
    and a tie is taken there for a detail beside it. In the last model of the last strip a lateral
    tie and a control point are taken for details beside them, alike in both photos.

    Parameters
    ----------
    block
        With cameras that have fiducials.
    truth
        True image coordinates [mm].
    models
        The block's models as they are measured without a mistake, in this order.
    seed
        Of the generator.

    Raises
    ------
    InputError
        A mistake finds no place, because a point of its kind is missing.
    """
    rng = np.random.default_rng([seed, 5])
    own = [model for model in models if model.strip == block.strips[0].id]
    last = models[-1]
    if len(own) < 2 or last.strip == block.strips[0].id:
        raise InputError("mistakes of every kind need a strip of two models and another strip")
    first, second = with_sizes(block, truth, map(_measured, own[:2]))
    # of a control point the control tells before the model or the next one does
    given = {c.point for c in block.control}
    pair, swapped = _swapped_pair(first, truth, given)
    hidden, missed = _next_model_error(first, second, given | swapped.keys(), rng)
    transferred, beside = _transfer_error(second, given | swapped.keys() | missed.keys(), rng)
    measured = {p.point for model in models[:-1] for p in model.plan}
    here = {p.point for model in models[:-1] if model.strip == last.strip for p in model.plan}
    ties = [p.point for p in last.plan if p.role == "lateral" and p.point not in here]
    known = [p.point for p in last.plan if p.point in given - measured]
    lateral, aside = _other_detail("wrong lateral tie", last, ties, rng)
    ground, apart = _other_detail("wrong control point", last, known, rng)
    fiducial, offsets = plant_wrong_fiducial(block, seed)
    for model, moved in (
        (first.photos, swapped | missed),
        (second.photos, beside),
        (last.photos, aside | apart),
    ):
        offsets |= {(*model, point): offset for point, offset in moved.items()}
    return Plot((fiducial, *pair, hidden, transferred, lateral, ground), offsets)


def _measured(model: ModelState) -> PointsOfModel:
    ties = frozenset(p.point for p in model.plan if p.role == "tie")
    return PointsOfModel(model.photos, tuple(p.point for p in model.plan), ties)


def _swapped_pair(
    model: ModelMistakes, truth: Truth, spared: Set[str]
) -> tuple[list[Planted], dict[str, Offsets]]:
    """Interchange the names of two neighbours in the right photo.

    Parameters
    ----------
    model
        Where it happens.
    truth
        True image coordinates [mm].
    spared
        Points that are to stay right.

    Raises
    ------
    InputError
        No two points of the model differ enough.
    """
    pair = _closest_pair(model, truth, [p for p in model.points if p not in spared])
    if pair is None:
        raise InputError(f"model {model.name} has no two points whose interchange shows")
    return _swapped(model, truth, pair)


def _next_model_error(
    model: ModelMistakes, following: ModelMistakes, spared: Set[str], rng: np.random.Generator
) -> tuple[Planted, dict[str, Offsets]]:
    """Miss a point in x that is no tie of its model, but one of the next.

    Parameters
    ----------
    model, following
        Where it happens, and where it shows.
    spared
        Points that are to have none.
    rng
        Chooses.

    Raises
    ------
    InputError
        The models have no such point.
    """
    later = sorted(following.ties - model.ties - spared)
    if not later:
        raise InputError(f"model {following.name} has no tie for a mistake of {model.name}")
    point = later[int(rng.integers(len(later)))]
    (planted,), moved = _x_error(model, point, following.name, False, rng)
    return planted, moved


def _transfer_error(
    model: ModelMistakes, spared: Set[str], rng: np.random.Generator
) -> tuple[Planted, dict[str, Offsets]]:
    """Take a tie for a detail beside it at another height: a parallax in x gives it away."""
    ties = sorted(model.ties - spared)
    if not ties:
        raise InputError(f"model {model.name} has no tie that could be taken for another detail")
    point = ties[int(rng.integers(len(ties)))]
    dx, dy = _beside(rng)
    px = model.smallest[point, "x"] * float(rng.uniform(1.5, 3.0))
    kind: Kind = "transfer error"
    planted = Planted(model.name, point, model.photos[1], "x", px * 1e3, kind, True, model.name)
    return planted, {point: Offsets(dx, dy, dx + px, dy)}


def _other_detail(
    kind: Kind, model: ModelState, points: list[str], rng: np.random.Generator
) -> tuple[Planted, dict[str, Offsets]]:
    """Take a point for a detail beside it, alike in both photos."""
    if not points:
        raise InputError(f"model {model.name} has no point for a {kind}")
    point = points[int(rng.integers(len(points)))]
    dx, dy = _beside(rng)
    size = 1e3 * hypot(dx, dy)
    planted = Planted(model.name, point, model.right, "x", size, kind, True, model.name)
    return planted, {point: Offsets(dx, dy, dx, dy)}


def _beside(rng: np.random.Generator) -> tuple[float, float]:
    """Return where another detail lies [mm]."""
    size, angle = rng.uniform(*_BESIDE), rng.uniform(0.0, 2.0 * np.pi)
    return float(size * np.cos(angle)), float(size * np.sin(angle))
