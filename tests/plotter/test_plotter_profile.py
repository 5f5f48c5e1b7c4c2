from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.plotter import profile as profile_module
from anaplot.plotter.examples import check_examples
from anaplot.plotter.profile import find_profiles, load_profile, parse_profile
from anaplot.plotter.schema import Profile

ROOT = Path(__file__).parents[2]
MINIMAL = """\
schema = 1
id = "mine"
title = "A gauge"
status = "simulated"
sources = ["none"]

[link.main]
baud = 9600

[framing]
kind = "line"
terminator = "\\n"

[record.value]
kind = "position"
pattern = '^(?P<x>[-+]\\d{3}\\.\\d{3}) (?P<y>[-+]\\d{3}\\.\\d{3})$'

[axis.x]
range = [-100.0, 100.0]

[axis.y]
range = [-100.0, 100.0]

[[example]]
bytes = "+001.000 -002.500\\n"
means = [{ position = [1.0, -2.5] }]
"""


def read(text: str) -> Profile:
    return parse_profile(text.encode(), "mine.toml")


def changed(old: str, new: str) -> str:
    assert MINIMAL.count(old) == 1
    return MINIMAL.replace(old, new)


def test_every_profile_that_comes_with_the_program_decodes_its_examples(any_profile):
    assert check_examples(any_profile) == []
    assert any_profile.sources
    assert len(any_profile.sha256) == 64


def test_every_shipped_profile_is_found_by_its_own_id():
    found = find_profiles()
    assert set(found) >= {
        "anaplot-ascii",
        "simulated",
        "heidenhain-nd281b",
        "heidenhain-nd720",
        "mitutoyo-gauge",
        "summagraphics-mm1103",
        "summagraphics-mm1201",
    }
    for name, path in found.items():
        assert load_profile(path).id == name


def test_minimal_profile():
    profile = read(MINIMAL)
    assert profile.mono
    assert profile.poll is None
    assert profile.drive is None
    assert check_examples(profile) == []


def test_what_a_desk_is_told_of_read_outs():
    asked, driven, pressed = map(load_profile, ("heidenhain-nd281b", "simulated", "mitutoyo-gauge"))
    assert (asked.reads, driven.reads, pressed.reads) == (True, True, False)
    assert read(MINIMAL).reads
    assert driven.still == pytest.approx(0.003)
    # in the plate's coordinates, of which one is the difference of two axes
    stage = "[stage]\nx = { x = 1.0, y = -1.0 }\ny = { y = 1.0 }\n\n[[example]]"
    turned = changed("[[example]]", stage).replace("[1.0, -2.5]", "[3.5, -2.5]")
    assert read(turned).still == pytest.approx(0.006)


def test_an_example_that_means_something_else_is_told():
    profile = read(changed("[1.0, -2.5]", "[1.0, -2.4]"))
    (problem,) = check_examples(profile)
    assert problem.startswith("example 1: it means position at 1.000000 -2.500000, not")


def line_of(text: str, start: str) -> int:
    return next(n for n, line in enumerate(text.splitlines(), 1) if line.startswith(start))


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("schema = 1", "schema = 2", ["line 1", "schema", "newer"]),
        ("schema = 1\n", "", ["schema"]),
        ("baud = 9600", "buad = 9600", ["[link.main] buad", "unknown key", "'baud'"]),
        ("baud = 9600", "baud = 9", ["[link.main] baud", "50"]),
        ("baud = 9600", 'parity = "evn"', ["[link.main] parity", "'even'"]),
        ("baud = 9600", "baud = true", ["baud", "whole number"]),
        ("[framing]", "[frameing]", ["line 10", "frameing", "unknown table", "'framing'"]),
        ('kind = "line"', 'kind = "lines"', ["[framing] kind", "'line'"]),
        ('terminator = "\\n"', 'terminator = ""', ["terminator", "empty"]),
        ('kind = "position"', 'kind = "record"', ["footswitch"]),
        ("pattern = '^", "pattern = '", ["[record.value] pattern", "anchored"]),
        ("[axis.y]", "[axis.z]", ["'z'"]),
        ("title =", "titel =", ["title"]),
        ('status = "simulated"', 'status = "tested"', ["status", "verified"]),
        ('id = "mine"', 'id = "Mine!"', ["id", "lower case"]),
        ("means = [{ position", "means = [{ postion", ["[[example]] means.postion", "'position'"]),
        ("[1.0, -2.5]", "[1.0, -2.5, 3.0]", ["2 numbers"]),
        ("[[example]]", "[example]", ["example"]),
        ("sources", "extra = 1\nsources", ["extra", "unknown key"]),
    ],
)
def test_errors_name_file_line_table_and_key(old, new, parts):
    with pytest.raises(InputError) as caught:
        read(changed(old, new))
    message = str(caught.value)
    assert message.startswith("mine.toml")
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_the_line_is_the_keys_own():
    text = changed("baud = 9600", "# a comment\nbuad = 9600")
    with pytest.raises(InputError, match=f"line {line_of(text, 'buad')}: "):
        read(text)
    text = MINIMAL.replace("range = [-100.0, 100.0]\n\n[[", "range = [5, 1]\n\n[[")
    with pytest.raises(InputError, match=rf"line {line_of(text, 'range = [5')}: \[axis.y\] range"):
        read(text)
    text = MINIMAL.replace("-2.5] }]", '-2.5] }]\n\n[[example]]\nbytes = "a"\nlenk = 1\n')
    with pytest.raises(InputError, match=rf"line {line_of(text, 'lenk')}: \[\[example\]\] lenk"):
        read(text)


