from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.hand import Hand
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.profile import find_profiles, load_profile, parse_profile
from anaplot.plotter.readings import UNREFERENCED, Fault, InPosition, Position, Record, Refused

CONFIRMED = load_profile("anaplot-ascii")
# what a record says by itself
ASCII = replace(CONFIRMED, confirm=False)
HERE = b"+012.3456 -034.5678 +012.0000 -034.5000"
PLACE = Position(12.3456, -34.5678, 12.0, -34.5)


def lines(*texts: bytes) -> bytes:
    return b"".join(text + b"\n" for text in texts)


def summed(text: bytes, profile=ASCII) -> bytes:
    return text + profile.checksum.digits(text)


def only(readings):
    (reading,) = readings
    return reading


def refusal(readings) -> str:
    reading = only(readings)
    assert isinstance(reading, Refused)
    return reading.reason


def test_readings_of_the_line_protocol():
    decoder = Decoder(ASCII)
    data = lines(b"P " + HERE, b"R 1 1 " + HERE, b"R 2 2 " + HERE, b"D " + HERE, b"E 2 stuck")
    assert decoder.feed(data, 0.0) == [
        PLACE,
        Record(PLACE, "pedal", 1),
        Record(PLACE, "second", 2),
        InPosition(PLACE),
        Fault("2", "stuck"),
    ]
    assert decoder.axes == {"xl": 12.3456, "yl": -34.5678, "xr": 12.0, "yr": -34.5}


def test_checksum_may_be_left_out_until_it_was_sent_once():
    decoder = Decoder(ASCII)
    assert decoder.feed(lines(b"P " + HERE), 0.0) == [PLACE]
    assert decoder.feed(lines(summed(b"P " + HERE) + b"\r"), 0.0) == [PLACE]
    assert refusal(decoder.feed(lines(b"P " + HERE), 0.0)) == "the checksum is missing"
    decoder.reopen()
    decoder.confirm_reference()
    assert decoder.feed(lines(b"P " + HERE), 0.0) == [PLACE]


def test_wrong_checksum():
    decoder = Decoder(ASCII)
    text = summed(b"P " + HERE).replace(b"12.3456", b"12.3457")
    assert refusal(decoder.feed(lines(text), 0.0)) == "the checksum is wrong"


def test_every_single_turned_bit_is_refused_with_checksum(simulated):
    text = summed(b"P " + HERE, simulated)
    for at in range(len(text)):
        for bit in range(8):
            raw = bytearray(text)
            raw[at] ^= 1 << bit
            for reading in Decoder(simulated).feed(bytes(raw) + b"\n", 0.0):
                # lower case digits of a checksum are the same checksum
                assert isinstance(reading, Refused) or reading == PLACE


def test_the_range_is_kept():
    decoder = Decoder(ASCII)
    reason = refusal(decoder.feed(lines(b"P " + HERE.replace(b"+012.3", b"+162.3")), 0.0))
    assert reason == "axis xl at 162.3456 mm is outside its range -160 to 160 mm"


def test_numbered_records_come_once_and_gaps_are_told():
    decoder = Decoder(ASCII)
    decoder.feed(lines(b"R 7 1 " + HERE), 0.0)
    assert refusal(decoder.feed(lines(b"R 7 1 " + HERE), 0.0)) == "record 7 came twice"
    fault, record = decoder.feed(lines(b"R 9 1 " + HERE), 0.0)
    assert fault == Fault("missing", "record 8 did not arrive")
    assert record == Record(PLACE, "pedal", 9)
    fault, record = decoder.feed(lines(b"R 14 1 " + HERE), 0.0)
    assert fault == Fault("missing", "records 10 to 13 did not arrive")


def test_a_record_is_confirmed_by_an_answer_that_is_asked_for_at_once():
    record = lines(b"R 1 1 " + HERE)

    def wait(*parts: bytes, behind: bytes = b"") -> float:
        """Return how long is waited for the line once these have come, 2 ms apart.

        `behind`: what comes at once with the answer before them.
        """
        decoder = Decoder(CONFIRMED)
        poller = decoder.poller
        assert poller is not None
        poller.begin(0.0)
        decoder.sent(b"?\n", now=0.0)
        for k, part in enumerate((lines(b"P " + HERE) + behind, *parts), 1):
            decoder.feed(part, 0.002 * k)
        poller.urge()
        return poller.wait(0.002 * (1 + len(parts)))

    assert wait() == pytest.approx(0.02)
    assert wait(record) == 0.0
    assert wait(record[:20], record[20:]) == 0.0
    assert wait(behind=record) == 0.0
    assert wait(record[20:], behind=record[:20]) == 0.0
    # the rest of it is not known yet, or it may be an answer
    assert wait(record[:20]) == pytest.approx(0.02)
    assert wait(record + b"P ") == pytest.approx(0.02)
    assert wait(lines(b"P " + HERE, record[:-1])) == pytest.approx(0.02)
    assert wait(lines(b"P " + HERE), record[:-2] + b"x\n") == pytest.approx(0.02)


