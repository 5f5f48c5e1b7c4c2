from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest

from anaplot.plotter import profile as profile_module
from anaplot.plotter import profilekeys, schema
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.examples import check_examples
from anaplot.plotter.profile import load_profile, parse_profile
from anaplot.plotter.readings import Record

GUIDE = (Path(__file__).parents[2] / "docs" / "write-a-profile.md").read_text()


def block(language: str) -> str:
    match = re.search(rf"```{language}\n(.*?)```", GUIDE, re.DOTALL)
    assert match is not None
    return match.group(1)


def test_the_smallest_profile_is_one():
    profile = parse_profile(block("toml").encode(), "guide.toml")
    assert check_examples(profile) == []
    plotter = SimulatedPlotter(profile, {})
    assert plotter.step(0.05) == b"+000.000 +000.000\r\n"


def test_every_key_that_the_loader_knows_is_in_the_guide():
    declared = [value for name, value in vars(profilekeys).items() if name.isupper()]
    keys = {key for of in declared if isinstance(of, dict) for key in of}
    # and those whose kind is put together from other tables
    source = Path(profile_module.__file__).read_text()
    kind = r"(?:keys\.|[A-Z]\w+\(|[A-Z]+,|self\._link|place|group,)"
    keys |= set(re.findall(rf'"(\w+)": {kind}', source)) - {"link", "mm"}
    assert len(keys) > 60
    missing = {key for key in keys if not re.search(rf"[`.]{key}\b", GUIDE)}
    assert missing == set()


@pytest.mark.parametrize(
    ("made", "row"),
    [(schema.Simulate, "simulate"), (schema.Footswitch, "footswitch.NAME")],
)
def test_what_stands_when_a_key_is_left_out_is_in_the_guide(made, row):
    (line,) = re.findall(rf"^\| `\[{re.escape(row)}\]` \|.*$", GUIDE, re.MULTILINE)
    usual = {field.name: field.default for field in fields(made)}
    told = {
        name: str(value).lower() if isinstance(value, bool) else f"{value:g}"
        for name, value in usual.items()
        if isinstance(value, bool | int | float)
    }
    assert len(told) > 2
    assert [name for name, value in told.items() if f"`{name}` {value}" not in line] == []


def test_what_the_sketch_prints_is_understood():
    sketch = block("cpp")
    assert '" %c%03ld.%04ld"' in sketch
    assert "sum & 0x8000 ? sum << 1 ^ 0x1021 : sum << 1) & 0xFFFF" in sketch
    profile = load_profile("anaplot-ascii-crc")

    def say(head: str, steps: list[int]) -> bytes:
        text = head
        for value in (step * 10 for step in steps):
            sign = "-" if value < 0 else "+"
            text += f" {sign}{abs(value) // 10000:03d}.{abs(value) % 10000:04d}"
        total = 0xFFFF
        for byte in text.encode():
            total ^= byte << 8
            for _ in range(8):
                total = (total << 1 ^ 0x1021 if total & 0x8000 else total << 1) & 0xFFFF
        return f"{text}*{total:04X}\n".encode()

    (record,) = Decoder(profile).feed(say("R 1 1", [12345, -1, 0, -150_000]), 0.0)
    assert isinstance(record, Record)
    assert record.position.xl == pytest.approx(12.345)
    assert record.position.yl == pytest.approx(-0.001)
    assert record.position.yr == pytest.approx(-150.0)
