"""Numbering accidents of a whole block, from its image points and control as the files have them.

The same tests as while one measures: every model as the next one after those before it in its
strip, and after the strips before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from anaplot.aliases import Progress
from anaplot.orientation.striptie import FEWEST
from anaplot.photogrammetry.block import Block
from anaplot.session.accidents import Accident, accidents_in, farthest
from anaplot.session.elsewhere import consecutive
from anaplot.session.filedaccidents import MOST_MEASUREMENTS, BlockAccidents, FiledAccident
from anaplot.session.filedmodels import filed_models
from anaplot.session.modelstate import ModelState
from anaplot.session.photoaccidents import photo_accidents
from anaplot.session.tiecheck import Known
from anaplot.session.transfer import RECENT, transfer_of_strip

__all__ = ["block_accidents"]

_STEP = RECENT // 2  # models from one comparison of a strip with the others to the next


def block_accidents(block: Block, progress: Progress | None = None) -> BlockAccidents:
    """Return the numbering accidents of a block.

    Parameters
    ----------
    block
        With image points and control. A strip counts up to the first model that has no points or
        cannot be computed, as in the bridge.
    progress
        Told how much of its strips is looked through; may raise to end it.
    """
    known = Known.of(block.control, None)
    models = filed_models(block)
    photos = photo_accidents(block)
    # cameras, photos and tests alone: a block is looked up whole
    block = replace(block, image_points=())
    before: dict[str, tuple[ModelState, ...]] = {}
    found: list[FiledAccident] = []
    unchecked = []
    for k, strip in enumerate(block.strips):
        if progress is not None:
            progress("accidents of numbering", k / len(block.strips))
        own = consecutive(block, strip.id, tuple(m for m in models if m.strip == strip.id))
        if sum(len(m.measured) for m in own) > MOST_MEASUREMENTS:
            unchecked.append(strip.id)
            continue
        found += _of_strip(block, before, own, known)
        before[strip.id] = own
    return BlockAccidents(tuple(found), tuple(unchecked), photos)


def _of_strip(
    block: Block,
    before: Mapping[str, tuple[ModelState, ...]],
    own: tuple[ModelState, ...],
    known: Known,
) -> Iterable[FiledAccident]:
    here = _points(own)
    # a strip with fewer points in common says nothing
    near = (one for one in before.values() if len(here & _points(one)) >= FEWEST)
    others = tuple(model for strip in near for model in strip)
    found: dict[str, Accident] = {}
    for end in range(len(own) % _STEP or _STEP, len(own) + 1, _STEP):
        said = transfer_of_strip(block, others, own[:end], known, _STEP, farthest(block.precision))
        # what is compared anew with more points is known better
        anew = _points(own[max(end - RECENT, 0) : end])
        found = {p: one for p, one in found.items() if not (one.against and p in anew)}
        for k, one in enumerate(said, end - len(said)):
            names = _points(own[: k + 1])
            models = (*others, *own[:k])
            for accident in accidents_in(block.precision, models, own[k], one, names):
                found[accident.point] = accident
    for point, accident in found.items():
        model = next((m for m in reversed(own) if m.measurement(point) is not None), None)
        if model is not None:
            yield FiledAccident(model.strip, model.name, accident)


def _points(models: Iterable[ModelState]) -> frozenset[str]:
    return frozenset(m.point for model in models for m in model.used)
