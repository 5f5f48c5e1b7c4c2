"""The screen driven by its keys, over a station made of dataclasses."""

import contextlib
import re
import sys
import threading
from dataclasses import replace

import pytest
from consolefake import FakeStation, console, diagnosis, picture
from idealmodel import ideal_pair, spoiled
from rich.cells import cell_len
from screenreading import came, lines, selected, text, until
from sessionscene import Scene
from testedrows import with_rows

from anaplot.adjustment.strategies import STRATEGIES
from anaplot.console.app import KEPT, ConsoleApp, run_console
from anaplot.console.helptext import help_lines
from anaplot.console.keymap import keys_in_force
from anaplot.console.keys import ACTIONS
from anaplot.console.panels import DetailsPane, MessagePanel, ReadOutLine
from anaplot.errors import InputError, LinkError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.session.commanding import decide
from anaplot.session.desk import Desk
from anaplot.session.heard import Abilities, Seen
from anaplot.session.nextstep import Agenda, Step
from anaplot.session.othernames import OtherName
from anaplot.session.plates import ReadOut
from anaplot.station.snapshot import LinkView, snapshot_of
from anaplot.textfiles.wording import plain

SIZES = [(80, 24), (120, 40), (160, 50)]


class Listened(ConsoleApp):
    """Counts its bells."""

    def __init__(self, station, keymap=None):
        super().__init__(station, keymap)
        self.bells = 0

    def bell(self):
        self.bells += 1


AT_80_BY_24 = """\
 demo   strip 1   photos 102 | 103   model 2 of 4               SIMULATED  live
 ties propagated   test tau 0.001   sigma0 9.31 µm   r 12   1 flagged
 x'  -12.346 y'   98.765 x'' -104.250 y''   99.125 px   91.904 py   -0.360 mm
 NOW  measure point 103
  POINT    RED-N PARX µm EXPD µm  SIGF
  102   y  0.587     3.1     5.4  0.57 ok
▶ 103   y  0.602    41.7     5.5  7.60 << REMEASURE
  104   y  0.851    -2.2     6.5  0.34 ok
  105   y  0.574     5.9     5.4  1.10 ok
  106   y  0.611    -4.4     5.5  0.80 ok
  107   y  0.702    -8.6     5.9  1.45 ok
  108   y  0.793     1.3     6.3  0.21 ok
  109   y  0.688     2.0     5.9  0.34 ok
  110   y  0.566    -3.7     5.3  0.70 ok
  111   y  0.559     6.6     5.3  1.25 ok
  112   y  0.787    -0.4     6.3  0.06 ok
  113   y  0.571     2.8     5.3  0.52 ok
  114   y  0.583    -5.1     5.4  0.94 ok
 · remeasure 103 (y): 12 to 1 over 102
 · 103 y and 102 y are hard to tell apart (correlation 0.93)


 space Record  enter Drive  n Next  f Flag  a Accept  u Undo  x Row off
 X Point off  s Sort  t Arrows  m Map  v Stereo  d More  o Auto  ? Help  q Quit"""


async def test_the_screen_at_80_by_24():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        shown = lines(app)
        wanted = AT_80_BY_24.splitlines()
        assert len(shown) == len(wanted) == 24
        for i, (line, want) in enumerate(zip(shown, wanted, strict=True)):
            # The map stands to the right of the table.
            part = line[:52] if 4 <= i <= 17 else line
            assert part.rstrip() == want
        map_part = "\n".join(line[54:] for line in shown[4:18])
        for sign in ("(!)", "●", "µm residual", "○ open ● done ! flag x off"):
            assert sign in map_part
        assert "…" not in text(app)


async def test_a_real_models_sentences_are_shown_and_the_fakes_are_like_them():
    test = TestSettings("baarda", 0.001, 0.80)
    solution = orient(spoiled(ideal_pair("6/3"), "6", "y", 0.3), Precision(5.0, "paper"), test)
    advice = diagnose(solution).advice
    assert len(advice) > 1

    def shape(sentence: str) -> str:
        return re.sub(r"[\d.]+", "#", sentence)

    assert {shape(said) for said in diagnosis().advice} <= {shape(said) for said in advice}
    station = FakeStation(picture(solution=solution, diagnosis=diagnose(solution), points=()))
    app = console(station)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.pause()
        shown = text(app)
    for sentence in advice[:2]:
        assert sentence in shown


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("measured", [0, 5, 13])
async def test_everything_that_matters_is_there_at_every_size(size, measured):
    app = console(FakeStation(picture(measured=measured)))
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        shown = lines(app)
        assert len(shown) == size[1]
        assert {cell_len(line) for line in shown} == {size[0]}
        whole = "\n".join(shown)
        for part in (
            "demo", "strip 1", "102 | 103", "model 2 of 4", "SIMULATED", "live", "ties propagated",
            "test tau 0.001", "x'", "98.765", "px   91.904", "py   -0.360", "RED-N", "PARX µm",
            "EXPD µm", "SIGF", "● done", "? Help", "q Quit",
        ):  # fmt: skip
            assert part in whole
        assert "measure point" in whole
        assert ("<< REMEASURE" in whole) == (measured == 13)
        assert ("SELECTED ROW" in whole) == (size[0] >= 120)
        assert ("FINDS µm" in whole) == (size[0] >= 160)
        assert "…" not in whole