def test_after_a_bare_press_the_line_must_be_quiet():
    """Else an answer that comes twice answers the request after the press: the place before it."""
    pattern = re.compile(rb"^R (?P<number>\d{1,6}) (?P<switch>[1-9])$")
    bare = replace(ASCII.records["pressed"], pattern=pattern, send=None)
    axes = {
        name: replace(axis, records=tuple(one for one in axis.records if one != "pressed"))
        for name, axis in ASCII.axes.items()
    }
    decoder = Decoder(replace(ASCII, records={**ASCII.records, "pressed": bare}, axes=axes))
    poller = decoder.poller
    assert poller is not None
    poller.begin(0.0)
    decoder.sent(b"?\n", now=0.0)
    assert decoder.feed(lines(b"P " + HERE), 0.02) == [PLACE]
    assert decoder.feed(lines(b"R 1 1"), 0.0205) == []
    poller.urge()
    assert poller.wait(0.0205) == pytest.approx(0.02)
    refused, again = decoder.feed(lines(b"P " + HERE), 0.0235)
    assert again == PLACE
    assert refused == Refused(b"", "pedal was not recorded: a position came that was not asked for")
    assert poller.wait(0.0235) == pytest.approx(0.02)


def test_a_number_counts_even_when_its_record_is_refused():
    decoder = Decoder(ASCII)
    decoder.feed(lines(b"R 1 1 " + HERE), 0.0)
    assert "range" in refusal(decoder.feed(lines(b"R 2 1 " + HERE.replace(b"+0", b"+9")), 0.0))
    assert only(decoder.feed(lines(b"R 3 1 " + HERE), 0.0)) == Record(PLACE, "pedal", 3)


def test_a_device_that_restarted_has_lost_its_origin(simulated):
    decoder = Decoder(ASCII)
    decoder.feed(lines(b"R 7 1 " + HERE), 0.0)
    fault, refused = decoder.feed(lines(b"R 1 1 " + HERE), 0.0)
    assert fault == Fault("restarted", "the device has restarted")
    assert isinstance(refused, Refused)
    assert refused.reason == UNREFERENCED
    absolute = Decoder(simulated)
    absolute.feed(lines(summed(b"R 7 1 " + HERE, simulated)), 0.0)
    assert only(absolute.feed(lines(summed(b"R 1 1 " + HERE, simulated)), 0.0)).number == 1


def test_the_count_wraps():
    decoder = Decoder(ASCII)
    decoder.feed(lines(b"R 999999 1 " + HERE), 0.0)
    assert only(decoder.feed(lines(b"R 1 1 " + HERE), 0.0)) == Record(PLACE, "pedal", 1)
    assert decoder.referenced


def test_counters_are_unreferenced_after_a_lost_line_until_measured_again():
    decoder = Decoder(ASCII)
    decoder.feed(lines(b"P " + HERE), 0.0)
    decoder.reopen("main")
    assert not decoder.referenced
    with pytest.raises(InputError, match="nothing to refer to"):
        decoder.reference(PLACE)
    zero = b"+000.0000 +000.0000 +000.0000 +000.0000"
    assert refusal(decoder.feed(lines(b"P " + zero), 1.0)) == UNREFERENCED
    assert refusal(decoder.feed(lines(b"R 1 1 " + zero), 1.0)) == UNREFERENCED
    assert decoder.feed(lines(b"D " + zero), 1.0) == [InPosition(None)]
    assert decoder.unreferenced_position == Position(0.0, 0.0, 0.0, 0.0)
    with pytest.raises(InputError, match="lost their reference"):
        decoder.drive_command(PLACE)
    assert decoder.reference(PLACE) == PLACE
    assert decoder.feed(lines(b"P " + zero), 1.0) == [PLACE]
    # commands count from the device's own origin
    assert decoder.drive_command(PLACE).startswith(b"G " + zero)


