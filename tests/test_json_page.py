"""docs/json.md names every key that the commands print, and none that no module knows."""

from __future__ import annotations

import argparse
import json
import re
import shutil
from collections.abc import Iterator
from contextlib import chdir, redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anaplot.cli import command_parser, main

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "json.md"

# commands that print nearly all that there is, by section of the page
RUNS = {
    "anaplot bridge": ["bridge flown --errors odds --pairs --matrix --plant 102:02-02:y:300"],
    "anaplot adjust": [
        "adjust g3b --errors search --control-last --prior separate --additional physical --pairs",
        "adjust g3b --snooping --correlations 0.5 --components --additional ebner "
        "--additional-prior b1=12+-3 --test-set point:32 --function distance,32,33 "
        "--covariance points:32,33 photos:101 --control-page",
        "adjust g3b --given g3b.npz --posterior next.npz --gnss-shift strip",
        "adjust flown --calibrate c,k1 --calibrate-sigma c=0.1,k1=0.01 --plant 102:02-02:y:100",
        "adjust flown --additional auto",
        "adjust flown --thin 0.2",
        "adjust tied --errors odds",
        "adjust tied --datum free",
        "adjust off",
    ],
    "anaplot compare": ["compare flown later", "compare flown later tied"],
    "anaplot fit": ["fit flown"],
    "anaplot inner": ["inner scan.toml"],
    "anaplot status": ["status flown"],
    "anaplot plan pattern": ["plan pattern 9/3 --matrix --plant 1:y:100", "plan pattern 6 9"],
    "anaplot plan block": [
        "plan block --strips 2 --photos 3",
        "plan block --strips 1 --photos 4 --stabilize 1",
    ],
    "Several bridging distances": ["plan block --bridging 1,2"],
    "anaplot plan network": [
        "plan network cube --case C --point 2 --plant 4:1:x:-30",
        "plan network cube --case A,B",
    ],
    "anaplot plan additional": ["plan additional gruen"],
    "anaplot plan simulate": [
        "plan simulate bayes-G0A --runs 2",
        "plan simulate 9/3 --runs 2",
        "plan simulate flown --runs 2",
        "plan simulate --list",
    ],
    "anaplot plotter list": ["plotter list"],
    "anaplot demo": ["demo --auto --keep demo"],
    "anaplot log": ["log demo"],
    "anaplot pointing": ["pointing demo"],
    "anaplot replay": ["replay demo/sessions/0001.jsonl"],
    "anaplot import and export": ["export patb flown -o model", "import patb model -o back"],
}
ANYWHERE = {"differs_from_journal"}


@cache
def sections() -> dict[str, list[tuple[list[str], str]]]:
    """Return the rows of every section: the keys of the first cell, and the last cell."""
    found: dict[str, list[tuple[list[str], str]]] = {}
    rows: list[tuple[list[str], str]] = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if heading := re.match(r"##+ (.*)", line):
            rows = found.setdefault(heading[1], [])
        elif line.startswith("| `"):
            cells = [cell.strip() for cell in line.removeprefix("|").removesuffix("|").split("|")]
            assert len(cells) == 3, line
            keys: list[str] = []
            for key in re.findall(r"`([^`]+)`", cells[0]):
                beside = keys[-1].rpartition(".")[0] if keys else ""
                keys.append(f"{beside}.{key}" if beside else key)
            rows.append(([key.replace("[]", "") for key in keys], cells[2]))
    return found


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


@cache
def told(section: str) -> frozenset[str]:
    """Return the keys of a section, with those of what it refers to."""
    anchors = {_anchor(heading): heading for heading in sections()}
    out: set[str] = set()
    for keys, meaning in sections()[section]:
        out.update(keys)
        for anchor in re.findall(r"\]\(#([^)]+)\)", meaning):
            out.update(f"{key}.{under}" for key in keys for under in told(anchors[anchor]))
    return frozenset(out)


