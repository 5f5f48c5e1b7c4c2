"""`--csv` is never written over what a block is made of, whichever command writes it."""

from __future__ import annotations

from pathlib import Path

import pytest
from clibench import make_block

from anaplot.cli import main
from anaplot.exchange.ownfiles import block_of_file

FILES = ("block.toml", "image_points.csv", "control.csv", "distances.csv",
         "sessions/0001.jsonl", "sessions/new.csv", "sessions/lock", "source/a.im")  # fmt: skip


@pytest.fixture
def block(tmp_path: Path) -> Path:
    return make_block(tmp_path / "b")


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize(
    "command", ["log", "pointing", "status", "fit", "replay", "bridge", "adjust"]
)
def test_no_file_of_a_block_is_taken_for_a_table(
    command: str, name: str, block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # `anaplot log B --csv B/sessions/0001.jsonl` put a table in place of the journal
    target = block / name
    target.parent.mkdir(exist_ok=True)
    if not target.exists() and "new" not in name:
        target.write_text("mine\n")
    before = target.read_bytes() if target.exists() else None
    assert main([command, str(block), "--csv", str(target)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "cannot be written" in said.err or "not a journal" in said.err or "line" in said.err
    assert (target.read_bytes() if target.exists() else None) == before


def test_a_table_of_another_name_may_lie_in_a_block(block: Path) -> None:
    for _ in range(2):
        assert main(["status", str(block), "--csv", str(block / "standing.csv")]) == 0


def test_no_file_that_the_command_line_names_is_taken_for_a_table(
    block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = block.parent / "given.csv"
    given.write_text("mine\n")
    call = ["adjust", str(block), "--datum", "free", "--operators", str(given), "--csv", str(given)]
    assert main(call) == 2
    assert "named as well" in capsys.readouterr().err
    assert given.read_text() == "mine\n"


def test_which_block_a_file_belongs_to(block: Path) -> None:
    assert block_of_file(block / "block.toml") == block
    assert block_of_file(block / "sessions" / "0001.jsonl") == block
    assert block_of_file(block / "table.csv") is None
    assert block_of_file(block.parent / "block.toml") is None
    # of one that cannot be read every file of its kinds may be meant
    (block / "wild.toml").write_text("")
    assert block_of_file(block / "wild.toml") is None
    (block / "block.toml").write_text("spoilt")
    assert block_of_file(block / "wild.toml") == block
