from __future__ import annotations

import itertools
import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError, LinkError
from anaplot.plotter import serialport
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.plotter.schema import LineSettings
from anaplot.plotter.serialport import ParityMarks, SerialPort, find_port, identity_of, ports

pytestmark = pytest.mark.usefixtures("nothing_left")


@pytest.fixture
def plotter(simulated) -> SimulatedPlotter:
    return SimulatedPlotter(simulated, {})


def answers(port: str) -> bytes:
    line = SerialPort(port, LineSettings("main"))
    try:
        line.write(b"?\n")
        data = b""
        while not data.endswith(b"\n"):
            data += line.read(1.0)
        return data
    finally:
        line.close()


def test_the_line_has_a_stable_name(plotter, tmp_path):
    name = tmp_path / "plotter"
    with SimulatorServer(plotter, symlink=name) as server:
        assert server.port == str(name)
        assert name.is_symlink()
        first = str(name.readlink())
        assert answers(server.port).startswith(b"P ")
        server.disconnect()
        assert not name.is_symlink()
        server.disconnect()
        server.reconnect()
        server.reconnect()
        assert answers(server.port).startswith(b"P ")
    assert not name.is_symlink()
    assert first.startswith("/dev/")


def test_nothing_but_a_dead_link_is_replaced(plotter, tmp_path):
    name = tmp_path / "plotter"
    name.write_text("precious")
    with pytest.raises(InputError, match="is no symbolic link"):
        SimulatorServer(plotter, symlink=name).start()
    assert name.read_text() == "precious"
    name.unlink()
    name.symlink_to("/dev/pts/99999999")
    with SimulatorServer(plotter, symlink=name) as server:
        assert answers(server.port)
        other = SimulatedPlotter(plotter.profile, {})
        with pytest.raises(InputError, match="leads to a terminal that is in use"):
            SimulatorServer(other, symlink=name).start()
        assert answers(server.port)


def test_a_folder_that_is_not_there(plotter, tmp_path):
    with pytest.raises(LinkError, match="No such file"):
        SimulatorServer(plotter, symlink=tmp_path / "no" / "plotter").start()


def test_several_links_have_several_names(tmp_path):
    profile = load_profile("heidenhain-nd281b")
    server = SimulatorServer(SimulatedPlotter(profile, {}), symlink=tmp_path / "nd")
    with server:
        assert server.ports == {name: str(tmp_path / f"nd-{name}") for name in profile.links}
        with pytest.raises(InputError, match="several"):
            _ = server.port
    assert list(tmp_path.iterdir()) == []


def test_a_private_name_is_taken_away(plotter):
    with SimulatorServer(plotter) as server:
        folder = Path(server.port).parent
        assert folder.is_dir()
    assert not folder.exists()
    server.close()


@pytest.mark.slow
def test_one_host_at_a_time_on_tcp(plotter):
    with SimulatorServer(plotter, tcp=True) as server:
        number = int(server.port.rsplit(":", 1)[1])
        first = socket.create_connection(("127.0.0.1", number), timeout=30)
        first.sendall(b"?\n")
        assert first.recv(100).startswith(b"P ")
        second = socket.create_connection(("127.0.0.1", number), timeout=30)
        assert second.recv(100) == b""
        second.close()
        first.sendall(b"?\n")
        assert first.recv(100).startswith(b"P ")
        first.close()
        assert answers(server.port).startswith(b"P ")
        server.disconnect()
        with pytest.raises(LinkError, match="refused"):
            answers(server.port)
        server.reconnect()
        assert answers(server.port).startswith(b"P ")


def test_a_given_tcp_port_and_one_in_use(plotter, simulated):
    with SimulatorServer(plotter, tcp=True) as server:
        number = int(server.port.rsplit(":", 1)[1])
        other = SimulatorServer(SimulatedPlotter(simulated, {}), tcp=True, tcp_port=number)
        with pytest.raises(LinkError, match="in use"):
            other.start()
        assert answers(server.port)


def test_misuse(plotter):
    with pytest.raises(InputError, match="time scale"):
        SimulatorServer(plotter, time_scale=0.0)
    server = SimulatorServer(plotter)
    with pytest.raises(InputError, match="does not run"):
        server.disconnect()
    with server, pytest.raises(InputError, match="runs already"):
        server.start()


def test_closing_a_port_whose_other_side_has_gone(plotter):
    with SimulatorServer(plotter, tcp=True) as server:
        line = SerialPort(server.port, LineSettings("main"))
        server.disconnect()
        with pytest.raises(LinkError, match=r"gone|reset"):
            line.read(30.0)
        line.close()
        line.close()
        line.wake()
        with pytest.raises(LinkError):
            line.write(b"x")
        with pytest.raises(LinkError):
            line.read(0.1)


def test_a_pseudo_terminal_has_no_modem_lines(plotter):
    with SimulatorServer(plotter) as server:
        line = SerialPort(server.port, LineSettings("main", bytesize=7, parity="even", stopbits=2))
        with pytest.raises(LinkError, match="line cts"):
            line.modem("cts")
        line.close()


def test_waking_ends_a_wait(plotter):
    with SimulatorServer(plotter) as server:
        line = SerialPort(server.port, LineSettings("main"))
        line.wake()
        assert line.read(3600.0) == b""
        line.close()


def marked(data: bytes, bad: set[int]) -> bytes:
    out = bytearray()
    for at, byte in enumerate(data):
        if at in bad:
            out += bytes([0xFF, 0x00, byte])
        else:
            out += b"\xff\xff" if byte == 0xFF else bytes([byte])
    return bytes(out)


@given(st.binary(max_size=30), st.sets(st.integers(0, 30)), st.lists(st.integers(0, 90)))
def test_parity_marks_are_undone_wherever_the_stream_is_cut(data, bad, cuts):
    raw = marked(data, bad)
    marks = ParityMarks()
    places = [0, *sorted(min(cut, len(raw)) for cut in cuts), len(raw)]
    found = b"".join(marks.strip(raw[a:b]) for a, b in itertools.pairwise(places))
    assert found == bytes(0xFF if at in bad else byte for at, byte in enumerate(data))


def test_ports_that_cannot_be_listed(monkeypatch):
    def broken():
        raise TypeError("no")

    monkeypatch.setattr(serialport.list_ports, "comports", broken)
    with pytest.raises(LinkError, match="cannot be listed"):
        ports()
    assert identity_of("/dev/ttyUSB0") == ""
    assert find_port("1:2:3") is None
    assert find_port("") is None
    assert identity_of("socket://x:1") == ""