def test_any_number_below_the_last_is_a_restart_unless_the_record_came_before():
    decoder = Decoder(ASCII)
    there = HERE.replace(b"+012.3456", b"+000.0010")
    decoder.feed(lines(b"R 6 1 " + HERE, b"R 7 1 " + there), 0.0)
    assert refusal(decoder.feed(lines(b"R 6 1 " + HERE), 0.0)) == "record 6 came twice"
    assert refusal(decoder.feed(lines(b"R 7 1 " + there), 0.0)) == "record 7 came twice"
    assert decoder.referenced
    # the box was off, and its third press came after the line had heard nothing of the first two
    fault, refused = decoder.feed(lines(b"R 3 1 " + there), 0.0)
    assert fault == Fault("restarted", "the device has restarted")
    assert refused.reason == UNREFERENCED
    # by chance the same number, elsewhere
    decoder.confirm_reference()
    fault, _ = decoder.feed(lines(b"R 3 1 " + HERE), 0.0)
    assert fault.code == "restarted"


def test_a_gap_over_the_end_of_the_count():
    decoder = Decoder(ASCII)
    decoder.feed(lines(b"R 999997 1 " + HERE), 0.0)
    fault, record = decoder.feed(lines(b"R 2 1 " + HERE), 0.0)
    assert fault == Fault("missing", "records 999998 to 1 did not arrive")
    assert record.number == 2
    assert decoder.referenced


def test_a_late_answer_is_not_the_one_to_the_request_after_the_press():
    decoder = Decoder(ASCII)
    request = decoder.poll_request()
    there = HERE.replace(b"+012.3456", b"+015.0000")
    decoder.sent(request, now=0.0)
    decoder.press("key", 0.50)
    decoder.sent(request, now=0.51)
    assert decoder.feed(lines(b"P " + HERE), 0.60) == [PLACE]
    position, record = decoder.feed(lines(b"P " + there), 0.70)
    assert record == Record(position, "key")
    assert record.position.xl == 15.0


def test_a_press_is_refused_when_the_device_answers_unasked():
    decoder = Decoder(ASCII)
    decoder.sent(decoder.poll_request(), now=0.0)
    decoder.press("key", 0.1)
    assert decoder.feed(lines(b"P " + HERE), 0.2) == [PLACE]
    refused, position = decoder.feed(lines(b"P " + HERE), 0.2)
    assert refused.reason == "key was not recorded: a position came that was not asked for"
    assert position == PLACE


def test_a_press_about_a_pause_of_a_stream_is_refused():
    decoder = Decoder(parse_profile(UNCONFIRMED.encode(), "pxpy.toml"))
    decoder.feed(b"0 0 0 0\n", 0.0)
    decoder.press("key", 2.0)
    # what was held up somewhere for two seconds comes at once
    _, refused = decoder.feed(b"0 0 0 0\n", 2.1)
    assert refused.reason == "key was not recorded: the line stood still: press again"
    decoder.press("key", 2.2)
    assert "stood still" in decoder.feed(b"0 0 0 0\n", 2.2)[1].reason
    decoder.feed(b"0 0 0 0\n", 2.5)
    decoder.press("key", 2.7)
    decoder.feed(b"0 0 0 0\n", 2.8)
    assert isinstance(decoder.feed(b"0 0 0 0\n", 2.9)[-1], Record)


def test_an_absolute_device_keeps_its_origin(simulated):
    decoder = Decoder(simulated)
    decoder.reopen()
    assert decoder.feed(lines(summed(b"P " + HERE, simulated)), 0.0) == [PLACE]


def test_commands():
    decoder = Decoder(ASCII)
    assert decoder.poll_request() == b"?\n"
    assert decoder.drive_command(PLACE) == summed(b"G " + HERE) + b"\n"
    assert decoder.stop_command() == summed(b"S") + b"\n"


@pytest.mark.parametrize("value", [math.nan, math.inf, -161.0, 160.001])
def test_a_drive_stays_within_its_limits(value):
    with pytest.raises(InputError, match=r"limits|not a number"):
        Decoder(ASCII).drive_command(Position(0.0, value, 0.0, 0.0))


def test_what_a_hand_driven_counter_cannot_do():
    decoder = Decoder(load_profile("heidenhain-nd281b"))
    with pytest.raises(InputError, match="no drive"):
        decoder.drive_command(PLACE)
    with pytest.raises(InputError, match="no drive"):
        decoder.stop_command()
    with pytest.raises(InputError, match="speaks by itself"):
        Decoder(load_profile("mitutoyo-gauge")).poll_request()


def nd(value: str) -> bytes:
    return f"{value[0]}{value[1:]:>10}  =A\r\n".encode()


