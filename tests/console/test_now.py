"""The line NOW with its keys, what Enter does, and the row that the cursor follows."""

from __future__ import annotations

from dataclasses import replace

import pytest
from consolefake import picture
from testedrows import with_rows

from anaplot.console.keymap import keys_in_force
from anaplot.console.now import Now, leading, longest_now, now_of
from anaplot.console.rows import ShownRow, shown_rows
from anaplot.session.nextstep import Agenda, Step
from anaplot.station.snapshot import LinkView, Snapshot

pytestmark = pytest.mark.smoke

KEYS = keys_in_force({})
AGAIN = Step("remeasure", "remeasure 103", "103")
OFF = Step("switch off", "switch it off", "103")
MEASURE = Step("measure", "measure 107", "107")
DONE = Agenda((AGAIN, OFF, Step("accept", "accept")))
LAY = Agenda((Step("lay", "lay photos 101 and 102"),), "next model")


def shown(agenda: Agenda, **changes: object) -> Snapshot:
    given: dict[str, object] = {"target": None, "expected": agenda.sentence}
    return picture(agenda=agenda, **(given | changes))


def by_hand(snapshot: Snapshot, point: str) -> ShownRow:
    return next(row for row in shown_rows(snapshot) if row.point == point)


@pytest.mark.parametrize(
    ("snapshot", "now"),
    [
        (
            shown(LAY, left="", right="", points=(), solution=None, diagnosis=None),
            Now("lay photos 101 and 102, then g (next model)", "next_model"),
        ),
        (
            shown(DONE),
            Now(
                "remeasure 103: Enter, or switch it off: x, or accept: a",
                "drive",
                "103",
                ("103", "y"),
            ),
        ),
        (
            shown(DONE, target="103"),
            Now(
                "remeasure 103, then space, or switch it off: x, or accept: a",
                "drive",
                "103",
                ("103", "y"),
            ),
        ),
        (
            shown(Agenda((MEASURE,), "8 of 13 points to go"), target="107", measured=5),
            Now("measure 107, then space (8 of 13 points to go)", "drive", "107", ("107", "y")),
        ),
        (
            shown(Agenda((AGAIN, MEASURE)), target="107", next_point="107"),
            Now("remeasure 103: Enter, or measure 107, then space", "drive", "103", ("103", "y")),
        ),
        (
            shown(Agenda((AGAIN, MEASURE)), target="103", next_point="107"),
            Now("remeasure 103, then space, or measure 107: n", "drive", "103", ("103", "y")),
        ),
        (
            shown(DONE, target="110"),
            Now(
                "measure 110, then space, or remeasure 103: Enter, or switch it off: x, "
                "or accept: a",
                "drive",
                "103",
                ("103", "y"),
            ),
        ),
        (
            shown(Agenda((Step("accept", "accept the model"),)), gross=False, target="114"),
            Now("measure 114, then space, or accept the model: a", "accept", None, ("114", "y")),
        ),
        (
            shown(Agenda((Step("resume", "work is suspended: resume"),)), suspended=True),
            Now("work is suspended: resume: p", "suspend", None, ("103", "y")),
        ),
        (
            # nothing is recorded meanwhile where the plates stand
            shown(
                Agenda((Step("resume", "work is suspended: resume"),)), suspended=True, target="110"
            ),
            Now("work is suspended: resume: p", "suspend", None, ("103", "y")),
        ),
        (
            shown(Agenda((Step("add", "add points"),), "not determined"), gross=False),
            Now("add points: + (not determined)", "add_point"),
        ),
    ],
)
def test_what_is_to_be_done_now(snapshot: Snapshot, now: Now) -> None:
    assert now_of(snapshot, KEYS) == now


@pytest.mark.parametrize(
    ("step", "action"),
    [
        (MEASURE, "next_point"),
        (AGAIN, "next_point"),
        (Step("lay", "lay photo 102 into the comparator"), "next_model"),
        (Step("accept", "accept"), "accept"),
        (Step("add", "add points"), "add_point"),
        (Step("resume", "work is suspended: resume"), "suspend"),
    ],
)
def test_with_which_key_the_model_goes_on(step: Step, action: str) -> None:
    assert leading(shown(Agenda((step,)))) == action


