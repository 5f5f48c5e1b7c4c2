"""A new block with its camera files, and a block.toml whose camera files are given as text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from anaplot.errors import InputError
from anaplot.exchange import blockfolder
from anaplot.exchange.blockfolder import (
    clear_image_points,
    read_block,
    write_block,
    write_new_block,
)
from anaplot.exchange.blocktoml import camera_texts, format_block_toml, parse_block_toml
from anaplot.exchange.camerafile import write_camera
from anaplot.exchange.newblock import NewBlock, choose_camera, strip_of, write_new
from anaplot.photogrammetry.block import Block, ControlPoint
from anaplot.planning.synthetic import synthetic_strip
from anaplot.planning.syntheticcamera import SYNTHETIC_CAMERA_FILE, with_calibration
from anaplot.textfiles import wholefile
from anaplot.textfiles.wholefile import create_whole, make_folder


@pytest.fixture
def block() -> Block:
    made = synthetic_strip(3, seed=1).block
    return replace(made, cameras=tuple(with_calibration(camera) for camera in made.cameras))


def test_it_is_read_back_equal(tmp_path: Path, block: Block) -> None:
    write_new_block(tmp_path / "new" / "block", block)
    assert read_block(tmp_path / "new" / "block") == block
    assert (tmp_path / "new" / "block" / SYNTHETIC_CAMERA_FILE).exists()


def test_without_camera_files_it_is_the_block_toml_alone(tmp_path: Path, block: Block) -> None:
    cameras = tuple(replace(c, calibration=None, file=None) for c in block.cameras)
    write_new_block(tmp_path / "b", replace(block, cameras=cameras))
    assert [p.name for p in (tmp_path / "b").iterdir()] == ["block.toml"]


def test_nothing_is_overwritten(tmp_path: Path, block: Block) -> None:
    write_new_block(tmp_path, block)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(InputError, match=r"block\.toml: exists already"):
        write_new_block(tmp_path, replace(block, name="other"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_camera_file_that_is_there_must_say_the_same(tmp_path: Path, block: Block) -> None:
    calibration = block.cameras[0].calibration
    assert calibration is not None
    same, other = tmp_path / "same", tmp_path / "other"
    for folder, c in ((same, calibration.c), (other, 99.0)):
        folder.mkdir()
        write_camera(folder / SYNTHETIC_CAMERA_FILE, replace(calibration, c=c))
    write_new_block(same, block)
    assert read_block(same) == block
    with pytest.raises(InputError, match=r"camera\.toml: exists already and says something else"):
        write_new_block(other, block)
    assert not (other / "block.toml").exists()


def test_camera_files_given_as_text_are_not_looked_for(tmp_path: Path, block: Block) -> None:
    text, files = format_block_toml(block), camera_texts(block)
    assert set(files) == {SYNTHETIC_CAMERA_FILE}
    assert parse_block_toml(text, tmp_path / "block.toml", files) == block
    with pytest.raises(InputError, match="file not found"):
        parse_block_toml(text, tmp_path / "block.toml")
    broken = {SYNTHETIC_CAMERA_FILE: files[SYNTHETIC_CAMERA_FILE].replace("c =", "cc =")}
    with pytest.raises(InputError, match=r"camera\.toml"):
        parse_block_toml(text, tmp_path / "block.toml", broken)


def test_every_folder_made_for_a_new_block_has_its_name_on_disk(tmp_path, monkeypatch):
    synced: list[Path] = []

    def noted(folder: Path) -> None:
        synced.append(folder)
        assert all(path.exists() for path in synced)

    monkeypatch.setattr(wholefile, "sync_folder", noted)
    make_folder(tmp_path / "year" / "flight" / "block")
    assert synced == [tmp_path, tmp_path / "year", tmp_path / "year" / "flight"]
    make_folder(tmp_path / "year" / "flight" / "block")
    assert len(synced) == 3
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be made: File exists"):
        make_folder(tmp_path / "file" / "block")


def test_what_a_killed_writer_left_is_cleared_and_nothing_else(tmp_path):
    path = tmp_path / "image_points.csv"
    kept = [
        path,
        tmp_path / ".image_points.csv.tmp",
        tmp_path / ".image_points.csv.0123456789ab.tmp.old",
        tmp_path / ".image_points.csv.0123456789AB.tmp",
        tmp_path / ".image_pointsxcsv.0123456789ab.tmp",
        tmp_path / ".block.toml.0123456789ab.tmp",
        tmp_path / "image_points.csv.0123456789ab.tmp",
    ]
    for file in kept:
        file.write_bytes(b"kept")
    folder = tmp_path / ".image_points.csv.aaaaaaaaaaaa.tmp"
    folder.mkdir()
    link = tmp_path / ".image_points.csv.bbbbbbbbbbbb.tmp"
    link.symlink_to(path)
    before = set(tmp_path.iterdir())
    for name in ("0123456789ab", "ffffffffffff"):
        (tmp_path / f".image_points.csv.{name}.tmp").write_bytes(b"half")
    clear_image_points(tmp_path)
    assert set(tmp_path.iterdir()) == before
    clear_image_points(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("text", "photos"),
    [
        ("101-103", ("101", "102", "103")),
        ("203-201", ("203", "202", "201")),
        ("101, 103,105", ("101", "103", "105")),
        # names with a dash, though 1-101 could be a range
        ("1-101,1-102,1-103", ("1-101", "1-102", "1-103")),
        ("F1-01,F1-02", ("F1-01", "F1-02")),
        ("north=8-11", ("8", "9", "10", "11")),
    ],
)
def test_a_strip_is_a_range_or_names(text, photos):
    assert strip_of(text, 1).photos == photos


def test_ranges_with_commas_are_not_taken_for_names():
    with pytest.raises(InputError, match="every strip stands on its own: 101-103; 203-201") as said:
        strip_of("101-103, 203-201", 1)
    assert "\n" not in str(said.value)


@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("how", [OSError, KeyboardInterrupt])
@pytest.mark.parametrize("fails", ["write", "sync"])
@pytest.mark.parametrize("after", range(6))
def test_what_cannot_be_written_whole_leaves_no_part_of_a_block(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fails: str,
    how: type[BaseException],
    after: int,
    there: bool,
) -> None:
    new = NewBlock(
        "b", choose_camera("rmk15"), (strip_of("101-103", 1),), (ControlPoint("7", (1, 2, 3)),)
    )
    folder = tmp_path / "a" / "b"
    if there:
        folder.mkdir(parents=True)
        (folder / "notes.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    calls = []

    def failing(*arguments: object) -> None:
        calls.append(arguments)
        if len(calls) == after + 1:
            raise how(28, "no space left")
        usual(*arguments)

    usual = getattr(wholefile, "write_all" if fails == "write" else "sync_folder")
    monkeypatch.setattr(wholefile, usual.__name__, failing)
    # three files, and two folders where there are none
    steps = 3 + (2 if fails == "sync" and not there else 0)
    if after >= steps:
        assert write_new(folder, new).control
        assert len(calls) == steps
        return
    with pytest.raises(KeyboardInterrupt if how is KeyboardInterrupt else InputError):
        write_new(folder, new)
    assert sorted(tmp_path.rglob("*")) == before
    monkeypatch.undo()
    # and nothing stands in the way of the next try
    assert write_new(folder, new).control == read_block(folder).control


@pytest.mark.parametrize("fails", ["block.toml", "control.csv"])
def test_a_block_that_cannot_be_written_whole_leaves_no_part_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: Block, fails: str
) -> None:
    whole = replace(
        block,
        control=(ControlPoint("7", (1.0, 2.0, 3.0)),),
    )

    def full(path: Path, data: bytes) -> None:
        if path.name == fails:
            raise InputError(f"{path.name}: no space left")
        create_whole(path, data)

    monkeypatch.setattr(blockfolder, "create_whole", full)
    with pytest.raises(InputError, match="no space left"):
        write_block(tmp_path / "b", whole)
    assert not (tmp_path / "b").exists()
    monkeypatch.undo()
    write_block(tmp_path / "b", whole)
    assert read_block(tmp_path / "b") == whole


PIXEL_CAMERA = """format = 1
[camera]
id = "fc"
c = 8.6
pixels = [4000, 3000]
pixel_um = 2.5
principal_px = [2010.5, 1490.25]
[lens]
model = "brown"
k1 = -0.12
"""


def test_points_in_pixels_are_read_with_pixels_and_lens_of_the_camera_file(tmp_path: Path) -> None:
    (tmp_path / "fc.toml").write_text(PIXEL_CAMERA)
    folder = tmp_path / "b"
    folder.mkdir()
    points = "photo,point,x_px,y_px\n1,a,0.1,3000\n2,a,10.7,20\n2,b,2010.5,1490.25\n"
    (folder / "image_points.csv").write_text(points)
    made = write_new(folder, NewBlock("b", choose_camera(str(tmp_path / "fc.toml"))))
    assert made == read_block(folder)
    (camera,) = made.cameras
    assert (camera.pixels, camera.format) == ((4000, 3000), (10.0, 7.5))
    assert camera.lens is not None
    assert [row.measured for row in made.image_points][:2] == [(0.1, 3000.0), (10.7, 20.0)]
    text = (folder / "block.toml").read_text()
    assert "pixels = [4000, 3000]" in text
    assert text.count("format = ") == 1  # pixels state that of the camera


def test_a_file_that_another_wrote_first_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new = NewBlock("b", choose_camera("rmk15"), (strip_of("101-103", 1),))

    def overtaken(path: Path, data: bytes) -> None:
        if path.name == "block.toml":
            path.write_text("another's")
        create_whole(path, data)

    monkeypatch.setattr(blockfolder, "create_whole", overtaken)
    with pytest.raises(InputError, match="exists already"):
        write_new(tmp_path / "b", new)
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["block.toml"]
    assert (tmp_path / "b" / "block.toml").read_text() == "another's"
