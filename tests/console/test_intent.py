from __future__ import annotations

from dataclasses import replace

import pytest
from consolefake import FakeStation, picture

from anaplot.console.choices import Choices
from anaplot.console.intent import (
    Leave,
    PointName,
    Question,
    Read,
    Say,
    Toggle,
    Turn,
    answer,
    idle,
    intended,
)
from anaplot.console.keymap import keys_in_force
from anaplot.console.now import Now, now_of
from anaplot.console.rows import shown_rows
from anaplot.console.situation import Situation
from anaplot.orientation.results import ModelSolution
from anaplot.session.commands import (
    Accept,
    Drive,
    KeepCounters,
    NextModel,
    RecordPoint,
    Reference,
    Resume,
    ReturnTo,
    Stop,
    Suspend,
    Switch,
)
from anaplot.station.returnadvice import ReturnAdvice
from anaplot.station.snapshot import LinkView, PointView

pytestmark = pytest.mark.smoke

STEREO = Choices(stereo_on=True)


def _without_hand() -> FakeStation:
    station = FakeStation()
    station.hand = False
    return station


def zoomed(by: int) -> Choices:
    return replace(STEREO, wheels=STEREO.wheels.zoomed(by))


def now(row: int | None = 1, **changes: object) -> Situation:
    snapshot = changes.pop("snapshot", picture())
    rows = shown_rows(snapshot)
    found = Situation(
        snapshot, None if row is None else rows[row], False, len(rows), Choices(), FakeStation()
    )
    return replace(found, **changes)


def offered(measured: int = 13) -> tuple[PointView, ...]:
    """The pattern, and a control point beyond it that is not measured."""
    beyond = PointView("C1", "new", 40.0, 10.0, "pending", 0, mark="control", offered=True)
    return (*picture(gross=False, measured=measured).points, beyond)


BACK = ReturnAdvice("101", "102", "102-3", "y", "102", 0.997)


def test_enter_on_the_advice_returns() -> None:
    shown = picture(returning=BACK, agenda=BACK.agenda, target=None)
    line = now_of(shown, keys_in_force({}))
    assert line.text == "return to 101/102: remeasure 102-3 y: Enter (99.7 %)"
    assert intended("drive", now(snapshot=shown, now=line)) == ReturnTo(
        "101", "102", "102-3", "102"
    )


def noisy(sigma0: float) -> ModelSolution:
    """A model in which nothing is flagged, with so many times the a-priori sigma0."""
    solution = picture(gross=False).solution
    assert solution is not None
    assert not solution.flagged
    return replace(solution, tested=replace(solution.tested, sigma0=sigma0))


@pytest.mark.parametrize(
    ("action", "situation", "meaning"),
    [
        ("record", now(), RecordPoint()),
        ("drive", now(), Drive("103")),
        ("drive", now(None), Say("no row is selected")),
        ("details", now(), Read("details")),
        ("details", now(None), Say("no row is selected")),
        ("next_point", now(), Drive("103")),
        (
            "next_point",
            now(snapshot=picture(next_point=None)),
            Say("no point is expected next"),
        ),
        ("accept", now(snapshot=picture(gross=False)), Accept()),
        ("accept", now(snapshot=picture(gross=False, points=offered())), Accept()),
        (
            "accept",
            now(snapshot=picture(measured=4)),
            Say(
                "the model cannot be accepted now: "
                "six points are needed, four of them ties or well spread",
            ),
        ),
        ("switch_row", now(), Switch("103", "y", False)),
        ("switch_point", now(), Switch("103", None, False)),
        ("reference", now(), Reference(None)),
        ("reference", now(by_hand=True), Reference("103")),
        ("reference", now(9, snapshot=picture(measured=4), by_hand=True), Reference(None)),
        ("keep_counters", now(), Say("the counters have their reference")),
        ("suspend", now(), Suspend()),
        ("suspend", now(snapshot=picture(suspended=True)), Resume()),
        ("add_point", now(), PointName()),
        ("automatic", now(), Toggle("automatic")),
        ("hand", now(choices=STEREO), Toggle("hand")),
        ("hand", now(controls=_without_hand()), Toggle("hand")),
        ("drive", now(now=Now("", "next_model")), NextModel()),
        ("drive", now(now=Now("", "accept"), snapshot=picture(gross=False)), Accept()),
        ("drive", now(now=Now("", "suspend"), snapshot=picture(suspended=True)), Resume()),
        ("drive", now(now=Now("", "add_point")), PointName()),
        ("drive", now(now=Now("", "drive", "110")), Drive("110")),
        ("left", now(choices=STEREO), Turn(-0.02, 0.0, 0.0, 0.0)),
        ("far_py_less", now(choices=STEREO), Turn(0.0, 0.0, 0.0, -0.2)),
        ("help", now(), Read("help")),
        ("leave", now(snapshot=picture(measured=0)), Leave()),
    ],
)
def test_what_a_key_means(action: str, situation: Situation, meaning: object) -> None:
    assert intended(action, situation) == meaning