def test_a_position_of_four_displays_is_made_of_one_cycle():
    decoder = Decoder(load_profile("heidenhain-nd281b"))
    assert decoder.feed(nd("+1.5"), 0.0, "xl") == []
    assert decoder.feed(nd("-2.5"), 0.0, "yl") == []
    assert decoder.feed(nd("+3.5"), 0.0, "xr") == []
    assert decoder.feed(nd("-.5"), 0.0, "yr") == [Position(1.5, -2.5, 3.5, -0.5)]
    for name in ("xl", "yl", "xr"):
        decoder.feed(nd("+9.0"), 0.1, name)
    decoder.sent(b"\x02", "xl", 0.1)
    # the last answer of the cycle before makes no position with the first ones of this
    assert decoder.feed(nd("+8.0"), 0.1, "yr") == []
    for name in ("xl", "yl"):
        assert decoder.feed(nd("+8.0"), 0.1, name) == []
    assert decoder.feed(nd("+8.0"), 0.1, "xr") == [Position(8.0, 8.0, 8.0, 8.0)]


def test_axes_heard_too_far_apart_make_no_position():
    decoder = Decoder(load_profile("mitutoyo-gauge"))
    gauge = b"01A+0001.000\r"
    assert decoder.feed(gauge * 2, 0.0, "x") == []
    assert decoder.feed(gauge * 2, 0.6, "y") == []
    position, record = decoder.feed(gauge * 2, 0.7, "x")
    assert isinstance(position, Position)
    assert record == Record(position, "pedal")


def test_a_key_records_the_next_position_and_none_from_before():
    decoder = Decoder(replace(load_profile("heidenhain-nd281b"), confirm=False))
    decoder.sent(b"\x02", "xl", 0.0)
    for name in ("xl", "yl", "xr"):
        decoder.feed(nd("+1.0"), 0.0, name)
    decoder.press("key", 0.0)
    # this answer was asked for before the press
    assert decoder.feed(nd("+1.0"), 0.0, "yr") == [Position(1.0, 1.0, 1.0, 1.0)]
    decoder.sent(b"\x02", "xl", 0.1)
    for name in ("xl", "yl", "xr"):
        decoder.feed(nd("+2.0"), 0.1, name)
    position, record = decoder.feed(nd("+2.0"), 0.1, "yr")
    assert position == Position(2.0, 2.0, 2.0, 2.0)
    assert record == Record(position, "key")


def test_a_key_at_a_device_that_speaks_by_itself_takes_the_second_position():
    decoder = Decoder(parse_profile(UNCONFIRMED.encode(), "pxpy.toml"))
    decoder.press("key", 0.0)
    assert len(decoder.feed(b"0 0 0 0\n", 0.0)) == 1
    position, record = decoder.feed(b"200 0 0 0\n", 0.0)
    assert record == Record(position, "key")
    assert position.xl == -149.0


def test_a_press_without_an_answer_or_with_a_bad_one_is_refused():
    decoder = Decoder(ASCII)
    decoder.press("key", 0.0)
    assert decoder.tick(0.5) == []
    assert refusal(decoder.tick(1.5)) == "key was not recorded: no position came after it"
    decoder.press("key", 2.0)
    first, second = decoder.feed(lines(b"P ?"), 2.1)
    assert first.reason == "no record of anaplot-ascii"
    assert second.reason == "key was not recorded: no record of anaplot-ascii"
    assert decoder.feed(lines(b"P " + HERE), 2.2) == [PLACE]


def test_a_key_pressed_again_before_the_answer_records_once():
    decoder = Decoder(parse_profile(UNCONFIRMED.encode(), "pxpy.toml"))
    decoder.press("key", 0.0)
    decoder.feed(b"0 0 0 0\n", 0.1)
    decoder.press("key", 0.2)
    # the second one after the second press
    assert len(decoder.feed(b"0 0 0 0\n", 0.3)) == 1
    position, record = decoder.feed(b"200 0 0 0\n", 0.4)
    assert record == Record(position, "key")
    assert len(decoder.feed(b"200 0 0 0\n", 0.5)) == 1


def test_a_held_key_records_once():
    decoder = Decoder(load_profile("summagraphics-mm1103"))
    decoder.feed(b"\n", 0.0)
    pressed = b"1000,2000,1\n"
    # the read-outs before and after the measurement are those of the held key itself
    kinds = [type(r) for r in decoder.feed(pressed * 5, 0.1)]
    assert kinds == [Position, Position, Position, Record, Position, Position]
    # after a pause it is another press
    kinds = [type(r) for r in decoder.feed(pressed * 3, 1.0)]
    assert kinds == [Position, Position, Position, Record]
    kinds = [type(r) for r in decoder.feed(b"1000,2000,0\n" + pressed * 2, 1.1)]
    assert kinds == [Position, Position, Position, Record]


def test_a_key_let_go_too_early_is_told():
    decoder = Decoder(load_profile("summagraphics-mm1103"))
    decoder.feed(b"\n" + b"1000,2000,0\n", 0.0)
    readings = decoder.feed(b"1000,2000,1\n1000,2000,0\n", 0.1)
    assert readings[-1].reason == "puck was not recorded: it was let go too early"