def test_what_enter_does_is_said_of_a_row_selected_by_hand_too() -> None:
    snapshot = shown(DONE)
    now = now_of(snapshot, KEYS, by_hand(snapshot, "110"))
    assert (now.text, now.point) == ("to 110: Enter, or remeasure 103: n", "110")
    same = now_of(snapshot, KEYS, by_hand(snapshot, "103"))
    assert same == now_of(snapshot, KEYS)
    between = shown(LAY)
    now = now_of(between, KEYS, by_hand(between, "110"))
    assert now.text == "to 110: Enter, or lay photos 101 and 102, then g (next model)"
    assert (now.action, now.point) == ("drive", "110")


@pytest.mark.parametrize(
    "snapshot",
    [shown(DONE), shown(LAY), shown(DONE, target="103"), shown(Agenda(())), shown(Agenda((OFF,)))],
)
def test_no_row_has_a_longer_sentence_than_the_longest(snapshot: Snapshot) -> None:
    rows = shown_rows(snapshot)
    texts = [now_of(snapshot, KEYS, row).text for row in (None, *rows)]
    longest = longest_now(snapshot, KEYS, [row.point for row in rows])
    assert longest in texts
    assert len(longest) == max(map(len, texts))


def test_without_a_drive_none_is_offered() -> None:
    pending = Agenda((MEASURE,), "8 of 13 points to go")
    snapshot = shown(pending, drives=False, measured=5)
    assert now_of(snapshot, KEYS).text == "measure 107, then space (8 of 13 points to go)"
    moved = now_of(snapshot, KEYS, by_hand(snapshot, "110"))
    assert moved.text.startswith("choose 110: Enter, or measure 107")
    assert now_of(shown(DONE, drives=False), KEYS).text.startswith("remeasure 103: Enter")


def test_the_keys_are_the_operators_own() -> None:
    keys = keys_in_force({"drive": "f6", "accept": "f9"})
    assert now_of(shown(DONE), keys).text.startswith("remeasure 103: f6, or")
    assert now_of(shown(DONE), keys).text.endswith("accept: f9")


def test_without_steps_the_sentence_stands_and_the_worst_row_is_followed() -> None:
    snapshot = replace(picture(expected="look around"), target="110")
    assert now_of(snapshot, KEYS) == Now("look around", "drive", "103", ("103", "y"))
    calm = replace(picture(gross=False, expected="look around"), target="110")
    assert now_of(calm, KEYS).row == ("110", "y")


def test_of_a_doubted_point_the_doubted_row_is_followed() -> None:
    solved = picture().solution
    assert solved is not None
    table = tuple(row._replace(flagged=row.key == ("103", "x"), w=9.9) for row in solved.table)
    given = picture().diagnosis
    assert given is not None
    snapshot = shown(
        DONE, solution=with_rows(solved, table), diagnosis=replace(given, suspects=(("103", "x"),))
    )
    assert now_of(snapshot, KEYS).row == ("103", "x")


@pytest.mark.parametrize("state", ["lost", "reconnecting"])
def test_while_the_line_is_away_nothing_is_to_be_measured_before_it_is_back(state: str) -> None:
    link = LinkView(state, "sim", "/dev/pts/7")
    agenda = Agenda((MEASURE,), "8 of 13 points to go")
    away = shown(agenda, target="107", measured=5, link=link)
    text = "wait for the line (look at cable and power), then measure 107, then space"
    now = now_of(away, KEYS)
    assert now.text == f"{text} (8 of 13 points to go)"
    assert longest_now(away, KEYS, []) == now.text
    assert now_of(replace(away, link=replace(link, state="live")), KEYS).text == (
        "measure 107, then space (8 of 13 points to go)"
    )
    # what needs no line is said as ever
    accept = shown(Agenda((Step("accept", "accept"),)), link=link)
    assert now_of(accept, KEYS).text == "accept: a"
    either = shown(Agenda((Step("accept", "accept"), AGAIN)), link=link)
    assert now_of(either, KEYS).text == (
        "accept: a, or wait for the line (look at cable and power), then remeasure 103: n"
    )