async def test_resizing_shows_more_and_less():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert not app.screen.query_one(DetailsPane).display
        await pilot.resize_terminal(160, 50)
        await until(pilot, lambda: "SELECTED ROW" in text(app))
        assert {len(line) for line in lines(app)} == {160}
        await pilot.resize_terminal(80, 24)
        await until(pilot, lambda: len(lines(app)) == 24 and "SELECTED ROW" not in text(app))
        assert "<< REMEASURE" in text(app)
        await pilot.resize_terminal(20, 6)
        await until(pilot, lambda: len(lines(app)) == 6)


@pytest.mark.parametrize(
    ("key", "call"),
    [
        ("space", ("record_point",)),
        ("f1", ("record_point",)),
        ("enter", ("drive", "103")),
        ("n", ("drive", "103")),
        ("g", ("next_model",)),
        ("u", ("undo",)),
        ("p", ("suspend",)),
        ("escape", ("stop",)),
        ("x", ("switch", "103", "y", False)),
        ("X", ("switch", "103", None, False)),
        ("o", ("set_automatic", True)),
    ],
)
async def test_a_key_gives_its_command(key, call):
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press(key)
        await came(station, *call)
    assert station.calls == [call]


async def test_enter_drives_to_the_row_of_the_cursor():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("home", "down", "down", "j", "k", "enter")
        await came(station, "drive", "104")
        await pilot.press("end", "enter")
        await came(station, "drive", "106")
        assert selected(app).key == ("106", "x")
        assert any(line.startswith("▶ 106   x") for line in lines(app))
        await pilot.press("pageup", "pageup", "up", "enter")
        await came(station, "drive", "102")
        await pilot.press("pagedown")
        assert selected(app).key == ("102", "x")


async def test_what_is_off_is_switched_on_again():
    points = picture().points
    row_off = replace(points[1], off_axes=("y",))
    station = FakeStation(picture(points=(points[0], row_off, *points[2:]), solution=None))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        assert selected(app).key == ("103", "y")  # the point under the mark
        await until(pilot, lambda: "x Row on" in text(app))
        await pilot.press("x")
        await came(station, "switch", "103", "y", True)
        await pilot.press("X")
        await came(station, "switch", "103", None, False)
        point_off = replace(points[1], status="off")
        station.tell(picture(serial=2, points=(points[0], point_off, *points[2:]), solution=None))
        await until(pilot, lambda: "X Point on" in text(app))
        await pilot.press("X")
        await came(station, "switch", "103", None, True)


async def test_accept_asks_when_rows_are_flagged():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("a")
        assert "1 row is still flagged in model 102 / 103" in text(app)
        await pilot.press("n")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        assert station.calls == []
        await pilot.press("f4", "y")
        await came(station, "accept")


async def test_accept_at_once_when_nothing_is_flagged():
    station = FakeStation(picture(gross=False))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("a")
        await came(station, "accept")
        assert len(app.screen_stack) == 1


async def test_accept_says_why_it_cannot():
    station = FakeStation(picture(measured=5))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("a")
        await until(pilot, lambda: "cannot be accepted now: six points" in text(app))
    assert station.calls == []


async def test_suspended_work_is_resumed():
    station = FakeStation(picture(suspended=True))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert " SUSPENDED " in text(app)
        assert "p Resume" in text(app)
        assert "space Record" not in text(app)
        await pilot.press("p")
        await came(station, "resume")


async def test_a_finished_strip_says_so():
    station = FakeStation(
        picture(finished=True, next_point=None, target=None, expected="the strip is finished")
    )
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert " DONE  the strip is finished" in text(app)
        await pilot.press("n")
        await until(pilot, lambda: "no point is expected next" in text(app))
        await pilot.press("q")
    assert app.return_value == 0


async def test_keys_without_a_row_say_so():
    nothing = picture(points=(), solution=None, diagnosis=None, left="", right="", strip="")
    station = FakeStation(nothing)
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        for key in ("enter", "x", "X", "d", "up", "end"):
            await pilot.press(key)
        await until(pilot, lambda: " no row is selected" in text(app))
        await pilot.press("f")
        await until(pilot, lambda: "no flagged row" in text(app))
        assert "warning:" not in text(app)
    assert station.calls == []


async def test_the_automatic_operator_is_for_simulated_plotters_only():
    station = FakeStation(picture(link=LinkView("live", "counter", "/dev/ttyUSB0", False, "")))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("o")
        await until(pilot, lambda: "only a simulated plotter" in text(app))
        assert "SIMULATED" not in text(app)
        assert "o Auto" not in text(app)
    assert station.calls == []


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ("live", "only a simulated plotter is worked from here"),
        ("replay", "this is a replay: one can only look on"),
    ],
)
async def test_where_no_simulated_hand_is_the_key_says_so(state, words):
    app = console(FakeStation(picture(link=LinkView(state, "counter", "", False, ""))))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("h")
        await until(pilot, lambda: words in text(app))