def asked(decoder, text: bytes, now: float) -> list:
    decoder.sent(decoder.poll_request(), now=now)
    return decoder.feed(lines(text), now + 0.01)


def test_a_press_is_recorded_when_the_read_outs_around_it_agree():
    decoder = Decoder(CONFIRMED)
    assert asked(decoder, b"P " + HERE, 0.0) == [PLACE]
    decoder.press("key", 0.03)
    assert decoder.waiting
    # the stage moves on: what lies between is a measurement
    there, beyond = (HERE.replace(b"+012.3", text) for text in (b"+012.7", b"+012.9"))
    (position,) = asked(decoder, b"P " + there, 0.04)
    after, record = asked(decoder, b"P " + beyond, 0.08)
    assert isinstance(after, Position)
    assert record == Record(position, "key")
    assert not decoder.waiting


@pytest.mark.parametrize(("digits", "good"), [(b"12.3486", True), (b"12.3487", False)])
def test_a_measurement_may_differ_by_still_from_what_is_around_it(digits, good):
    decoder = Decoder(CONFIRMED)
    asked(decoder, b"P " + HERE, 0.0)
    decoder.press("key", 0.03)
    asked(decoder, b"P " + HERE.replace(b"12.3456", digits), 0.04)
    _, last = asked(decoder, b"P " + HERE, 0.08)
    assert isinstance(last, Record) is good
    if not good:
        assert last.reason == (
            "key was not recorded: axis xl at 12.3487 mm is not between the read-outs around it "
            "(12.3456 and 12.3456 mm): press again"
        )


def test_read_outs_far_apart_confirm_nothing():
    decoder = Decoder(CONFIRMED, speed_limits=False)
    far = HERE.replace(b"+012.3456", b"+052.3456")
    between = HERE.replace(b"+012.3456", b"+032.3456")
    asked(decoder, b"P " + far, 0.0)
    decoder.feed(lines(b"R 1 1 " + between), 0.03)
    assert asked(decoder, b"P " + HERE, 0.04) == [PLACE]
    assert "is not between" in asked(decoder, b"P " + HERE, 0.08)[1].reason
    # whoever has only just arrived is recorded by the two read-outs after it
    asked(decoder, b"P " + far, 0.12)
    decoder.feed(lines(b"R 2 1 " + HERE), 0.15)
    assert asked(decoder, b"P " + HERE, 0.16) == [PLACE]
    assert asked(decoder, b"P " + HERE, 0.20) == [PLACE, Record(PLACE, "pedal", 2)]


def test_a_record_with_its_position_is_compared_with_the_read_outs_around_it():
    decoder = Decoder(CONFIRMED)
    asked(decoder, b"P " + HERE, 0.0)
    assert decoder.feed(lines(b"R 1 1 " + HERE), 0.03) == []
    assert asked(decoder, b"P " + HERE, 0.04) == [PLACE, Record(PLACE, "pedal", 1)]
    assert decoder.feed(lines(b"R 2 1 " + HERE.replace(b"034.56", b"034.46")), 0.07) == []
    _, refused = asked(decoder, b"P " + HERE, 0.08)
    assert refused.reason.startswith("pedal was not recorded: axis yl at -34.4678 mm is not")
    # without read-outs around it nothing can be said
    (refused,) = decoder.feed(lines(b"R 3 1 " + HERE), 2.0)
    assert "no read-out came before it" in refused.reason
    asked(decoder, b"P " + HERE, 2.1)
    assert decoder.feed(lines(b"R 4 1 " + HERE), 2.2) == []
    assert refusal(decoder.tick(6.0)) == "pedal was not recorded: no read-out confirmed it"


def test_counters_that_jump_are_unreferenced():
    decoder = Decoder(CONFIRMED)
    zero = b"+000.0000 +000.0000 +000.0000 +000.0000"
    asked(decoder, b"P " + HERE, 0.0)
    # one read-out far away may be damaged
    assert refusal(asked(decoder, b"P " + zero, 0.04)) == (
        "axis xl jumped by 12.346 mm: it moves 200 mm/s"
    )
    assert asked(decoder, b"P " + HERE, 0.08) == [PLACE]
    assert decoder.referenced
    # the box was off and on: its next press bears a number that fits
    assert "jumped" in refusal(decoder.feed(lines(b"R 1 1 " + zero), 0.1))
    asked(decoder, b"P " + zero, 0.12)
    fault, refused = asked(decoder, b"P " + zero, 0.16)
    assert fault == Fault("jumped", "the counters jumped")
    assert refused.reason == UNREFERENCED
    assert not decoder.referenced


