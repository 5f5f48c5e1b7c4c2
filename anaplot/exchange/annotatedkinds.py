"""Which kind of value a field may hold, from its annotation.

What stands in a file for an object of the session is declared once, where the object is: a new
field, or a new kind of event, needs nothing more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from anaplot.textfiles.kinds import Blank, Items, Kind, ListOf, Made, Word

__all__ = ["AnnotatedKinds"]


@dataclass(frozen=True, slots=True)
class AnnotatedKinds:
    """How one file writes values of annotated fields.

    Attributes
    ----------
    simple
        The kinds of what is one JSON value.
    of_class
        Returns the kind of what stands for instances of a class.
    items
        What the items of a list are called in messages.
    most
        How many items there may be; None: as many as there are.
    """

    simple: Mapping[Any, Kind[Any]]
    of_class: Callable[[type[Any]], Kind[Any]]
    items: str
    most: int | None = None

    def kind(self, annotation: Any) -> Kind[Any]:
        """Return the kind of values that an annotation allows.

        Parameters
        ----------
        annotation
            As `typing.get_type_hints` gives it, with extras.
        """
        origin, inner = get_origin(annotation), get_args(annotation)
        if annotation in self.simple:
            return self.simple[annotation]
        if origin is Literal:
            return Word(*inner)
        if origin in (Union, UnionType):
            parts = [part for part in inner if part is not NoneType]
            words = tuple(word for part in parts for word in get_args(part))
            kind = self.kind(parts[0]) if len(parts) == 1 else Word(*words)
            return Blank(kind) if NoneType in inner else kind
        if origin is frozenset:
            return Made(ListOf(self.kind(inner[0]), self.items, most=self.most), frozenset)
        if origin is tuple and inner[-1] is Ellipsis:
            return ListOf(self.kind(inner[0]), self.items, most=self.most)
        if origin is tuple:
            return Items(*map(self.kind, inner))
        return self.of_class(annotation)
