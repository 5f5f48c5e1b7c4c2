"""Photographs under the name of another one, turned, or mirrored: told by how they lie.

Two photographs whose names are exchanged agree with each other as well as before, so that no
residual tells it. The strips do: along them every photograph lies about a base from the one before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import combinations, pairwise
from math import hypot, pi
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.photolayout import LaidOut, laid_out, overlap
from anaplot.session.modelstate import ModelState

__all__ = [
    "PhotoAccident",
    "PhotoAccidentKind",
    "photo_accidents",
    "with_photos_exchanged",
    "wrong_photo",
]

PhotoAccidentKind = Literal["exchanged", "elsewhere", "turned", "mirrored"]

_IRREGULAR = 0.6  # bases that a photo is off its place: overlaps vary less
_CURED = 0.4  # of what was irregular, at most, may be left when the right two are exchanged
_CLEARER = 0.5  # bases by which it must be better than with any other two
_ALIKE = 2  # exchanges that may do as well
_ENOUGH = 5  # points of a model in work from which its photos are looked at
_LOOSE = 0.35  # times the spread of the points: worse than that nothing is known
_MOST_CANDIDATES = 40  # photos of which pairs are tried
_TURNED = pi / 4  # a photo that lies so far from its strip's direction is turned


class PhotoAccident(NamedTuple):
    """What is wrong with a photograph, or with two.

    Attributes
    ----------
    kind
        "exchanged": two under each other's name; "elsewhere": one that does not lie where its
        strip has it; "turned" or "mirrored" against the others.
    photos
        Names: two that are exchanged, else one.
    strips
        Those that have them.
    text
        One sentence.
    """

    kind: PhotoAccidentKind
    photos: tuple[str, ...]
    strips: tuple[str, ...]
    text: str


def photo_accidents(block: Block) -> tuple[PhotoAccident, ...]:
    """Return what is wrong with photographs of a block, as their common points have it.

    Parameters
    ----------
    block
        With image points and strips; photographs outside strips say nothing.
    """
    if not block.strips:
        return ()
    laid = laid_out(block.image_points)
    strips = {strip.id: strip.photos for strip in block.strips}
    misplaced, strips = _misplaced(strips, laid)
    return (*misplaced, *_turned(strips, laid))


def with_photos_exchanged(block: Block, first: str, second: str) -> Block:
    """Return a block in which two photographs bear each other's name.

    A model that a row names is left out where it has not the photograph any more.
    """
    other = {first: second, second: first}

    def named(row: ImagePoint) -> ImagePoint:
        photo = other.get(row.photo)
        if photo is None:
            return row
        model = row.model if row.model is not None and photo in row.model.split("/") else None
        return replace(row, photo=photo, model=model)

    rows = {(r.photo, r.point, r.model): r for r in map(named, reversed(block.image_points))}
    return replace(block, image_points=tuple(reversed(rows.values())))


def wrong_photo(model: ModelState, base: float | None, earlier: Iterable[ModelState]) -> str:
    """Return what speaks against a photograph of a model in work, in words; "" for nothing.

    Parameters
    ----------
    model
        With its measurements so far.
    base
        Nominal base of its strip [mm], or None: that of the earlier models.
    earlier
        Models of its strip.
    """
    if len(model.used) < _ENOUGH:
        return ""
    left, right = _sides(model)
    found = overlap(left, right)
    spread = float(np.sqrt(((left - left.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if found.misfit > _LOOSE * spread:
        return ""
    photos = f"photos {model.left} and {model.right}"
    if found.mirrored:
        return f"one of {photos} is mirrored: does its emulsion lie on the wrong side?"
    if abs(found.angle) > _TURNED:
        by = round(abs(found.angle) / (pi / 2)) * 90
        return f"{photos} are turned against each other by {by} degrees"
    step = float(np.hypot(*(left - right).mean(axis=0)))
    others = [float(np.hypot(*(a - b).mean(axis=0))) for a, b in map(_sides, earlier) if len(a)]
    usual = float(np.median(others)) if others else abs(base or 0.0)
    if usual and abs(step - usual) > _IRREGULAR * usual:
        return f"{photos} lie {step / usual:.1f} bases apart: is another photograph in its place?"
    return ""


def _sides(model: ModelState) -> tuple[Array, Array]:
    """Return the (n, 2) image coordinates of a model's points in its photos."""
    at = np.array([(m.xl, m.yl, m.xr, m.yr) for m in model.used]).reshape(-1, 4)
    return at[:, :2], at[:, 2:]


