"""[refinement] of a block.toml: what is read, written and wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import format_block_toml, parse_block_toml
from anaplot.photogrammetry.airandearth import AirAndEarth

CAMERA = 'format = 1\n[camera]\nid = "k"\nc = 152.0\n'
HEAD = 'format = 1\nname = "t"\n'
TAIL = '[[camera]]\nfile = "k.toml"\n'
BOTH = "flying_height = 1900.0\nground_height = 200\n"


def parsed(refinement: str, tail: str = TAIL):
    return parse_block_toml(HEAD + refinement + tail, Path("B/block.toml"), {"k.toml": CAMERA})


def test_a_block_says_what_is_taken_off():
    block = parsed(f"[refinement]\nrefraction = true\n{BOTH}")
    assert block.air == AirAndEarth(1900.0, 200.0, refraction=True)
    both = parsed(f"[refinement]\nrefraction = true\nearth_curvature = true\n{BOTH}")
    assert both.air == AirAndEarth(1900.0, 200.0, refraction=True, earth_curvature=True)
    for one in (block, both):
        again = parse_block_toml(format_block_toml(one), Path("x"), {"k.toml": CAMERA})
        assert again == one


@pytest.mark.parametrize(
    "words", ["", "[refinement]\n", f"[refinement]\n{BOTH}", "[refinement]\nrefraction = false\n"]
)
def test_nothing_is_taken_off_unless_it_is_asked_for(words):
    block = parsed(words)
    assert block.air is None
    assert "refinement" not in format_block_toml(block)


@pytest.mark.parametrize(
    ("words", "line", "said"),
    [
        ("refraction = true\nflying_height = 1900.0\n", 4, "refraction without ground_height"),
        ("earth_curvature = true\n", 4, "earth_curvature without flying_height"),
        ("flying_height = 200\nground_height = 200\n", 4, "must be above ground_height"),
        (f"refraction = 1\n{BOTH}", 4, "refraction: must be true or false, not a number"),
        (f"refracton = true\n{BOTH}", 4, "did you mean 'refraction'"),
        ("flying_height = 20001\n", 4, "must lie between -500 and 20000"),
        ("flying_height = nan\n", 4, "must be a finite number"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(words, line, said):
    with pytest.raises(InputError) as caught:
        parsed(f"[refinement]\n{words}")
    assert str(caught.value).startswith(f"B/block.toml line {line}: [refinement] ")
    assert said in str(caught.value)


GROUND = '[ground]\ncrs = "EPSG:32632"\nframe = "{}"\norigin = [9.0, 48.0, 300.0]\n'


def test_a_tangential_system_is_curved_already():
    both = f"[refinement]\nearth_curvature = true\n{BOTH}"
    with pytest.raises(InputError, match=r'line 4: .*curved in \[ground\] frame = "local" already'):
        parsed(both + GROUND.format("local"))
    assert parsed(both + GROUND.format("offset")).air is not None
    assert parsed(both.replace("earth_curvature", "refraction") + GROUND.format("local")).air


def test_a_camera_without_a_file_cannot_be_refined():
    tail = '[[camera]]\nid = "k"\nc = 152.0\n'
    with pytest.raises(InputError, match=r"line 3: \[refinement\]: camera 'k' has no file"):
        parsed(f"[refinement]\nrefraction = true\n{BOTH}", tail)
    assert parsed("", tail).air is None
