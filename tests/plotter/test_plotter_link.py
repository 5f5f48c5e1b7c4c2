from __future__ import annotations

import itertools
import os
import select
import socket
import threading
import time
import tty
from types import SimpleNamespace

import pytest
import serial
import serial.rfc2217

from anaplot.errors import InputError, LinkError
from anaplot.plotter import serialport
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.hand import Hand
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.link import Link
from anaplot.plotter.profile import find_profiles, load_profile, parse_profile
from anaplot.plotter.readings import UNREFERENCED, Fault, InPosition, Position, Record, Refused

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("nothing_left")]
FAST = (0.02,)


def served(profile, photographs, *, tcp=False, hand=None, time_scale=50.0, **settings):
    plotter = SimulatedPlotter(profile, photographs, hand=hand, **settings)
    plotter.lay("1", None if profile.mono else "2")
    return SimulatorServer(plotter, tcp=tcp, time_scale=time_scale)


def with_silence(profile_name: str, seconds: float):
    text = (
        find_profiles()[profile_name].read_text().replace("silence = 2.0", f"silence = {seconds}")
    )
    return parse_profile(text.encode(), "quick.toml")


def press_until(link: Link, heard, count: int) -> None:
    """Press the key until so many records have come; on a busy machine a press may be refused."""
    while len(heard.of(Record)) < count:
        start = len(heard.readings)
        link.record()
        heard.wait(
            lambda start=start: any(isinstance(r, Record | Refused) for r in heard.readings[start:])
        )


@pytest.mark.parametrize("tcp", [False, True], ids=["pty", "socket"])
def test_a_row_of_points_through_a_real_line(tcp, simulated, photographs, heard):
    points = list(photographs["2"])[:10]
    with served(simulated, photographs, tcp=tcp, hand=Hand(auto_pedal=True)) as server:
        with Link(simulated, server.port, **heard.callbacks) as link:
            heard.wait_state("live")
            for at, point in enumerate(points):
                link.drive(Position(*photographs["1"][point], *photographs["2"][point]))
                heard.wait(lambda at=at: len(heard.of(Record)) > at)
            position, age = link.latest()
            assert age >= 0.0
            assert link.state == "live"
        assert link.state == "closed"
    assert len(heard.of(InPosition)) == len(points)
    assert [record.number for record in heard.of(Record)] == list(range(1, 11))
    assert not heard.of(Refused)
    for point, record in zip(points, heard.of(Record), strict=True):
        x, y = photographs["1"][point]
        assert abs(record.position.xl - x) < 0.05
        assert abs(record.position.yl - y) < 0.05
    assert isinstance(position, Position)


@pytest.mark.parametrize("tcp", [False, True], ids=["pty", "socket"])
def test_every_profile_through_a_real_line(tcp, any_profile, photographs, heard, same_place):
    switch = next(iter(any_profile.footswitches.values()))
    with (
        served(any_profile, photographs, tcp=tcp, time_scale=2.0) as server,
        Link(any_profile, server.ports, speed_limits=False, **heard.callbacks) as link,
    ):
        settled = threading.Event()
        server.simulator.set_on_settled(lambda _: settled.set())
        x, y = photographs["1"]["103"]
        server.simulator.hand_to(Position(x, y, *photographs["2"]["103"]))
        assert settled.wait(30)
        heard.wait_state("live" if switch.source == "key" else "opening")
        while not heard.of(Record):
            start = len(heard.readings)
            if switch.source == "key":
                link.record("key")
            else:
                server.simulator.press(switch.name)
            # on a busy machine a press may be refused: press again, as an operator would
            heard.wait(
                lambda start=start: any(
                    isinstance(r, Record | Refused) for r in heard.readings[start:]
                )
            )
        record = heard.of(Record)[0]
        assert record.switch == switch.name
        assert same_place(any_profile, record.position, server.simulator.positions())
    out = b"".join(data for way, _, data in heard.traffic if way == "out")
    assert (any_profile.poll is None) == (out == b"")


