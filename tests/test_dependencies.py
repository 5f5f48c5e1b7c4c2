"""What is tested against is what pyproject.toml states."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def pins(name: str) -> dict[str, list[str]]:
    """Versions pinned in a file of constraints, in its order."""
    found: dict[str, list[str]] = {}
    for line in (ROOT / ".ci" / name).read_text().splitlines():
        if line and not line.startswith("#"):
            package, version = line.split(";")[0].strip().split("==")
            found.setdefault(package, []).append(version)
    return found


def test_the_lowest_that_are_tested_are_the_bounds() -> None:
    bounds = dict(re.split(">=|==", one) for one in PROJECT["dependencies"])
    assert {package: versions[0] for package, versions in pins("lowest.txt").items()} == bounds


def test_the_known_set_has_the_tools_of_the_extras() -> None:
    """Of the extras that pin what they name (test, docs), every pin."""
    known = pins("known.txt")
    extras = PROJECT["optional-dependencies"]
    tools = [one.split("==") for extra in extras.values() for one in extra if "==" in one]
    assert {tool: known[tool] for tool, _ in tools} == {tool: [v] for tool, v in tools}
    assert {"sphinx", "pytest"} <= {tool for tool, _ in tools}
    assert known.keys() >= {"numpy", "scipy", "textual", "pyserial"}


def test_what_is_optional_is_tested_within_its_bounds() -> None:
    known = pins("known.txt")
    extras = PROJECT["optional-dependencies"]
    optional = [one.split(">=") for extra in extras.values() for one in extra if ">=" in one]
    assert optional
    for package, bound in optional:
        (version,) = known[package]
        assert [int(part) for part in version.split(".")] >= [int(x) for x in bound.split(".")]
        assert f"{package}=={version}" in extras["test"]
