from __future__ import annotations

import io
import json
import os
import re
import threading
from types import SimpleNamespace

import pytest

from anaplot.cli import main
from anaplot.errors import InputError, LinkError
from anaplot.plotter import serialport
from anaplot.plotter.device.hand import Hand
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.ports import parse_ports
from anaplot.plotter.profile import find_profiles, load_profile
from anaplot.plotter.readings import Fault, InPosition, Position, Record, Refused
from anaplot.report.plottercommand import check_profile, describe, watch
from anaplot.report.simulatorcommand import grid_photographs, laid_pair, obey, run_simulator

pytestmark = pytest.mark.usefixtures("nothing_left")


class Lines(io.StringIO):
    """A text stream on which lines can be waited for."""

    def __init__(self) -> None:
        super().__init__()
        self.condition = threading.Condition()

    def write(self, text: str) -> int:
        with self.condition:
            count = super().write(text)
            self.condition.notify_all()
            return count

    def wait(self, pattern: str) -> re.Match[str]:
        with self.condition:
            assert self.condition.wait_for(lambda: re.search(pattern, self.getvalue()), 30)
            found = re.search(pattern, self.getvalue())
            assert found is not None
            return found


def test_list(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(
        serialport.list_ports,
        "comports",
        lambda: [
            SimpleNamespace(
                device="/dev/ttyUSB0",
                description="\x1b[2Jadapter",
                vid=0x403,
                pid=0x6001,
                serial_number="A1",
            ),
            SimpleNamespace(
                device="/dev/ttyS0", description="n/a", vid=None, pid=None, serial_number=None
            ),
        ],
    )
    assert main(["plotter", "list", "--csv", str(tmp_path / "profiles.csv")]) == 0
    text = capsys.readouterr().out
    assert "/dev/ttyUSB0          0403:6001:A1  \\x1b[2Jadapter" in text
    assert "heidenhain-nd281b     from-manual" in text
    lines = (tmp_path / "profiles.csv").read_text().splitlines()
    assert lines[0] == "profile,status,title"
    assert {line.split(",")[0] for line in lines[1:]} == find_profiles().keys()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "anaplot" / "device_profiles"
    folder.mkdir(parents=True)
    (folder / "broken.toml").write_text("schema = 1\nidd = 2\n")
    wrong = "broken.toml line 2: idd: unknown key (did you mean 'id'?)"
    assert main(["plotter", "list"]) == 2
    assert wrong in capsys.readouterr().out
    assert main(["plotter", "list", "--json"]) == 2
    answer = json.loads(capsys.readouterr().out)
    (one,) = answer["not_readable"]
    assert one["profile"] == "broken"
    assert wrong in one["error"]
    assert {port["address"] for port in answer["ports"]} == {"/dev/ttyUSB0", "/dev/ttyS0"}


def test_check(any_profile, tmp_path):
    out = io.StringIO()
    assert check_profile(any_profile.id, out) == 0
    assert f"examples  {len(any_profile.examples)}, all right" in out.getvalue()
    assert any_profile.sha256 in out.getvalue()


def test_check_tells_which_example_is_wrong(tmp_path):
    text = find_profiles()["heidenhain-nd281b"].read_text()
    file = tmp_path / "mine.toml"
    file.write_text(text.replace("xl = -5.23", "xl = 5.23"))
    with pytest.raises(InputError, match=r"mine\.toml: example 1: axis xl is -5\.23"):
        check_profile(str(file), io.StringIO())


def test_ports_as_typed():
    one, four = load_profile("simulated"), load_profile("heidenhain-nd281b")
    assert parse_ports(one, ["COM3"]) == {"main": "COM3"}
    assert parse_ports(one, ["main=COM3"]) == {"main": "COM3"}
    assert parse_ports(four, ["xl=a,yl=b", "xr=c", "yr=socket://h:1"])["yr"] == "socket://h:1"
    for texts, part in [
        (["COM3"], "LINK=PORT"),
        (["xl=a,xl=b"], "twice"),
        (["xk=a"], "no link 'xk'"),
        (["xl=a,yl=b,xr=c"], '"yr"'),
        (["xl="], "LINK=PORT"),
    ]:
        with pytest.raises(InputError, match=part):
            parse_ports(four, texts)


def test_watch(simulated, photographs):
    plotter = SimulatedPlotter(simulated, photographs)
    out, stop = Lines(), threading.Event()
    with SimulatorServer(plotter) as server:
        thread = threading.Thread(
            target=watch, args=([server.port], "simulated", out), kwargs={"raw": True, "stop": stop}
        )
        thread.start()
        out.wait("link      live")
        plotter.press()
        out.wait(r"record 1  x' +\+0\.0000")
        out.wait("position  x'")
        out.wait(r"out +main: \?\\x0a")
        stop.set()
        thread.join()
    assert "link      closed" in out.getvalue()


def test_watch_ends_after_some_time_and_tells_a_wrong_port(simulated):
    plotter = SimulatedPlotter(simulated, {})
    with SimulatorServer(plotter) as server:
        assert watch([server.port], "simulated", io.StringIO(), seconds=0.0) == 0
    with pytest.raises(LinkError, match="no such file"):
        watch(["/dev/none"], "simulated", io.StringIO())


def test_readings_as_lines():
    place = Position(1.0, -2.0, 3.0, 0.25)
    assert describe(place).startswith("position  x'    +1.0000  y'    -2.0000")
    assert describe(Record(place, "a\x1b")).endswith("mm  a\\x1b")
    assert describe(InPosition(None)) == "arrived"
    assert describe(InPosition(place)).startswith("arrived   x'")
    assert describe(Fault("3", "stuck")) == "fault     3 stuck"
    assert describe(Refused(b"\x1b[2J", "why")) == "refused   why  <\\x1b[2J>"


def test_a_simulated_plotter_by_itself(tmp_path):
    reader, writer = os.pipe()
    out, stop = Lines(), threading.Event()
    name = tmp_path / "plotter"
    with open(reader) as control, open(writer, "w") as commands:  # noqa: PTH123
        thread = threading.Thread(
            target=run_simulator,
            args=("simulated", out),
            kwargs={
                "symlink": name,
                "control": control,
                "stop": stop,
                "hand": Hand(settle_time=0.0),
            },
        )
        thread.start()
        out.wait(f"SIMULATED  simulated  main={re.escape(str(name))}")
        for line, answer in [
            ("press", "pressed"),
            ("move 1 2 3 4", r"at x' +\+1\.0000"),
            ("lay right left", "laid right left"),
            ("flip", "fault flip"),
            ("freeze 0.1", "fault freeze"),
            ("power", "switched off and on"),
            ("help", r"SIMULATED  press \[SWITCH\] \| move"),
            ('lay "no such" \'n', r"no photograph no such"),
            ('attend "', "is not understood"),
            ("dance", '"dance" is not understood'),
            ("press knee", 'no footswitch "knee"'),
            ("", ""),
        ]:
            commands.write(line + "\n")
            commands.flush()
            out.wait(answer)
        commands.write("quit\n")
        commands.flush()
        thread.join(30)
        assert not thread.is_alive()
    assert out.getvalue().endswith("SIMULATED  ended\n")
    assert not name.exists()


def test_control_lines(simulated, photographs):
    plotter = SimulatedPlotter(simulated, photographs)
    for words in (["move", "1"], ["move", "a", "0", "0", "0"], ["flip", "inf"], ["lay", "x", "y"]):
        with pytest.raises(InputError):
            obey(plotter, words)
    key = SimulatedPlotter(load_profile("heidenhain-nd720"), photographs)
    assert "host" in obey(key, ["press", "key"])


def test_the_grid_has_points_common_to_both_photographs():
    grid = grid_photographs()
    assert set(grid) == {"left", "right"}
    assert set(grid["left"]) == set(grid["right"])
    assert len(grid["left"]) > 20


def test_what_the_simulator_refuses(tmp_path):
    with pytest.raises(InputError, match="'flip'"):
        run_simulator("simulated", io.StringIO(), fault_rates={"flap": 0.1})
    with pytest.raises(InputError, match="no photograph"):
        run_simulator("simulated", io.StringIO(), laid=("a", "b"))


@pytest.mark.parametrize(
    ("text", "pair"),
    [
        ("101/102", ("101", "102")),
        ("101", ("101", "101")),
        ("101/", ("101", "101")),
        ("run 0/1.jpg/run 0/2.jpg", ("run 0/1.jpg", "run 0/2.jpg")),
        ("run 0/1.jpg/101", ("run 0/1.jpg", "101")),
        ("run 0/2.jpg", ("run 0/2.jpg", "run 0/2.jpg")),
    ],
)
def test_photographs_to_lay_may_have_slashes_in_their_names(
    text: str, pair: tuple[str, str]
) -> None:
    assert laid_pair(text, ["101", "102", "run 0/1.jpg", "run 0/2.jpg"]) == pair


def test_photographs_to_lay_that_are_none_or_may_be_several_are_refused() -> None:
    with pytest.raises(InputError, match="--lay 'a/b/c' may be 'a' and 'b/c', or 'a/b' and 'c'"):
        laid_pair("a/b/c", ["a", "b", "c", "a/b", "b/c"])
    with pytest.raises(InputError, match="--lay 'a/b' may be 'a' and 'b', or 'a/b' and 'a/b'"):
        laid_pair("a/b", ["a", "b", "a/b"])
    with pytest.raises(InputError, match="--lay '101/103': neither LEFT/RIGHT nor"):
        laid_pair("101/103", ["101", "102"])


def test_the_photographs_of_the_command_line_are_laid(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    laid = []
    photographs = {"run/1.jpg": {}, "run/2.jpg": {}}
    monkeypatch.setattr("anaplot.simulation.opening.plates_in", lambda *_: (photographs, {}))
    monkeypatch.setattr(
        "anaplot.report.simulatorcommand.run_simulator", lambda *_, **said: laid.append(said) or 0
    )
    command = ["plotter", "sim", "simulated"]
    assert main([*command, "--lay", "left/right"]) == 0
    assert main([*command, "--truth", "b", "--lay", "run/1.jpg/run/2.jpg"]) == 0
    assert [said["laid"] for said in laid] == [("left", "right"), ("run/1.jpg", "run/2.jpg")]
    assert main([*command, "--lay", "run/1.jpg"]) == 2
    assert "--lay 'run/1.jpg': neither" in capsys.readouterr().err