def test_traffic_and_what_the_decoder_was_told_replay_to_the_same_readings(photographs, heard):
    profile = load_profile("heidenhain-nd281b")
    log: list[tuple[str, str, bytes | str, float]] = []
    with served(profile, photographs, time_scale=1.0) as server:
        link = Link(
            profile,
            server.ports,
            on_reading=heard.on_reading,
            on_traffic=lambda way, name, data: log.append((way, name, data, link.event_time)),
            on_decoder=lambda kind, text: log.append((kind, "", text, link.event_time)),
        )
        with link:
            for count in range(1, 4):
                press_until(link, heard, count)
    decoder = Decoder(profile)
    again = []
    for kind, name, what, when in log:
        if kind == "in":
            again += decoder.feed(what, when, name)
        elif kind == "out":
            decoder.sent(what, name)
        else:
            decoder.press(what, when)
    assert again == heard.readings


def test_a_key_records_where_the_plates_stand(simulated, photographs, heard):
    with (
        served(simulated, photographs) as server,
        Link(simulated, server.port, **heard.callbacks) as link,
    ):
        heard.wait(lambda: heard.of(Position))
        place = server.simulator.move(12.0, -3.0, 4.0, 0.5)
        press_until(link, heard, 1)
        assert heard.of(Record) == [Record(place, "key")]
        assert ("press", "key") in heard.told


def test_wrong_port_names_are_one_line_each(simulated, heard, tmp_path):
    closed = socket.socket()
    closed.bind(("127.0.0.1", 0))
    number = closed.getsockname()[1]
    closed.close()
    file = tmp_path / "file"
    file.write_text("")
    for address, part in [
        ("/dev/does-not-exist", "no such file"),
        (str(file), ""),
        (f"socket://127.0.0.1:{number}", "refused"),
        ("socket://nowhere", ""),
        ("telepathy://x", ""),
        ("", ""),
    ]:
        with pytest.raises(LinkError) as caught:
            Link(simulated, address, **heard.callbacks).open()
        message = str(caught.value)
        assert "\n" not in message
        assert message.startswith("port ")
        assert part in message.lower()
    assert heard.states[-1][0] == "closed"


def test_a_port_is_given_to_one_link_only(simulated, photographs, heard):
    with served(simulated, photographs) as server:
        first = Link(simulated, server.port, **heard.callbacks)
        with first:
            heard.wait_state("live")
            with pytest.raises(LinkError, match="in use by another program"):
                Link(simulated, server.port, on_reading=heard.on_reading).open()
            with pytest.raises(InputError, match="open already"):
                first.open()
        # and may be opened again after it was closed
        start = len(heard.states)
        with first:
            heard.wait_state("live", start)


@pytest.mark.parametrize("tcp", [False, True], ids=["pty", "socket"])
def test_a_lost_line_is_told_and_found_again(tcp, simulated, photographs, heard):
    with served(simulated, photographs, tcp=tcp) as server:
        link = Link(simulated, server.port, back_off=FAST, **heard.callbacks)
        with link:
            heard.wait_state("live")
            server.disconnect()
            heard.wait_state("lost")
            heard.wait_state("reconnecting")
            with pytest.raises(LinkError, match="is lost"):
                link.drive(Position(0.0, 0.0, 0.0, 0.0))
            with pytest.raises(LinkError, match="is lost"):
                link.record()
            start = len(heard.states)
            server.reconnect()
            heard.wait_state("live", start)
            link.drive(Position(1.0, 0.0, 0.0, 0.0))
            heard.wait(lambda: heard.of(InPosition))
    assert ("reopen", "main") in heard.told


def test_counters_are_unreferenced_after_a_lost_line(photographs, heard):
    profile = load_profile("anaplot-ascii")
    here = Position(3.0, 4.0, 5.0, 6.0)
    with served(profile, photographs, hand=Hand(follow=False)) as server:
        server.simulator.move(3.0, 4.0, 5.0, 6.0)
        link = Link(profile, server.port, back_off=FAST, **heard.callbacks)
        with link:
            heard.wait(lambda: here in heard.readings)
            server.simulator.inject("disconnect", seconds=5.0)
            server.simulator.power_cycle()
            heard.wait_state("lost")
            heard.wait(
                lambda: (
                    any(r.reason == UNREFERENCED for r in heard.of(Refused))
                    and link.unreferenced_position is not None
                )
            )
            assert not link.referenced
            assert link.unreferenced_position == Position(0.0, 0.0, 0.0, 0.0)
            link.reference_by(here)
            assert link.shift == here
            start = len(heard.readings)
            heard.wait(lambda: here in heard.readings[start:])
            assert ("reference", "3.0 4.0 5.0 6.0") in heard.told
            link.confirm_reference()
            assert link.referenced


