"""Two points where one is: told by where they lie, in this model, in another one, or elsewhere."""

from __future__ import annotations

from math import sqrt

import pytest
from syntheticblocks import synthetic_block

from anaplot.session.accidents import accidents
from anaplot.session.events import PlannedPoint
from anaplot.session.modelstate import Measured, ModelState
from anaplot.session.othernames import OtherName, other_names
from anaplot.session.state import SessionState
from anaplot.session.transfer import Mark, Transfer

Place = tuple[float, float, float, float]
HERE: Place = (10.0, 20.0, -80.0, 20.5)
BLOCK = synthetic_block(1, 4, seed=1).block
# of the difference of two pointings
NEAR = 4.0 * sqrt(2.0) * BLOCK.precision.image_um * 1e-3


def model(photos: tuple[str, str] = ("102", "103"), **places: Place) -> ModelState:
    return ModelState(
        "1",
        *photos,
        plan=tuple(PlannedPoint(point, "new", *at) for point, at in places.items()),
        measured=tuple(Measured(point, *at, times=1) for point, at in places.items()),
    )


def told(
    current: ModelState, *accepted: ModelState, known: Transfer | None = None
) -> dict[str, str]:
    state = SessionState(BLOCK, models=accepted, current=current)
    return {a.point: a.text for a in accidents(state, known or Transfer())}


def twice(point: str, other: str) -> dict[str, str]:
    return {point: f"{point} lies where {other} lies: the same point under two names?"}


def moved(**by: float) -> Place:
    at = dict(zip(("xl", "yl", "xr", "yr"), HERE, strict=True))
    return tuple(value + by.get(name, 0.0) for name, value in at.items())  # type: ignore[return-value]


def test_in_one_model_both_photos_say_so() -> None:
    assert told(model(a=HERE, b=HERE)) == twice("b", "a")
    for name in ("xl", "yl", "xr", "yr"):
        assert told(model(a=HERE, b=moved(**{name: 0.99 * NEAR}))) == twice("b", "a")
        # one behind the other, or beside it: another point
        assert told(model(a=HERE, b=moved(**{name: 1.01 * NEAR}))) == {}


def test_to_exchange_two_names_of_one_place_is_no_cure() -> None:
    both = model(a=HERE, b=HERE)
    found = accidents(SessionState(BLOCK, current=both), Transfer())
    assert [one.other for one in found] == [""]
    assert other_names(both, None, found) == ()


def test_a_tie_is_named_otherwise_where_it_got_its_name() -> None:
    there = {"a": (0.0, 0.0, *HERE[:2]), "c": (0.0, 50.0, 0.0, 50.0)}
    here = model(b=HERE, c=moved(yl=50.0, yr=50.0))
    before, first = model(("101", "102"), **there), model(("100", "101"), c=HERE)
    (found,) = accidents(SessionState(BLOCK, models=(first, before), current=here), Transfer())
    assert (found.point, found.other, found.first) == ("b", "a", "")
    assert other_names(here, None, [found]) == (OtherName("b", "a"),)
    # the model before has it under this name, too: it would contradict what it is tied to
    before = model(("101", "102"), **there, b=(0.0, 0.0, *HERE[:2]))
    first = model(("100", "101"), b=HERE)
    for models, name in (((before,), "101/102"), ((first, before), "100/101")):
        (found,) = accidents(SessionState(BLOCK, models=models, current=here), Transfer())
        assert (found.point, found.other, found.first) == ("b", "a", name)
        assert other_names(here, None, [found]) == ()


@pytest.mark.parametrize(("photos", "at"), [(("101", "102"), 2), (("103", "104"), 0)])
def test_a_point_of_another_model_is_seen_in_the_common_photo(
    photos: tuple[str, str], at: int
) -> None:
    # the right photo of the one before is the left one here
    where = (0.0, 0.0, *HERE[:2]) if at == 2 else (*HERE[2:], 0.0, 0.0)
    assert told(model(b=HERE), model(photos, a=where)) == twice("b", "a")
    # under its own name it is the tie that it should be
    assert told(model(a=HERE), model(photos, a=where)) == {}
    assert told(model(a=moved(xl=1.0, xr=1.0), b=HERE), model(photos, a=where)) == {}


def test_what_the_model_had_when_it_was_accepted_is_no_second_name() -> None:
    # returned to, and a point named otherwise since
    assert told(model(b=HERE), model(a=HERE)) == {}


@pytest.mark.parametrize(("mark", "what"), [("lateral", ""), ("control", "control point ")])
def test_a_place_that_is_well_known_tells_of_a_second_name(mark: Mark, what: str) -> None:
    def known(sigma: float) -> Transfer:
        return Transfer(marks={"9": mark}, places={"9": (HERE, sigma)})

    assert told(model(b=HERE), known=known(0.02)) == twice("b", f"{what}9")
    assert told(model(b=moved(yr=0.2)), known=known(0.02)) == {}
    # a place known to a quarter of a millimetre is that of many points
    assert told(model(b=HERE), known=known(0.25)) == {}
    # it has been measured itself, beside: that the other one lies where it should says nothing
    assert told(model(b=HERE, **{"9": moved(xl=1.0, xr=1.0)}), known=known(0.02)) == {}
