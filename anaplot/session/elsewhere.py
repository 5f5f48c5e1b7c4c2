"""What accepted models of other strips and the control say of points: places, and their errors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from anaplot.orientation.stripgeometry import Located, StripGeometry
from anaplot.orientation.striptie import Placed
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.session.models import geometry_of
from anaplot.session.modelstate import ModelState
from anaplot.session.remembering import remembered
from anaplot.session.statedorientation import StatedPoint, stated_points

__all__ = ["NOTHING_ELSEWHERE", "Elsewhere", "OtherStrips", "consecutive", "elsewhere", "ground"]

_STRIPS = 128  # oriented ones that are remembered


class OtherStrips(Mapping[str, StripGeometry]):
    """Strips that are oriented, by name: a strip is computed when it is asked for.

    In a large block most strips have no point in common with the one in work, and the errors of a
    strip of 60 models take 60 MB.

    Parameters
    ----------
    chains
        Block and models of each strip, from its first one on; strips whose first model is not
        determined are none.
    """

    def __init__(self, chains: Mapping[str, tuple[Block, tuple[ModelState, ...]]]) -> None:
        self._chains = {
            name: (block, models)
            for name, (block, models) in chains.items()
            if geometry_of(block, models[:1]) is not None
        }
        self._oriented: dict[str, StripGeometry] = {}

    def __getitem__(self, strip: str) -> StripGeometry:
        # by name: what is remembered by its models is found by hashing all their measurements
        if strip not in self._oriented:
            geometry = _oriented(*self._chains[strip])
            assert geometry is not None  # its first model is determined
            self._oriented[strip] = geometry
        return self._oriented[strip]

    def __iter__(self) -> Iterator[str]:
        return iter(self._chains)

    def __len__(self) -> int:
        return len(self._chains)

    def may_have(self, strip: str, points: Set[str]) -> bool:
        """Return whether a strip may have any of some points."""
        return any(m.point in points for model in self._chains[strip][1] for m in model.used)


class Elsewhere(NamedTuple):
    """What the accepted models of other strips say.

    Attributes
    ----------
    strips
        Those that are oriented, by name; each is computed when it is looked at.
    strip_of
        The strip that has a point, by point; one of them where several have it.
    stated
        Where points lie by the exterior orientations that are stated beforehand.
    """

    strips: OtherStrips
    strip_of: Mapping[str, str]
    stated: Mapping[str, StatedPoint] = MappingProxyType({})


NOTHING_ELSEWHERE = Elsewhere(OtherStrips({}), {})


@remembered
def elsewhere(block: Block, models: tuple[ModelState, ...], strip: str) -> Elsewhere:
    """Return what the models of all strips but one say: the same from one record to the next."""
    chains: dict[str, tuple[Block, tuple[ModelState, ...]]] = {}
    strip_of: dict[str, str] = {}
    for other in block.strips:
        if other.id == strip:
            continue
        theirs = tuple(m for m in models if m.strip == other.id)
        chains[other.id] = block, consecutive(block, other.id, theirs)
    for model in models:
        if model.strip != strip:
            strip_of |= {m.point: model.strip for m in model.used}
    stated = stated_points(block, (model for model in models if model.strip != strip))
    return Elsewhere(OtherStrips(chains), strip_of, stated)


@lru_cache(maxsize=_STRIPS)
def _oriented(block: Block, models: tuple[ModelState, ...]) -> StripGeometry | None:
    """Return a strip in which nothing is measured now, remembered whole.

    Remembering it up to each of its models would take room with the cube of its length.
    """
    return geometry_of(block, models)


def consecutive(block: Block, strip: str, models: tuple[ModelState, ...]) -> tuple[ModelState, ...]:
    """Return models of a strip from its first one on, up to the first that is missing."""
    by_photos = {m.photos: m for m in models}
    out: list[ModelState] = []
    for photos in next(s for s in block.strips if s.id == strip).models():
        if photos not in by_photos:
            break
        out.append(by_photos[photos])
    return tuple(out)


@remembered
def ground(block: Block, control: tuple[ControlPoint, ...]) -> Placed:
    """Return the points whose three ground coordinates are known [m]."""
    sigma0 = block.precision.image_um * 1e-3
    whole = [(c, block.sigma_of(c)) for c in control if all(v is not None for v in c.xyz)]
    points = {}
    for k, (one, sigma) in enumerate(whole):
        errors = np.zeros((3, 3 * len(whole)))
        errors[:, 3 * k : 3 * k + 3] = np.diag(np.array(sigma) / sigma0)
        points[one.point] = Located(np.array(one.xyz, dtype=np.float64), errors)
    return Placed(points, 3 * len(whole))