def test_a_box_that_was_silent_has_not_gone_far():
    decoder = Decoder(CONFIRMED)
    far = HERE.replace(b"+012.3456", b"+072.3456")
    asked(decoder, b"P " + far, 0.0)
    assert "jumped" in refusal(asked(decoder, b"P " + HERE, 3.0))
    assert asked(decoder, b"P " + HERE, 3.04)[0].code == "jumped"


def test_former_rules_are_kept_for_recorded_sessions():
    decoder = Decoder(CONFIRMED, rules=1)
    assert decoder.feed(lines(b"R 7 1 " + HERE), 0.0) == [Record(PLACE, "pedal", 7)]
    assert refusal(decoder.feed(lines(b"R 5 1 " + HERE), 0.0)) == "record 5 came twice"
    decoder.sent(b"?\n")
    decoder.press("key", 1.0)
    decoder.sent(b"?\n")
    assert decoder.feed(lines(b"P " + HERE), 1.1) == [PLACE, Record(PLACE, "key")]
    with pytest.raises(InputError, match="newer version"):
        Decoder(CONFIRMED, rules=3)


def test_two_equal_records_make_one():
    decoder = Decoder(load_profile("mitutoyo-gauge"))
    one, other = b"01A+0001.000\r", b"01A+0001.001\r"
    assert decoder.feed(one, 0.0, "x") == []
    assert refusal(decoder.feed(other, 0.1, "x")).startswith("differs")
    assert decoder.feed(other, 0.2, "x") == []
    assert decoder.axes == {"x": 1.001}
    # a single one is forgotten after two seconds
    assert decoder.feed(one, 1.0, "x") == []
    assert decoder.feed(other, 9.0, "x") == []
    assert decoder.axes == {"x": 1.001}


STAGE = """
schema = 1
id = "pxpy"
title = "X, Y, Px, Py"
status = "simulated"
sources = ["none"]
[link.main]
[framing]
kind = "line"
terminator = "\\n"
[record.p]
kind = "position"
pattern = '^(?P<x>-?\\d{1,7}) (?P<y>-?\\d{1,7}) (?P<px>-?\\d{1,7}) (?P<py>-?\\d{1,7})$'
send = "{x:d} {y:d} {px:d} {py:d}"
[record.arrived]
kind = "in-position"
pattern = '^OK$'
send = "OK"
[axis.x]
encoding = "integer"
scale = 0.005
range = [0.0, 300.0]
[axis.y]
encoding = "integer"
scale = 0.005
direction = -1
range = [-125.0, 125.0]
[axis.px]
encoding = "integer"
scale = 0.005
range = [-25.0, 25.0]
[axis.py]
encoding = "integer"
scale = 0.005
range = [-25.0, 25.0]
[stage]
xl = { x = 1.0, offset = -150.0 }
yl = { y = 1.0 }
xr = { x = 1.0, px = -1.0, offset = -150.0 }
yr = { y = 1.0, py = -1.0 }
[drive]
command = "{x:d},{y:d},{px:d},{py:d}"
stop = "!"
in_position = "arrived"
[simulate]
resolution_um = 5.0
[[example]]
bytes = "30200 -400 200 -2\\n"
means = [{ position = [1.0, 2.0, 0.0, 2.01] }]
"""


def test_a_machine_with_common_carriage_and_parallax_screws(same_place):
    profile = parse_profile(STAGE.encode(), "pxpy.toml")
    decoder = Decoder(profile)
    assert decoder.feed(b"30200 -400 200 -2\n", 0.0) == [Position(1.0, 2.0, 0.0, 2.01)]
    target = Position(1.0, 2.0, 0.0, 2.01)
    assert decoder.drive_command(target) == b"30200,-400,200,-2\n"
    simulator = SimulatedPlotter(profile, {}, hand=Hand(follow=False))
    simulator.receive(decoder.drive_command(target))
    readings = decoder.feed(simulator.step(60.0), 60.0)
    assert InPosition(None) in readings
    assert readings[-1] == target
    assert same_place(profile, simulator.positions(), target)


UNCONFIRMED = STAGE.replace("schema = 1\n", "schema = 1\nconfirm = false\n")


def binary(framing: str, pattern: str, send: str, axis: str) -> str:
    axes = "".join(
        f"[axis.{name}]\n{axis}\nrange = [{low}, 200.0]\n"
        for name, low in (("x", 0.0), ("y", 0.0 if "bits" in axis or "hex" in axis else -200.0))
    )
    return f"""
schema = 1
id = "binary"
title = "A binary counter"
status = "simulated"
sources = ["none"]
[link.main]
[framing]
{framing}
[record.p]
kind = "position"
pattern = '^{pattern}$'
send = "{send}"
{axes}
[[example]]
hex = "00"
means = [{{ refused = "none" }}]
"""


