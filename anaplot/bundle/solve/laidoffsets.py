"""Offsets of stated positions and angles laid out for a bundle: which there are, and whose."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.laidparameters import groups_of_photos
from anaplot.bundle.solve.weightrange import check_weighted
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.prioroffsets import PriorOffsets
from anaplot.textfiles.wording import quoted

__all__ = [
    "OFFSET_KINDS",
    "LaidOffsets",
    "OffsetKind",
    "OffsetName",
    "OffsetUnit",
    "lay_out_offsets",
]

OffsetKind = Literal["shift", "drift", "boresight"]
OffsetUnit = Literal["m", "m/s", "m/photo", "rad"]

OFFSET_KINDS: tuple[OffsetKind, ...] = ("shift", "drift", "boresight")
_AXES = {
    "shift": ("X", "Y", "Z"),
    "drift": ("X", "Y", "Z"),
    "boresight": ("omega", "phi", "kappa"),
}
_UNLIKE = 1e4  # of standard deviations: their squares leave a sum of weights half its digits
_OF_PHOTO = 9  # unknowns that the stated orientation of a photo may depend on


class OffsetName(NamedTuple):
    """An offset: what it is, of which strip, camera or block, along or about which axis."""

    kind: OffsetKind
    group: str
    axis: str
    unit: OffsetUnit

    @property
    def words(self) -> str:
        """What it is called."""
        of = "" if self.group == "block" else f" of {self.group}"
        return f"{self.kind} {self.axis}{of}"


@dataclass(frozen=True, eq=False)
class LaidOffsets:
    """The offsets of a bundle's stated positions and angles.

    Attributes
    ----------
    names
        Of the k offsets.
    columns
        (n, 9) which of them a photo's stated orientation depends on: shift, drift and boresight; k
        where there is none.
    times
        (n,) since the middle of the photo's group [s, or photos]; zero without a drift.
    middles
        (k,) the time [s] from which a drift is counted; NaN without times, and for other offsets.
    sigma
        (k,) a-priori standard deviations in their units; infinite for those that are free.
    """

    names: tuple[OffsetName, ...]
    columns: Index = field(repr=False)
    times: Array = field(repr=False)
    middles: Array = field(repr=False)
    sigma: Array = field(repr=False)

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def place(self) -> csr_array:
        """(k, 9 n) ones: which of the photos' nine places belongs to which offset."""
        count = len(self.names)
        at = self.columns.ravel()
        there = np.flatnonzero(at < count)
        ones = np.ones(len(there))
        return csr_array((ones, (at[there], there)), shape=(count, at.size))

    @cached_property
    def weight(self) -> Array:
        """(k,) a-priori weights."""
        return np.asarray(self.sigma**-2.0)

    @property
    def weighted(self) -> Bools:
        """(k,) which of them are observed themselves."""
        return np.isfinite(self.sigma)

    @cached_property
    def linear(self) -> Array:
        """(n, 3, 6) what shifts and drifts do to stated positions."""
        out = np.zeros((len(self.times), 3, 6))
        for axis in range(3):
            out[:, axis, axis] = self.columns[:, axis] < len(self)
            out[:, axis, 3 + axis] = np.where(
                self.columns[:, 3 + axis] < len(self), self.times, 0.0
            )
        return out

    def observed(self, prior_sigma: Array) -> Bools:
        """Return (k,) which of them anything is observed of: the others are no unknowns.

        Parameters
        ----------
        prior_sigma
            (n, 6) standard deviations of the photos' stated orientations; NaN without.
        """
        stated = np.isfinite(prior_sigma)
        its = np.empty((len(stated), _OF_PHOTO))
        its[:, :3] = its[:, 3:6] = stated[:, :3]
        its[:, 6:] = stated[:, 3:].any(axis=1, keepdims=True)
        found: Bools = (self.place @ its.ravel() > 0.0) | self.weighted
        return found


