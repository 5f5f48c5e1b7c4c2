"""Photographs under the name of another one, turned, or mirrored: told by how they lie.

Two photographs whose names are exchanged agree with each other as well as before, so that no
residual tells it. The strips do: along them every photograph lies about a base from the one before.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import combinations, pairwise
from math import degrees, hypot, pi, remainder, tau
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.photolayout import PhotoPlace, laid_out, overlap
from anaplot.photogrammetry.selection import model_name, model_splits

if TYPE_CHECKING:
    from anaplot.session.modelstate import ModelState

__all__ = [
    "PhotoAccident",
    "PhotoAccidentKind",
    "photo_accidents",
    "with_photos_exchanged",
    "wrong_photo",
]

PhotoAccidentKind = Literal["exchanged", "order", "elsewhere", "turned", "mirrored"]

_IRREGULAR = 0.6  # bases that a photo is off its place: overlaps vary less
_CURED = 0.4  # of what was irregular, at most, may be left when the right two are exchanged
_CLEARER = 0.5  # bases by which it must be better than with any other two
_FEW = 8  # photos of a strip that are all looked at, and named
_ALIKE = 2  # exchanges that may do as well
_ENOUGH = 5  # points of a model in work from which its photos are looked at
_MOST_CANDIDATES = 40  # photos of which pairs are tried
_ABOUT = 10.0  # degrees from a quarter turn, up to which it is called one
_TURNED = 60.0  # degrees: up to there every model is found from nothing: no accident
_AGREED = pi / 6  # by which the others of its strip differ at most
_DELIBERATE = 1 / 3  # share of a strip's photos above which they were turned, or are so, on purpose
_SHORT_BASE = 0.3  # times the spread of a photo's points: a shorter base orders nothing
_CONTRADICTED = 0.25  # share of a photo's points: more, and its reflection is not known


class PhotoAccident(NamedTuple):
    """What is wrong with a photograph, or with two.

    Attributes
    ----------
    kind
        "exchanged": two under each other's name; "order": several of a strip; "elsewhere": one
        that does not lie where its strip has it; "turned" or "mirrored" against the others.
    photos
        Names: two that are exchanged, all that are out of order, else one.
    strips
        Those that have them.
    text
        One sentence.
    alternatives
        Other pairs of which the same may be true instead of `photos`.
    """

    kind: PhotoAccidentKind
    photos: tuple[str, ...]
    strips: tuple[str, ...]
    text: str
    alternatives: tuple[tuple[str, str], ...] = ()

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The pairs that may be exchanged, one of them; none of another kind."""
        if self.kind != "exchanged":
            return ()
        first, second = self.photos
        return ((first, second), *self.alternatives)


def photo_accidents(block: Block) -> tuple[PhotoAccident, ...]:
    """Return what is wrong with photographs of a block, as their common points have it.

    Parameters
    ----------
    block
        With image points and strips; photographs outside strips say nothing. Where photographs
        do not lie like prints on a table, as convergent ones, nothing is said of them.

    Returns
    -------
    tuple of PhotoAccident
        What is exchanged holds with those before it put right.
    """
    if not block.strips:
        return ()
    laid = laid_out(block.image_points)
    strips = {strip.id: strip.photos for strip in block.strips}
    orders = {s.id: tuple(p for p in s.photos if p in laid) for s in block.strips}
    base = _base(orders.values(), {photo: np.array([one.x, one.y]) for photo, one in laid.items()})
    if base <= _SHORT_BASE * float(np.median([one.spread for one in laid.values()] or [0.0])):
        return ()
    misplaced, orders = _misplaced(strips, orders, laid, base)
    return (*misplaced, *_turned(orders, laid))


