"""`anaplot status`: where a block stands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from deskless import write_measured

from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_control, write_image_points
from anaplot.photogrammetry.block import ControlPoint
from anaplot.report import statuscommand


def status(folder: Path, capsys: pytest.CaptureFixture[str]) -> dict:
    assert main(["status", str(folder), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_new_block_is_open(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "b"
    assert main(["new", str(folder), "--strip", "1-3", "--strip", "9-7"]) == 0
    capsys.readouterr()
    found = status(folder, capsys)
    assert [strip["strip"] for strip in found["strips"]] == ["1", "2"]
    assert [m["state"] for strip in found["strips"] for m in strip["models"]] == ["open"] * 4
    assert list(found["strips"][0]["models"][0]) == [
        "left", "right", "state", "sigma0_um", "redundancy", "flagged", "off", "ties",
    ]  # fmt: skip
    assert found["block"] is None
    assert found["next"] == {
        "do": "measure",
        "command": f"anaplot open {folder}",
        "model": "1/2",
        "photo": None,
        "point": None,
        "inner": None,
        "why": None,
        "strip": None,
    }
    assert main(["status", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "block: nothing is measured yet" in said
    # `open` alone connects no instrument
    profiled = "[measuring]\nprofile = 'simulated'\n"
    assert said.endswith(f"anaplot open {folder} --simulate, or --profile NAME --port PORT\n")
    with (folder / "block.toml").open("a") as file:
        file.write(profiled)
    assert main(["status", str(folder)]) == 0
    assert capsys.readouterr().out.endswith(f"anaplot open {folder} --simulate, or --port PORT\n")


def test_measured_models_without_a_session_are_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    made = write_measured(folder, models=3, measured=2)
    write_control(folder, [ControlPoint("101-1", (1.0, 2.0, 3.0)), ControlPoint("far", (1, 2, 3))])
    found = status(folder, capsys)
    (strip,) = found["strips"]
    assert [m["state"] for m in strip["models"]] == ["accepted", "accepted", "open"]
    assert [m["ties"] for m in strip["models"]] == [0, 5, 0]
    assert strip["models"][0]["sigma0_um"] > 0.0
    assert strip["models"][2]["sigma0_um"] is None
    assert found["block"]["flagged"] == 0
    assert found["block"]["suspects"] == []
    assert found["control"] == {"points": 2, "seen": 1}
    assert found["next"]["model"] == "103/104"
    assert made.block.strips[0].photos[2] == "103"


def test_everything_measured_is_to_be_adjusted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    write_measured(folder, models=2, measured=2)
    # there is too little control for the command alone: what is advised can be done
    advised = status(folder, capsys)["next"]["command"]
    assert advised == f"anaplot adjust {folder} --datum free"
    assert main(advised.split()[1:]) == 0
    capsys.readouterr()
    assert main(["status", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "NEXT: adjust the block" in out
    assert "0 flagged" in out


def test_what_is_next_of_a_block_without_a_solution_is_to_see_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    write_measured(folder, models=1, measured=1)
    rows = read_block(folder).image_points
    kept = sorted({row.point for row in rows})[:4]
    write_image_points(folder, [row for row in rows if row.point in kept])
    step = status(folder, capsys)["next"]
    assert step["do"] == "adjust"
    assert "not determined" in step["why"]
    assert main(["status", str(folder)]) == 0
    told = capsys.readouterr().out
    assert f"block: {step['why']}" in told
    assert "NEXT: see why the block has no solution: anaplot adjust" in told
    assert main(step["command"].split()[1:]) == 4


def test_a_wrong_point_is_returned_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "b"
    # a new point of the first model, used as a tie by the second: its right ray is wrong in y
    write_measured(
        folder,
        models=2,
        measured=2,
        change=lambda row: (
            replace(row, y=row.y + 0.4)
            if (row.photo, row.point, row.model) == ("102", "102-2", "101/102")
            else row
        ),
    )
    found = status(folder, capsys)
    assert found["strips"][0]["models"][0]["state"] == "look"
    suspect = found["block"]["suspects"][0]
    assert list(suspect) == ["photo", "point", "axis", "model", "probability", "unless"]
    assert suspect["unless"] is None
    assert (suspect["photo"], suspect["point"], suspect["model"]) == ("102", "102-2", "101/102")
    assert suspect["probability"] > 0.99
    assert found["next"] | {"command": ""} == {
        "do": "return",
        "command": "",
        "model": "101/102",
        "photo": "102",
        "point": "102-2",
        "inner": None,
        "why": None,
        "strip": None,
    }
    assert main(["status", str(folder)]) == 0
    assert "NEXT: return to model 101/102, point 102-2" in capsys.readouterr().out


def test_the_session_says_what_is_in_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    assert main(["demo", "--auto", "--models", "1", "--keep", str(folder)]) == 0
    journal = folder / "sessions" / "0001.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    measured = [k for k, line in enumerate(lines) if '"kind":"point-measured"' in line]
    # as it was after seven points
    journal.write_text("".join(lines[: measured[6] + 1]))
    (folder / "image_points.csv").unlink()
    capsys.readouterr()
    found = status(folder, capsys)
    (model,) = found["strips"][0]["models"]
    assert model["state"] == "in work"
    assert model["redundancy"] == 2
    assert found["next"]["do"] == "measure"
    assert found["next"]["point"]
    assert main(["status", str(folder)]) == 0
    assert "block: no model is accepted yet" in capsys.readouterr().out
    # a journal that cannot be read is told, and the files are believed
    journal.write_text("".join(lines).replace('"point":"101-1"', '"point":"101-7"', 1))
    found = status(folder, capsys)
    assert found["strips"][0]["models"][0]["state"] == "open"
    assert "the journal was not read" in found["remarks"][0]


def test_a_block_without_strips(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "a b"  # as a shell takes it
    write_measured(folder, models=2, measured=2, keep_models=False)
    text = (folder / "block.toml").read_text()
    before, _, after = text.partition("[[strip]]")
    (folder / "block.toml").write_text(before + after[after.index("[[photo]]") :])
    found = status(folder, capsys)
    assert found["strips"] == []
    assert found["next"]["command"].startswith(f"anaplot adjust '{folder}'")
    assert found["next"]["do"] == "adjust"
    assert main(["status", str(tmp_path / "nowhere")]) == 2


def test_weak_photos_get_the_points_that_a_plan_gives_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "planned"
    said = ["plan", "block", "--strips", "2", "--photos", "4", "--to", str(folder), "--json"]
    assert main(said) == 0
    planned = json.loads(capsys.readouterr().out)["stabilizing"]
    found = status(folder, capsys)["block"]
    assert {one["photo"] for one in planned} == set(found["weak_photos"])
    for mine, its in zip(found["stabilizing"], planned, strict=True):
        assert mine["after"] == pytest.approx(its["after"], abs=1e-6)
        assert [(p["x"], p["y"], p["photos"]) for p in mine["points"]] == [
            (p["x"], p["y"], p["photos"]) for p in its["points"]
        ]
    assert main(["status", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "weak: 4 of 8 photos have few redundant observations beside the others" in text
    assert found["stabilizing_left_out"] == 0
    assert "  101    mean r 0.230, 0.309 with 1, 0.364 with 2, 0.419 with 4 points" in text
    # a photo waits until its models are measured
    rows = (folder / "image_points.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [row for row in rows if "103/104" not in row]
    (folder / "image_points.csv").write_text("".join(kept), encoding="utf-8")
    waiting = status(folder, capsys)["block"]
    assert {"103", "104"}.isdisjoint(waiting["weak_photos"])
    assert "101" in waiting["weak_photos"]


def test_weak_photos_that_are_left_out_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "planned"
    main(["plan", "block", "--strips", "2", "--photos", "4", "--to", str(folder)])
    capsys.readouterr()
    monkeypatch.setattr(statuscommand, "_MOST_WEAK", 1)
    found = status(folder, capsys)["block"]
    assert (len(found["weak_photos"]), found["stabilizing_left_out"]) == (4, 3)
    assert main(["status", str(folder)]) == 0
    assert "and 3 more, for which nothing was looked for" in capsys.readouterr().out


def test_a_block_of_nonsense_is_not_searched_for_long(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "b"
    write_measured(folder, models=2, measured=2)
    good = status(folder, capsys)
    assert good["block"]["sigma0"] > 0.0
    assert good["remarks"] == []
    rng = np.random.default_rng(0)
    rows = read_block(folder).image_points
    wrong = rng.uniform(-100.0, 100.0, (len(rows), 2)).round(3).tolist()
    write_image_points(
        folder, tuple(replace(r, x=x, y=y) for r, (x, y) in zip(rows, wrong, strict=True))
    )
    monkeypatch.setattr(statuscommand, "PATIENCE", 3)
    monkeypatch.setattr(statuscommand, "PATIENCE_PER_PHOTO", 0)
    found = status(folder, capsys)
    assert found["block"] is None
    (remark,) = found["remarks"]
    assert remark.startswith("no approximate values found in 3 steps")
    assert main(["status", str(folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the measurements may contradict each other; anaplot adjust searches on" in said
    assert said.count("no approximate values found") == 1
    # what is right takes fewer steps than that
    write_image_points(folder, rows)
    assert status(folder, capsys)["block"] == good["block"]