@pytest.mark.parametrize(
    ("action", "situation", "then", "words"),
    [
        ("accept", now(), Accept(), "1 row is still flagged in model 102 / 103. Accept it?"),
        (
            "accept",
            now(snapshot=replace(picture(gross=False), solution=noisy(13.0))),
            Accept(),
            "Nothing is flagged in model 102 / 103, but sigma0 is 13 times its a-priori value. "
            "Accept it?",
        ),
        ("hand", now(), Toggle("hand"), "Take the simulated hand away?"),
        (
            "accept",
            now(snapshot=replace(picture(measured=11), may_accept=True)),
            Accept(),
            "Model 102 / 103 is incomplete, 2 of 13 points to go: 113, 114. Accept it?",
        ),
        (
            "accept",
            now(snapshot=replace(picture(), points=picture(measured=12).points)),
            Accept(),
            "Model 102 / 103 is incomplete, 1 of 13 points to go: 114. 1 row is still flagged",
        ),
        (
            "accept",
            now(snapshot=replace(picture(measured=12, may_accept=True), points=offered(12))),
            Accept(),
            "Model 102 / 103 is incomplete, 1 of 13 points to go: 114. Accept it?",
        ),
        ("leave", now(), Leave(), "Model 102 / 103 is not accepted yet."),
        (
            "leave",
            now(snapshot=replace(picture(), accepted=(("102", "103"),), reopened=True)),
            Leave(),
            "You returned to model 102 / 103: it stays open, and image_points.csv keeps it as it",
        ),
        (
            "keep_counters",
            now(snapshot=picture(unreferenced=True)),
            KeepCounters(),
            "Did the counters keep their origin",
        ),
    ],
)
def test_what_is_asked_first(action: str, situation: Situation, then: object, words: str) -> None:
    question = intended(action, situation)
    assert isinstance(question, Question)
    assert question.then == then
    assert question.text.startswith(words)


@pytest.mark.parametrize("action", ["left", "py_more", "automatic", "hand"])
def test_only_a_simulated_plotter_is_worked_from_here(action: str) -> None:
    assert isinstance(intended(action, now(controls=None, choices=STEREO)), Say)
    assert isinstance(intended(action, now(choices=STEREO)), Turn | Toggle)


@pytest.mark.parametrize(
    ("action", "situation", "words"),
    [
        ("zoom_in", now(), "the handwheels are those of a simulated plotter's stereo view (v)"),
        ("coarse", now(choices=STEREO, controls=None), "the handwheels are those of"),
        ("zoom_in", now(choices=zoomed(20)), "this is the smallest field"),
        ("zoom_out", now(choices=zoomed(-20)), "this is the widest field"),
        ("zoom_out", now(choices=STEREO), ""),
        ("transfers", now(snapshot=picture(gross=False)), "no critical transfers"),
        ("transfers", now(), ""),
        ("sort", now(), ""),
    ],
)
def test_what_changes_nothing_says_why(action: str, situation: Situation, words: str) -> None:
    said = idle(action, situation)
    assert said.startswith(words)
    assert bool(said) == bool(words)


def test_a_drive_is_told_and_where_there_is_none_what_happens_instead() -> None:
    assert answer(Drive("103"), picture()) == "to 103"
    undriven = picture(drives=False)
    assert answer(Drive("103"), undriven) == "103 is next: set the mark on it, then record"
    assert answer(Stop(), undriven) == "nothing to stop: this plotter has no drive"
    assert answer(Accept(), picture()) == ""


def test_the_stereo_view_takes_the_place_of_a_map_that_is_shown() -> None:
    choices = Choices()
    for action, panes, stereo in (
        ("stereo", "both", True),
        ("layout", "map", True),
        ("layout", "table", False),
        ("stereo", "both", True),
        ("stereo", "both", False),
        ("layout", "map", False),
    ):
        after = choices.after(action)
        assert after is not None
        assert (after.panes, after.stereo) == (panes, stereo)
        choices = after
    assert choices.after("record") is None


def test_the_words_on_leaving_are_true_of_a_demo_too() -> None:
    plain = replace(now(), temporary=True)
    asked = intended("leave", plain)
    assert isinstance(asked, Question)
    assert "deleted when you leave" in asked.text
    assert (asked.then, asked.other) == (Leave(), ("keep it, and leave", Leave(keep=True)))
    # between models, too, there is something to keep; with nothing measured there is not
    between = picture(left="", right="", accepted=(("101", "102"),))
    assert isinstance(intended("leave", replace(plain, snapshot=between)), Question)
    assert intended("leave", now(snapshot=between)) == Leave()
    nothing = picture(left="", right="", accepted=())
    assert intended("leave", replace(plain, snapshot=nothing)) == Leave()
    # a block that is simulated is none of a demo
    assert "deleted" not in intended("leave", now()).text
    real = intended("leave", now(snapshot=picture(link=LinkView("live", "p", "/dev/x"))))
    assert isinstance(real, Question)
    assert "demo" not in real.text


def test_a_model_of_which_one_photo_is_measured_is_not_left_without_a_question() -> None:
    nothing = picture(measured=0)
    assert intended("leave", now(snapshot=nothing)) == Leave()
    first, *others = nothing.points
    half = replace(nothing, points=(replace(first, seen=("left",)), *others))
    asked = intended("leave", now(snapshot=half))
    assert isinstance(asked, Question)
    assert asked.then == Leave()