def with_photos_exchanged(block: Block, first: str, second: str) -> Block:
    """Return a block in which two photographs bear each other's name.

    A row's model becomes the one that its two photographs form then. Where the strips have no such
    model the row has none; where the photograph has such a row already, it takes another model of
    the photograph, so that every row stays that the block has a place for.
    """
    other = {first: second, second: first}
    photos = {photo.id for photo in block.photos}
    formed = {frozenset(m): model_name(*m) for strip in block.strips for m in strip.models()}
    pairs = {name: both for both, name in formed.items()}
    of_photo = {p: [name for both, name in formed.items() if p in both] for p in other}
    kept: list[ImagePoint] = []
    waiting: list[ImagePoint] = []
    for row in block.image_points:
        model = row.model
        if model is not None:
            splits = (both for both in model_splits(model) if photos.issuperset(both))
            both = pairs.get(model, next(splits, ()))
            if not other.keys().isdisjoint(both):
                model = formed.get(frozenset(other.get(p, p) for p in both))
        one = replace(row, photo=other.get(row.photo, row.photo), model=model)
        (kept if model == row.model or model is not None else waiting).append(one)
    taken = {(row.photo, row.point, row.model) for row in kept}
    for row in waiting:
        for model in (None, *of_photo.get(row.photo, ())):
            if (row.photo, row.point, model) not in taken:
                taken.add((row.photo, row.point, model))
                kept.append(replace(row, model=model))
                break
    return replace(block, image_points=tuple(kept))


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
    if found.loose:
        return ""
    photos = f"photos {model.left} and {model.right}"
    if found.mirrored:
        return f"one of {photos} is mirrored: does its emulsion lie on the wrong side?"
    if turned := _turned_by(found.angle):
        return f"{photos} are turned against each other {turned}"
    step = float(np.hypot(*(left - right).mean(axis=0)))
    others = [float(np.hypot(*(a - b).mean(axis=0))) for a, b in map(_sides, earlier) if len(a)]
    usual = float(np.median(others)) if others else abs(base or 0.0)
    if usual and abs(step - usual) > _IRREGULAR * usual:
        return f"{photos} lie {step / usual:.1f} bases apart: is another photograph in its place?"
    return ""


def _turned_by(angle: float) -> str:
    """Return by how much a photograph is turned, in words; "" for what is no accident."""
    off = degrees(abs(remainder(angle, tau)))
    if off <= _TURNED:
        return ""
    # relief and tilts turn a photograph by some degrees against a quarter or half turn
    quarters = 90 * round(off / 90)
    return f"by {quarters if abs(off - quarters) < _ABOUT else round(off)} degrees"


def _sides(model: ModelState) -> tuple[Array, Array]:
    """Return the (n, 2) image coordinates of a model's points in its photos."""
    at = np.array([(m.xl, m.yl, m.xr, m.yr) for m in model.used]).reshape(-1, 4)
    return at[:, :2], at[:, 2:]


Order = tuple[str, ...]


def _misplaced(
    strips: Mapping[str, Order],
    orders: dict[str, Order],
    laid: Mapping[str, PhotoPlace],
    base: float,
) -> tuple[list[PhotoAccident], dict[str, Order]]:
    """Return photographs that are exchanged, or lie elsewhere; and the strips put right."""
    at = {photo: np.array([one.x, one.y]) for photo, one in laid.items()}
    found: list[PhotoAccident] = []
    for name in orders:
        out_of_order, orders = _out_of_order(name, orders, laid, at, base)
        found += out_of_order
    for _ in range(len(at)):
        odd = {name: o for name, o in orders.items() if _cost(o, at, base) > _IRREGULAR * base}
        best = _exchange(odd, orders, at, base)
        if not best:
            break
        # of a strip alone nobody knows which end comes first: two exchanges may do as well
        best = sorted(best, key=lambda pair: _against(orders, pair, laid))
        found.append(_told_exchange(best, orders))
        orders = {name: _with(order, *best[0]) for name, order in orders.items()}
    steps = [hypot(*(at[b] - at[a])) for o in orders.values() for a, b in pairwise(o)]
    base = float(np.median(steps))
    for name, order in orders.items():
        if len(order) > 3:
            found += _elsewhere(name, order, strips[name], at, base)
    return found, orders