def walked(value: Any, path: str = "") -> Iterator[str]:
    """Yield the paths of all that is no mapping and no list of mappings."""
    if isinstance(value, dict):
        for key, inside in value.items():
            yield from walked(inside, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        for item in value:
            yield from walked(item, path)
    else:
        yield path


def _known(path: str, pages: frozenset[str]) -> bool:
    parts = path.split(".")
    # names that are data, and what is null or empty here and a mapping elsewhere
    data = (".".join([*parts[:k], "NAME", *parts[k + 1 :]]) for k in range(1, len(parts)))
    return any(
        one in pages or any(key.startswith(f"{one}.") for key in pages) for one in (path, *data)
    ) or any(re.fullmatch(rf"{re.escape(key)}\.\w+", path) for key in pages if key in OPEN)


OPEN = {"strips.transformation.polynomials"}  # its keys are names


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Small blocks with something to tell."""
    at = tmp_path
    flown = ["plan", "block", "--strips", "2", "--photos", "3", "--sidelap", "60", "--to"]
    assert main([*flown, str(at / "flown")]) == 0
    shutil.copytree(at / "flown", at / "later")
    shutil.copytree(at / "flown", at / "tied")
    for name, seed in (("flown", 3), ("later", 5), ("tied", 7)):
        _measure_anew(at / name / "image_points.csv", seed)
    (at / "tied" / "distances.csv").write_text(
        "from,to,distance,sigma,use\n02-01,02-02,920.0,0.05,control\n02-02,02-03,920.0,0.05,check\n"
    )
    _switch_off(shutil.copytree(at / "flown", at / "off"))
    one = ["plan", "simulate", "bayes-G3B", "--seed", "1", "--to-block", str(at / "g3b")]
    assert main(one) == 0
    assert main(["adjust", str(at / "g3b"), "--posterior", str(at / "g3b.npz")]) == 0
    text = (ROOT / "docs" / "inner-orientation.md").read_text(encoding="utf-8")
    camera, scan = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)[:2]
    (at / "rc30.toml").write_text(camera, encoding="utf-8")
    (at / "scan.toml").write_text(scan, encoding="utf-8")
    return at


def _measure_anew(path: Path, seed: int) -> None:
    """Give error-free coordinates noise of 5 um, and one a gross error."""
    header, *lines = path.read_text(encoding="utf-8").splitlines()
    rng = np.random.default_rng(seed)
    columns = header.split(",")
    rows = [line.split(",") for line in lines]
    for k, row in enumerate(rows):
        for axis in "xy":
            at = columns.index(axis)
            row[at] = repr(float(row[at]) + rng.normal(0.0, 0.005) + 0.09 * (k == 9))
    path.write_text("\n".join([header, *map(",".join, rows)]) + "\n", encoding="utf-8")


def _switch_off(block: Path) -> None:
    """Switch off rays, control and a prior, and leave a gross error in."""
    points = block / "image_points.csv"
    header, *rows = points.read_text(encoding="utf-8").splitlines()
    uses = {2: ",off,blurred", 6: ",x,"}
    lines = [f"{row}{uses.get(k, ',,')}" for k, row in enumerate(rows)]
    points.write_text("\n".join([f"{header},use,reason", *lines]) + "\n", encoding="utf-8")
    control = block / "control.csv"
    lines = control.read_text(encoding="utf-8").splitlines()
    lines[1] = lines[1].replace("control", "off")
    lines[2] = lines[2].replace("0.0,0.0,0.0,control", "0.05,0.05,0.05,control")
    more = ["02-02,920.0,0.0,0.0,1,1,1,prior", "02-03,1840.0,0.0,0.0,1,1,1,off"]
    control.write_text("\n".join([*lines, *more]) + "\n", encoding="utf-8")


@pytest.fixture
def printed(folder: Path) -> dict[str, set[str]]:
    """The keys that the commands print, by section."""
    found: dict[str, set[str]] = {}
    with chdir(folder):
        for section, runs in RUNS.items():
            for words in runs:
                said = StringIO()
                call = [
                    word.replace(",", " ") if "distance" in word else word for word in words.split()
                ]
                with redirect_stdout(said):
                    assert main([*call, "--json"]) == 0, words
                found.setdefault(section, set()).update(walked(json.loads(said.getvalue())))
    return found


@pytest.mark.slow
@pytest.mark.long
def test_the_page_has_the_keys_that_are_printed_and_no_other(printed: dict[str, set[str]]) -> None:
    """A key that the runs have no reason to print is a word or a field of some module."""
    undescribed = [
        f"{section}: {path}"
        for section, paths in printed.items()
        for path in sorted(paths)
        if not _known(path, told(section) | ANYWHERE)
    ]
    assert undescribed == []
    declared = {"NAME"}
    for path in (ROOT / "anaplot").rglob("*.py"):
        found = re.findall(r'"(\w+)"|^\s+(\w+):', path.read_text(encoding="utf-8"), re.MULTILINE)
        declared.update(word for pair in found for word in pair)
    missing = [
        f"{section}: {key}"
        for section, paths in printed.items()
        for key in told(section)
        if not any(path == key or path.startswith(f"{key}.") for path in paths)
        and key.rpartition(".")[2] not in declared
    ]
    assert missing == []


def _with_json(parser: argparse.ArgumentParser, name: str) -> Iterator[str]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, under in action.choices.items():
                yield from _with_json(under, f"{name} {word}")
        elif "--json" in action.option_strings:
            yield name


def test_every_command_with_json_has_a_section() -> None:
    there = " and ".join(f"anaplot {h}" for s in sections() for h in re.split(r"anaplot | and ", s))
    missing = [name for name in _with_json(command_parser(), "anaplot") if name not in there]
    assert missing == ["anaplot report"]  # that of adjust, as the page says
    assert "`anaplot report`" in PAGE.read_text(encoding="utf-8")


def test_every_section_is_of_a_command_or_referred_to() -> None:
    anchors = re.findall(r"\]\(#([^)]+)\)", PAGE.read_text(encoding="utf-8"))
    for heading, rows in sections().items():
        assert heading in RUNS or _anchor(heading) in anchors or not rows, heading
