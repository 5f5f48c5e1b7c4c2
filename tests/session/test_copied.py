"""Copies with other values in some fields: what `dataclasses.replace` makes."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import pytest
from sessionscene import Scene

from anaplot.session.copied import copied
from anaplot.session.events import PlannedPoint
from anaplot.session.modelstate import Measured, ModelState
from anaplot.session.returning import Return
from anaplot.session.state import fold


@dataclass(frozen=True, slots=True)
class Checked:
    one: int
    two: int

    def __post_init__(self) -> None:
        assert self.one < self.two


@dataclass(frozen=True)
class Loose:
    one: int
    two: int


def instances() -> list[object]:
    scene = Scene(3)
    state = fold(scene.start, [scene.choice(scene.start, 0)])
    state = fold(state, scene.measurements(state))
    model = state.current
    assert model is not None
    return [
        PlannedPoint("1", "new", 1.0, 2.0, 3.0, 4.0),
        Measured("1", 1.0, 2.0, 3.0, 4.0, 2),
        Return(model, "1", None),
        model,
        state,
    ]


@pytest.mark.parametrize("one", instances(), ids=lambda one: type(one).__name__)
def test_a_copy_is_what_replace_makes(one: object) -> None:
    for field in fields(one):  # type: ignore[arg-type]
        value = object()
        again = copied(one, **{field.name: value})
        assert type(again) is type(one)
        expected = replace(one, **{field.name: value})  # type: ignore[type-var]
        for each in fields(one):  # type: ignore[arg-type]
            assert getattr(again, each.name) is getattr(expected, each.name)
        assert getattr(one, field.name) is not value
    assert copied(one) == one
    assert copied(one) is not one


def test_what_is_no_field_is_refused() -> None:
    model = ModelState("1", "101", "102", ())
    with pytest.raises(TypeError, match="ModelState has no field 'of'"):
        copied(model, of=1)


@pytest.mark.parametrize("one", [Checked(1, 2), Loose(1, 2)])
def test_a_class_that_does_more_is_refused(one: object) -> None:
    with pytest.raises(TypeError, match="nothing more"):
        copied(one, two=0)
