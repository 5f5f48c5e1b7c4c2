"""`anaplot new`: from options, from answers, from measurements."""

from __future__ import annotations

import builtins
import io
from pathlib import Path

import pytest

from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_image_points, write_new_block
from anaplot.exchange.camerafile import read_camera, write_camera
from anaplot.exchange.patternfile import read_pattern
from anaplot.photogrammetry.block import ImagePoint, PointPrior
from anaplot.photogrammetry.nominalcameras import NOMINAL_CAMERAS
from anaplot.planning.synthetic import synthetic_strip


def new(*arguments: object) -> int:
    return main(["new", *map(str, arguments)])


def test_decimal_commas_of_control_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "points.txt").write_text("id;E;N;H\n7;1000,5;2000;300\n")
    options = ("--strip", "1-3", "--camera", "153", "--control", tmp_path / "points.txt")
    assert new(tmp_path / "b", *options) == 0
    assert "control: numbers with a decimal comma\n" in capsys.readouterr().out
    assert read_block(tmp_path / "b").control[0].xyz == (1000.5, 2000.0, 300.0)


def test_a_block_from_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = tmp_path / "points.txt"
    points.write_text("id E N H sigma\n7 1000 2000 300 0.05\n8 1500 2000 310 0.05\n")
    folder = tmp_path / "survey"
    assert (
        new(
            folder,
            *("--strip", "101-120"),
            *("--strip", "west=220-201"),
            *("--camera", "rc30"),
            *("--control", points),
            *("--profile", "anaplot-ascii"),
            *("--pattern", "9"),
            *("--sigma", "4"),
        )
        == 0
    )
    block = read_block(folder)
    assert block.name == "survey"
    assert [strip.id for strip in block.strips] == ["1", "west"]
    assert block.strips[1].photos[:2] == ("220", "219")
    assert len(block.photos) == 40
    assert block.precision.image_um == 4.0
    assert block.precision.tie_variance == "exact"
    assert (block.measuring.profile, block.measuring.pattern) == ("anaplot-ascii", "9")
    assert block.cameras[0].calibration == NOMINAL_CAMERAS["rc30"].calibration()
    assert [point.point for point in block.control] == ["7", "8"]
    text = (folder / "block.toml").read_text()
    assert "nominal values of the Wild RC20, Leica RC30" in text
    assert 'first = "220"' in text
    assert "nominal" in (folder / "camera-rc30.toml").read_text().splitlines()[0]
    out = capsys.readouterr().out
    assert "2 strips, 40 photos, 2 control points" in out
    assert "nominal" in out
    assert f"next: anaplot open {folder} --simulate" in out
    # nothing is overwritten
    assert new(folder, "--strip", "1-5") == 2
    assert "exists already and is not overwritten" in capsys.readouterr().err
    assert read_block(folder) == block


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "no photo: name the photos of a strip"),
        (("--camera", "rm15", "--strip", "1-2"), "did you mean 'rmk15'"),
        (("--camera", "-3", "--strip", "1-2"), "camera '-3'"),
        (("--camera", "none.toml", "--strip", "1-2"), "none.toml"),
        (("--strip", "1"), "fewer than 2 photos"),
        (("--strip", "1,2,1"), "photo '1' twice"),
        (("--strip", "a=1-2", "--strip", "a=3-4"), "strip 'a' twice"),
        (("--strip", "009-11"), "equally long"),
        (("--strip", "1-2", "--profile", "nobody"), "nobody"),
        (("--strip", "1-2", "--pattern", "nothing"), "nothing"),
        (("--strip", "1-2", "--name", " "), "the name ' ' is empty"),
        (("--strip", "1-2", "--control", "nowhere.csv"), "nowhere.csv"),
    ],
)
def test_bad_answers_end_with_2_and_write_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    assert new(tmp_path / "b", *(f"{a}" for a in arguments)) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
    assert not (tmp_path / "b" / "block.toml").exists()