def lay_out_offsets(
    block: Block,
    photos: Sequence[str],
    position_sigma: Array,
    rotation_sigma: Array,
    wanted: PriorOffsets | None = None,
) -> LaidOffsets | None:
    """Lay out the offsets of a bundle; None where the block declares none.

    Parameters
    ----------
    block
        The block.
    photos
        Names of its n photos.
    position_sigma, rotation_sigma
        (n, 3) standard deviations of what is stated of them; NaN where nothing is observed.
    wanted
        Others than the block declares, or None.

    Raises
    ------
    InputError
        Offsets of what no photo states, a standard deviation without a weight, photos with and
        without times together, or a photo with a position in two strips that have their own.
    NotComputableError
        A drift of positions of one time, or standard deviations too far apart to compute with.
    """
    wanted = block.offsets if wanted is None else wanted
    if wanted is None or not wanted.any:
        return None
    declared = {photo.id: photo for photo in block.photos}
    stated = [declared[name] for name in photos]
    placed = np.isfinite(position_sigma).sum(axis=1) > 0
    turned = np.isfinite(rotation_sigma).sum(axis=1) > 0
    names: list[OffsetName] = []
    middles: list[float] = []
    sigmas: list[float] = []
    columns = np.full((len(photos), _OF_PHOTO), -1, dtype=np.intp)
    times = np.zeros(len(photos))
    for at, kind in enumerate(OFFSET_KINDS):
        scope = getattr(wanted, kind)
        if scope is None:
            continue
        of_angles = kind == "boresight"
        mine, what = (turned, "rotation") if of_angles else (placed, "position")
        if not mine.any():
            raise InputError(
                f"block {block.name}: no photo has a {what}_sigma: there is nothing that a {kind} "
                "could belong to"
            )
        sigma = _sigma(kind, getattr(wanted, f"{kind}_sigma"))
        if scope == "strip":
            _check_one_strip(block, kind, {photos[k] for k in np.flatnonzero(mine).tolist()})
        labels = groups_of_photos(block, scope, photos)
        for group in dict.fromkeys(
            label for label, there in zip(labels, mine.tolist(), strict=True) if there
        ):
            its = np.array([label == group for label in labels]) & mine
            stated_sigma = rotation_sigma if of_angles else position_sigma
            _check_alike(block, f"{kind} of {scope} {quoted(group)}", photos, its, stated_sigma)
            unit: OffsetUnit = "rad" if kind == "boresight" else "m"
            middle = float("nan")
            if kind == "drift":
                found = [stated[k].time for k in np.flatnonzero(its).tolist()]
                timed = _times(block, scope, group, photos, its, found)
                unit = "m/photo" if found[0] is None else "m/s"
                if found[0] is not None:
                    middle = float(timed.mean())
                times[its] = timed - timed.mean()
                if not np.ptp(timed) > 0.0 and np.isinf(sigma).any():
                    ids = [quoted(photos[k]) for k in np.flatnonzero(its)[:6].tolist()]
                    more = ", ..." if int(its.sum()) > len(ids) else ""
                    raise NotComputableError(
                        f"block {block.name}: not determined: the drift of {scope} "
                        f"{quoted(group)}: its positions are all of one time (photo "
                        f"{', '.join(ids)}{more}): give drift_sigma, or take position_sigma out "
                        "there"
                    )
            columns[its, 3 * at : 3 * at + 3] = len(names) + np.arange(3)
            names += [OffsetName(kind, group, axis, unit) for axis in _AXES[kind]]
            middles += [middle] * 3
            sigmas += sigma.tolist()
    columns[columns < 0] = len(names)
    return LaidOffsets(tuple(names), columns, times, np.array(middles), np.array(sigmas))


def _sigma(kind: OffsetKind, stated: tuple[float, float, float] | None) -> Array:
    if stated is None:
        return np.full(3, np.inf)
    for value in stated:
        if not 0.0 < value < float("inf"):
            raise InputError(f"the {kind}: its standard deviation {value:g} must be positive")
        check_weighted(f"the {kind}", value)
    return np.array(stated)


def _check_one_strip(block: Block, kind: OffsetKind, photos: Collection[str]) -> None:
    """Refuse photos of which nobody can say to which strip's flight their position belongs."""
    first: dict[str, str] = {}
    for strip in block.strips:
        for name in strip.photos:
            if name in photos and first.setdefault(name, strip.id) != strip.id:
                raise InputError(
                    f"block {block.name}: photo {quoted(name)} is in strips {quoted(first[name])} "
                    f"and {quoted(strip.id)}: to which of them its {kind} belongs is not known"
                )


def _check_alike(block: Block, what: str, photos: Sequence[str], its: Bools, sigma: Array) -> None:
    """Refuse standard deviations of which the smallest leave nothing of most others' weights.

    Large ones among small ones do no harm: they count for nothing, as they should.
    """
    where = np.flatnonzero(its)
    for mine in sigma[where].T:
        stated = np.flatnonzero(np.isfinite(mine))
        if not len(stated):
            continue
        least = stated[int(mine[stated].argmin())]
        middle = float(np.median(mine[stated]))
        if middle > _UNLIKE * float(mine[least]):
            raise NotComputableError(
                f"block {block.name}: the {what}: the standard deviation {mine[least]:g} of photo "
                f"{quoted(photos[where[least]])} beside {middle:g} of others is too small to "
                "compute with: state a larger one"
            )


def _times(
    block: Block,
    scope: str,
    group: str,
    photos: Sequence[str],
    its: Bools,
    found: list[float | None],
) -> Array:
    """Return the times of a group's positions [s], or, without any, their order."""
    where = np.flatnonzero(its).tolist()
    known = [time for time in found if time is not None]
    if len(known) == len(found):
        return np.array(known)
    if known:
        without = photos[where[found.index(None)]]
        raise InputError(
            f"block {block.name}: photo {without} has no time, others of {scope} "
            f"{quoted(group)} have one: a drift needs the times of all, or of none"
        )
    order: dict[str, int] = {}
    for name in (name for strip in block.strips for name in strip.photos):
        order.setdefault(name, len(order))
    for photo in block.photos:
        order.setdefault(photo.id, len(order))
    return np.array([float(order[photos[k]]) for k in where])