def test_a_silent_device_is_noticed_and_so_is_its_return(photographs, heard):
    profile = with_silence("simulated", 0.3)
    with (
        served(profile, photographs, time_scale=1.0) as server,
        Link(profile, server.port, **heard.callbacks),
    ):
        heard.wait_state("live")
        server.simulator.inject("freeze", seconds=1.0)
        heard.wait_state("silent")
        assert "nothing understood" in dict(heard.states)["silent"]
        start = len(heard.states)
        heard.wait_state("live", start)
        assert ("live", "") in heard.states[start:]


def test_a_device_that_speaks_nonsense_is_silent(photographs, heard):
    profile = with_silence("simulated", 0.3)
    with (
        served(profile, photographs, time_scale=1.0) as server,
        Link(profile, server.port, **heard.callbacks),
    ):
        server.simulator.inject("wrong-baud", seconds=600.0)
        heard.wait_state("silent")


def test_nothing_on_the_other_side(simulated, heard):
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        profile = with_silence("simulated", 0.2)
        with Link(profile, os.ttyname(slave), **heard.callbacks) as link:
            assert link.latest() is None
            heard.wait_state("silent")
    finally:
        os.close(master)
        os.close(slave)
    assert [state for state, _ in heard.states][:2] == ["opening", "silent"]


def test_closing_from_a_callback(simulated, photographs):
    closed = threading.Event()
    with served(simulated, photographs) as server:

        def on_reading(_) -> None:
            link.close()
            closed.set()

        link = Link(simulated, server.port, on_reading=on_reading)
        link.open()
        assert closed.wait(30)
        link.close()
        assert link.state == "closed"
        with pytest.raises(LinkError, match="closed"):
            link.stop()


def test_opened_again_from_a_callback_it_has_one_reader(simulated, photographs, heard):
    with served(simulated, photographs) as server:
        readers = []

        def on_reading(reading) -> None:
            if not readers:
                readers.append(threading.current_thread())
                link.close()
                link.open()
            heard.on_reading(reading)

        link = Link(simulated, server.port, on_reading=on_reading, on_state=heard.on_state)
        with link:
            heard.wait(lambda: readers)
            readers[0].join(30)
            assert not readers[0].is_alive()
            heard.wait_state("live")
            assert link.state == "live"
    assert "lost" not in dict(heard.states)


def test_closed_while_it_looks_for_its_port_a_link_keeps_none(simulated, photographs, heard):
    with served(simulated, photographs) as server:

        def on_state(state: str, detail: str) -> None:
            if state == "lost":
                server.reconnect()  # so that the port is there again
            if state == "reconnecting":
                link.close()
            heard.on_state(state, detail)

        link = Link(
            simulated, server.port, back_off=FAST, on_reading=lambda _: 0, on_state=on_state
        )
        link.open()
        heard.wait_state("live")
        (reader,) = (t for t in threading.enumerate() if t.name == "plotter link main")
        server.disconnect()
        heard.wait_state("closed")
        reader.join(30)
        assert not reader.is_alive()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_link_whose_callback_fails_does_not_look_alive(simulated, photographs, heard):
    def fails(_) -> None:
        raise RuntimeError("a mistake in a callback")

    with served(simulated, photographs) as server:
        link = Link(simulated, server.port, on_reading=fails, on_state=heard.on_state)
        with link:
            heard.wait_state("lost")
            assert link.detail == "the reader has failed"


