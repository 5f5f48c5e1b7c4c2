"""Re-measuring the counters' reference: on places whose plate coordinates are known.

Incremental counters that were out of reach may count from elsewhere now. The operator sets the
mark on something measured before; by how much the counters disagree there is the offset. One
pointing is not believed: a second one, there or elsewhere, has to say the same.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from anaplot.aliases import Side
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.readings import Position
from anaplot.session.modelstate import ModelState
from anaplot.session.plates import plate_of, plates_of_model
from anaplot.session.state import SessionState

__all__ = [
    "KnownPlace",
    "Offset",
    "Referencing",
    "asked_for",
    "in_words",
    "references",
]

Offset = tuple[float, float]
_COUNTERS = ("xl", "yl", "xr", "yr")
_SAME_MM = 0.0005  # counters nearer than this stand where they stood

Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class KnownPlace:
    """Something on the plates whose plate coordinates are known from its measurement.

    Attributes
    ----------
    name
        Of the point or the fiducial.
    title
        What the operator reads.
    places
        Its plate coordinates [mm] by carriage: a point's in both, a fiducial's in one.
    side
        The carriage of a fiducial; None for a point.
    """

    name: str
    title: str
    places: Mapping[Side, Place]
    side: Side | None = None


def references(
    state: SessionState, last: str | None = None, doubted: Collection[str] = ()
) -> tuple[tuple[Side, ...], tuple[KnownPlace, ...]]:
    """Return the carriages whose counters matter, and what there is to refer them to.

    Parameters
    ----------
    state
        The session's state. Between models the plates of the last one still lie.
    last
        The point or fiducial measured last: it comes first.
    doubted
        Points and fiducials whose measurement may be wrong, and with it all that is measured on
        counters referred to them: they come last.

    Returns
    -------
    tuple of Side
        Carriages on whose counters something measured depends. A photo that still needs its
        inner orientation from the beginning does not.
    tuple of KnownPlace
        The one proposed first.
    """
    model = state.current
    over = model is None
    if model is None:
        model = None if state.latest is None else state.accepted(*state.latest)
    if model is None:
        return (), ()
    if model.mono and model.laying != state.layings:
        return (), ()
    needed = tuple(s for s in model.carriages if _matters(model, s, over=over))
    found = [*_points(state, model, needed), *_fiducials(model, needed)]
    found.sort(key=lambda reference: (reference.name in doubted, reference.name != last))
    return needed, tuple(found)


def _matters(model: ModelState, side: Side, *, over: bool) -> bool:
    inner = model.inner_of(side)
    if inner is None:
        return True  # plate and image coordinates are one: the origin is all there is
    if over and not model.mono:
        return False  # the next plates are oriented anew
    return bool(inner.measured)


def _points(state: SessionState, model: ModelState, needed: tuple[Side, ...]) -> list[KnownPlace]:
    plates = plates_of_model(state, model)
    oriented = {"left": plates.left.oriented, "right": plates.right.oriented}
    if not needed or not all(oriented[side] for side in needed):
        return []
    places: dict[str, tuple[float, float, float, float]]
    if model.mono:
        places = {s.point: (s.x, s.y, s.x, s.y) for s in model.seen if s.side == needed[0]}
    else:
        places = {m.point: (m.xl, m.yl, m.xr, m.yr) for m in model.used}
    found = []
    for point, place in reversed(places.items()):
        try:
            at = plate_of(*place, plates)
        except NotComputableError:
            continue
        both: dict[Side, Place] = {"left": (at.xl, at.yl), "right": (at.xr, at.yr)}
        found.append(KnownPlace(point, f"point {point}", {side: both[side] for side in needed}))
    return found


def _fiducials(model: ModelState, needed: tuple[Side, ...]) -> list[KnownPlace]:
    found = []
    for inner in reversed(model.inner):
        if inner.side not in needed:
            continue
        found += [
            KnownPlace(
                m.fiducial,
                f"fiducial {m.fiducial} of {inner.name}",
                {inner.side: (m.x, m.y)},
                inner.side,
            )
            for m in reversed(inner.used)
        ]
    return found


@dataclass(frozen=True, slots=True)
class Referencing:
    """How far re-measuring the reference has come.

    Attributes
    ----------
    once
        Offsets [mm] said by one pointing, by carriage.
    agreed
        Offsets said by two.
    chosen
        Name of the reference that the operator wants to point at, or None.
    last
        Where the counters stood at the last pointing [mm], or None.
    moved
        Whether they were seen elsewhere since, or the mark was set anew by itself.
    pointed_at
        Name of the reference pointed at last, or None.
    contradicted
        Names of those that contradicted each other: one of them may be measured wrong.
    """

    once: Mapping[Side, Offset] = field(default_factory=dict)
    agreed: Mapping[Side, Offset] = field(default_factory=dict)
    chosen: str | None = None
    last: Position | None = None
    moved: bool = False
    pointed_at: str | None = None
    contradicted: frozenset[str] = frozenset()

    def is_away(self, position: Position) -> bool:
        """Whether any counter [mm], as it counts, is elsewhere than at the last pointing."""
        last = self.last
        return last is not None and any(
            abs(getattr(position, axis) - getattr(last, axis)) > _SAME_MM for axis in _COUNTERS
        )

    def open_sides(self, needed: tuple[Side, ...]) -> tuple[Side, ...]:
        """Return the carriages whose offset is not agreed upon yet."""
        return tuple(side for side in needed if side not in self.agreed)

    def proposed(
        self, needed: tuple[Side, ...], known: tuple[KnownPlace, ...]
    ) -> KnownPlace | None:
        """Return what to point at now: the chosen one, or the first that helps.

        A second pointing is to be elsewhere where it can be: what was measured wrong would say the
        same of itself twice. What contradicted each other comes after all others.
        """
        to_go = self.open_sides(needed)
        useful = [r for r in known if any(side in r.places for side in to_go)]
        useful.sort(
            key=lambda r: (
                self.once.keys().isdisjoint(r.places),
                r.name == self.pointed_at,
                r.name in self.contradicted,
            )
        )
        chosen = (r for r in useful if r.name == self.chosen)
        return next(chosen, useful[0] if useful else None)

    def pointed(self, reference: KnownPlace, here: Position, tolerance: float) -> Referencing:
        """Return how far it has come after the mark was set on a reference.

        Parameters
        ----------
        reference
            What the mark is set on.
        here
            Where the counters say it is [mm].
        tolerance
            By how much two pointings may differ [mm].

        Raises
        ------
        InputError
            The second pointing contradicts the first: both are to be forgotten.
        """
        counted: dict[Side, Place] = {"left": (here.xl, here.yl), "right": (here.xr, here.yr)}
        once, agreed = dict(self.once), dict(self.agreed)
        for side, (x, y) in reference.places.items():
            if side in agreed:
                continue
            offset = (x - counted[side][0], y - counted[side][1])
            before = once.pop(side, None)
            if before is None:
                once[side] = offset
                continue
            gap = max(abs(offset[0] - before[0]), abs(offset[1] - before[1]))
            if gap > tolerance:
                raise InputError(
                    f"{reference.title} ({side}) is {gap:.3f} mm from where the first pointing "
                    f"puts it, more than {tolerance:.3f} mm: set the mark again, twice"
                )
            agreed[side] = ((offset[0] + before[0]) / 2.0, (offset[1] + before[1]) / 2.0)
        return replace(
            self, once=once, agreed=agreed, last=here, moved=False, pointed_at=reference.name
        )

    def forgotten(self, reference: KnownPlace) -> Referencing:
        """Return where it begins anew, after a pointing that contradicted the one before."""
        names = filter(None, (self.pointed_at, reference.name))
        return Referencing(contradicted=self.contradicted.union(names))

    def shift(self, was: Position, tolerance: float, *, mono: bool) -> Position | None:
        """Return by how much the counters are to be moved [mm]; None when they kept their origin.

        Parameters
        ----------
        was
            By how much they were moved before: still so where nothing depends on them.
        tolerance
            By how much two pointings may differ [mm]. Offsets, means of two, that differ from
            `was` by no more than half of it are those of counters that lost nothing.
        mono
            Whether there is one carriage, whichever photo lies in it.
        """
        before: dict[Side, Offset] = {"left": (was.xl, was.yl), "right": (was.xr, was.yr)}
        moved = {
            side: max(abs(new[0] - before[side][0]), abs(new[1] - before[side][1]))
            for side, new in self.agreed.items()
        }
        if all(gap <= tolerance / 2.0 for gap in moved.values()):
            return None
        if mono:
            (one,) = self.agreed.values()
            return Position(*one, *one)
        left, right = ({**before, **self.agreed}[side] for side in ("left", "right"))
        return Position(*left, *right)


def asked_for(referencing: Referencing, at: KnownPlace | None, needed: tuple[Side, ...]) -> str:
    """Return what is to be done about the reference before anything else, one sentence.

    Parameters
    ----------
    referencing
        How far re-measuring has come.
    at
        What is to be pointed at now, or None.
    needed
        Carriages on whose counters something measured depends.
    """
    lost = "the counters have lost their reference"
    if at is not None:
        second = any(side in referencing.once for side in at.places)
        again = " again" if at.name == referencing.pointed_at else ", too,"
        return f"{lost}: set the mark on {at.title}{again if second else ''} and press R"
    if needed:
        return f"{lost}: nothing is measured to refer them to; set them, and press K"
    return f"{lost}: nothing measured depends on it; press R"


def in_words(shift: Position, *, mono: bool) -> str:
    """Return an offset of the counters as the operator reads it."""
    names = ("x", "y") if mono else ("x'", "y'", "x''", "y''")
    values = (shift.xl, shift.yl, shift.xr, shift.yr)
    parts = [f"{name} {value:+.3f}" for name, value in zip(names, values, strict=False)]
    return ", ".join(parts) + " mm"
