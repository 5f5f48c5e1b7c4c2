"""A first-time user's path through a real terminal: he does what the screen says."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from clibench import anaplot
from programs import AtTerminal, at_terminal

pytestmark = pytest.mark.slow

KEYS = {"Enter": "\r", "enter": "\r", "space": " "}
MOST = 1000


def now(screen: str) -> str:
    """What the line NOW says."""
    found = re.search(r"^ NOW +(.*)$", screen, re.MULTILINE)
    return "" if found is None else found[1].strip()


def last_line(screen: str) -> str:
    """The last line with anything on it."""
    return screen.rstrip().rpartition("\n")[2]


def key_of(sentence: str) -> str | None:
    """The first key that a sentence names."""
    found = re.search(r"(?:then|:) (Enter|enter|space|[a-zA-Z+])(?: |,|$)", sentence)
    return None if found is None else KEYS.get(found[1], found[1])


def follow(terminal: AtTerminal, done: Callable[[], bool]) -> list[str]:
    """Press what NOW says until that is done; returns what it said, in order."""
    said: list[str] = []
    for _ in range(MOST):
        terminal.until(lambda screen: done() or key_of(now(screen)) is not None)
        sentence = now(terminal.quiet())
        if done():
            return said
        key = key_of(sentence)
        if key is not None:
            said += [] if said and said[-1] == sentence else [sentence]
            terminal.type(key)
    raise AssertionError(f"it leads nowhere:\n{terminal.screen}")


@pytest.mark.long
def test_from_nothing_to_the_adjusted_block(tmp_path: Path) -> None:
    folder = tmp_path / "survey"
    points = folder / "image_points.csv"  # written when a model is accepted
    python = [sys.executable, "-m", "anaplot"]
    with at_terminal([*python, "new", "survey"], tmp_path) as terminal:
        # every question has a default; three of them he answers
        for question, answer in [
            ("name of the block", ""),
            ("camera:", "152.4"),
            ("photos of strip 1", "101-102"),
            ("photos of strip 2", ""),
            ("control points", ""),
            ("profile", ""),
            ("pattern", "6"),
            ("sigma", ""),
        ]:
            terminal.until(lambda screen, asked=question: asked in last_line(screen))
            terminal.type(answer + "\r")
        assert terminal.ended() == 0
    opened = [*python, "open", "survey", "--simulate", "--operator", "ann"]
    with at_terminal(opened, tmp_path) as terminal:
        terminal.until(lambda screen: "NOW" in screen)
        said = follow(terminal, points.exists)
        assert sum("measure" in one for one in said) >= 6
        terminal.type("q")
        assert terminal.ended() == 0
        # the shell's one line may be broken by the width of the screen
        assert "1 model accepted" in terminal.screen
    with at_terminal(opened, tmp_path) as terminal:
        terminal.until(lambda screen: "every model is accepted" in screen)
        terminal.type("q")
        assert terminal.ended() == 0
    found = json.loads(anaplot("status", folder, "--json").stdout)
    (model,) = found["strips"][0]["models"]
    assert (model["left"], model["right"], model["state"]) == ("101", "102", "accepted")
    assert found["next"]["do"] == "adjust"
    bridged = json.loads(anaplot("bridge", folder, "--json").stdout)
    assert bridged["strips"][0]["models"][0]["sigma0_um"] == model["sigma0_um"]
    adjusted = anaplot(*found["next"]["command"].split()[1:], "--json")
    assert adjusted.returncode == 0, adjusted.stderr
    assert len(json.loads(adjusted.stdout)["photos"]) == 2