@pytest.mark.parametrize("tcp", [False, True], ids=["pty", "socket"])
def test_a_line_that_does_not_check_parity_says_so(tcp, simulated, photographs, heard):
    for profile, unchecked in [
        (load_profile("heidenhain-nd720"), ("main",)),
        (simulated, ()),
    ]:
        with (
            served(profile, photographs, tcp=tcp) as server,
            Link(profile, server.port, **heard.callbacks) as link,
        ):
            assert link.unchecked_parity == unchecked


def test_ports_belong_to_links(simulated, heard):
    four = load_profile("heidenhain-nd281b")
    with pytest.raises(InputError, match="needs a port for each of its links: xl, yl, xr, yr"):
        Link(four, "/dev/ttyUSB0", on_reading=heard.on_reading)
    with pytest.raises(InputError, match='no port is given for its link "yr"'):
        Link(four, {"xl": "a", "yl": "b", "xr": "c"}, on_reading=heard.on_reading)
    with pytest.raises(InputError, match='no link "left"'):
        Link(simulated, {"left": "a"}, on_reading=heard.on_reading)


def test_when_one_of_several_ports_cannot_be_opened_none_stays_open(photographs, heard):
    profile = load_profile("heidenhain-nd281b")
    with served(profile, photographs) as server:
        ports = server.ports | {"yr": "/dev/does-not-exist"}
        with pytest.raises(LinkError, match="does-not-exist"):
            Link(profile, ports, **heard.callbacks).open()
        with Link(profile, server.ports, **heard.callbacks):
            heard.wait(lambda: heard.of(Position))


def test_one_of_several_cables_pulled(photographs, heard):
    profile = load_profile("heidenhain-nd281b")
    with (
        served(profile, photographs, time_scale=2.0) as server,
        Link(profile, server.ports, back_off=FAST, **heard.callbacks) as link,
    ):
        heard.wait_state("live")
        server.disconnect("xr")
        heard.wait_state("lost")
        start = len(heard.states)
        server.reconnect("xr")
        heard.wait_state("live", start)
        assert not link.referenced


def test_an_adapter_is_found_again_under_another_name(simulated, photographs, heard, monkeypatch):
    names = {"one": "ttyACM0"}
    with served(simulated, photographs) as one, served(simulated, photographs) as two:
        places = {"ttyACM0": one.port, "ttyACM1": two.port}

        def comports():
            return [
                SimpleNamespace(
                    device=places[names["one"]],
                    description="adapter",
                    vid=0x2341,
                    pid=0x43,
                    serial_number="77",
                )
            ]

        monkeypatch.setattr(serialport.list_ports, "comports", comports)
        link = Link(simulated, one.port, back_off=FAST, **heard.callbacks)
        with link:
            assert link.identities == {"main": "2341:0043:77"}
            heard.wait_state("live")
            names["one"] = "ttyACM1"
            one.disconnect()
            heard.wait_state("lost")
            start = len(heard.states)
            heard.wait_state("live", start)
            two.simulator.move(9.0)
            heard.wait(lambda: Position(9.0, 0.0, 0.0, 0.0) in heard.readings)
        # and it may be asked for by what it is
        start = len(heard.states)
        with Link(simulated, "usb:2341:0043:77", **heard.callbacks) as link:
            heard.wait_state("live", start)
            assert link.identities == {"main": "2341:0043:77"}
        with pytest.raises(LinkError, match="no such adapter"):
            Link(simulated, "usb:2341:0043:78", **heard.callbacks).open()


MODEM = """
schema = 1
id = "modem"
title = "A counter that streams, a pedal on CTS"
status = "simulated"
sources = ["none"]
[link.main]
[framing]
kind = "line"
terminator = "\\n"
[record.p]
kind = "position"
pattern = '^(?P<x>\\d) (?P<y>\\d)$'
[axis.x]
range = [0.0, 9.0]
[axis.y]
range = [0.0, 9.0]
[footswitch.pedal]
source = "modem"
line = "cts"
debounce = 0.0
[[example]]
bytes = "1 2\\n"
means = [{ position = [1.0, 2.0] }]
"""