FIXED = 'kind = "fixed"\nlength = 8\ngap = 0.05'


@pytest.mark.parametrize(
    ("framing", "pattern", "send", "axis"),
    [
        (FIXED, r"(?P<x>.{4})(?P<y>.{4})", "{x}{y}", 'encoding = "int-le"\nscale = 0.00001'),
        (FIXED, r"(?P<x>.{4})(?P<y>.{4})", "{x}{y}", 'encoding = "int-be"\nscale = 0.00001'),
        (
            FIXED.replace("8", "12"),
            r"(?P<x>[0-9A-F]{6})(?P<y>[0-9A-F]{6})",
            "{x:06X}{y:06X}",
            'encoding = "hex"\nscale = 0.0005',
        ),
        (
            'kind = "sync-bit"\nlength = 7',
            r"\x80(?P<x>[\x00-\x3f]{3})(?P<y>[\x00-\x3f]{3})",
            "\\u0080{x}{y}",
            'encoding = "bits6"\nscale = 0.001',
        ),
        (
            'kind = "sync-bit"\nlength = 7',
            r"\xff(?P<x>[\x00-\x7f]{3})(?P<y>[\x00-\x7f]{3})",
            "\\u00ff{x}{y}",
            'encoding = "bits7"\nscale = 0.0005',
        ),
    ],
)
def test_binary_encodings_both_ways(framing, pattern, send, axis, same_place):
    profile = parse_profile(binary(framing, pattern, send, axis).encode(), "binary.toml")
    simulator = SimulatedPlotter(profile, {}, hand=Hand(follow=False))
    decoder = Decoder(profile)
    for at, y in enumerate((12.345, 0.001, 199.999) if profile.axes["y"].low == 0 else (-5.5,)):
        place = simulator.hand_to(Position(150.25, y, 0.0, 0.0)) or simulator.positions()
        data = simulator.step(0.04)
        assert data
        (reading,) = decoder.feed(data, float(at))
        assert same_place(profile, reading, place)
        # half a record, then a pause: nothing of it is taken for the next one
        assert good(decoder.feed(data[:3], at + 0.2)) == []
        assert len(good(decoder.feed(data, at + 0.5))) == 1


def test_a_fixed_record_that_fits_nothing_is_followed_by_silence_until_a_pause():
    pattern = r"(?P<x>[0-9A-F]{6})(?P<y>[0-9A-F]{6})"
    text = binary(FIXED.replace("8", "12"), pattern, "{x:06X}{y:06X}", 'encoding = "hex"')
    decoder = Decoder(parse_profile(text.encode(), "binary.toml"))
    assert good(decoder.feed(b"x00000A00000B" + b"00000A00000B", 0.0)) == []
    assert good(decoder.feed(b"00000A00000B", 0.01)) == []
    assert good(decoder.feed(b"00000A00000B", 0.1)) == [Position(10.0, 11.0, 10.0, 11.0)]


def test_device_text_is_made_safe():
    decoder = Decoder(ASCII)
    hostile = b"E 3 [red]x[/] \x1b]0;t\x07"
    assert "\\x1b" not in repr(decoder.feed(lines(hostile), 0.0)[0].reason)
    assert decoder.feed(lines(b"E 3 [red]x[/]"), 0.0) == [Fault("3", "[red]x[/]")]


# -- every profile ----------------------------------------------------------------------------


def spoken(profile, count: int = 3) -> tuple[dict[str, list[bytes]], list]:
    """What the simulated device sends for some positions and presses, and what it means."""
    simulator = SimulatedPlotter(profile, {}, hand=Hand(follow=False))
    decoder = Decoder(replace(profile, confirm=False), speed_limits=False)
    sent: dict[str, list[bytes]] = {name: [] for name in profile.links}
    meant = []
    switch = next((s for s in profile.footswitches.values() if s.source != "key"), None)
    for at in range(count):
        simulator.hand_to(Position(3.0 + 7 * at, -4.0 - 5 * at, 2.0 - 7 * at, -4.5 + 3 * at))
        if profile.poll is not None:
            for name in profile.poll.links:
                decoder.sent(profile.poll.request, name)
                simulator.receive(profile.poll.request, name)
        if switch is not None:
            simulator.press(switch.name)
        simulator.advance(2.0)
        for name in profile.links:
            data = simulator.take(name)
            if profile.framing.joined == "middle" and at == 0:
                data = profile.framing.terminator + data
            sent[name].append(data)
            meant += decoder.feed(data, 10.0 * at, name)
    return sent, meant