def _base(orders: Iterable[Order], at: Mapping[str, Array]) -> float:
    """Return the usual distance of a photograph to the nearest one of its strip [mm].

    What is exchanged within a strip does not change it.
    """
    nearest = []
    for order in orders:
        if len(order) > 1:
            places = np.array([at[photo] for photo in order])
            apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
            np.fill_diagonal(apart, np.inf)
            nearest += apart.min(axis=1).tolist()
    return float(np.median(nearest)) if nearest else 0.0


def _out_of_order(
    name: str,
    orders: dict[str, Order],
    laid: Mapping[str, PhotoPlace],
    at: Mapping[str, Array],
    base: float,
) -> tuple[list[PhotoAccident], dict[str, Order]]:
    """Return what is wrong with the order of a strip whose photographs lie on a line.

    And the strips put right.
    """
    order = orders[name]
    if len(order) < 3:
        return [], orders
    places = np.array([at[photo] for photo in order])
    places = places - places.mean(axis=0)
    along = places @ np.linalg.svd(places, full_matrices=False)[2][0]
    right = tuple(order[k] for k in np.argsort(along).tolist())
    # the same line the other way: nobody knows in which direction it was flown
    runs = (right, right[::-1])
    if order in runs or _stumbles(right, at, base):
        return [], orders
    fewest = min(len(_moved(order, one)) for one in runs)
    alike = [one for one in runs if len(_moved(order, one)) == fewest]
    pairs = _exchanges(order, alike[0])
    if fewest == 2:
        either = [pair for one in alike for pair in _exchanges(order, one)]
        either.sort(key=lambda pair: _against(orders, pair, laid))
        told = [_told_exchange(either, orders)]
        return told, {strip: _with(one, *either[0]) for strip, one in orders.items()}
    if pairs and len(alike) == 1:
        told = []
        for pair in pairs:
            told.append(_told_exchange([pair], orders))
            orders = {strip: _with(one, *pair) for strip, one in orders.items()}
        return told, orders
    right, moved = alike[0], _moved(order, alike[0])
    here = sorted(right.index(photo) for photo in moved)
    few = right if len(right) <= _FEW else right[max(here[0] - 1, 0) : here[-1] + 2]
    text = (
        f"strip {name} does not run straight on: by their points its photos follow as "
        f"{' '.join(few)}"
    )
    return [PhotoAccident("order", moved, (name,), text)], orders | {name: right}


def _moved(order: Order, right: Order) -> Order:
    return tuple(photo for photo, other in zip(order, right, strict=True) if photo != other)


def _exchanges(order: Order, right: Order) -> list[tuple[str, str]]:
    """Return the pairs that are exchanged between two orders; none where it takes more."""
    wanted = dict(zip(order, right, strict=True))
    moved = _moved(order, right)
    if any(wanted[wanted[photo]] != photo for photo in moved):
        return []
    return [(photo, wanted[photo]) for k, photo in enumerate(moved) if wanted[photo] in moved[k:]]


def _stumbles(order: Order, at: Mapping[str, Array], base: float) -> bool:
    """Return whether a step of a strip is not about a whole number of bases straight on.

    More than one: photographs between them are missing, and nothing is wrong.
    """
    steps = np.diff(np.array([at[photo] for photo in order]), axis=0)
    usual = _usual(steps)
    size = hypot(*usual)
    if abs(size - base) > 0.5 * base:
        usual = usual * (base / size) if size else usual
    times = np.maximum(np.round(steps @ usual / max(float(usual @ usual), 1e-12)), 1.0)
    off = np.hypot(*(steps - times[:, None] * usual).T)
    return bool(np.any(off > 0.5 * base))


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
    orders: Mapping[str, Order], pair: tuple[str, str], laid: Mapping[str, PhotoPlace]
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
    alike = [
        pair
        for gain, left, _, pair in gains
        if gain > best - _CLEARER * base and left <= max(now, _IRREGULAR * base)
    ]
    return alike if len(alike) <= _ALIKE else []