@pytest.mark.parametrize(
    ("table", "part"),
    [
        ('[drive]\ncommand = "G {x:.3f} {z:.3f}"\nstop="S"\nin_position="value"', "{z}"),
        ('[drive]\ncommand = "G {x:.3f}"\nstop="S"\nin_position="value"', "axis y"),
        ('[drive]\ncommand = "G {x} {y}"\nstop="S"\nin_position="value"', "in-position"),
        ('[poll]\nrequest = ""', "empty"),
        ('[poll]\nrequest = "?"\nlinks = ["mian"]', "'main'"),
        ('[checksum]\nkind = "crc"', "xor8"),
        ('[footswitch.a]\nsource = "record"\nrecord = "value"', "group"),
        ('[footswitch.a]\nsource = "modem"\nline = "ctx"', "cts"),
        ("[stage]\nx = { x = 1.0 }\ny = { x = 1.0 }", "inverted"),
        ("[stage]\nx = { x = 1.0 }\ny = { q = 1.0 }", "unknown axis 'q'"),
        ("[stage]\nxl={x=1}\nyl={y=1}\nxr={x=1}\nyr={y=1}", "needs 4 axes"),
        ("[simulate]\nlatency = -1", "between"),
        ("[simulate]\nspeed = nan", "finite"),
        ("[simulate]\nlatancy = 1", "'latency'"),
    ],
)
def test_further_tables_are_checked(table, part):
    with pytest.raises(InputError, match=r"mine\.toml") as caught:
        read(MINIMAL.replace("[[example]]", table + "\n\n[[example]]"))
    assert part in str(caught.value)


def test_user_folder_comes_first(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "anaplot" / "device_profiles"
    folder.mkdir(parents=True)
    (folder / "mine.toml").write_text(MINIMAL)
    shutil.copy(ROOT / "device_profiles" / "simulated.toml", folder / "simulated.toml")
    found = find_profiles()
    assert found["mine"] == folder / "mine.toml"
    assert found["simulated"] == folder / "simulated.toml"
    assert found["anaplot-ascii"].parent != folder
    assert load_profile("mine").title == "A gauge"


def test_profiles_inside_an_installed_package_are_found(tmp_path, monkeypatch):
    package = tmp_path / "site" / "anaplot"
    (package / "plotter").mkdir(parents=True)
    shutil.copytree(ROOT / "device_profiles", package / "device_profiles")
    monkeypatch.setattr(profile_module, "__file__", str(package / "plotter" / "profile.py"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "none"))
    assert find_profiles()["simulated"] == package / "device_profiles" / "simulated.toml"


def test_unknown_name_and_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"no device profile 'simulatd'.*'simulated'"):
        load_profile("simulatd")
    with pytest.raises(InputError, match="file not found"):
        load_profile(tmp_path / "none.toml")
    with pytest.raises(InputError, match="a folder, not a file"):
        load_profile(tmp_path)


def test_size_is_bounded(tmp_path):
    file = tmp_path / "big.toml"
    file.write_bytes(b"#" * 70_000)
    with pytest.raises(InputError, match=r"more than 65\.54 kB is not read"):
        load_profile(file)
    with pytest.raises(InputError, match="larger than"):
        parse_profile(b"#" * 70_000, "big.toml")


@pytest.mark.parametrize(
    "raw",
    [b"\xff\xfe", b"a = ", b"a = " + b"[" * 20_000, b"a = " + b"9" * 5000, b"[a]\n[a]\n", b""],
)
def test_what_is_no_toml(raw):
    with pytest.raises(InputError) as caught:
        parse_profile(raw, "x.toml")
    assert "\n" not in str(caught.value)


def test_hostile_text_is_shown_as_text():
    profile = read(changed('title = "A gauge"', 'title = "\\u001b[2J[red]x"'))
    assert profile.title == "\\x1b[2J[red]x"
    with pytest.raises(InputError) as caught:
        read(changed("baud = 9600", '"\\u001b[2J" = 1'))
    assert "\x1b" not in str(caught.value)


SOURCES = [path.read_bytes() for path in sorted((ROOT / "device_profiles").glob("*.toml"))]


def taken_or_refused_in_one_line(raw: bytes) -> None:
    message = "ok"
    try:
        check_examples(parse_profile(raw, "fuzz.toml"))
    except InputError as error:
        message = str(error)
    assert message.isprintable()


@given(st.binary(max_size=400))
def test_any_bytes_are_a_profile_or_an_input_error(raw):
    with pytest.raises(InputError):
        parse_profile(raw, "fuzz.toml")


@pytest.mark.slow
@settings(max_examples=300)
@given(st.data())
def test_a_damaged_profile_is_a_profile_or_an_input_error(data):
    raw = bytearray(data.draw(st.sampled_from(SOURCES)))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(raw) - 1))
        count = data.draw(st.integers(0, 6))
        raw[at : at + count] = data.draw(st.binary(max_size=6))
    taken_or_refused_in_one_line(bytes(raw))


TOKENS = st.sampled_from(
    [
        "1",
        "-1",
        "0",
        "1e400",
        "nan",
        "inf",
        "true",
        '""',
        '"x"',
        "[]",
        "{}",
        "[1,2]",
        "[{}]",
        "1979-05-27",
        '"\\u0000"',
        '"{"',
        '"{xl.__class__}"',
        '"\\u4e2d"',
        "99999999999999999999",
    ]
)


@pytest.mark.slow
@settings(max_examples=400)
@given(st.sampled_from(SOURCES), st.integers(0, 10_000), TOKENS)
def test_a_value_of_another_type_is_refused_or_taken_never_a_crash(raw, number, token):
    lines = raw.decode().splitlines()
    places = [at for at, line in enumerate(lines) if re.match(r"\w+ = ", line)]
    at = places[number % len(places)]
    lines[at] = lines[at].split("=")[0] + "= " + token
    taken_or_refused_in_one_line("\n".join(lines).encode())