Order = tuple[str, ...]


def _misplaced(
    strips: Mapping[str, Order], laid: Mapping[str, LaidOut]
) -> tuple[list[PhotoAccident], dict[str, Order]]:
    """Return photographs that are exchanged, or lie elsewhere; and the strips put right."""
    at = {photo: np.array([one.x, one.y]) for photo, one in laid.items()}
    orders = {name: tuple(p for p in photos if p in at) for name, photos in strips.items()}
    steps = [hypot(*(at[b] - at[a])) for o in orders.values() for a, b in pairwise(o)]
    base = float(np.median(steps)) if steps else 0.0
    if base <= 0.0:
        return [], orders
    found: list[PhotoAccident] = []
    for _ in range(len(at)):
        odd = {name: o for name, o in orders.items() if _cost(o, at, base) > _IRREGULAR * base}
        best = _exchange(odd, orders, at, base)
        if not best:
            break
        # of a strip alone nobody knows which end comes first: two exchanges may do as well
        best = sorted(best, key=lambda pair: _against(orders, pair, laid))
        found.append(_told_exchange(best, orders))
        orders = {name: _with(order, *best[0]) for name, order in orders.items()}
    for name, order in orders.items():
        if len(order) > 3 and _cost(order, at, base) > _IRREGULAR * base:
            found += _elsewhere(name, order, at, base)
    return found, orders


def _cost(order: Order, at: Mapping[str, Array], base: float) -> float:
    """Return by how much a strip is not straight on, a base a step [mm]."""
    if len(order) < 2:
        return 0.0
    places = np.array([at[photo] for photo in order])
    steps = np.diff(places, axis=0)
    usual = _usual(steps)
    off = np.hypot(*(steps - usual).T)
    # overlaps vary, and what varies less than half a base is no accident
    uneven = float(np.sum(off[off > 0.5 * base]))
    size = hypot(*usual)
    return uneven + len(order) * max(abs(size - base) - _IRREGULAR * base, 0.0)


def _usual(steps: Array) -> Array:
    """Return the step that the others are nearest to."""
    apart = np.hypot(*(steps[:, None] - steps[None]).transpose(2, 0, 1)).sum(axis=1)
    found: Array = steps[int(np.argmin(apart))]
    return found


def _against(
    orders: Mapping[str, Order], pair: tuple[str, str], laid: Mapping[str, LaidOut]
) -> int:
    """Return how many strips run against the others, by their images, with two exchanged."""
    along = []
    for order in (_with(order, *pair) for order in orders.values()):
        steps = [
            complex(laid[b].x - laid[a].x, laid[b].y - laid[a].y) * np.exp(-1j * laid[a].angle)
            for a, b in pairwise(order)
        ]
        along.append(bool(steps) and float(np.median([step.real for step in steps])) > 0.0)
    return min(sum(along), len(along) - sum(along))


def _with(order: Order, first: str, second: str) -> Order:
    other = {first: second, second: first}
    return tuple(other.get(photo, photo) for photo in order)


def _exchange(
    odd: Mapping[str, Order], orders: Mapping[str, Order], at: Mapping[str, Array], base: float
) -> list[tuple[str, str]]:
    """Return the two photographs with which exchanged the strips run straight on.

    None where nothing does, or more than two exchanges do.
    """
    doubtful = [photo for order in odd.values() for photo in _doubtful(order, at, base)]
    if len(doubtful) > _MOST_CANDIDATES:
        return []
    strip_of = {photo: name for name, order in orders.items() for photo in order}
    before = {name: _cost(order, at, base) for name, order in orders.items()}
    gains = []
    for pair in combinations(dict.fromkeys(doubtful), 2):
        touched = {strip_of[photo] for photo in pair}
        was = sum(before[name] for name in touched)
        now = sum(_cost(_with(orders[name], *pair), at, base) for name in touched)
        gains.append((was - now, now, was, pair))
    gains.sort(key=lambda gain: -gain[0])
    if not gains:
        return []
    best, now, was, _ = gains[0]
    if now > _CURED * was or was <= _IRREGULAR * base:
        return []
    alike = [pair for gain, _, _, pair in gains if gain > best - _CLEARER * base]
    return alike if len(alike) <= _ALIKE else []