def test_a_pedal_on_a_modem_line_and_a_port_without_descriptor(heard, monkeypatch):
    profile = parse_profile(MODEM.encode(), "modem.toml")
    # closed at first, which is no press; then open, closed, bounced
    levels = itertools.chain([True, False, False, True, True], itertools.repeat(False))
    monkeypatch.setattr(serialport.SerialPort, "modem", lambda self, line: next(levels))
    link = Link(profile, "loop://", **heard.callbacks)
    with link:
        heard.wait_state("live")
        device = link._lines["main"].port._serial
        heard.wait(lambda: ("press", "pedal") in heard.told)
        device.write(b"1 2\n")
        heard.wait(lambda: heard.of(Position))
        device.write(b"3 4\n3 4\n")
        heard.wait(lambda: heard.of(Record))
        assert heard.of(Record) == [Record(Position(3.0, 4.0, 3.0, 4.0), "pedal")]
        assert heard.told == [("press", "pedal")]


ASKED = (
    MODEM.replace('source = "modem"\nline = "cts"\ndebounce = 0.0', 'source = "key"')
    + """
[poll]
request = "?"
timeout = 0.2
period = 0.05
"""
)


@pytest.mark.skipif(os.name == "nt", reason="no pseudo-terminals there")
def test_an_answer_that_came_while_nobody_looked_is_not_that_to_the_next_request(
    heard, monkeypatch
):
    """The process stands still between two looks at the line, and longer than an answer takes."""
    profile = parse_profile(ASKED.encode(), "asked.toml")
    stopped, go_on = threading.Event(), threading.Event()
    read = serialport.SerialPort.read

    def standing_still(self, timeout):
        if timeout > 0.0 and not go_on.is_set():
            stopped.set()
            assert go_on.wait(30)
            return b""  # nothing had come when it was last looked
        return read(self, timeout)

    monkeypatch.setattr(serialport.SerialPort, "read", standing_still)
    master, slave = os.openpty()
    try:
        tty.setraw(slave)
        link = Link(profile, os.ttyname(slave), **heard.callbacks)
        with link:
            assert stopped.wait(30)
            assert os.read(master, 1) == b"?"
            os.write(master, b"1 2\n")  # where the plates stood before
            link.record()
            asked = time.monotonic()
            while time.monotonic() < asked + 0.3:
                threading.Event().wait(0.05)
            go_on.set()
            assert os.read(master, 1) == b"?"
            os.write(master, b"3 4\n")
            assert os.read(master, 1) == b"?"
            os.write(master, b"3 4\n")
            heard.wait(lambda: heard.of(Record))
            assert heard.of(Record) == [Record(Position(3.0, 4.0, 3.0, 4.0), "key")]
    finally:
        go_on.set()
        os.close(master)
        os.close(slave)


class LateCounter:
    """A counter on a pseudo-terminal, behind something that delays what it says."""

    def __init__(self, delays: list[float], usual: float) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave
        self.port = os.ttyname(slave)
        self.x = 0
        self._delays = delays
        self._usual = usual
        self._coming: list[tuple[float, bytes]] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            ready, _, _ = select.select([self.master], [], [], 0.005)
            now = time.monotonic()
            for _ in os.read(self.master, 64) if ready else b"":
                delay = self._delays.pop(0) if self._delays else self._usual
                when = max([now + delay, *(item[0] for item in self._coming)])
                self._coming.append((when, b"%04d %04d\n" % (self.x, self.x)))
            while self._coming and self._coming[0][0] <= now:
                os.write(self.master, self._coming.pop(0)[1])

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self.master)
        os.close(self._slave)


LATE = (
    ASKED.replace("\\d)", "\\d{4})")
    .replace("[0.0, 9.0]", "[0.0, 9999.0]")
    .replace('"1 2\\n"', '"0001 0002\\n"')
    .replace("timeout = 0.2", "timeout = 0.1\nlatency = 2.0")
)


