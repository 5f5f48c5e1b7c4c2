"""What hangs the strips of a block together, and on the ground."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from anaplot.photogrammetry.block import Block, Strip
from anaplot.photogrammetry.imagepoints import counting_names_of

__all__ = ["Coverage", "coverage_of", "is_held"]


class Coverage(NamedTuple):
    """What hangs the strips together, and on the ground.

    Attributes
    ----------
    lateral_ties
        How many points are measured in photos of more than one strip.
    control
        How many control and check points there are.
    control_seen
        How many of them are measured in two photos.
    apart
        Strips with points that no chain of common points leads to from the first of these.
    """

    lateral_ties: int
    control: int
    control_seen: int
    apart: tuple[str, ...] = ()


def is_held(block: Block) -> bool:
    """Return whether anything says where the block lies, enough of it or not."""
    return (
        any(row.use == "control" for row in block.control)
        or bool(block.priors)
        or block.given is not None
        or any(photo.position_sigma is not None for photo in block.photos)
    )


def coverage_of(block: Block) -> Coverage:
    """Return a block's lateral ties and control, as far as they are measured and not off."""
    known = [point.point for point in block.control if point.use != "off"]
    photos_of: dict[str, set[str]] = {name: set() for name in known}
    of_photo = _strips_of_photos(block.strips)
    strips_of: dict[str, frozenset[str]] = {}
    # looked at after every accepted model: a point of one strip alone keeps that strip's set
    for photo, point in counting_names_of(block.image_points):
        if point in photos_of:
            photos_of[point].add(photo)
        own = of_photo.get(photo)
        if own is not None and strips_of.setdefault(point, own) is not own:
            strips_of[point] |= own
    return Coverage(
        sum(len(strips) > 1 for strips in strips_of.values()),
        len(known),
        sum(len(photos_of[point]) > 1 for point in known),
        _apart([strip.id for strip in block.strips], strips_of.values()),
    )


def _apart(names: Sequence[str], joined: Iterable[frozenset[str]]) -> tuple[str, ...]:
    """Return the strips that hang together with others than the first measured one."""
    different = set(joined)
    measured = [name for name in names if any(name in strips for strips in different)]
    reached, grown = set[str](), set(measured[:1])
    while grown != reached:
        reached = grown
        grown = reached.union(*(one for one in different if not one.isdisjoint(reached)))
    return tuple(name for name in measured if name not in reached)


def _strips_of_photos(strips: Iterable[Strip]) -> dict[str, frozenset[str]]:
    """Return the strips of every photo, those of the same strips by the same set."""
    found: dict[str, set[str]] = {}
    for strip in strips:
        for photo in strip.photos:
            found.setdefault(photo, set()).add(strip.id)
    same: dict[frozenset[str], frozenset[str]] = {}
    out = {}
    for photo, ids in found.items():
        of = frozenset(ids)
        out[photo] = same.setdefault(of, of)
    return out