async def test_the_automatic_operator_is_in_plain_sight():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("o")
        await came(station, "set_automatic", True)
        await until(pilot, lambda: " AUTO " in lines(app)[1])
        await pilot.press("o")
        await came(station, "set_automatic", False)
        await until(pilot, lambda: " AUTO " not in lines(app)[1])


async def test_simulated_is_written_in_reverse():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        strip = app.screen._compositor.render_strips()[0]
        marked = [s for s in strip if "SIMULATED" in s.text]
        assert marked
        assert all(s.style.reverse for s in marked)


async def test_a_new_point_is_asked_for_by_name():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("+", "q", "[", "7", "enter")
        await came(station, "add_point", "q[7")
        await pilot.press("+", "enter")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        await pilot.press("+", "a", "escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
    assert station.calls == [("add_point", "q[7")]


async def test_one_key_and_enter_take_the_name_that_is_proposed():
    points = [view.point for view in picture().points]
    first, second = points[1:3]
    station = FakeStation(
        picture(other_names=(OtherName(first, second, "right"), OtherName(second, first, "right")))
    )
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        while selected(app).point != first:
            await pilot.press("j")
        assert "N Exchange" in text(app)
        await pilot.press("N")
        await until(pilot, lambda: f"{first} and {second} exchanged in" in text(app))
        await pilot.press("enter")
        await came(station, "rename", first, second, "right")
        # another name, in both photos: what is typed stands in place of what is proposed
        await pilot.press("N", "tab", "tab", "end", *["backspace"] * 9, "7")
        await until(pilot, lambda: f"{first} named 7 in " in text(app))
        await pilot.press("enter")
        await came(station, "rename", first, "7", None)
        await pilot.press("N", "escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
    assert len(station.calls) == 2


class AtDesk(FakeStation):
    """A station at a desk: what the console gives is decided there."""

    def __init__(self, desk):
        self.desk = desk
        super().__init__(snapshot_of(desk, 1, LinkView("live")))

    def give(self, command):
        self.desk = decide(self.desk, command, Seen(line="live")).after
        super().give(command)
        self.tell(snapshot_of(self.desk, self.current.serial + 1, self.current.link))


async def test_what_the_prompt_for_a_name_promises_is_what_the_desk_does():
    scene = Scene()
    station = AtDesk(Desk.at(scene.whole(scene.chosen()), Abilities()))
    first, second, third = (p.point for p in station.desk.state.current.plan[:3])
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        while selected(app).point != first:
            await pilot.press("j")
        # a name that the model does not have: nothing to exchange in one photo alone
        await pilot.press("N", "7")
        await until(pilot, lambda: f"{first} named 7 in both photos: in one alone" in text(app))
        await pilot.press("tab")
        await until(pilot, lambda: f"{first} named 7 in both photos: in one alone" in text(app))
        await pilot.press("enter")
        await came(station, "rename", first, "7", None)
        while selected(app).point != second:
            await pilot.press("j")
        await pilot.press("N", *third, "tab", "tab")
        await until(pilot, lambda: f"{second} and {third} exchanged in 102 alone" in text(app))
        before = station.desk.state.current
        await pilot.press("enter")
        await came(station, "rename", second, third, "right")
    after = station.desk.state.current
    assert after.place_of("right", second) == before.place_of("right", third)
    assert after.place_of("left", second) == before.place_of("left", second)
    assert after.measurement("7") is not None


async def test_photo_by_photo_a_name_is_of_the_photos_in_which_the_point_was_measured():
    shown = picture(mono=True)
    first, second = shown.points[:2]
    seen = (replace(first, seen=("left",)), *shown.points[1:])
    station = FakeStation(replace(shown, points=seen))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        while selected(app).point != first.point:
            await pilot.press("j")
        await pilot.press("N", *second.point)
        for where in ("in both photos", "in 102 alone", "in both photos"):
            await until(pilot, lambda where=where: f"{second.point} exchanged {where}" in text(app))
            await pilot.press("tab")
        await pilot.press("escape")
    assert station.calls == []


async def test_a_point_that_is_not_measured_has_no_other_name():
    station = FakeStation(picture(measured=3))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("end", "N")
        await until(pilot, lambda: "is not measured yet" in text(app))
    assert station.calls == []


async def test_sorting_keeps_the_cursor_on_its_row():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("end")
        for order in ("significance", "redundancy", "point"):
            await pilot.press("s")
            await until(pilot, lambda order=order: f"sorted by {order}" in text(app))
            assert selected(app).key == ("106", "x")
            assert any(line.startswith("▶ 106   x") for line in lines(app))
        await pilot.press("home")
        assert "POINT▴" in lines(app)[4]
        await pilot.press("s", "s", "home")
        assert "SIGF▾" in lines(app)[4]
        assert lines(app)[5].startswith("▶ 103   y")


async def test_map_and_table_alternate():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("m")
        await until(pilot, lambda: "RED-N" not in text(app))
        assert "(!)" in text(app)
        await pilot.press("m")
        await until(pilot, lambda: "FINDS µm" in text(app))
        assert "(!)" not in text(app)
        await pilot.press("m")
        await until(pilot, lambda: "RED-N" in text(app) and "(!)" in text(app))


async def test_all_transfers_or_those_of_the_row():
    app = console(FakeStation())
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause()
        before = [line[70:112] for line in lines(app)[4:38]]
        await pilot.press("t")
        await until(pilot, lambda: "critical transfers of all rows" in text(app))
        assert [line[70:112] for line in lines(app)[4:38]] != before
        await pilot.press("t")
        await until(pilot, lambda: [line[70:112] for line in lines(app)[4:38]] == before)


async def test_pages_explain():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("?")
        assert "Record the point under the mark" in text(app)  # the keys come first
        pages = [text(app)]
        for key in ("down", "up", *("pagedown",) * 16):
            await pilot.press(key)
            pages.append(text(app))
        assert pages[1] != pages[0]
        read = "\n".join(pages)
        # no line is skipped, the last one is there
        whole = [line.plain.strip() for line in help_lines(keys_in_force({}), 72)]
        assert [line for line in whole if line not in read] == []
        assert whole[-1] in pages[-1]
        # of actions that belong together the first speaks for all
        speakers = {action.group or action.id: action for action in reversed(ACTIONS)}
        assert all(action.help in read for action in speakers.values())
        await pilot.press("escape", "f2")
        assert "bx 91.8734, by 0.4121, bz -1.0932 mm" in text(app)
        assert "omega 0.70703" in text(app)
        await pilot.press("escape", "d")
        assert "12 to 1 over 102 y" in text(app)
        await pilot.press("escape", "l")
        assert "Messages" in text(app)
        await pilot.press("escape")
        assert len(app.screen_stack) == 1


async def test_details_follow_the_cursor_on_a_wide_screen():
    app = console(FakeStation())
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.pause()
        assert "shows as large in 107 y" in text(app)
        await pilot.press("home")
        await until(pilot, lambda: "102 y, tie" in text(app))


async def test_a_fault_is_one_line_and_the_work_goes_on():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        for fault in (LinkError("the plotter [b]does[/b] not answer"), RuntimeError("odd [/")):
            station.fault = fault
            await pilot.press("space")
            await until(pilot, lambda fault=fault: str(fault) in text(app))
            assert "error: " in lines(app)[21]
            assert "Traceback" not in text(app)
        station.calls.clear()
        await pilot.press("space")
        await came(station, "record_point")


async def test_messages_too_long_are_read_on_their_page():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        station.notice("warning", "word " * 30 + "end.")
        await until(pilot, lambda: "(l: all)" in text(app))
        await pilot.press("l")
        assert "end." in text(app)


async def test_the_bell_rings_on_a_record_and_on_a_new_flag():
    station = FakeStation(picture(gross=False))
    app = Listened(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert app.bells == 0
        station.notice("info", "nothing to ring for")
        station.notice("record", "103 recorded")
        await until(pilot, lambda: app.bells == 1)
        station.tell(picture(serial=2))
        await until(pilot, lambda: app.bells == 2)
        assert selected(app).key == ("103", "y")
        station.tell(picture(serial=3, expected="the same flag again"))
        await until(pilot, lambda: "the same flag again" in text(app))
        assert app.bells == 2


async def test_the_cursor_is_left_alone_once_moved_by_hand():
    station = FakeStation(picture(gross=False))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("end")
        station.tell(picture(serial=2))
        await until(pilot, lambda: "REMEASURE" in text(app) or "1 flagged" in text(app))
        assert selected(app).key == ("106", "x")
        await pilot.press("f")
        await until(pilot, lambda: selected(app).key == ("103", "y"))
        station.tell(picture(serial=3, left="103", right="104", measured=0))
        await until(pilot, lambda: "103 | 104" in text(app))
        assert selected(app).key == ("102", "y")


async def test_a_thousand_snapshots_show_the_newest():
    station = FakeStation(picture(gross=False))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        main = app.screen
        shown = []
        show = main._show
        main._show = lambda snapshot: (shown.append(snapshot.serial), show(snapshot))
        ready, go = threading.Event(), threading.Event()
        snapshots = [picture(serial=i, expected=f"number {i}") for i in range(2, 1002)]

        def pour():
            ready.set()
            go.wait(60)
            for snapshot in snapshots:
                station.tell(snapshot)

        thread = threading.Thread(target=pour)
        thread.start()
        ready.wait(60)
        go.set()
        # The event loop stands still meanwhile, as under load: nothing may queue up.
        thread.join(60)
        await until(pilot, lambda: "number 1001" in text(app))
        assert shown == [1001]


async def test_an_older_snapshot_never_replaces_a_newer_one():
    station = FakeStation(picture(serial=10))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        station.tell(picture(serial=9, expected="old news"))
        station.notice("info", "after it")
        await until(pilot, lambda: "after it" in text(app))
        assert "old news" not in text(app)


async def test_the_readout_is_live_or_it_is_dashes():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        station.read = ReadOut(1.0, -2.0, 3.5, -4.25)
        await until(pilot, lambda: "px   -2.500 py    2.250" in text(app))
        station.tell(picture(serial=2, link=LinkView("lost", "p", "/dev/x", True, "cable [b]out")))
        await until(pilot, lambda: " LOST " in text(app))
        await until(pilot, lambda: "px        –" in text(app))
        assert "warning: link: cable [b]out" in text(app)
        station.read = None
        station.tell(picture(serial=3))
        await until(pilot, lambda: " LOST " not in text(app))
        assert "px        –" in text(app)
        assert app.screen.query_one(ReadOutLine).size.height == 1


async def test_a_line_that_cannot_be_opened_is_told_once():
    station = FakeStation(picture(serial=10))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        said = []
        panel = app.screen.query_one(MessagePanel)
        panel.say = lambda severity, text: said.append(text)
        steps = [("lost", "unplugged"), ("reconnecting", "unplugged")]
        steps += [("lost", "no such port"), ("reconnecting", "no such port")] * 3
        steps += [("opening", ""), ("live", ""), ("lost", "unplugged")]
        for serial, (state, detail) in enumerate(steps, 11):
            station.tell(picture(serial=serial, link=LinkView(state, "p", "/dev/x", True, detail)))
            await until(pilot, lambda at=serial: app.screen_stack[0]._snapshot.serial == at)
        assert said == ["link: unplugged", "link: no such port", "link: unplugged"]


HOSTILE = ("[red]x[/]", "[/", "\x1b[2J", "a\nb", "[@click=app.exit]go[/]", "\u202eevil", "$error")


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("size", SIZES)
async def test_foreign_text_is_shown_as_it_is(name, size):
    points = picture().points
    odd = replace(points[0], point=name)
    solved = picture().solution
    table = tuple(
        row._replace(key=(name, row.axis), flagged=True, w=9.9) if row.point == "102" else row
        for row in solved.table
    )
    advised = replace(picture().diagnosis, advice=(f"remeasure {name}",), suspects=((name, "y"),))
    station = FakeStation(
        picture(
            block=name,
            strip=name,
            left=name,
            right=name,
            points=(odd, *points[1:]),
            target=name,
            next_point=name,
            solution=replace(with_rows(solved, table), remarks=(name,)),
            diagnosis=advised,
            problem=name,
            expected=f"measure {name}",
            link=LinkView("lost", name, name, True, name),
            tie_variance=name,
            test=name,
        )
    )
    app = console(station)
    safe = plain(name)
    async with app.run_test(size=size) as pilot:
        station.notice("error", f"fault {name}")
        station.notice(name, name)
        await until(pilot, lambda: f"remeasure {safe}" in text(app))
        assert f"measure {safe}" in text(app)
        for key in ("d", "f2", "l"):
            await pilot.press(key)
            await until(pilot, lambda: len(app.screen_stack) == 2)
            assert safe in text(app)
            assert {cell_len(line) for line in lines(app)} == {size[0]}
            await pilot.press("escape")
            await until(pilot, lambda: len(app.screen_stack) == 1)
        await pilot.press("a")
        await until(pilot, lambda: len(app.screen_stack) == 2)
        assert f"{safe} / {safe}"[:20] in text(app)
        everything = text(app)
        assert not any(c in everything for c in ("\x1b", "\u202e", "\x00"))
        await pilot.press("n")
        assert app.is_running


async def test_leaving_asks_while_a_model_is_in_progress():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("q")
        assert "Model 102 / 103 is not accepted yet" in text(app)
        await pilot.press("n")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        await pilot.press("ctrl+q")
        await until(pilot, lambda: len(app.screen_stack) == 2)
        await pilot.press("y")
    assert app.return_value == 0
    assert station.listeners == []
    assert station.notice_listeners == []


async def test_ctrl_c_leaves_and_twice_without_a_question():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("?", "ctrl+c")
        await until(pilot, lambda: "is not accepted yet" in text(app))
        await pilot.press("ctrl+c")
    assert app.return_value == 0


@pytest.mark.parametrize(
    "snapshot",
    [picture(measured=0), picture(accepted=(("102", "103"),)), picture(left="", right="")],
)
async def test_leaving_between_models_asks_nothing(snapshot):
    app = console(FakeStation(snapshot))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("q")
    assert app.return_value == 0


async def test_the_users_keys_replace_the_defaults():
    station = FakeStation()
    app = console(station, {"record": "n,f9", "next_point": "space", "undo": "ctrl+z"})
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("n")
        await came(station, "record_point")
        await pilot.press("space")
        await came(station, "drive", "103")
        await pilot.press("u", "f1", "ctrl+z")
        await came(station, "undo")
        assert station.calls == [("record_point",), ("drive", "103"), ("undo",)]
        assert "n Record" in text(app)
        assert "^z Undo" in text(app)


async def test_the_mouse_works():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.click("#table", offset=(5, 4))
        await until(pilot, lambda: selected(app).key == ("105", "y"))
        await pilot.click("#table", offset=(5, 6), times=2)
        await came(station, "drive", "107")
        at = lines(app)[22].index("Undo")
        await pilot.click("#keys", offset=(at, 0))
        await came(station, "undo")
        await pilot.click("#table", offset=(5, 0))
        await pilot.click("#keys", offset=(79, 1))
        assert selected(app).key == ("107", "y")


async def test_the_palette_offers_actions_and_points():
    points = picture().points
    odd = replace(points[0], point="[b]7")
    station = FakeStation(picture(points=(odd, *points[1:])))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("ctrl+p")
        await until(
            pilot,
            lambda: (
                "Record the point under the mark" in text(app) or "Accept the model" in text(app)
            ),
        )
        await pilot.press(*"drive to [b]7")
        await until(pilot, lambda: "Drive to [b]7" in text(app))
        await pilot.press("enter")
        await came(station, "drive", "[b]7")


async def test_redrawing_changes_nothing():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        before = text(app)
        await pilot.press("r")
        await pilot.pause()
        assert text(app) == before


async def test_every_action_has_a_binding_with_its_id_and_a_meaning():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        main = app.screen
        actions = {
            active.binding.id: active.binding.action for active in main.active_bindings.values()
        }
        for action in ACTIONS:
            assert actions[action.id] == f"press({action.id!r})"
            assert main.action_press(action.id) is None
            await pilot.pause()
            while app.screen is not main:
                await pilot.press("escape")
        with pytest.raises(ValueError, match="no meaning of 'dance'"):
            main.action_press("dance")


async def test_a_long_expectation_takes_two_lines():
    expected = (
        "drive to point 103 with n, clear both parallaxes, then press space or the pedal: again"
    )
    app = console(FakeStation(picture(expected=expected)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert " ".join(text(app).split()).count(expected.split(",")[1]) == 1
        assert "again" in lines(app)[4]
        assert "q Quit" in lines(app)[23]


async def test_nothing_moves_up_or_down_with_the_cursor():
    again = Step("remeasure", "103 and 104 are interchanged? remeasure 103", "103")
    agenda = Agenda((again, Step("switch off", "switch it off"), Step("accept", "accept")))
    app = console(FakeStation(picture(agenda=agenda, target=None)))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "accept: a" in lines(app)[4]
        assert lines(app)[5].strip().startswith("POINT")
        await pilot.press("j", "j")
        await until(pilot, lambda: "to 105: Enter, or 103 and 104" in lines(app)[3])
        assert lines(app)[4].strip() == ""
        assert lines(app)[5].strip().startswith("POINT")
        await pilot.press("k", "k")
        await until(pilot, lambda: "accept: a" in lines(app)[4])


async def test_too_much_advice_says_how_much_more_there_is():
    advice = tuple(f"sentence number {i}" for i in range(6))
    station = FakeStation(picture(diagnosis=replace(picture().diagnosis, advice=advice)))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "(+3 lines: F2)" in text(app)
        await pilot.press("f2", "pagedown", "pagedown")
        assert "sentence number 5" in text(app)


async def test_messages_are_kept_within_bounds():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        for i in range(1000):
            station.notice("info", f"message {i}")
        await until(pilot, lambda: "message 999" in text(app))
        assert len(app.screen.query_one(MessagePanel).history(70)) <= 200


def test_running_closes_the_station_whatever_happens(tmp_path):
    station = FakeStation()
    with pytest.raises(InputError, match="file not found"):
        run_console(station, keymap=tmp_path / "none.toml")
    assert station.closed == 1


@pytest.mark.parametrize("fails", [False, True])
def test_running_leaves_threads_to_take_turns_as_before(monkeypatch, tmp_path, fails):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    before, within = sys.getswitchinterval(), []

    def run(self, **_):
        within.append(sys.getswitchinterval())
        if fails:
            raise InputError("no screen")

    monkeypatch.setattr(ConsoleApp, "run", run)
    station = FakeStation()
    with pytest.raises(InputError) if fails else contextlib.nullcontext():
        run_console(station)
    assert within[0] < before
    assert sys.getswitchinterval() == before


def test_running_returns_what_the_application_says(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    (tmp_path / "anaplot").mkdir()
    (tmp_path / "anaplot" / "keymap.toml").write_text('record = "f5"\n')
    seen = []

    def run(self, **_):
        seen.append(self._keys_of_user)

    monkeypatch.setattr(ConsoleApp, "run", run)
    station = FakeStation()
    assert run_console(station) == 0
    assert seen == [{"record": "f5"}]
    assert station.closed == 1


def test_the_station_is_closed_before_threads_are_waited_for(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    station, let, waited = FakeStation(), threading.Event(), []
    close = station.close

    def closing():
        close()
        let.set()

    def run(self, *, loop):
        async def left():
            loop.run_in_executor(None, lambda: waited.append(let.wait(10)))

        loop.run_until_complete(left())

    monkeypatch.setattr(station, "close", closing)
    monkeypatch.setattr(ConsoleApp, "run", run)
    assert run_console(station) == 0
    assert waited == [True]


async def test_large_numbers_and_longer_names_keep_apart():
    points = tuple(replace(view, point=f"{view.point}-1'") for view in picture().points)
    solved = picture().solution
    table = tuple(
        row._replace(
            key=(f"{row.point}-1'", row.axis), residual=-2519.14, expected=1234.56, w=274.67
        )
        for row in solved.table
    )
    solved = with_rows(solved, table, sigma0=557.49 / 5.0)
    station = FakeStation(picture(points=points, solution=solved, test="baarda 0.001"))
    station.automatic = True
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert any(
            line.startswith("  102-1' y  0.587 -2519.1  1234.6 274.7 ") for line in lines(app)
        )
        assert lines(app)[1].rstrip().endswith("AUTO")
        assert "sigma0 557 µm" in lines(app)[1]
        assert "1 flagged" in lines(app)[1]


async def test_the_cursor_follows_now_until_it_is_moved_and_again_after_a_record():
    again = Agenda((Step("remeasure", "remeasure 103", "103"), Step("accept", "accept")))
    station = FakeStation(picture(gross=False, measured=5))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert selected(app).key == ("107", "y")  # under the mark
        station.tell(picture(serial=2, agenda=again, target=None))
        await until(pilot, lambda: "NOW  remeasure 103: Enter, or accept: a" in text(app))
        assert selected(app).key == ("103", "y")
        await pilot.press("end")
        assert selected(app).key == ("106", "x")
        assert "NOW  to 106: Enter, or remeasure 103: n" in text(app)
        station.tell(picture(serial=3, agenda=again, target=None, test="tau 0.002"))
        await until(pilot, lambda: "tau 0.002" in text(app))
        assert selected(app).key == ("106", "x")
        await pilot.press("enter")
        await came(station, "drive", "106")
        assert " to 106" in lines(app)[21]
        points = tuple(replace(p, times=1 + (p.point == "106")) for p in picture().points)
        station.tell(picture(serial=4, agenda=again, target=None, points=points))
        await until(pilot, lambda: selected(app).key == ("103", "y"))
        await pilot.press("enter")
        await came(station, "drive", "103")
        # chosen with f it is the row of the line NOW as well
        await pilot.press("home", "f")
        assert selected(app).key == ("103", "y")
        assert "NOW  remeasure 103: Enter" in text(app)


async def test_enter_does_what_now_says():
    lay = Agenda((Step("lay", "lay photos 101 and 102"),), "next model")
    nothing = {"points": (), "solution": None, "diagnosis": None, "left": "", "right": ""}
    station = FakeStation(picture(agenda=lay, target=None, next_point=None, **nothing))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "NOW  lay photos 101 and 102, then g" in text(app)
        assert "enter Model" in text(app)
        await pilot.press("enter")
        await came(station, "next_model")
        accept = Agenda((Step("accept", "accept the model"),))
        station.tell(picture(serial=2, gross=False, agenda=accept, target=None, next_point=None))
        await until(pilot, lambda: "accept the model: a" in text(app) and "enter Acc" in text(app))
        await pilot.press("enter")
        await came(station, "accept")


@pytest.mark.parametrize("size", [(80, 24), (160, 50)])
async def test_flagged_rows_out_of_sight_are_counted(size):
    solved = picture().solution
    bad = {("102", "y"), ("103", "y"), ("104", "x"), ("105", "x"), ("106", "x")}
    table = tuple(row._replace(flagged=row.key in bad, w=9.9) for row in solved.table)
    station = FakeStation(picture(solution=with_rows(solved, table)))
    app = console(station)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        if size[1] > 24:
            assert "flagged below" not in text(app)
            return
        assert any(line.startswith("▶ 103   y") for line in lines(app))
        assert lines(app)[17].startswith("  ↓ 3 flagged below ")
        await pilot.press("end")
        await until(pilot, lambda: lines(app)[17].startswith("  ↑ 2 flagged above "))
        assert lines(app)[16].startswith("▶ 106   x")
        await pilot.press(*("up",) * 2)
        for row in range(18):  # wherever the cursor is, its row is in sight
            await pilot.press("home", *("down",) * row)
            assert any(line.startswith("▶") for line in lines(app)[5:17])
        await pilot.click("#table", offset=(5, 13))  # the note is no row
        assert selected(app).key == ("106", "x")


async def test_a_second_a_accepts_what_is_incomplete():
    station = FakeStation(replace(picture(measured=11, gross=False), may_accept=True))
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("a")
        assert "Model 102 / 103 is incomplete, 2 of 13 points to go: 113" in text(app)
        assert "y, a accept as it is" in text(app)
        await pilot.press("escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        assert station.calls == []
        await pilot.press("a", "a")
        await came(station, "accept")
    app = console(FakeStation(station.current), {"accept": "f9"})
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("f9", "a")
        assert len(app.screen_stack) == 2
        await pilot.press("f9")
        await until(pilot, lambda: len(app.screen_stack) == 1)


async def test_the_simulated_hand_does_not_go_silently():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("h")
        assert "Take the simulated hand away?" in text(app)
        assert "hand off" not in lines(app)[1]
        await pilot.press("n")
        await until(pilot, lambda: len(app.screen_stack) == 1)
        assert station.calls == []
        await pilot.press("h", "h")
        await came(station, "set_hand", False)
        await until(pilot, lambda: lines(app)[1].rstrip().endswith("hand off"))
        await pilot.press("h")
        await came(station, "set_hand", True)
        await until(pilot, lambda: "hand off" not in lines(app)[1])


async def test_every_key_answers():
    station = FakeStation()
    app = console(station)
    quiet = {"redraw"}  # the screen is drawn again, and looks the same
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause()
        main = app.screen
        await pilot.press("home")
        for action in ACTIONS:
            if action.id in quiet:
                continue
            station.calls.clear()
            app.screen.query_one(MessagePanel).clear()
            await pilot.pause()
            before = text(app)
            main.action_press(action.id)
            await until(pilot, lambda before=before: text(app) != before or station.calls)
            while app.screen is not main:
                await pilot.press("escape")
        for key in ("y", "i", "ctrl+x", "tab", "f11"):
            await pilot.press(key)
            await until(pilot, lambda: "means nothing here (? helps)" in text(app))
        await pilot.press("home", "home")
        assert "this is the first row" in text(app)
        await pilot.press("end", "end")
        assert "this is the last row" in text(app)


async def test_old_messages_go():
    station = FakeStation()
    app = console(station)
    async with app.run_test(size=(80, 24)) as pilot:
        station.notice("info", "undone: 102-3 x on again")
        await until(pilot, lambda: "undone: 102-3 x on again" in text(app))
        await pilot.press("home")
        assert "undone:" not in text(app)
        await pilot.press("l")
        assert "undone: 102-3 x on again" in text(app)


def test_messages_age():
    now = [0.0]
    panel = MessagePanel(clock=lambda: now[0])
    panel.say("error", "the link is lost")
    panel.say("info", "a word")
    now[0] = 9.0
    panel.age()
    assert len(panel.lines(80, 5)) == 2
    now[0] = 11.0
    panel.age()
    assert [line.plain for line in panel.lines(80, 5)] == [" error: the link is lost"]
    assert len(panel.history(80)) == 2


async def test_the_help_is_filtered_and_knows_all_strategies():
    app = console(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("?", "/")
        await pilot.press(*"danish")
        await until(pilot, lambda: "what lies far off soon counts nothing" in text(app))
        assert "Record the point" not in text(app)
        await pilot.press("q", "q")  # words, not the end
        await until(pilot, lambda: "Nothing here about danishqq" in text(app))
        await pilot.press("escape")
        await until(pilot, lambda: "Record the point" in text(app))
        await pilot.press("escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)
    said = "\n".join(line.plain for line in help_lines(keys_in_force({}), 72))
    assert all(f"\n{name} " in said for name in STRATEGIES)


async def test_the_culprit_looks_different_without_colour_too():
    solved = picture().solution
    bad = {("102", "y"), ("103", "y")}
    table = tuple(row._replace(flagged=row.key in bad, w=9.9) for row in solved.table)
    points = tuple(
        replace(p, status="flagged") if p.point in ("102", "103") else p for p in picture().points
    )
    station = FakeStation(
        picture(solution=with_rows(solved, table), points=points, target=None, serial=2)
    )
    app = console(station)
    async with app.run_test(size=(160, 50)) as pilot:
        await pilot.pause()
        marks = [
            segment.style.reverse
            for strip in app.screen._compositor.render_strips()
            for segment in strip
            if segment.text.strip() in ("!", "<< REMEASURE", "< flagged")
        ]
    assert sorted(map(bool, marks)) == [False, False, True, True]


@pytest.mark.parametrize(("key", "result"), [("k", KEPT), ("y", 0)])
async def test_the_block_of_a_demo_is_kept_or_deleted(key, result):
    app = ConsoleApp(FakeStation(), temporary=True)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("q")
        await until(pilot, lambda: len(app.screen_stack) == 2)
        assert "k keep it, and leave" in text(app)
        await pilot.press(key)
    assert app.return_value == result


async def test_where_nothing_would_be_deleted_k_is_no_answer():
    app = ConsoleApp(FakeStation())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("q")
        await until(pilot, lambda: len(app.screen_stack) == 2)
        await pilot.press("k")
        await pilot.pause()
        assert len(app.screen_stack) == 2
        assert "keep it" not in text(app)