@pytest.mark.skipif(os.name == "nt", reason="no pseudo-terminals there")
@pytest.mark.parametrize(
    ("delays", "usual"),
    [([0.0] * 5 + [0.45], 0.0), ([], 0.15), ([0.3, 0.0] * 40, 0.02)],
    ids=["one hiccup", "always late", "every other one"],
)
def test_no_press_is_recorded_with_a_late_answer(delays, usual, heard):
    """Every place is another one; whatever is recorded is where the counter stood at the press."""
    device = LateCounter(delays, usual)
    try:
        with Link(
            parse_profile(LATE.encode(), "late.toml"), device.port, **heard.callbacks
        ) as link:
            heard.wait_state("live")
            for _ in range(12):
                device.x += 10
                start = len(heard.readings)
                link.record()
                heard.wait(
                    lambda start=start: any(
                        isinstance(r, Record) or "key was not" in getattr(r, "reason", "")
                        for r in heard.readings[start:]
                    )
                )
                assert {r.position.xl for r in heard.of(Record)} <= set(range(0, 130, 10))
                fresh = [r for r in heard.readings[start:] if isinstance(r, Record)]
                assert all(record.position.xl == device.x for record in fresh)
            assert len(heard.of(Record)) >= 6
    finally:
        device.close()


@pytest.mark.filterwarnings("ignore:setDaemon")
@pytest.mark.filterwarnings("ignore:setName")
def test_rfc2217(heard):
    """A terminal server on the other side, with a counter behind it."""
    profile = parse_profile(
        MODEM.replace('source = "modem"\nline = "cts"\ndebounce = 0.0', 'source = "key"').encode(),
        "remote.toml",
    )
    listener = socket.create_server(("127.0.0.1", 0))
    opened = threading.Event()
    ended = threading.Event()
    device = serial.serial_for_url("loop://", timeout=0.01)
    conversation: list[socket.socket] = []

    def serve() -> None:
        client, _ = listener.accept()
        conversation.append(client)
        client.settimeout(0.01)
        lock = threading.Lock()

        class Wire:
            def write(self, data: bytes) -> None:
                with lock:
                    client.sendall(data)

        manager = serial.rfc2217.PortManager(device, Wire())
        opened.set()
        while not ended.is_set():
            try:
                data = client.recv(1024)
            except TimeoutError:
                data = None
            except OSError:
                return
            if data == b"":
                return
            if data:
                b"".join(manager.filter(data))
            said = device.read(64)
            if said:
                Wire().write(b"".join(manager.escape(said)))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        number = listener.getsockname()[1]
        with Link(profile, f"rfc2217://127.0.0.1:{number}", **heard.callbacks):
            assert opened.wait(30)
            device.write(b"1 2\n3 4\n")
            heard.wait(lambda: len(heard.of(Position)) == 2)
    finally:
        ended.set()
        thread.join()
        for client in conversation:
            client.close()
        listener.close()
        device.close()


def test_faults_of_the_line_are_survived(simulated, photographs, heard):
    rates = {"drop": 0.05, "flip": 0.05, "partial": 0.05, "duplicate": 0.05, "garbage": 0.05}
    with (
        served(simulated, photographs, fault_rates=rates, hand=Hand(follow=False)) as server,
        Link(simulated, server.port, **heard.callbacks),
    ):
        count = 0
        for at in range(40):
            place = server.simulator.move(1.0, 0.5, -1.0, 0.25)
            while count == len(heard.of(Record)):
                start = len(heard.readings)
                server.simulator.press()
                heard.wait(
                    lambda start=start: any(
                        isinstance(r, Record | Refused | Fault) for r in heard.readings[start:]
                    )
                )
            count = len(heard.of(Record))
            assert heard.of(Record)[-1].position == place, at
        allowed = {Position(n * 1.0, n * 0.5, -n * 1.0, n * 0.25) for n in range(41)}
        assert set(heard.of(Position)) <= allowed


def test_many_records_and_nothing_is_kept(simulated, heard):
    with (
        served(simulated, {"1": {}, "2": {}}, hand=Hand(follow=False)) as server,
        Link(simulated, server.port, **heard.callbacks),
    ):
        heard.wait_state("live")
        for count in range(1, 1001):
            server.simulator.press()
            if count % 20 == 0:
                heard.wait(lambda count=count: len(heard.of(Record)) == count)
    numbers = [record.number for record in heard.of(Record)]
    assert numbers == list(range(1, 1001))
    assert server.lost_bytes == 0