def test_priors_of_points_are_no_control(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = tmp_path / "points.txt"
    points.write_text("name,E,N,H,s,use\n1,5,6,7,3,prior\n1,5,6,7,,check\n2,1,2,3,0.1,control\n")
    folder = tmp_path / "b"
    call = ["new", str(folder), "--strip", "1-2", "--camera", "rmk15", "--control"]
    assert main([*call, str(points)]) == 0
    assert "2 control points, 1 point prior\n" in capsys.readouterr().out
    block = read_block(folder)
    assert [(row.point, row.use) for row in block.control] == [("1", "check"), ("2", "control")]
    assert block.priors == (PointPrior("1", (5.0, 6.0, 7.0), (3.0, 3.0, 3.0)),)


def test_measurements_alone_become_a_block(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    models = ["3/4", "1/2", "2/3", "8/9"]
    rows = [
        ImagePoint(photo, "p", 1.0, 2.0, model=model)
        for model in models
        for photo in model.split("/")
    ]
    (tmp_path / "b").mkdir()
    write_image_points(tmp_path / "b", rows)
    assert new(tmp_path / "b", "--camera", "152.4") == 0
    block = read_block(tmp_path / "b")
    assert {strip.photos for strip in block.strips} == {("1", "2", "3", "4"), ("8", "9")}
    assert block.cameras[0].c == 152.4
    assert len(block.image_points) == 8
    assert "next: anaplot bridge" in capsys.readouterr().out


def test_measurements_without_models_have_no_strips(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [ImagePoint(photo, "p", 1.0, 2.0) for photo in ("a", "b", "c")]
    write_image_points(tmp_path, rows)
    assert new(tmp_path, "--camera", "100", "--name", "close range") == 0
    block = read_block(tmp_path)
    assert block.strips == ()
    assert [photo.id for photo in block.photos] == ["a", "b", "c"]
    assert "next: anaplot adjust" in capsys.readouterr().out
    assert main(["bridge", str(tmp_path)]) == 2
    assert "at least one [[strip]] is needed" in capsys.readouterr().err
    # outside the format: nothing is written
    (tmp_path / "block.toml").unlink()
    write_image_points(tmp_path, [ImagePoint("a", "p", 116.0, 2.0)])
    assert new(tmp_path, "--camera", "rmk15") == 2
    assert "lies outside the format" in capsys.readouterr().err
    assert not (tmp_path / "block.toml").exists()


def test_a_measured_demo_gives_the_same_models_in_a_new_block(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = synthetic_strip(3, seed=1)
    write_new_block(tmp_path / "demo", made.block)
    truth = [
        ImagePoint(photo, point, round(x, 4), round(y, 4))
        for photo, points in made.truth.items()
        for point, (x, y) in points.items()
    ]
    write_image_points(tmp_path / "demo", truth)
    (tmp_path / "again").mkdir()
    (tmp_path / "again" / "image_points.csv").write_bytes(
        (tmp_path / "demo" / "image_points.csv").read_bytes()
    )
    block = read_block(tmp_path / "demo")
    strip = ",".join(block.strips[0].photos)
    camera = f"{block.cameras[0].c}"
    assert new(tmp_path / "again", "--camera", camera, "--strip", strip) == 0
    again = read_block(tmp_path / "again")
    assert again.strips[0].photos == block.strips[0].photos
    assert again.image_points == block.image_points
    capsys.readouterr()
    assert main(["bridge", str(tmp_path / "again")]) == 0
    assert "101/102" in capsys.readouterr().out.replace(" ", "")


def test_a_calibration_file_is_taken_along(tmp_path: Path) -> None:
    calibration = NOMINAL_CAMERAS["rc10"].calibration()
    write_camera(tmp_path / "mine.toml", calibration)
    assert new(tmp_path / "b", "--strip", "1-3", "--camera", tmp_path / "mine.toml") == 0
    block = read_block(tmp_path / "b")
    assert block.cameras[0].calibration == calibration
    assert read_camera(tmp_path / "b" / "camera-rc10.toml") == calibration


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A person at a terminal who gives these answers, in order."""
    given: list[str] = []

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    def answer(prompt: str) -> str:
        print(prompt)
        if not given:
            raise EOFError
        return given.pop(0)

    monkeypatch.setattr("sys.stdin", Terminal())
    monkeypatch.setattr(builtins, "input", answer)
    return given


def test_every_question_has_a_default(tmp_path: Path, answers: list[str]) -> None:
    answers += [""] * 8
    assert new(tmp_path / "b") == 0
    assert answers == []
    block = read_block(tmp_path / "b")
    assert block.name == "b"
    assert [strip.photos for strip in block.strips] == [("101", "102", "103")]
    assert block.cameras[0].id == "rmk15"
    assert block.measuring.profile is None


def test_a_wrong_answer_is_asked_again(
    tmp_path: Path, answers: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    answers += ["my block", "?", "rcx", "rc8", "1", "1-4", "1-4,x", "5-8", ""]
    answers += ["nowhere.csv", "none", "nobody", "anaplot-ascii", "9", "-1", "6"]
    assert new(tmp_path / "b") == 0
    assert answers == []
    block = read_block(tmp_path / "b")
    assert block.name == "my block"
    assert [strip.photos for strip in block.strips] == [
        ("1", "2", "3", "4"),
        ("1-4", "x"),
        ("5", "6", "7", "8"),
    ]
    assert (block.measuring.profile, block.measuring.pattern) == ("anaplot-ascii", "9")
    assert block.precision.image_um == 6.0
    out = capsys.readouterr().out
    assert "Jena LMK 15/2323" in out
    assert "nowhere.csv" in out


def test_answers_that_end_write_nothing(
    tmp_path: Path, answers: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    answers += ["b"]
    assert new(tmp_path / "b") == 2
    assert "not answered" in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


PATTERN = """\
label,x,y,tie
a,0,80,yes
b,0,0,yes
c,0,-80,yes
m,46,80,no
n,46,-80,no
d,92,80,no
e,92,0,no
f,92,-80,no
"""


def test_a_pattern_of_ones_own_comes_to_stand_in_the_folder(tmp_path: Path) -> None:
    file, folder = tmp_path / "mine.csv", tmp_path / "b"
    file.write_text(PATTERN)
    assert new(folder, "--strip", "1-5", "--pattern", file) == 0
    assert read_block(folder).measuring.pattern == "mine.csv"
    assert read_pattern(folder / "mine.csv").points == read_pattern(file).points
    # it may stand there before
    (folder / "block.toml").unlink()
    assert new(folder, "--strip", "1-5", "--pattern", folder / "mine.csv") == 0


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("few.csv", PATTERN.replace("yes", "no"), "0 of its points are ties"),
        ("off.csv", PATTERN.replace("92,0", "92,300"), "off.csv line 8: point 'e' would lie"),
        ("control.csv", PATTERN, "no name for a pattern: another file of a block has it"),
        ("twice.toml", 'format = 1\n[[point]]\nlabel = "1"\nx = 1.0\n', "y"),
    ],
)
def test_a_pattern_that_cannot_be_measured_leaves_no_block(
    tmp_path: Path, name: str, text: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text(text)
    assert new(tmp_path / "b", "--strip", "1-5", "--pattern", tmp_path / name) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "b").exists()
