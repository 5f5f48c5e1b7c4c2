"""How often everything was pointed at: what the simulated hand's noise goes on from."""

from __future__ import annotations

from collections import Counter

import pytest
import test_inner_rules
from hypothesis import given
from hypothesis import strategies as st
from test_session_fold import Draft, drafts, played

from anaplot.plotter.device.hand import fiducial_name, monocular_name
from anaplot.session.events import (
    Event,
    FiducialMeasured,
    ModelAccepted,
    MonoMeasured,
    Place,
    PointMeasured,
    PointRepeated,
)
from anaplot.session.pointedat import Target, pointed_at, unusual, with_unusual
from anaplot.simulation.instrument import name_of

BOTH = (Place("101", "left", 1.0, 2.0), Place("102", "right", 3.0, 4.0))


@pytest.mark.parametrize(
    ("event", "name"),
    [
        (PointMeasured("101", "102", "7", 1.0, 2.0, 3.0, 4.0, "key"), "7"),
        (PointRepeated("101", "102", "7", False, BOTH, True, "key"), "7"),
        (MonoMeasured("101", "102", "right", "7", 1.0, 2.0, "key"), monocular_name("right", "7")),
        (
            PointRepeated("101", "102", "7", False, BOTH[1:], True, "key"),
            monocular_name("right", "7"),
        ),
        (
            PointRepeated("101", "102", "7", True, BOTH[:1], True, "key"),
            fiducial_name("left", "7"),
        ),
    ],
)
def test_the_hand_counts_it_by_this_name(event: Event, name: str) -> None:
    target = pointed_at(event, None)
    assert target is not None
    assert (target.left, target.right, name_of(target)) == ("101", "102", name)


def test_a_fiducial_belongs_to_the_model_in_the_instrument() -> None:
    state = test_inner_rules.SCENE.whole(test_inner_rules.SCENE.chosen(2))
    model = state.current
    assert model is not None
    event = FiducialMeasured(model.right, "right", "1", 1.0, 2.0, "key")
    target = pointed_at(event, model)
    assert target == Target(*model.photos, "1", "right", True)
    assert name_of(target) == fiducial_name("right", "1")
    assert pointed_at(ModelAccepted(*model.photos), model) is None
    # a day on which everything was pointed at once, and nothing taken back, has nothing to tell
    counts = with_unusual(state, [])
    assert unusual(state, counts) == []
    assert set(counts.values()) == {1}


@given(drafts, st.dictionaries(st.integers(0, 30), st.integers(0, 5)))
def test_what_is_unusual_says_it_all(steps: list[Draft], more: dict[int, int]) -> None:
    state = played(steps)[1][-1]
    targets = Counter(with_unusual(state, []))
    for k, count in more.items():
        targets[Target("101", "102", str(k), None, False)] += count
    for k, target in enumerate(sorted(targets, key=str)):
        targets[target] -= min(more.get(k, 0), targets[target])
    assert with_unusual(state, unusual(state, targets)) == dict(+targets)
