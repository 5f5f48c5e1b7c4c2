"""`anaplot demo --auto`: the whole job in one command."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from clibench import TIMEOUT, anaplot, command, environment, one_line
from processes import running

from anaplot.exchange.blockfolder import read_block

pytestmark = pytest.mark.slow

MANY = "10"  # models, of which the first is told long before the last is measured


def test_the_demo_tells_its_story() -> None:
    result = anaplot("demo", "--auto", "--models", "2")
    assert (result.returncode, result.stderr) == (0, "")
    for words in ("MODEL 101/102", "MODEL 102/103", "MISTAKES PLANTED", "missed although", "RED-N"):
        assert words in result.stdout
    assert "missed although detectable: none" in result.stdout


def test_json_is_the_same_twice() -> None:
    texts = [anaplot("demo", "--auto", "--json", "--seed", "5", "--models", "1") for _ in range(2)]
    assert [t.returncode for t in texts] == [0, 0]
    assert texts[0].stdout == texts[1].stdout
    answer = json.loads(texts[0].stdout)
    assert answer.keys() >= {
        *("seed", "planted", "found", "repaired", "missed", "false_flags", "models")
    }
    assert answer["seed"] == 5


def test_csv(tmp_path: Path) -> None:
    table, folder = tmp_path / "planted.csv", tmp_path / "tables"
    command = ("demo", "--auto", "--json", "--models", "2", "--csv", table, "--to", folder)
    result = anaplot(*command)
    assert (result.returncode, result.stderr) == (0, "")
    answer = json.loads(result.stdout)
    with table.open(newline="") as file:
        planted = list(csv.DictReader(file))
    assert [row["point"] for row in planted] == [one["point"] for one in answer["planted"]] != []
    assert [list(row) for row in planted] == [list(one) for one in answer["planted"]]
    with (folder / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    told = [row for m in answer["models"] for when in ("before", "after") for row in m[when]]
    assert [float(row["parx_um"]) for row in rows] == [row["parx_um"] for row in told]
    assert {row["when"] for row in rows} == {"before", "after"}
    names = {one.name for one in folder.iterdir()}
    tables = ("planted", "found", "repaired", "missed", "false_flags", "stages", "rows")
    assert names == {"summary.json", *(f"{name}.csv" for name in tables)}
    one_line(anaplot("demo", "--csv", table), 2, "--csv goes with --auto")


def test_keep(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    assert anaplot("demo", "--auto", "--models", "1", "--keep", folder).returncode == 0
    block = read_block(folder)
    assert {row.model for row in block.image_points} == {"101/102"}
    assert anaplot("bridge", folder, "--fail-on-flag").returncode == 0
    points = (folder / "image_points.csv").read_bytes()
    one_line(anaplot("demo", "--auto", "--keep", folder), 2, "exists already")
    assert (folder / "image_points.csv").read_bytes() == points


def test_temporary_folders_are_taken_away(tmp_path: Path) -> None:
    result = anaplot("demo", "--auto", "--models", "1", env={"TMPDIR": str(tmp_path)})
    assert result.returncode == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="signals are others there")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_leaves_everything_in_order(tmp_path: Path, number: signal.Signals) -> None:
    with running(
        command("demo", "--auto", "--models", MANY),
        stderr=subprocess.PIPE,
        env=environment(TMPDIR=str(tmp_path)),
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("MODEL 101/102")
        assert list(tmp_path.iterdir()) != []
        process.send_signal(number)
        _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 128 + number
    assert "Traceback" not in errors
    if number == signal.SIGINT:
        assert re.fullmatch(r"anaplot: interrupted, after \d+\.\d s\n", errors)
    assert list(tmp_path.iterdir()) == []
    # nothing of its session lives on
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


@pytest.mark.skipif(os.name == "nt", reason="signals are others there")
def test_interrupted_a_kept_block_is_good(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    with running(
        command("demo", "--auto", "--models", MANY, "--keep", folder),
        stderr=subprocess.PIPE,
        env=environment(),
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=TIMEOUT)
    assert process.returncode == 130
    assert "101/102" in {row.model for row in read_block(folder).image_points}


@pytest.mark.skipif(os.name == "nt", reason="pipes are others there")
def test_the_reader_goes_away(tmp_path: Path) -> None:
    with running(
        command("demo", "--auto", "--models", "3"),
        stderr=subprocess.PIPE,
        env=environment(TMPDIR=str(tmp_path)),
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        errors = process.stderr.read()
        process.wait(TIMEOUT)
    assert (process.returncode, errors) == (0, "")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    one_line(anaplot("demo", "--auto", "--keep", tmp_path / "file" / "x"), 2, "cannot be made")