def _doubtful(order: Order, at: Mapping[str, Array], base: float) -> tuple[str, ...]:
    """Return the photographs at the irregular steps of a strip; of a short one all."""
    if len(order) <= _FEW:
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
        few = order if len(order) <= _FEW else _around(order, first, second)
        follow = " ".join(_with(few, first, second))
        runs = f"by their points the photos of strip {names[0]} follow as {follow}"
    else:
        runs = f"by their points {first} lies in strip {names[1]} and {second} in {names[0]}"
        if first not in orders[names[0]]:
            runs = f"by their points {first} lies in strip {names[0]} and {second} in {names[1]}"
    other = "".join(f", or {a} and {b}" for a, b in others)
    text = f"photos {first} and {second}{other} exchanged? {runs[0].upper()}{runs[1:]}"
    return PhotoAccident("exchanged", (first, second), names, text, tuple(others))


def _around(order: Order, first: str, second: str) -> Order:
    at = sorted((order.index(first), order.index(second)))
    return order[max(at[0] - 1, 0) : at[1] + 2]


def _elsewhere(
    name: str, order: Order, declared: Order, at: Mapping[str, Array], base: float
) -> list[PhotoAccident]:
    """Return the one photograph without which a strip runs straight on."""
    stumbles = _stumbles(order, at, base)
    left = {}
    for k, photo in enumerate(order):
        if not stumbles and not _in_a_free_place(k, order, declared):
            continue
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
    if not left:
        return []
    photo, (cost, gap) = min(left.items(), key=lambda item: (item[1][0], -item[1][1]))
    others = [value[0] for key, value in left.items() if key != photo]
    # where two do as well, nobody knows which
    if (others and cost >= _CURED * min(others)) or cost > _IRREGULAR * base:
        return []
    if gap < _IRREGULAR * base:
        return []
    text = (
        f"photo {photo} lies {gap / base:.1f} bases from where strip {name} has it: another "
        "photograph?"
    )
    return [PhotoAccident("elsewhere", (photo,), (name,), text)]


def _in_a_free_place(k: int, order: Order, declared: Order) -> bool:
    """Return whether a strip's end lies where another photo of it may lie that has no points.

    A gap before the end is none where the names leave one, too.
    """
    step = {0: 1, len(order) - 1: -1}.get(k)
    if step is None or not {order[k], order[k + step]} <= set(declared):
        return False
    here, beside = declared.index(order[k]), declared.index(order[k + step])
    ends = [re.search(r"(\d+)$", photo) for photo in (order[k], order[k + step])]
    numbers = [int(end.group(1)) for end in ends if end is not None]
    follows = len(numbers) < 2 or abs(numbers[0] - numbers[1]) == 1
    beyond = declared[:here] if k == 0 else declared[here + 1 :]
    return abs(here - beside) == 1 and follows and len(beyond) == 1


def _turned(strips: Mapping[str, Order], laid: Mapping[str, PhotoPlace]) -> list[PhotoAccident]:
    found = []
    for name, order in strips.items():
        here = [(photo, laid[photo]) for photo in order]
        if len(here) < 3 or any(one.contradicted > _CONTRADICTED for _, one in here):
            continue
        mean = np.median([np.exp(1j * one.angle).real for _, one in here]) + 1j * np.median(
            [np.exp(1j * one.angle).imag for _, one in here]
        )
        usual = float(np.angle(mean))
        told, most = [], 0.0
        for photo, one in here:
            kind: PhotoAccidentKind | None = None
            if one.mirrored:
                kind, words = "mirrored", "is mirrored"
            elif by := _turned_by(one.angle - usual):
                kind, words = "turned", f"is turned {by}"
            if kind is not None:
                text = f"photo {photo} {words} against the others of strip {name}"
                told.append(PhotoAccident(kind, (photo,), (name,), text))
            else:
                most = max(most, abs(remainder(one.angle - usual, tau)))
        if len(told) <= _DELIBERATE * len(here) and most < _AGREED:
            found += told
    return found
