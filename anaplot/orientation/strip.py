"""A strip: consecutive models in one system."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Protocol

import numpy as np

from anaplot.aliases import Progress, RowKey
from anaplot.errors import NotComputableError
from anaplot.orientation.model import orient
from anaplot.orientation.pair import LeftPhoto, Stereopair
from anaplot.orientation.results import ModelPoint, ModelSolution
from anaplot.orientation.tieerrors import ExactStatistics
from anaplot.photogrammetry.block import Block, Camera, ImagePoint, Strip
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.photogrammetry.selection import (
    measured_once,
    model_name,
    points_of,
    rows_by_photo,
    rows_off,
)

__all__ = ["BridgedStrip", "Predecessor", "bridge", "bridge_strip", "pooled_sigma_um", "stereopair"]

Coordinates = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class BridgedStrip:
    """A strip as far as it could be bridged.

    Attributes
    ----------
    strip
        Name.
    models
        The oriented models.
    error
        Why the next model could not be computed, or None.
    """

    strip: str
    models: tuple[ModelSolution, ...]
    error: str | None = None


class Predecessor(Protocol):
    """What a model takes over from the preceding one of its strip, as a `ModelSolution` has it."""

    @property
    def centre(self) -> tuple[float, float, float]:
        """Projection centre of its left photo [mm] in the strip system."""

    @property
    def base(self) -> tuple[float, float, float]:
        """From there to the right one [mm]."""

    @property
    def rotation(self) -> tuple[float, float, float]:
        """Angles [rad] of the right photo in the strip system."""

    @property
    def points(self) -> tuple[ModelPoint, ...]:
        """Its points."""

    @property
    def exact(self) -> ExactStatistics | None:
        """How its points err, under "exact"."""


def stereopair(
    photos: tuple[str, str],
    left: Coordinates,
    right: Coordinates,
    cameras: tuple[Camera, Camera],
    *,
    preceding: Predecessor | None,
    base: float | None = None,
    off: frozenset[RowKey] = frozenset(),
    once: frozenset[str] = frozenset(),
) -> Stereopair:
    """Put together what a model is computed from.

    Parameters
    ----------
    photos
        Names of the left and the right photo.
    left, right
        Image coordinates [mm] by point; the model has the points common to both, in the order
        of the left photo, but those of which every row is switched off.
    cameras
        Of the left and the right photo.
    preceding
        The preceding model of the strip; None for the first.
    base
        Nominal base of a first model [mm].
    off
        Rows (point, axis) switched off.
    once
        Points whose left ray is the right one of the preceding model, measured once for both.
    """
    measured = tuple(point for point in left if point in right)
    before = () if preceding is None else frozenset(p.point for p in preceding.points)
    rows = [(point, "y") for point in measured]
    rows += [(point, "x") for point in measured if point in before]
    counting = [row for row in rows if row not in off]
    used = frozenset(point for point, _ in counting)
    fixed = LeftPhoto()
    ties = None
    preceding_bx = None
    tie_errors = None
    if preceding is not None:
        centre = np.array(_centre_of(preceding))
        fixed = LeftPhoto(centre, rotation_matrix(*preceding.rotation))
        ties = {p.point: (p.X, p.Y, p.Z) for p in preceding.points if isfinite(p.Z)}
        preceding_bx = preceding.base[0]
        tie_errors = None if preceding.exact is None else preceding.exact.ties

    def pair(points: tuple[str, ...], off: frozenset[RowKey]) -> Stereopair:
        return Stereopair(
            left=photos[0],
            right=photos[1],
            points=points,
            xl=np.array([left[point] for point in points]).reshape(-1, 2),
            xr=np.array([right[point] for point in points]).reshape(-1, 2),
            c_left=cameras[0].c,
            c_right=cameras[1].c,
            fixed=fixed,
            ties=ties,
            preceding_bx=preceding_bx,
            base=base,
            off=off,
            tie_errors=tie_errors,
            once=once,
        )

    counted = pair(tuple(point for point in measured if point in used), off)
    if len(counting) == len(rows):
        return counted
    return replace(counted, aside=pair(measured, frozenset(counting)))


def _centre_of(model: Predecessor) -> tuple[float, float, float]:
    left, base = model.centre, model.base
    return left[0] + base[0], left[1] + base[1], left[2] + base[2]


def bridge_strip(
    block: Block,
    strip: Strip,
    *,
    form: Callable[[Stereopair], ModelSolution] | None = None,
    rows: Mapping[str, Sequence[ImagePoint]] | None = None,
) -> BridgedStrip:
    """Form the models of a strip one after another, as the operator would.

    A model that cannot be computed ends the strip; the models before it stand. `form` makes the
    model of a pair; None: it is oriented as it is. `rows` are the block's, photo by photo; None:
    they are sorted here, which is much for every strip of many.
    """
    models: list[ModelSolution] = []
    rows = rows_by_photo(block.image_points) if rows is None else rows
    before: Mapping[str, ImagePoint] = {}
    for photos in strip.models():
        unseen = next((photo for photo in photos if photo not in rows), None)
        if unseen is not None:
            why = f"model {model_name(*photos)}: photo {unseen} has no image points"
            return BridgedStrip(strip.id, tuple(models), f"strip {strip.id}, {why}")
        left, right = (
            points_of(rows.get(photo, ()), photo, model_name(*photos)) for photo in photos
        )
        pair = stereopair(
            photos,
            {name: (p.x, p.y) for name, p in left.items()},
            {name: (p.x, p.y) for name, p in right.items()},
            (block.camera_of(photos[0]), block.camera_of(photos[1])),
            preceding=models[-1] if models else None,
            base=strip.base,
            off=rows_off(left, right),
            once=measured_once(before, left),
        )
        before = right
        try:
            models.append(orient(pair, block.precision, block.test) if form is None else form(pair))
        except NotComputableError as error:
            return BridgedStrip(strip.id, tuple(models), f"strip {strip.id}, {error}")
    return BridgedStrip(strip.id, tuple(models))


def bridge(block: Block, progress: Progress | None = None) -> tuple[BridgedStrip, ...]:
    """Bridge every strip of a block; `progress` is told how many of its models are formed."""
    count, formed = sum(len(strip.models()) for strip in block.strips), 0

    def form(pair: Stereopair) -> ModelSolution:
        nonlocal formed
        if progress is not None:
            progress("models", formed / count)
        formed += 1
        return orient(pair, block.precision, block.test)

    rows = rows_by_photo(block.image_points)
    return tuple(bridge_strip(block, strip, form=form, rows=rows) for strip in block.strips)


def pooled_sigma_um(models: tuple[ModelSolution, ...]) -> float | None:
    """Return sigma0 [um] pooled over models: sum of v'Pv over sum of redundancies."""
    redundancy = sum(model.redundancy for model in models)
    if redundancy == 0:
        return None
    total = sum(
        model.redundancy * model.sigma0_um**2 for model in models if model.sigma0_um is not None
    )
    return float((total / redundancy) ** 0.5)
