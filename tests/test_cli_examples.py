"""Examples of every help parse, and those that need no instrument are run."""

from __future__ import annotations

import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clibench import every_parser

from anaplot.cli import command_parser, main
from anaplot.exchange.blockfolder import read_block, write_control, write_image_points
from anaplot.orientation.strip import bridge_strip
from anaplot.photogrammetry.block import ControlPoint
from anaplot.plotter.profile import find_profiles

PARSERS = {one.prog: one for one in every_parser(command_parser())}
EXAMPLES = tuple(dict.fromkeys(line for one in PARSERS.values() for line in one.examples))
INSTRUMENT = ("anaplot open ", "anaplot plotter watch ", "anaplot plotter sim ")


def words(example: str) -> list[str]:
    """What the program is given of a line: without what the shell does with its output."""
    program, *given = shlex.split(example.partition(" > ")[0].partition(" | ")[0])
    assert program == "anaplot"
    return given


def is_run(example: str) -> bool:
    return not example.startswith(INSTRUMENT) and example != "anaplot demo"


@pytest.mark.parametrize("prog", PARSERS)
def test_every_help_has_two_examples_of_its_own(prog: str) -> None:
    parser = PARSERS[prog]
    assert len(set(parser.examples)) >= 2
    assert all(one.startswith("anaplot ") for one in parser.examples)
    if prog != "anaplot":
        assert all(f"{one} ".startswith(f"{prog} ") for one in parser.examples)
    assert parser.format_help().endswith("\n".join(f"  {one}" for one in parser.examples) + "\n")


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_parses(
    example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("myblock").mkdir()
    if not example.endswith(" --help"):
        assert callable(command_parser().parse_args(words(example)).run)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with all that the examples name: a measured block with control, and its epochs."""
    monkeypatch.chdir(tmp_path)
    block = tmp_path / "myblock"
    assert main(["demo", "--auto", "--models", "3", "--keep", str(block)]) == 0
    read = read_block(block)
    at = {
        p.point: np.array([p.X, p.Y, p.Z]) * 10.0
        for model in bridge_strip(read, read.strips[0]).models
        for p in model.points
    }
    names = list(at)
    rng = np.random.default_rng(1)
    write_control(
        block,
        [
            ControlPoint(name, tuple((at[name] + rng.normal(0.0, 0.02, 3)).round(3).tolist()))
            for name in (*names[:3], names[len(names) // 2], *names[-3:])
        ],
    )
    for name in ("spring", "summer", "autumn"):
        shutil.copytree(block, tmp_path / name)
        noise = rng.normal(0.0, 0.003, (len(read.image_points), 2))
        both = zip(read.image_points, noise, strict=True)
        write_image_points(
            tmp_path / name, [replace(p, x=p.x + dx, y=p.y + dy) for p, (dx, dy) in both]
        )
    for folder in ("backup", "sparse"):
        (tmp_path / folder).mkdir()
    # the camera of the block that `anaplot new` makes, on a plate that lies shifted
    marks = {1: (2.003, 118.0), 2: (228.001, 118.002), 3: (115.001, 231.004), 4: (115.004, 5.002)}
    Path("fiducials.toml").write_text(
        'format = 1\ncamera = "flight/camera-rmk15.toml"\n[photo.101]\n'
        + "".join(f"{name} = [{x}, {y}]\n" for name, (x, y) in marks.items())
    )
    Path("plates.csv").write_text("photo,point,x,y\n101,7,84.121,203.482\n")
    shutil.copy(find_profiles()["anaplot-ascii"], "my-counter.toml")
    Path("points.txt").write_text("name,E,N,H\n1,1000.0,2000.0,100.0\n2,3000.0,2500.0,120.0\n")
    assert main(["export", "colmap", "myblock", "-o", "sparse/0"]) == 0
    return tmp_path


@pytest.mark.slow
@pytest.mark.long
def test_the_examples_do_what_they_say(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ran = [one for one in EXAMPLES if is_run(one)]
    assert len(ran) > 0.8 * len(EXAMPLES)
    for example in ran:
        capsys.readouterr()
        try:
            code = main(words(example))
        except SystemExit as end:
            code = end.code
        said = capsys.readouterr()
        assert (code, said.err) == (0, ""), example
        given = words(example)
        if not {"-o", "--to"} & set(given):
            assert said.out, example
        for option in ("-o", "--csv", "--to", "--report"):
            if option in given:
                assert Path(given[given.index(option) + 1]).exists(), example