def good(readings) -> list:
    return [reading for reading in readings if not isinstance(reading, Refused)]


def test_host_and_simulator_understand_each_other(any_profile, same_place):
    _, meant = spoken(any_profile)
    positions = [r for r in good(meant) if isinstance(r, Position)]
    assert len({(p.xl, p.yl) for p in positions}) == 3
    last = Position(17.0, -14.0, -12.0, 1.5)
    if any_profile.mono:
        last = Position(17.0, -14.0, 17.0, -14.0)
    assert same_place(any_profile, positions[-1], last)
    if any(s.source != "key" for s in any_profile.footswitches.values()):
        assert len([r for r in meant if isinstance(r, Record)]) == 3


def test_the_stream_cut_at_every_byte_means_the_same(any_profile):
    sent, _ = spoken(any_profile)
    for name, chunks in sent.items():
        for chunk in chunks:
            whole = Decoder(any_profile)
            expected = whole.feed(chunk, 0.0, name)
            for cut in range(len(chunk) + 1):
                parts = Decoder(any_profile)
                found = parts.feed(chunk[:cut], 0.0, name) + parts.feed(chunk[cut:], 0.0, name)
                assert good(found) == good(expected)
                assert parts.axes == whole.axes


def axis_values(profile, name, chunks) -> set[tuple[str, float]]:
    decoder = Decoder(profile)
    values = set()
    for at, chunk in enumerate(chunks):
        decoder.feed(chunk, 10.0 * at, name)
        values |= set(decoder.axes.items())
    return values


def test_a_stream_whose_beginning_or_end_is_missing_never_means_anything_else(any_profile):
    sent, _ = spoken(any_profile)
    for name, chunks in sent.items():
        allowed = axis_values(any_profile, name, chunks)
        first, second = chunks[0], chunks[1]
        for cut in range(len(first)):
            for damaged in (first[cut:], first[:cut] + second):
                decoder = Decoder(any_profile)
                decoder.feed(damaged, 0.0, name)
                decoder.feed(second, 10.0, name)
                assert set(decoder.axes.items()) <= allowed


@pytest.mark.slow
@settings(max_examples=60)
@given(data=st.data())
@pytest.mark.parametrize("name", list(find_profiles()))
def test_garbage_between_records_never_yields_a_reading_that_was_not_sent(name, data):
    profile = load_profile(name)
    sent, _ = SPOKEN.setdefault(name, spoken(profile))
    link = data.draw(st.sampled_from(list(profile.links)))
    allowed = axis_values(profile, link, sent[link])
    decoder = Decoder(profile)
    now = 0.0
    for chunk in sent[link]:
        # it cannot spell a record by itself: the shortest has five bytes, and of longer garbage
        # none is a digit (the records in text) or has its highest bit set (those in bytes)
        short = st.lists(st.sampled_from(b"01,+\r\n\x02\x81") | st.integers(0, 255), max_size=4)
        longer = st.lists(st.sampled_from(b"PRDE?,. +-*A\r\n\x02"), max_size=12)
        garbage = bytes(data.draw(short | longer))
        now += data.draw(st.sampled_from([0.0, 0.05, 3.0]))
        decoder.feed(garbage, now, link)
        decoder.feed(chunk, now, link)
        assert set(decoder.axes.items()) <= allowed


SPOKEN: dict = {}


@pytest.mark.slow
@settings(max_examples=80)
@given(
    chunks=st.lists(st.tuples(st.binary(max_size=80), st.floats(0.0, 3.0)), max_size=15),
    name=st.sampled_from(list(find_profiles())),
)
def test_any_bytes_are_decoded_or_refused(chunks, name):
    profile = load_profile(name)
    decoder = Decoder(profile)
    now = 0.0
    for data, pause in chunks:
        now += pause
        decoder.press("key", now)
        for link in profile.links:
            for reading in decoder.feed(data, now, link):
                assert isinstance(reading, Refused | Fault | Position | Record | InPosition)
                if isinstance(reading, Refused):
                    assert reading.reason.isascii()
                    assert reading.reason.isprintable()
        decoder.tick(now)


@pytest.mark.parametrize("name", list(find_profiles()))
def test_a_recorded_stream_decodes_the_same_again(name):
    profile = load_profile(name)
    sent, _ = spoken(profile)
    results = []
    for _ in range(2):
        decoder = Decoder(profile)
        found = []
        for at in range(3):
            for link in profile.links:
                found += decoder.feed(sent[link][at], float(at), link)
        results.append(found)
    assert results[0] == results[1]
