"""Block folders for the tests of this room."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

BLOCK_TOML = """\
format = 1
name = "demo"
[precision]
image_um = 5.0
tie_variance = "paper"
control_m = 0.05
[test]
kind = "tau"
alpha = 0.001
power = 0.80
[[camera]]
id = "rmk"
c = 152.40
format = [230.0, 230.0]
[[strip]]
id = "1"
photos = ["101", "102", "103"]
base = 92.0
[[photo]]
id = "101"
camera = "rmk"
position = [1000.0, 2000.0, 1500.0]
rotation = { omega = 0.0, phi = 90.0, kappa = -180.0, unit = "deg" }
position_sigma = [10.0, 10.0, 10.0]
rotation_sigma = { omega = 0.1, phi = 0.1, kappa = 0.1, unit = "gon" }
[[photo]]
id = "102"
camera = "rmk"
[[photo]]
id = "103"
camera = "rmk"
"""

MakeBlock = Callable[..., Path]


@pytest.fixture
def make_block(tmp_path: Path) -> MakeBlock:
    """Return a function that writes a block folder from texts (or bytes) and returns it."""

    def make(
        toml: str | bytes = BLOCK_TOML,
        points: str | bytes | None = None,
        control: str | bytes | None = None,
    ) -> Path:
        folder = tmp_path / "block"
        folder.mkdir(exist_ok=True)
        names = ("block.toml", "image_points.csv", "control.csv")
        for name, text in zip(names, (toml, points, control), strict=True):
            if text is not None:
                data = text.encode() if isinstance(text, str) else text
                (folder / name).write_bytes(data)
        return folder

    return make


@pytest.fixture
def block_toml() -> str:
    """Return the text of a good block.toml."""
    return BLOCK_TOML
