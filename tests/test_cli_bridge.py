"""`anaplot bridge` as people and programs call it: output, exit codes, one-line errors."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from clibench import TIMEOUT, anaplot, command, contents, environment, here, make_block, one_line

pytestmark = pytest.mark.slow


@pytest.fixture
def block(tmp_path: Path) -> Path:
    return make_block(tmp_path / "block")


def strict(text: str) -> dict:
    def refuse(name: str) -> None:
        raise ValueError(name)

    answer: dict = json.loads(text, parse_constant=refuse)
    return answer


def test_the_printout(block: Path) -> None:
    before = contents(block)
    result = anaplot("bridge", block)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.count("STRIP 1  MODEL") == 2
    for words in ("PARALLAXES [um]", "TIE DISCREPANCIES [um]", "RED-N", "nothing is flagged"):
        assert words in result.stdout
    # only read: no journal, no lock
    assert contents(block) == before
    assert not (block / "sessions").exists()


def test_json(block: Path) -> None:
    result = anaplot("bridge", block, "--json")
    assert result.returncode == 0
    (strip,) = strict(result.stdout)["strips"]
    assert strip["strip"] == "1"
    assert "error" not in strip
    for model in strip["models"]:
        assert model.keys() >= {
            *("left", "right", "base", "rotation", "sigma0_um", "redundancy", "iterations"),
            *("test", "table", "points", "ties"),
        }
        assert model["rotation"].keys() == {"omega", "phi", "kappa"}
        assert sum(row["redn"] for row in model["table"]) == pytest.approx(model["redundancy"])


def test_csv(block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, folder = tmp_path / "rows.csv", tmp_path / "tables"
    result = here(capsys, "bridge", block, "--json", "--csv", table, "--to", folder)
    assert (result.returncode, result.stderr) == (0, "")
    (strip,) = strict(result.stdout)["strips"]
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    told = [(m["left"], m["right"], row) for m in strip["models"] for row in m["table"]]
    assert len(rows) == len(told)
    for row, (left, right, same) in zip(rows, told, strict=True):
        assert list(row) == ["strip", "left", "right", *same]
        assert (row["strip"], row["left"], row["right"]) == ("1", left, right)
        assert (row["point"], row["axis"], float(row["parx_um"])) == (
            same["point"], same["axis"], same["parx_um"],
        )  # fmt: skip
    names = {one.name for one in folder.iterdir()}
    assert names == {"rows.csv", "points.csv", "summary.json"}
    before = contents(block)
    one_line(here(capsys, "bridge", block, "--csv", block / "image_points.csv"), 2, "it is read")
    assert contents(block) == before


def test_fail_on_flag(tmp_path: Path, block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert here(capsys, "bridge", block, "--fail-on-flag").returncode == 0
    wrong = make_block(tmp_path / "wrong", dy=0.2)
    assert here(capsys, "bridge", wrong).returncode == 0
    result = here(capsys, "bridge", wrong, "--fail-on-flag")
    assert (result.returncode, result.stderr) == (1, "")
    assert "remeasure 102-2 (y)" in result.stdout


def no_ties_at_all(folder: Path) -> None:
    path = folder / "image_points.csv"
    rows = path.read_text().splitlines()
    ties = {
        name
        for name in {row.split(",")[1] for row in rows[1:]}
        if {row.split(",")[0] for row in rows[1:] if row.split(",")[1] == name} >= {"101", "103"}
    }
    known = {row.split(",")[1] for row in rows if row.startswith("101,")}
    path.write_text(
        "\n".join(r for r in rows if not (r.startswith("103,") and r.split(",")[1] in known | ties))
        + "\n"
    )


def test_models_before_one_that_is_not_computable_are_printed(
    block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    no_ties_at_all(block)
    result = here(capsys, "bridge", block)
    one_line(result, 4, "strip 1", "model 102/103")
    assert result.stdout.count("MODEL") == 1
    assert "MODEL 101/102" in result.stdout
    result = here(capsys, "bridge", block, "--json")
    line = one_line(result, 4, "102/103")
    (strip,) = strict(result.stdout)["strips"]
    assert [(m["left"], m["right"]) for m in strip["models"]] == [("101", "102")]
    assert strip["error"] in line
    assert here(capsys, "bridge", block, "--fail-on-flag").returncode == 4


def test_python_m_is_the_command(block: Path) -> None:
    assert command()[1:3] == ["-m", "anaplot"]
    result = anaplot("--version")
    assert result.returncode == 0
    assert result.stdout.startswith("anaplot ")


def test_help_has_an_example() -> None:
    for arguments in ((), ("bridge",), ("demo",), ("open",)):
        result = anaplot(*arguments, "--help")
        assert (result.returncode, result.stderr) == (0, "")
        assert "examples:\n  anaplot" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("brigde",), "brigde"),
        (("bridge",), "BLOCK"),
        (("bridge", "x", "--jsn"), "--jsn"),
        (("demo", "--seed", "x"), "'x' is no whole number"),
        (("demo", "--models", "0"), "'0' is no whole number from 1"),
        (("demo", "--models", "1e9"), "--models"),
        (("demo", "--json"), "--json goes with --auto"),
        (("bridge", "x", "\x1b[31m\nred"), "unrecognized"),
    ],
)
def test_wrong_usage_is_one_line(arguments: tuple[str, ...], words: str) -> None:
    one_line(anaplot(*arguments), 2, words)


# -- bad input, through bridge and open ----------------------------------------------------------


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        path = folder / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return change


def append(name: str, text: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        with (folder / name).open("a") as file:
            file.write(text)

    return change


def remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


BAD = {
    "unknown key": (edit("block.toml", "format = 1", "format = 1\nfrmat = 2"), "frmat"),
    "unknown key in a table": (edit("block.toml", "kind =", "knid ="), "knid"),
    "newer block": (edit("block.toml", "format = 1", "format = 2"), "newer version"),
    "no block.toml": (remove("block.toml"), "block.toml"),
    "missing column": (edit("image_points.csv", "photo,point,x,y", "photo,point,x,z"), "column"),
    "not a number": (append("image_points.csv", "101,new,one,2.0,\n"), "one"),
    "nan": (append("image_points.csv", "101,new,nan,2.0,\n"), "nan"),
    "infinite": (append("image_points.csv", "101,new,1e999,2.0,\n"), "line"),
    "absurd": (append("image_points.csv", "101,new,115.1,2.0,\n"), "format"),
    "twice": (append("image_points.csv", "101,new,1,2,\n101,new,1,2,\n"), "twice"),
    "unknown photo": (append("image_points.csv", "999,new,1,2,\n"), "999"),
    "unknown model": (append("image_points.csv", "101,new,1,2,101/103\n"), "101/103"),
    "hostile name": (append("image_points.csv", "101,\x1b[2J,1,2,\n"), "image_points.csv"),
    "no toml": (edit("block.toml", "format = 1", "format = = 1"), "line 1"),
}


@pytest.mark.parametrize("fault", BAD)
def test_bad_input(block: Path, fault: str, capsys: pytest.CaptureFixture[str]) -> None:
    change, words = BAD[fault]
    change(block)
    before = contents(block)
    line = one_line(here(capsys, "bridge", block), 2, words)
    assert "block.toml" in line or "image_points.csv" in line
    assert here(capsys, "bridge", block, "--json").stdout == ""
    # the console fails before its screen starts, and writes nothing
    result = here(capsys, "open", block, "--simulate")
    assert one_line(result, 2, words) == line
    assert result.stdout == ""
    assert contents(block) == before


def test_what_only_the_bridge_refuses(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = block / "image_points.csv"
    whole = points.read_text()
    points.write_text("\n".join(r for r in whole.splitlines() if not r.startswith("101,")) + "\n")
    one_line(here(capsys, "bridge", block), 2, "101", "no image points")
    # a later photo may be measured yet: the models before it are there
    points.write_text("\n".join(r for r in whole.splitlines() if not r.startswith("103,")) + "\n")
    begun = here(capsys, "bridge", block)
    assert begun.returncode == 4
    assert "MODEL 101/102" in begun.stdout
    assert "strip 1, model 102/103: photo 103 has no image points" in begun.stderr
    points.unlink()
    one_line(here(capsys, "bridge", block), 2, "no image points")


def test_four_common_points(block: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = block / "image_points.csv"
    kept: dict[str, int] = {}
    rows = points.read_text().splitlines()
    names = {
        photo: [r.split(",")[1] for r in rows if r.startswith(photo)] for photo in ("101", "102")
    }
    common = [name for name in names["101"] if name in names["102"]][:4]
    out = [rows[0]]
    for row in rows[1:]:
        photo, name = row.split(",")[:2]
        if photo != "101" or name in common:
            out.append(row)
            kept[photo] = kept.get(photo, 0) + 1
    points.write_text("\n".join(out) + "\n")
    assert kept["101"] == 4
    result = here(capsys, "bridge", block)
    one_line(result, 4, "101/102", "4 points in common", "needs five")
    assert result.stdout == ""


def test_points_on_a_line_do_not_determine_a_model(
    block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = block / "image_points.csv"
    rows = points.read_text().splitlines()
    flat = [f"{photo},p{k},{10.0 * k - 40 - 92 * i},0.0," for i, photo in enumerate(("101", "102"))
            for k in range(8) if abs(10.0 * k - 40 - 92 * i) < 115]  # fmt: skip
    points.write_text("\n".join([rows[0], *flat, "103,p1,0,0,"]) + "\n")
    one_line(here(capsys, "bridge", block), 4, "101/102")


def test_no_such_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("bridge", "open"):
        one_line(here(capsys, name, tmp_path / "none\x1b[31m"), 2, "no such folder")
        (tmp_path / "file").write_text("")
        one_line(here(capsys, name, tmp_path / "file"), 2, "not a folder")


# root may write everywhere, unless the right to do so is taken away
POWERFUL = hasattr(os, "geteuid") and os.geteuid() == 0
WITH_TERMINAL = """
import sys
from anaplot import cli
cli.need_terminal = lambda: None
sys.exit(cli.main(sys.argv[1:]))
"""
HUMBLE = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]


@pytest.mark.skipif(os.name == "nt", reason="folders know no such permission there")
@pytest.mark.skipif(POWERFUL and shutil.which("setpriv") is None, reason="run by root")
def test_a_read_only_folder_serves_the_bridge_and_not_the_console(block: Path) -> None:
    before = contents(block)
    block.chmod(0o555)
    prefix = HUMBLE if POWERFUL else []
    try:
        result = anaplot("bridge", block, prefix=prefix)
        assert (result.returncode, result.stderr) == (0, "")
        python = [*prefix, sys.executable, "-c", WITH_TERMINAL]
        result = subprocess.run(
            [*python, "open", str(block), "--simulate"],
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            env=environment(),
            check=False,
        )
        one_line(result, 2, "sessions", "cannot be made")
    finally:
        block.chmod(0o755)
    assert contents(block) == before


# -- output --------------------------------------------------------------------------------------


def test_the_reader_of_the_output_goes_away(block: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        for more in ((), ("--json",)):
            result = subprocess.run(
                command("bridge", block, *more),
                stdout=writing,
                stderr=subprocess.PIPE,
                text=True,
                env=environment(),
                timeout=TIMEOUT,
                check=False,
            )
            assert (result.returncode, result.stderr) == (0, "")
    finally:
        os.close(writing)


def test_a_terminal_that_cannot_show_a_name(block: Path) -> None:
    for name, old, new in (
        ("block.toml", '"102"', '"北2"'),
        ("image_points.csv", "\n102,", "\n北2,"),
    ):
        path = block / name
        path.write_text(path.read_text().replace(old, new), encoding="utf-8")
    result = anaplot("bridge", block, env={"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"})
    assert (result.returncode, result.stderr) == (0, "")
    assert "\\u53172" in result.stdout


def test_output_that_cannot_be_written(block: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no such device here")
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            command("bridge", block),
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=environment(),
            timeout=TIMEOUT,
            check=False,
        )
    assert result.returncode == 2
    assert "No space left on device" in result.stderr
    assert "Traceback" not in result.stderr


def test_errors_are_taken_out_before_the_next_model(
    block: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = (block / "image_points.csv").read_text().splitlines()
    header = rows[0].split(",")
    at = 9
    cells = rows[at].split(",")
    column = header.index("y")
    cells[column] = f"{float(cells[column]) + 0.3:.4f}"
    rows[at] = ",".join(cells)
    (block / "image_points.csv").write_text("\n".join(rows) + "\n")
    result = here(capsys, "bridge", block, "--errors", "search", "--json")
    assert (result.returncode, result.stderr) == (0, "")
    models = strict(result.stdout)["strips"][0]["models"]
    rejected = [row["point"] for model in models for row in model["errors"]["rejected"]]
    assert cells[header.index("point")] in rejected
    for model in models:
        assert model["errors"]["strategy"] == "search"
        kept = {(row["point"], row["axis"]) for row in model["table"]}
        assert not kept & {(r["point"], r["axis"]) for r in model["errors"]["rejected"]}
    text = here(capsys, "bridge", block, "--errors", "search", "--fail-on-flag")
    assert text.returncode == 1
    assert "GROSS ERRORS (search)" in text.stdout
    assert "; step 1, the sum falls by" in text.stdout
    one_line(here(capsys, "bridge", block, "--errors", "guess"), 2, "--errors")
    pairs = here(
        capsys, "bridge", block, "--errors", "baarda", "--pairs", "--json", "--partner", "0.5"
    )
    for model in strict(pairs.stdout)["strips"][0]["models"]:
        errors = model["errors"]
        odds = errors["pair_odds"]
        single = sum(row["probability"] for row in odds["single"])
        assert odds["none"] + single <= 1.0 + 1e-9
        assert all(abs(pair["correlation"]) >= 0.5 for pair in errors["hard_to_tell"])
        for row in errors["rejected"]:
            (why, *_) = [e for e in errors["evidence"] if e["point"] == row["point"]]
            assert why["statistic"] > why["critical"]
    one_line(
        here(capsys, "bridge", block, "--pairs"),
        2,
        "--partner, --pairs and --as-given go with --errors",
    )
    modified = here(capsys, "bridge", block, "--errors", "modified", "--json")
    first = strict(modified.stdout)["strips"][0]["models"][0]["errors"]
    assert first["model_values"]["decided"] > 0
    assert isinstance(first["model_values"]["beyond_tolerance"], int)
    assert first["remarks"] == []
    assert "model values decided" in here(capsys, "bridge", block, "--errors", "modified").stdout
