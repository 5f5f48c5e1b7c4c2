"""What is known of names: which other one a point probably has, and where a name is elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from math import dist, hypot
from typing import NamedTuple

from anaplot.aliases import Side
from anaplot.orientation.results import Interchange
from anaplot.session.accidents import Accident
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState

__all__ = ["Elsewhere", "OtherName", "other_names", "still_called", "where_elsewhere"]

_SIDES: tuple[Side, ...] = ("left", "right")
_SIGMAS = 4.0  # of an expected place: farther off, it is another point
_POINTING = 0.3  # mm: farther off, it is another point rather than a bad pointing
Place = tuple[float, float, float, float]


class OtherName(NamedTuple):
    """The name that a measured point of the model in work probably has.

    Attributes
    ----------
    point
        The name that it has now.
    name
        The other one; where the model has it, the two are exchanged.
    side
        In which photo alone; None for both.
    """

    point: str
    name: str
    side: Side | None = None


def other_names(
    model: ModelState, interchange: Interchange | None, accidents: Iterable[Accident]
) -> tuple[OtherName, ...]:
    """Return what the program takes for wrong names, one for a point.

    Parameters
    ----------
    model
        The model in work.
    interchange
        Two points of it whose records are exchanged, or None.
    accidents
        What is wrong with points against what is known elsewhere.
    """
    found: dict[str, OtherName] = {}
    if interchange is not None:
        first, second = interchange.points
        side = _side(model, interchange)
        found[first] = OtherName(first, second, side)
        found[second] = OtherName(second, first, side)
    for one in accidents:
        # a name that a model before gave it is corrected there, or the two contradict each other
        if one.other and not one.first and model.measurement(one.point) is not None:
            found.setdefault(one.point, OtherName(one.point, one.other))
    return tuple(found.values())


def _side(model: ModelState, interchange: Interchange) -> Side | None:
    """Return in which photo two points are exchanged.

    Where the rays meet alike whichever photo it is, the one in which the two were measured where
    the plan has the other one.
    """
    if interchange.photo:
        return "left" if interchange.photo == model.left else "right"
    if interchange.exchanged == "both":
        return None
    gain = {side: _gain(model, side, *interchange.points) for side in _SIDES}
    return "left" if gain["left"] > max(gain["right"], 0.0) else "right"


def _gain(model: ModelState, side: Side, *points: str) -> float:
    """Return by how much two points would be nearer to their planned places [mm], exchanged."""
    planned = {p.point: (p.xl, p.yl) if side == "left" else (p.xr, p.yr) for p in model.plan}
    gain = 0.0
    for point, other in (points, points[::-1]):
        at = model.place_of(side, point)
        if at is None:
            return 0.0
        (x, y), (ox, oy) = planned[point], planned[other]
        gain += hypot(at[0] - x, at[1] - y) - hypot(at[0] - ox, at[1] - oy)
    return gain


class Elsewhere(NamedTuple):
    """Where what has a name now lies from where the name is known elsewhere.

    Attributes
    ----------
    name, where
        The name, and what knows it.
    gap_mm
        How far off, in the photo where it is most.
    agrees
        Whether that may be pointing.
    """

    name: str
    where: str
    gap_mm: float
    agrees: bool

    @property
    def text(self) -> str:
        """In words."""
        if self.agrees:
            return f"{self.name} is where {self.where} has it, within {1e3 * self.gap_mm:.0f} µm"
        return f"{self.name} is {self.gap_mm:.2f} mm from where {self.where} has it: another point?"


def where_elsewhere(
    state: SessionState, places: Mapping[str, tuple[Place, float]], name: str
) -> Elsewhere | None:
    """Compare a name of the model in work with what is known of it elsewhere; None for nothing.

    Parameters
    ----------
    state
        The session's state.
    places
        Where points of other strips and of the ground are expected in the model, with standard
        deviations [mm].
    name
        A point measured in the model.
    """
    model = state.current
    assert model is not None
    mine = {side: model.place_of(side, name) for side in _SIDES}
    found = [
        Elsewhere(name, where, gap, gap <= limit)
        for side, at, where, limit in _known(state, model, places, name)
        if (here := mine[side]) is not None
        for gap in (hypot(here[0] - at[0], here[1] - at[1]),)
    ]
    return max(found, key=lambda one: (not one.agrees, one.gap_mm), default=None)


def _known(
    state: SessionState,
    model: ModelState,
    places: Mapping[str, tuple[Place, float]],
    name: str,
) -> Iterator[tuple[Side, tuple[float, float], str, float]]:
    """Yield where a name is known: photo, place, what knows it, and what may be pointing [mm]."""
    for other in state.models:
        if other.photos == model.photos:
            continue
        for side in _SIDES:
            photo = model.photo(side)
            if photo not in other.photos:
                continue
            at = other.place_of("left" if photo == other.left else "right", name)
            if at is not None:
                yield side, at, f"model {other.name}", _POINTING
    if name in places:
        (xl, yl, xr, yr), sigma = places[name]
        limit = max(_POINTING, _SIGMAS * sigma)
        yield "left", (xl, yl), "what is known of it", limit
        yield "right", (xr, yr), "what is known of it", limit


def still_called(
    state: SessionState, before: ModelState, names: Mapping[str, str]
) -> tuple[str, ...]:
    """Return in words which other models of the strip have what was renamed as it was called.

    Parameters
    ----------
    state
        The session's state, with the model in work as it is now.
    before
        That model as it was.
    names
        The names of now by the former ones.
    """
    model = state.current
    assert model is not None
    parked = None if state.returned is None else state.returned.parked
    others = (*state.models, *((parked,) if parked else ()))
    strip = tuple(m for m in others if m.strip == model.strip and m.photos != model.photos)
    found: dict[str, list[str]] = {}
    for point, name in names.items():
        for other in _with_it(strip, model, name, point):
            found.setdefault(other.name, []).append(f"{name} as {point}")
    return tuple(
        f"model {other.name} still has {' and '.join(found[other.name])}"
        + _ties_left(before, model, other)
        for other in strip
        if other.name in found
    )


def _with_it(
    strip: tuple[ModelState, ...], model: ModelState, name: str, point: str
) -> Iterator[ModelState]:
    """Yield models, one after the other on either side of one, that have its point as another."""
    for near, far in (_SIDES, _SIDES[::-1]):
        at, photo = model.place_of(far, name), model.photo(far)
        while at is not None:
            here = next((m for m in strip if m.photo(near) == photo), None)
            there = None if here is None else here.place_of(near, point)
            if here is None or there is None or dist(at, there) > _POINTING:
                break
            yield here
            at, photo = here.place_of(far, point), here.photo(far)


def _ties_left(before: ModelState, model: ModelState, other: ModelState) -> str:
    """Return how many points tie another model to one that was renamed in, where fewer do now."""
    if other.left != model.right:
        return ""
    there = {m.point for m in other.used}
    were, are = (len(there & {m.point for m in one.used}) for one in (before, model))
    if are >= were:
        return ""
    if are == 0:
        return ": nothing ties it, and it cannot be computed before it has these names, too"
    return f": {are} of {were} points tie it"
