"""When the operator is told to return to an accepted model."""

from __future__ import annotations

from dataclasses import replace

import pytest
from sessionscene import Scene

from anaplot.session.desk import Desk
from anaplot.session.events import ModelAccepted, ModelReopened, Suspended
from anaplot.session.referencing import Referencing
from anaplot.session.state import SessionState, apply
from anaplot.station.blockstatus import status_of
from anaplot.station.blockview import BlockView, FlaggedCoordinate, SuspectedPoint, SuspectedRay
from anaplot.station.returnadvice import return_advice
from anaplot.station.snapshot import LinkView, snapshot_of

SCENE = Scene(4)
FIRST, SECOND = SCENE.block.strips[0].models()[:2]
NAMES = ["/".join(photos) for photos in (FIRST, SECOND)]


def spoilt() -> tuple[SessionState, str]:
    """The second model complete, and a point that was wrong in x in the first."""
    state = SCENE.chosen(0)
    point = next(p.point for p in state.current.plan if p.point == "102-2")  # type: ignore[union-attr]
    state = apply(SCENE.whole(state), SCENE.measurement(state, point, dxr=0.15))
    state = apply(state, ModelAccepted(*FIRST))
    return SCENE.whole(apply(state, SCENE.choice(state, 1))), point


STATE, WRONG = spoilt()


def view(
    probability: float,
    model: str | None = NAMES[0],
    point: str = WRONG,
    explained: float = 1.0,
) -> BlockView:
    flagged = FlaggedCoordinate("102", model, "x", 20.0, 0.3)
    ray = SuspectedRay("102", model, probability)
    suspect = SuspectedPoint(point, (flagged,), (ray,), NAMES[1], True, explained)
    return BlockView(NAMES[1], 2, provisional=True, datum="free", suspects=(suspect,))


def again(state: SessionState, times: int) -> SessionState:
    """The state after the wrong point was measured again in the model in work."""
    for _ in range(times):
        state = apply(state, SCENE.measurement(state, WRONG))
    return state


def test_what_the_block_is_sure_of() -> None:
    desk = Desk.at(STATE)
    assert desk.outlook.diagnosis is not None
    assert desk.outlook.diagnosis.suspects[0] == (WRONG, "x")
    advice = return_advice(desk, view(0.9973))
    assert advice is not None
    assert (advice.left, advice.right, advice.point, advice.axis, advice.photo) == (
        *FIRST,
        WRONG,
        "x",
        "102",
    )
    words = f"return to {NAMES[0]}: remeasure {WRONG} x: 99.7 %"
    shown = snapshot_of(desk, 1, LinkView("none"), status_of(SCENE.block, STATE, view(0.9973), "x"))
    assert (shown.expected, shown.returning) == (words, advice)
    assert shown.agenda.steps[0].kind == "return"
    # the figure is never rounded to certainty
    certain = return_advice(desk, view(1.0))
    assert certain is not None
    assert certain.agenda.remark == "99.9 %"
    # between models, too
    between = Desk.at(apply(STATE, ModelAccepted(*SECOND)))
    assert return_advice(between, view(0.995)) is not None


@pytest.mark.parametrize(
    "said",
    [
        None,
        view(0.99),
        # by chance, or more than that measurement is wrong
        view(1.0, explained=0.5),
        view(1.0, explained=0.0),
        view(1.0, NAMES[1]),
        view(1.0, None),
        view(1.0, "998/999"),
        view(1.0, NAMES[0], "nowhere"),
        replace(view(1.0), busy=True),
        replace(view(1.0), suspects=()),
    ],
)
def test_no_advice_where_it_is_not_sure_of_an_accepted_model(said: BlockView | None) -> None:
    assert return_advice(Desk.at(STATE), said) is None


def test_a_tie_that_was_measured_again_and_does_not_fit() -> None:
    advice = return_advice(Desk.at(again(STATE, 1)), None)
    assert advice is not None
    assert (advice.left, advice.right, advice.point, advice.probability) == (*FIRST, WRONG, None)
    assert advice.agenda.sentence == (
        f"return to {NAMES[0]}: remeasure {WRONG} x: measured again here, it does not fit"
    )


def test_what_does_not_help_is_not_asked_for_for_ever() -> None:
    state = apply(STATE, ModelReopened(*FIRST, point=WRONG))
    for _ in range(2):
        state = apply(state, SCENE.measurement(state, WRONG, dxr=0.15))
    state = again(apply(state, ModelAccepted(*FIRST)), 1)
    assert return_advice(Desk.at(state), view(1.0)) is None


def test_one_thing_at_a_time() -> None:
    desk, said = Desk.at(again(STATE, 1)), view(1.0)
    assert return_advice(desk, said) is not None
    other = Desk.at(apply(again(STATE, 1), Suspended()))
    assert return_advice(other, said) is None
    assert return_advice(replace(desk, referencing=Referencing()), said) is None
    assert return_advice(replace(desk, checks=("102-1",)), said) is None
    returned = Desk.at(apply(again(STATE, 1), ModelReopened(*FIRST)))
    assert return_advice(returned, said) is None
    # pending points come first
    begun = SCENE.chosen(1)
    assert return_advice(Desk.at(begun), said) is None
