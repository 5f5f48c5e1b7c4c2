"""The door: kinds, options, notes, and folders that are there wholly or not at all."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats import door, registry
from anaplot.exchange.formats.sourcelines import source_lines
from anaplot.photogrammetry.block import Block, Camera, ImagePoint, Photo, Precision, TestSettings
from anaplot.photogrammetry.objectconditions import ObjectCondition

BLOCK = Block(
    "plain",
    Precision(),
    TestSettings(),
    (Camera("c", 100.0),),
    (Photo("a/1", "c"), Photo("2", "c")),
    (),
    (ImagePoint("a/1", "p", 1.0, 2.0), ImagePoint("2", "p", -1.0, 2.0)),
    conditions=(ObjectCondition("distance", ("p", "q"), 2.5, 0.001, "check"),),
)


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """A format of one line, which says whose it is."""

    def recognises(source: Path) -> bool:
        return source.is_file() and source.read_text().startswith("plain")

    def read(source: Path, options: door.ImportOptions) -> door.Imported:
        notes = (door.Note("dropped", 3, "points without a \x1b[1mray", ("p", "q")),)
        return door.Imported(BLOCK, notes, ("from \x1b[2J plain",), {"deep/in": source})

    def write(exporting: door.Exporting, target: Path) -> door.Exported:
        target.write_text("plain")
        return door.Exported((target,), (door.Note("not held", None, "colours"),))

    module = SimpleNamespace(recognises=recognises, read=read, write=write)
    monkeypatch.setitem(sys.modules, "anaplot.exchange.formats.plain", module)
    one = registry.Format("plain", "plain files", import_options=("c",))
    monkeypatch.setattr(registry, "FORMATS", {"plain": one})
    monkeypatch.setattr("anaplot.report.importcommand.FORMATS", {"plain": one})


@pytest.mark.usefixtures("plain")
def test_a_block_comes_in_and_goes_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, block, out = tmp_path / "s", tmp_path / "b", tmp_path / "out"
    source.write_text("plain")
    assert main(["import", str(source), "-o", str(block)]) == 0
    said = capsys.readouterr().out
    assert "dropped: 3 points without a" in said
    assert "\x1b" not in said
    assert read_block(block).image_points == BLOCK.image_points
    assert [c.value for c in read_block(block).conditions] == [2.5]
    assert (block / "block.toml").read_text().startswith("# from ")
    assert "\x1b" not in (block / "block.toml").read_text()
    assert (block / "source" / "deep" / "in").read_text() == "plain"
    assert main(["export", "plain", str(block), "-o", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["notes"][0]["text"] == "colours"
    assert main(["export", "plain", str(block), "-o", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plain", "nowhere"], "nowhere: no such file"),
        (["plane", "source"], "did you mean 'plain'"),
        (["other"], "of no known format"),
        (["other"], "any table is pixels)"),
        (["nothere"], "nothere: no such file or folder"),
        (["plain"], "SOURCE is missing"),
        (["plain", "source", "--unit", "mm"], "--unit: plain has no use for it"),
        (["plain", "source", "--with", "a=b", "--with", "a=c"], "given twice"),
        (["plain", "source", "--pixels", "4000"], "WIDTHxHEIGHT"),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("source").write_text("plain")
    Path("other").write_text("else")
    assert main(["import", *arguments, "-o", "b"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not Path("b").exists()


@pytest.mark.usefixtures("plain")
def test_what_cannot_be_written_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "s").write_text("plain")
    block = tmp_path / "b"
    block.mkdir()
    (block / "image_points.csv").write_text("mine")
    assert main(["import", str(tmp_path / "s"), "-o", str(block)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert [file.name for file in block.iterdir()] == ["image_points.csv"]


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize("name", ["distances.csv", "conditions.csv", "sessions", "source"])
def test_what_lies_there_of_another_block_is_no_part_of_this_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    source, block = tmp_path / "s", tmp_path / "b"
    source.write_text("plain")
    (block / name).mkdir(parents=True)
    (block / "notes.txt").write_text("mine")
    assert main(["import", str(source), "-o", str(block)]) == 2
    assert f"{name}: exists already and is not overwritten" in capsys.readouterr().err
    assert sorted(p.name for p in block.iterdir()) == sorted((name, "notes.txt"))
    (block / name).rmdir()
    assert main(["import", str(source), "-o", str(block)]) == 0


def test_lines_have_their_place(tmp_path: Path) -> None:
    file = tmp_path / "f.txt"
    file.write_bytes(b"\xef\xbb\xbf1 2.5 1_0\r\n7 nan x\n\xff\n")
    lines = source_lines(file)
    first, second = next(lines), next(lines)
    assert first.text == "1 2.5 1_0"
    assert first.number_of("2.5", "x") == 2.5
    assert first.whole_of("1", "id") == 1
    for text in ("1_0", "nan", "1e999", "x"):
        with pytest.raises(InputError, match=r"f\.txt line 2: x must be a finite number"):
            second.number_of(text, "x")
    for text in ("1.5", "", "9" * 30, "-1"):
        with pytest.raises(InputError, match=r"f\.txt line 1: id must"):
            first.whole_of(text, "id")
    with pytest.raises(InputError, match="line 3"):
        next(lines)


@pytest.mark.parametrize("suffix", [".csv", ".im", ".json", ".phc", ".txt", ".xml"])
def test_no_format_takes_anything_out_of_a_pipe_to_know_it(suffix: str, tmp_path: Path) -> None:
    pipe = tmp_path / f"pipe{suffix}"
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDWR | os.O_NONBLOCK)
    try:
        written = os.write(end, b"x" * 65536)  # more than any of them looks at
        kinds = [one.kind for one in registry.FORMATS.values() if one.reads]
        found = [kind for kind in kinds if registry.module_of(kind).recognises(pipe)]
        assert kinds
        assert not found
        assert len(os.read(end, 65536)) == written
    finally:
        os.close(end)


def test_some_format_has_a_use_for_every_option_and_none_has_a_door_that_is_shut() -> None:
    ins = {name for one in registry.FORMATS.values() for name in one.import_options}
    outs = {name for one in registry.FORMATS.values() for name in one.export_options}
    assert ins == set(door.ImportOptions.__dataclass_fields__)
    assert outs == set(door.ExportOptions.__dataclass_fields__)
    for one in registry.FORMATS.values():
        module = registry.module_of(one.kind)
        doors = [hasattr(module, name) for name in ("recognises", "read", "write")]
        assert doors == [one.reads, one.reads, one.writes], one.kind
