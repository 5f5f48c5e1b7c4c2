"""Keys of many dots are refused before tomllib sees them; all else is as tomllib has it."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import anaplot
from anaplot.textfiles.tomlvalues import MOST_DOTS, TomlError, toml_values

LONG = ".".join(["a"] * (MOST_DOTS + 2))
ALLOWED = ".".join(["a"] * (MOST_DOTS + 1))

BOMB = """
import resource, sys
from pathlib import Path
from anaplot.errors import InputError
from anaplot.console.keymap import load_keymap
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.camerafile import read_camera
from anaplot.exchange.networkfile import read_network
from anaplot.exchange.patternfile import read_pattern
from anaplot.plotter.profile import load_profile
path = Path(sys.argv[1])
resource.setrlimit(resource.RLIMIT_AS, (1_000_000_000,) * 2)
readers = (
    load_keymap, read_camera, read_network, read_pattern, load_profile,
    lambda path: read_block(path.parent),
)
for read in readers:
    try:
        read(path)
    except InputError as error:
        print(error)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", [f"{'.'.join('a' * 30_000)} = 1\n", f"[{'.'.join('a' * 30_000)}]\n"]
)
def test_no_reader_of_toml_takes_a_key_of_thousands_of_dots(tmp_path, text):
    path = tmp_path / "block.toml"
    path.write_text(text)
    result = subprocess.run(
        [sys.executable, "-c", BOMB, str(path)],
        capture_output=True,
        text=True,
        env={
            **os.environ,
            "PYTHONPATH": str(Path(anaplot.__file__).parents[1]),
            "OPENBLAS_NUM_THREADS": "1",
        },
        timeout=60,
        check=True,
    )
    said = result.stdout.splitlines()
    assert len(said) == 6
    assert all("a key of more than 32 dots" in line and "line 1" in line for line in said)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"{LONG} = 1", 1),
        (f"\n[{LONG}]", 2),
        (f"[[ {LONG} ]]", 1),
        (f"x = 1\n\ny = {{ {LONG} = 1 }}", 3),
        (LONG.replace("a", '"a"') + "=1", 1),
        (LONG.replace("a", "''") + "=1", 1),
        (LONG.replace(".", " \t. ") + "=1", 1),
        ('x = ["""a"""", "b"]\n' + LONG + "=1", 2),
        ("x = {k = '''a'''''," + LONG + "=1}", 1),
        ('x = "\\""\n' + LONG + "=1", 2),
        ('x = """\n\\"""\n"""\n' + LONG + "=1", 4),
        ('x = ""\n' + LONG + "=1", 2),
        ("x = 'a#\\'\n" + LONG + "=1", 2),
        ("x = '''\n#'''\n" + LONG + "=1", 3),
    ],
)
def test_a_key_of_many_dots_is_found_wherever_it_stands(text, line):
    with pytest.raises(TomlError, match="a key of more than 32 dots") as caught:
        toml_values(text)
    assert caught.value.line == line


@pytest.mark.parametrize(
    "text",
    [
        f"{ALLOWED} = 1",
        f"[{ALLOWED}]\n{ALLOWED} = 1",
        f'x = "{LONG}"',
        f"x = '{LONG}' # {LONG}",
        f'x = """\n{LONG}"""""',
        f"x = '''\n{LONG}\n'''",
        f"x = [{'1.5, ' * 100}]",
        f"x = {{ {', '.join(f'k{n}.a = {n}.5' for n in range(60))} }}",
        f"# {LONG}\nx = 1",
    ],
)
def test_dots_that_join_no_key_are_not_counted(text):
    assert toml_values(text) == tomllib.loads(text)


def outcome(parse: Callable[[str], object], text: str) -> tuple[object, str]:
    try:
        return parse(text), ""
    except ValueError as error:
        return None, str(error)


@given(st.text(alphabet="ab\"'.=[]{}#\\\n ,1", max_size=40))
def test_what_is_read_is_what_tomllib_reads(text):
    expected, why = outcome(tomllib.loads, text)
    values, said = outcome(toml_values, text)
    assert values == expected
    assert why.startswith(said)
    assert bool(why) == bool(said)


PIECES = [
    "a",
    "b",
    "1",
    '""',
    "''",
    '"x.y"',
    "'''",
    '"""',
    "\\",
    "#",
    "\n",
    " ",
    "=",
    "[",
    "]",
    ",",
]
texts = st.lists(st.sampled_from(PIECES), max_size=8).map("".join)


@given(texts, texts)
def test_nothing_before_a_long_key_hides_it(before, after):
    text = f"{before}\n{LONG.replace('a', 'k')} = 1{after}\n"
    expected, _ = outcome(tomllib.loads, text)
    values, said = outcome(toml_values, text)
    if depth(expected) > MOST_DOTS + 1:
        assert "a key of more than 32 dots" in said
    elif not said.startswith("a key of more"):
        assert values == expected


def depth(value: object) -> int:
    return 1 + max(map(depth, value.values()), default=0) if isinstance(value, dict) else 0
