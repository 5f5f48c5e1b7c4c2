"""Which rays, points and photos of a block determine anything, and which are left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Bools, Index
from anaplot.bundle.solve.sorting import distinct
from anaplot.photogrammetry.block import Block

__all__ = [
    "FAR_APART",
    "HALF_RAYS",
    "NO_ANGLE",
    "LeftOut",
    "counted_in_photos",
    "left_out_sentences",
    "select_rays",
]

HALF_RAYS = "has rays of which x or y is off, and the rest does not meet before its photos"
"""Why a point takes no part whose half rays do not determine it."""

FAR_APART = "has rays far apart, and too little to tell which of them, or of its control, is wrong"
"""Why a point takes no part whose rays gross errors keep from meeting."""

NO_ANGLE = "has rays that do not meet at an angle"
"""Why a point takes no part that is as far away as its rays can tell, or seen from one place."""

_MOST_LEFT_OUT = 20  # that are named
_MOST_ALIKE = 4  # points left out for the same reason that are named one by one


class LeftOut(NamedTuple):
    """Something declared or measured that takes no part.

    Attributes
    ----------
    kind
        "photo", "point", "control", "prior" or "condition".
    name, reason
        What, and why.
    """

    kind: Literal["photo", "point", "control", "prior", "condition"]
    name: str
    reason: str


def select_rays(
    block: Block,
    photo: Index,
    point: Index,
    counted: Bools,
    names: list[str],
    observed: Index,
    has_prior: Index,
    undetermined: Mapping[str, str],
) -> tuple[Bools, list[LeftOut]]:
    """Return (m,) rays that take part, and what does not.

    Parameters
    ----------
    block
        The block.
    photo, point
        (m,) of every ray, in its photos and in `names`.
    counted
        (m, 2) which coordinates count.
    names
        Of the points.
    observed, has_prior
        (points,) coordinates of a point, (photos,) elements of an orientation, that are known
        beside the rays.
    undetermined
        Points that are left out because what counts of their rays does not determine them, and why.
    """
    pair_photo, pair_point, seen_axes, pair_of = counted_in_photos(photo, point, counted)
    coordinates = seen_axes.sum(axis=1)
    alive = coordinates > 0
    gone_points = np.array([name in undetermined for name in names], dtype=bool)
    left = [
        LeftOut("point", names[k], undetermined[names[k]])
        for k in np.flatnonzero(gone_points).tolist()
    ]
    alive &= ~gone_points[pair_point]
    gone_photos = np.zeros(len(block.photos), dtype=bool)
    while True:
        rays = np.bincount(pair_point[alive], minlength=len(names))
        # one ray and one known coordinate still determine a point
        enough = np.bincount(pair_point[alive], coordinates[alive], len(names))
        poor = ~gone_points & ((enough + observed < 3) | (rays == 0))
        for k in np.nonzero(poor)[0]:
            reason = ("has no ray left", "has one ray only", "has two coordinates only")[
                min(int(rays[k]), 2)
            ]
            left.append(LeftOut("point", names[int(k)], reason))
        gone_points |= poor
        alive &= ~gone_points[pair_point]
        seen = np.bincount(pair_photo[alive], minlength=len(block.photos))
        enough = np.bincount(pair_photo[alive], coordinates[alive], len(block.photos))
        few = ~gone_photos & ((enough + has_prior < 6) | (seen == 0))
        for k in np.nonzero(few)[0]:
            count = int(seen[k])
            what = "no usable points" if count == 0 else f"{count} usable point{'s' * (count > 1)}"
            if 2 * count + has_prior[k] >= 6:
                what = f"{int(enough[k])} usable coordinates"
            left.append(LeftOut("photo", block.photos[int(k)].id, f"has {what}"))
        gone_photos |= few
        alive &= ~gone_photos[pair_photo]
        if not few.any():
            return alive[pair_of] & counted.any(axis=1), left


def counted_in_photos(
    photo: Index, point: Index, counted: Bools
) -> tuple[Index, Index, Bools, Index]:
    """Return (p,) photo and (p,) point of all pairs that have a ray, and what counts of them.

    Parameters
    ----------
    photo, point, counted
        As `select_rays` has them: a point may be measured several times in a photo.

    Returns
    -------
    (p,), (p,), (p, 2) and (m,) arrays
        Photos, points, whether x and y count in any ray of the pair, and the pair of each ray.
    """
    points = int(point.max(initial=0)) + 1
    number = photo * points + point
    if len(distinct(number)) == len(number):  # as nearly always
        return photo, point, counted, np.arange(len(number))
    pair, pair_of = np.unique(number, return_inverse=True)
    axes = np.zeros((len(pair), 2), dtype=bool)
    np.logical_or.at(axes, pair_of, counted)
    return pair // points, pair % points, axes, pair_of


def left_out_sentences(left_out: Iterable[LeftOut]) -> list[str]:
    """Return sentences for a person: what takes no part; many points of one reason are one."""
    alike: dict[tuple[str, str], list[str]] = {}
    for one in left_out:
        alike.setdefault((one.kind, one.reason), []).append(one.name)
    several = {
        key for key, names in alike.items() if key[0] == "point" and len(names) > _MOST_ALIKE
    }
    out = [
        f"{kind} {name} is left out: it {reason}"
        for (kind, reason), names in alike.items()
        if (kind, reason) not in several
        for name in names
    ]
    more = len(out) - _MOST_LEFT_OUT
    if more > 0:
        out[_MOST_LEFT_OUT:] = [f"{more} more are left out"]
    out += [
        f"{len(names)} points are left out: {', '.join(names[:_MOST_ALIKE])}, ...: each {reason}"
        for (kind, reason), names in alike.items()
        if (kind, reason) in several
    ]
    return out
