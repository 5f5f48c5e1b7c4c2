"""What other strips and the ground say of points: once for many records."""

from dataclasses import replace

import pytest
from transferscene import flown

from anaplot.session.elsewhere import elsewhere, ground
from anaplot.session.events import PlannedPoint
from anaplot.session.modelstate import Measured, ModelState
from anaplot.session.state import start

SEED = 4


def model(made, strip, left, right, names=None) -> ModelState:
    """A model whose points were pointed at without error."""
    seen = {
        name: (*made.truth[left][name], *made.truth[right][name])
        for name in made.truth[left]
        if name in made.truth[right] and (names is None or name in names)
    }
    plan = tuple(PlannedPoint(name, "new", *at) for name, at in seen.items())
    measured = tuple(Measured(name, *at, 1) for name, at in seen.items())
    return ModelState(strip, left, right, plan, measured)


@pytest.fixture(scope="module")
def second_strip():
    """The first strip accepted, and of the second one a model without its control."""
    made = flown(SEED)
    first, second = made.block.strips
    ground_points = {c.point for c in made.block.control}
    state = replace(
        start(made.block),
        models=tuple(model(made, first.id, *photos) for photos in first.models()),
        current=model(made, second.id, *second.models()[0], made.ground.keys() - ground_points),
    )
    return made, state


def test_what_is_elsewhere_stays_from_one_record_to_the_next(second_strip):
    made, state = second_strip
    known = elsewhere(state.block, state.models, "2")
    assert elsewhere(state.block, state.models, "2") is known
    assert known.strips.keys() == {"1"}
    assert set(known.strip_of.values()) == {"1"}
    assert not elsewhere(state.block, state.models, "1").strip_of
    # another model of the strip in work changes nothing of the geometry of the others
    more = (*state.models, state.current)
    assert elsewhere(state.block, more, "2").strips["1"] is known.strips["1"]
    control = made.block.control
    assert ground(state.block, control) is ground(state.block, control)
