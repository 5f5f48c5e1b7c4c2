"""The part of the fold that is about accepted models to which the operator returns.

A model is as it was accepted until it is accepted again; then it takes its former place. What is
computed from it follows by itself, for tables are pure functions of the state. What the next model
has taken from it, roles and in a mono comparator coordinates, follows here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from anaplot.session.copied import copied
from anaplot.session.events import PlannedPoint, Role
from anaplot.session.modelstate import ModelState
from anaplot.session.monofold import followed

__all__ = [
    "AsAccepted",
    "Return",
    "following",
    "recomputed_since",
    "replaced",
    "same_measurements",
]

Models = tuple[ModelState, ...]


@dataclass(frozen=True, slots=True)
class Return:
    """Why a model is in work that is accepted already.

    Attributes
    ----------
    parked
        The model that was in work before; it waits. None: there was none.
    point
        What is to be measured again, or None.
    photo
        In a mono comparator, in which photo, or None.
    """

    parked: ModelState | None = None
    point: str | None = None
    photo: str | None = None


@dataclass(frozen=True, slots=True)
class AsAccepted:
    """An accepted model that was computed anew since, and its strip as it was then.

    Attributes
    ----------
    photos
        Of the model.
    models
        The accepted models of its strip: it follows from them. Those of the whole block would be
        as many as models times models computed anew.
    """

    photos: tuple[str, str]
    models: Models

    @classmethod
    def among(cls, photos: tuple[str, str], models: Iterable[ModelState]) -> AsAccepted:
        """Return what of all accepted models a model follows from."""
        models = tuple(models)
        strip = next((model.strip for model in models if model.photos == photos), None)
        return cls(photos, tuple(model for model in models if model.strip == strip))


def same_measurements(one: ModelState, other: ModelState) -> bool:
    """Whether two versions of a model say the same, however their photos lie."""
    return (one.plan, one.measured, one.seen, one.off) == (
        other.plan,
        other.measured,
        other.seen,
        other.off,
    )


def following(models: Models, model: ModelState) -> Iterator[ModelState]:
    """Yield the accepted models of a strip after a model, first to last."""
    by_left = {m.left: m for m in models if m.strip == model.strip}
    right = model.right
    # a strip has every photo once: the walk ends
    while (found := by_left.get(right)) is not None:
        yield found
        right = found.right


def recomputed_since(
    known: tuple[AsAccepted, ...], anew: Iterable[ModelState], models: Models
) -> tuple[AsAccepted, ...]:
    """Return the models that were computed anew since they were accepted, with further ones.

    Parameters
    ----------
    known
        Those so far; they stay as they were.
    anew
        Models that are computed anew now.
    models
        The accepted models as they were before.
    """
    told = {one.photos for one in known}
    return (*known, *(AsAccepted.among(m.photos, models) for m in anew if m.photos not in told))


def replaced(
    models: Models, parked: ModelState | None, new: ModelState
) -> tuple[Models, ModelState | None]:
    """Put a new version of an accepted model in the place of the former one.

    Parameters
    ----------
    models
        The accepted models.
    parked
        The model that waits, or None.
    new
        The version that is accepted now.

    Returns
    -------
    tuple of ModelState
        The accepted models, in the same order.
    ModelState or None
        The model that waits.
    """
    old = next(m for m in models if m.photos == new.photos)

    def adapted(model: ModelState) -> ModelState:
        if (model.strip, model.left) != (new.strip, new.right):
            return model
        return _with_roles(followed(model, old, new) if model.mono else model, new)

    return (
        tuple(new if m is old else adapted(m) for m in models),
        None if parked is None else adapted(parked),
    )


def _with_roles(model: ModelState, preceding: ModelState) -> ModelState:
    """Return a model with its ties as the preceding one knows them now.

    A point that is switched off altogether stays so, whichever rows it has.
    """
    known = {m.point for m in preceding.used}

    def role(point: PlannedPoint) -> Role:
        if point.point in known:
            return "tie"
        return "new" if point.role == "tie" else point.role

    roles = [role(point) for point in model.plan]
    if all(point.role == now for point, now in zip(model.plan, roles, strict=True)):
        return model
    plan = tuple(copied(point, role=now) for point, now in zip(model.plan, roles, strict=True))
    after = copied(model, plan=plan)
    off = {key for key in model.off if key[1] in after.axes(key[0])}
    for p in model.plan:
        if model.is_off(p.point):
            off |= {(p.point, axis) for axis in after.axes(p.point)}
    return copied(after, off=frozenset(off))
