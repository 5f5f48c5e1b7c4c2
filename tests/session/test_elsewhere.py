"""What other strips and the ground say of points: once for many records, without check points."""

from dataclasses import replace

import numpy as np
import pytest
from transferscene import flown, second_strip_begun

from anaplot.session.elsewhere import _oriented, elsewhere, ground
from anaplot.session.tiecheck import GROUND, Known
from anaplot.session.transfer import Transfer, transfer

SEED = 4


@pytest.fixture(scope="module")
def second_strip():
    """The first strip accepted, and of the second one a model without its control."""
    made = flown(SEED)
    return made, second_strip_begun(made)


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


def test_a_strip_without_a_common_point_is_compared_without_being_computed(second_strip):
    _, state = second_strip
    models = tuple(
        replace(m, measured=tuple(replace(one, point=f"far-{one.point}") for one in m.measured))
        for m in state.models
    )
    _oriented.cache_clear()
    far = replace(state, models=models)
    checks = transfer(far, Known()).checks
    assert [(c.other, c.common, c.tie, c.problem) for c in checks] == [
        ("1", 0, None, "0 common points, 2 are needed")
    ]
    assert _oriented.cache_info().misses == 0
    # nor is there one that is not oriented at all, whatever its later models are
    first, *others = models
    none = (replace(first, measured=first.measured[:3]), *others)
    assert transfer(replace(state, models=none), Known()).checks == ()
    # a single common point, and it is computed
    point = state.current.measured[0].point
    named = replace(first, measured=(replace(first.measured[0], point=point), *first.measured[1:]))
    (one,) = transfer(replace(state, models=(named, *others)), Known()).checks
    assert (one.common, one.problem) == (1, "1 common points, 2 are needed")
    assert _oriented.cache_info().misses == 1


def by_way_of_the_neighbour(made, state, moved_m: float) -> Transfer:
    """What follows where two points of the neighbour are check points, somewhere near or not."""
    control = tuple(
        replace(c, use="check", xyz=tuple(v + moved_m for v in c.xyz))
        if c.point in ("C2", "C5")
        else c
        for c in made.block.control
    )
    return transfer(state, Known.of(control, None))


def test_a_check_point_does_not_say_where_control_is_looked_for(second_strip):
    made, state = second_strip
    near, far = (by_way_of_the_neighbour(made, state, by) for by in (0.0, 3.0))
    first = {m.point for m in state.models for m in m.measured}
    own = {m.point for m in state.current.measured}
    assert {"C1", "C2", "C4", "C5"} <= first  # the neighbour is fitted to the first and third
    # the strip itself has no control yet: the neighbour's fit shows it
    assert next(c.tie for c in near.checks if c.other == GROUND) is None
    shown = near.places.keys() - first - own
    assert shown
    assert shown == far.places.keys() - first - own
    for name in shown:
        assert far.places[name] == near.places[name]
    left, right = (made.truth[photo] for photo in state.current.photos)
    seen = shown & left.keys() & right.keys()
    assert seen
    for name in seen:
        at, sigma = near.places[name]
        # normal, exceeded by chance in one of 15 000 coordinates
        assert np.abs(np.array(at) - (*left[name], *right[name])).max() < 4.0 * sigma
