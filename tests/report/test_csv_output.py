"""`--csv`: refused before anything is done, written whole or not at all."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from clibench import anaplot, contents, make_block, one_line

from anaplot.cli import main
from anaplot.planning.networkplan import CUBE_VERSIONS
from anaplot.textfiles import wholefile

PATTERN = ["plan", "pattern", "6"]
BLOCK = ["plan", "block", "--strips", "2", "--photos", "3"]
NETWORK = ["plan", "network", "cube"]
SIMULATE = ["plan", "simulate", "9/3", "--runs", "2", "--processes", "1"]


@pytest.mark.parametrize("call", [PATTERN, BLOCK, NETWORK])
def test_a_file_that_cannot_be_is_refused_before_anything(call, tmp_path: Path, capsys) -> None:
    folder = tmp_path / "made"
    to = [] if call is PATTERN else ["--to", str(folder)]
    for target, said in (
        (tmp_path / "none" / "x.csv", "x.csv: cannot be written: there is no folder"),
        (tmp_path, "cannot be written: it is a folder"),
        ("a\0b", "cannot be written"),
    ):
        assert main([*call, *to, "--csv", str(target)]) == 2
        out = capsys.readouterr()
        assert said in out.err
        assert out.err.count("\n") == 1
        assert out.out == ""
        assert not folder.exists()


def test_inputs_are_not_overwritten(tmp_path: Path, capsys) -> None:
    pattern = tmp_path / "p.csv"
    pattern.write_text("label,x,y\n1,0,0\n")
    first, second = make_block(tmp_path / "a"), make_block(tmp_path / "b")
    before = contents(tmp_path)
    planned = tmp_path / "made"
    for call, target, use in (
        (["plan", "pattern", str(pattern)], pattern, "is read"),
        (["plan", "network", str(pattern)], pattern, "is read"),
        (["compare", str(first), str(second)], second / "image_points.csv", "is read"),
        ([*BLOCK, "--to", str(planned)], planned / "control.csv", "is written"),
        ([*NETWORK, "--to", str(planned)], planned, "becomes a folder"),
    ):
        assert main([*call, "--csv", str(target)]) == 2
        assert f"cannot be written: it {use}; name another file" in capsys.readouterr().err
    assert contents(tmp_path) == before


@pytest.mark.parametrize("call", [PATTERN, BLOCK, NETWORK, SIMULATE])
def test_a_read_only_folder_is_refused_before_anything(
    call, tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path.resolve())
    assert main([*call, "--csv", str(tmp_path / "x.csv")]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.endswith("x.csv: cannot be written: the folder is read-only\n")


def test_a_named_pattern_is_no_input(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*PATTERN, "--csv", "6"]) == 0
    assert main([*NETWORK, "--csv", "cube"]) == 0
    assert set(contents(tmp_path)) == {"6", "cube"}


@pytest.mark.parametrize("call", [BLOCK, NETWORK])
def test_a_file_in_the_folder_that_is_made(call, tmp_path: Path) -> None:
    folder = tmp_path / "made"
    assert main([*call, "--json", "--to", str(folder), "--csv", str(folder / "x.csv")]) == 0
    assert {"block.toml", "x.csv"} <= set(contents(folder))


@pytest.mark.parametrize("call", [PATTERN, BLOCK, NETWORK])
def test_a_full_disk_leaves_the_old_file(call, tmp_path: Path, capsys, monkeypatch) -> None:
    target = tmp_path / "x.csv"
    target.write_text("old")

    def full(_: int, __: bytes) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(wholefile, "write_all", full)
    assert main([*call, "--csv", str(target)]) == 2
    assert capsys.readouterr().err == f"anaplot: {target}: cannot be written: {os.strerror(28)}\n"
    assert contents(tmp_path) == {"x.csv": b"old"}


def test_a_link_stays_a_link_and_a_pipe_is_written(tmp_path: Path) -> None:
    real, link, pipe = (tmp_path / name for name in ("real.csv", "link.csv", "pipe"))
    real.write_text("old")
    link.symlink_to(real)
    assert main([*PATTERN, "--csv", str(link)]) == 0
    assert link.is_symlink()
    assert real.read_text().startswith("point,")
    os.mkfifo(pipe)
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
    reader.start()
    assert main([*PATTERN, "--csv", str(pipe)]) == 0
    reader.join(10.0)
    assert got == [real.read_text()]


def test_a_link_into_no_folder_is_refused(tmp_path: Path, capsys) -> None:
    link = tmp_path / "link.csv"
    link.symlink_to(tmp_path / "none" / "x.csv")
    assert main([*PATTERN, "--csv", str(link)]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert "cannot be written: there is no folder" in error


def test_the_report_is_not_written_over(tmp_path: Path) -> None:
    out = tmp_path / "out.txt"
    script = f"exec \"$@\" > '{out}'"
    result = anaplot(*PATTERN, "--csv", out, prefix=("sh", "-c", script, "sh"))
    one_line(result, 2, "the report goes there")
    assert out.read_text() == ""


def test_the_networks_worth_as_csv(tmp_path: Path) -> None:
    for version in CUBE_VERSIONS:
        path = tmp_path / f"{version}.csv"
        assert main([*NETWORK, "--case", version, "--json", "--csv", str(path)]) == 0
        rows = path.read_bytes().decode().split("\r\n")
        assert len(rows) == 1 + 27 + len(CUBE_VERSIONS[version]) + 1