def _doubtful(order: Order, at: Mapping[str, Array], base: float) -> tuple[str, ...]:
    """Return the photographs at the irregular steps of a strip; of a short one all."""
    if len(order) <= 8:
        return order
    steps = np.diff(np.array([at[photo] for photo in order]), axis=0)
    off = np.hypot(*(steps - _usual(steps)).T) > 0.5 * base
    near = {k + end for k in np.flatnonzero(off).tolist() for end in (0, 1)}
    return tuple(order[k] for k in sorted(near))


def _told_exchange(pairs: list[tuple[str, str]], orders: Mapping[str, Order]) -> PhotoAccident:
    (first, second), *others = pairs
    names = tuple(name for name, order in orders.items() if {first, second} & set(order))
    if len(names) == 1:
        order = orders[names[0]]
        few = order if len(order) <= 8 else _around(order, first, second)
        follow = " ".join(_with(few, first, second))
        runs = f"by their points the photos of strip {names[0]} follow as {follow}"
    else:
        runs = f"by their points {first} lies in strip {names[1]} and {second} in {names[0]}"
        if first not in orders[names[0]]:
            runs = f"by their points {first} lies in strip {names[0]} and {second} in {names[1]}"
    other = "".join(f", or {a} and {b}" for a, b in others)
    text = f"photos {first} and {second}{other} exchanged? {runs[0].upper()}{runs[1:]}"
    return PhotoAccident("exchanged", (first, second), names, text)


def _around(order: Order, first: str, second: str) -> Order:
    at = sorted((order.index(first), order.index(second)))
    return order[max(at[0] - 1, 0) : at[1] + 2]


def _elsewhere(
    name: str, order: Order, at: Mapping[str, Array], base: float
) -> list[PhotoAccident]:
    """Return the one photograph without which a strip runs straight on."""
    left = {}
    for k, photo in enumerate(order):
        rest = np.array([at[other] for other in order if other != photo])
        # the gap where it was counts as two steps
        steps = np.diff(rest, axis=0)
        usual = _usual(steps)
        wanted = np.tile(usual, (len(steps), 1))
        if 0 < k < len(order) - 1:
            wanted[k - 1] *= 2.0
        off = np.hypot(*(steps - wanted).T)
        expected = rest[k - 1] + usual if k else rest[0] - usual
        left[photo] = (
            float(np.sum(off[off > 0.5 * base])),
            float(np.hypot(*(at[photo] - expected))),
        )
    photo, (cost, gap) = min(left.items(), key=lambda item: (item[1][0], -item[1][1]))
    others = [value[0] for key, value in left.items() if key != photo]
    if cost > _CURED * min(others) or gap < _IRREGULAR * base:
        return []
    text = (
        f"photo {photo} lies {gap / base:.1f} bases from where strip {name} has it: another "
        "photograph?"
    )
    return [PhotoAccident("elsewhere", (photo,), (name,), text)]


def _turned(strips: Mapping[str, Order], laid: Mapping[str, LaidOut]) -> list[PhotoAccident]:
    found = []
    for name, order in strips.items():
        here = [(photo, laid[photo]) for photo in order if photo in laid]
        if len(here) < 3:
            continue
        mean = np.median([np.exp(1j * one.angle).real for _, one in here]) + 1j * np.median(
            [np.exp(1j * one.angle).imag for _, one in here]
        )
        usual = float(np.angle(mean))
        for photo, one in here:
            off = (one.angle - usual + pi) % (2.0 * pi) - pi
            kind: PhotoAccidentKind | None = None
            if one.mirrored:
                kind, words = "mirrored", "is mirrored"
            elif abs(off) > _TURNED:
                by = round(abs(off) / (pi / 2)) * 90
                kind, words = "turned", f"is turned by {by} degrees"
            if kind is not None:
                text = f"photo {photo} {words} against the others of strip {name}"
                found.append(PhotoAccident(kind, (photo,), (name,), text))
    return found
