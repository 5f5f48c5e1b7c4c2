"""A session's state to and from text, strictly: what is written is read back equal.

Undo is no part of it: that is rebuilt from the events behind a snapshot. What a field may hold is
what its annotation says, as with events (`anaplot.exchange.eventcodec`).
"""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple, get_type_hints

from anaplot.errors import InputError
from anaplot.exchange.annotatedkinds import AnnotatedKinds
from anaplot.photogrammetry.block import Block
from anaplot.session.events import PhotoName
from anaplot.session.modelstate import ModelState
from anaplot.session.pointedat import Target, Targets, unusual, with_unusual
from anaplot.session.reasons import LastChange, RowReason
from anaplot.session.returning import AsAccepted, Return
from anaplot.session.state import SessionState
from anaplot.textfiles.kinds import (
    FLAG,
    NAME,
    NUMBER,
    PHOTO,
    Blank,
    Items,
    Kind,
    ListOf,
    Made,
    Whole,
    WrongValueError,
)
from anaplot.textfiles.wording import plain, quoted

__all__ = ["StateWriter", "Told", "state_from_text"]

_COUNT = Whole(0, 1_000_000_000)


class _NameOrNone(Kind[str]):
    """A name, or "" where there is none."""

    def of(self, value: Any) -> str:
        """Return the name."""
        return "" if value == "" else NAME.of(value)


def _class_kind(cls: type[Any]) -> Kind[Any]:
    """Return the kind of the lists that stand for instances of a class: its fields in order."""
    return Made(Items(*(kind for _, kind in _parts(cls))), lambda found: cls(*found))


def _parts(cls: type[Any]) -> list[tuple[str, Kind[Any]]]:
    hints = get_type_hints(cls, include_extras=True)
    names = [f.name for f in fields(cls)] if is_dataclass(cls) else list(cls.__annotations__)
    return [(name, _kind(hints[name])) for name in names]


_kind = AnnotatedKinds(
    {str: _NameOrNone(), PhotoName: PHOTO, float: NUMBER, bool: FLAG, int: _COUNT},
    _class_kind,
    "items",
).kind


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: objects as lists of their fields, sets sorted."""
    if is_dataclass(value):
        return [_plain(getattr(value, field.name)) for field in fields(value)]
    if isinstance(value, frozenset):
        return sorted(map(_plain, value))
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


_MODEL = _kind(ModelState)
_NUMBER_OF = Blank(_COUNT)
_STATE = Items(
    ListOf(_MODEL, "models"),
    ListOf(_COUNT, "numbers of models"),
    _NUMBER_OF,
    FLAG,
    _COUNT,
    Blank(Items(_NUMBER_OF, Blank(NAME), Blank(PHOTO))),
    Blank(Items(PHOTO, PHOTO)),
    ListOf(Items(Items(PHOTO, PHOTO), ListOf(_COUNT, "numbers of models")), "models"),
    ListOf(_kind(RowReason), "reasons"),
    Blank(_kind(LastChange)),
    ListOf(Items(PHOTO, PHOTO), "models"),
    ListOf(Items(_kind(Target), _COUNT), "pointings"),
)


class Told(NamedTuple):
    """What a text says.

    Attributes
    ----------
    state
        The state, which may undo nothing.
    ever
        Names "left/right" of every model that was ever accepted.
    pointed
        How often what was pointed at.
    """

    state: SessionState
    ever: frozenset[str]
    pointed: Targets


class StateWriter:
    """Makes texts of the states of one session; what it knows from the last one it keeps.

    Most models of a state are those of the state before: a text costs what is new in it. Equal
    states have the same text, whichever of their models are the same objects.
    """

    def __init__(self) -> None:
        # the model itself too, so that nothing else takes its identity
        self._known: dict[int, tuple[ModelState, str]] = {}

    def text(self, state: SessionState, ever: Collection[str], pointed: Targets) -> str:
        """Return a state, its block and what undo brings back left out, as one line of JSON.

        Parameters
        ----------
        state
            The state.
        ever
            Names "left/right" of every model that was ever accepted.
        pointed
            How often what was pointed at.
        """
        known: dict[int, tuple[ModelState, str]] = {}
        table: dict[str, int] = {}
        numbers: dict[int, int] = {}

        def number(model: ModelState | None) -> int | None:
            if model is None:
                return None
            if id(model) not in numbers:
                known[id(model)] = self._known.get(id(model)) or (model, _json(_plain(model)))
                numbers[id(model)] = table.setdefault(known[id(model)][1], len(table))
            return numbers[id(model)]

        listed: dict[int, list[int | None]] = {}

        def all_of(models: tuple[ModelState, ...]) -> list[int | None]:
            # mostly some were computed anew at once
            if id(models) not in listed:
                listed[id(models)] = [number(model) for model in models]
            return listed[id(models)]

        back = state.returned
        found = [
            all_of(state.models),
            number(state.current),
            state.suspended,
            state.layings,
            None if back is None else [number(back.parked), back.point, back.photo],
            state.latest,
            [[one.photos, all_of(one.models)] for one in state.recomputed],
            _plain(state.reasons),
            _plain(state.last_change),
            sorted(name.split("/") for name in ever),
            unusual(state, pointed),
        ]
        self._known = known
        return f"[[{','.join(table)}],{_json(found)[1:]}"


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), allow_nan=False)


def _check(model: ModelState, block: Block) -> None:
    """Refuse a model that is none of the block, or was measured beyond its plan."""
    strip = next((strip for strip in block.strips if strip.id == model.strip), None)
    planned = {point.point for point in model.plan}
    points = {m.point for m in model.measured} | {s.point for s in model.seen}
    fits = (
        strip is not None
        and model.left in strip.photos
        and strip.photos[-1] != model.left
        and strip.photos[strip.photos.index(model.left) + 1] == model.right
        and points | {point for point, _ in model.off} <= planned
        and all(inner.photo in model.photos for inner in model.inner)
    )
    if not fits:
        raise WrongValueError(f"model {quoted(model.name)} does not fit the block")


def state_from_text(text: str, start: SessionState) -> Told:
    """Return the state that a text says, of a block, and what no undo takes back.

    Parameters
    ----------
    text
        From `StateWriter.text`.
    start
        The state of its block before any event.

    Raises
    ------
    InputError
        It is no such text.
    """
    try:
        said = _STATE.of(json.loads(text))
        table, models, current, suspended, layings, back, latest, recomputed = said[:8]
        reasons, change, ever, pointed = said[8:]
        for model in table:
            _check(model, start.block)

        def named(number: int | None) -> ModelState | None:
            return None if number is None else table[number]

        state = replace(
            start,
            models=tuple(table[number] for number in models),
            current=named(current),
            suspended=suspended,
            layings=layings,
            returned=None if back is None else Return(named(back[0]), *back[1:]),
            latest=latest,
            recomputed=tuple(
                # texts of version 3 have all models of the block
                AsAccepted.among(photos, [table[n] for n in numbers])
                for photos, numbers in recomputed
            ),
            reasons=reasons,
            last_change=change,
        )
        names = frozenset("/".join(photos) for photos in ever)
        return Told(state, names, with_unusual(state, pointed))
    except WrongValueError as error:
        raise InputError(plain(f"snapshot: {error.placed()}", 400)) from None
    except (ValueError, IndexError, RecursionError):
        raise InputError("snapshot: not a session's state") from None
