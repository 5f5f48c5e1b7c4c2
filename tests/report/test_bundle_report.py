"""`anaplot adjust`: the contract's JSON, the text, exit codes, progress."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandbench import run_adjust
from wild import wild, words

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import read_block
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.lens import LENS_PARAMETERS
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.report.adjustdocument import adjust_document
from anaplot.report.astext import page_text
from anaplot.report.progress import ProgressLine

TOML = """\
format = 1
name = "small"
[precision]
image_um = 5.0
control_m = 0.05
[test]
kind = "tau"
alpha = 0.001
power = 0.80
[[camera]]
id = "rmk"
c = 150.0
[[strip]]
id = "1"
photos = ["101", "102", "103"]
[[photo]]
id = "101"
camera = "rmk"
[[photo]]
id = "102"
camera = "rmk"
[[photo]]
id = "103"
camera = "rmk"
"""


def write_block(folder: Path, *, error_mm: float = 0.0, control: bool = True) -> Path:
    """A strip of three photos, fifteen points, six control points and a check point."""
    rng = np.random.default_rng(4)
    folder.mkdir()
    (folder / "block.toml").write_text(TOML)
    lines = ["photo,point,x,y,sigma_um,model"]
    points = {}
    for k, (x, y) in enumerate((x, y) for x in range(0, 1300, 300) for y in (-500, 0, 500)):
        points[f"{k + 1}"] = (x, y, rng.uniform(-30, 30))
    for i, photo in enumerate(("101", "102", "103")):
        centre = np.array([600.0 * i, 0.0, 1000.0])
        rotation = rotation_matrix(*rng.normal(size=3) * 0.01)
        for name, at in points.items():
            if abs(at[0] - centre[0]) > 650:
                continue
            seen = project(centre[None], rotation[None], np.array([150.0]), np.array([at]))
            x, y = seen.xy[0] + rng.normal(size=2) * 0.005
            if photo == "102" and name == "8":
                y += error_mm
            lines.append(f"{photo},{name},{x!r},{y!r},,")
    (folder / "image_points.csv").write_text("\n".join(lines).replace("np.float64", "") + "\n")
    rows = ["point,X,Y,Z,sX,sY,sZ,use"]
    for name in ("1", "3", "7", "9", "13", "15"):
        x, y, z = points[name]
        sigma = ",0,0,0," if name == "1" else ",,,,"
        rows.append(f"{name},{x},{y},{z}{sigma}control")
    rows.append("8,{},{},{},,,,check".format(*points["8"]))
    if control:
        (folder / "control.csv").write_text("\n".join(rows) + "\n")
    text = (folder / "image_points.csv").read_text().replace("(", "").replace(")", "")
    (folder / "image_points.csv").write_text(text)
    return folder


def printout(block: AdjustedBlock) -> str:
    return page_text(adjust_document(block).page, everything=True)


def numbers(value) -> list[float]:
    if isinstance(value, dict):
        return [n for item in value.values() for n in numbers(item)]
    if isinstance(value, list):
        return [n for item in value for n in numbers(item)]
    return [float(value)] if isinstance(value, (int, float)) else []


def test_the_contract(tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b")
    code, out, err = run_adjust(folder, as_json=True)
    assert (code, err) == (0, "")
    got = json.loads(out)
    block = read_block(folder)
    assert set(got) >= {
        "observations", "unknowns", "redundancy", "sigma0", "sigma0_um", "photos", "points",
        "image_points", "control", "check", "indicators",
    }  # fmt: skip
    assert got["observations"] - got["unknowns"] == got["redundancy"] > 0
    assert got["observations"] == 2 * len(block.image_points) + 5 * 3
    assert got["sigma0_um"] == pytest.approx(5.0 * got["sigma0"])
    assert [p["photo"] for p in got["photos"]] == ["101", "102", "103"]
    assert set(got["photos"][0]) >= {
        "X", "Y", "Z", "omega", "phi", "kappa", "sX", "sY", "sZ", "somega", "sphi", "skappa",
    }  # fmt: skip
    keys = {
        "photo", "point", "model", "vx_um", "vy_um", "rx", "ry", "wx", "wy", "mdb_x_um",
        "mdb_y_um", "flagged",
    }  # fmt: skip
    assert [(r["photo"], r["point"]) for r in got["image_points"]] == [
        (r.photo, r.point) for r in block.image_points
    ]
    assert all(set(r) >= keys for r in got["image_points"])
    assert {c["axis"] for c in got["control"]} == {"X", "Y", "Z"}
    assert len(got["control"]) == 15
    assert [c["point"] for c in got["check"]] == ["8"]
    assert abs(got["check"][0]["dX"]) < 1.0
    # what is listed adds up to the redundancy
    seen = [r for r in got["image_points"] if r["rx"] is not None]
    total = sum(r["rx"] + r["ry"] for r in seen) + sum(c["r"] for c in got["control"])
    assert total == pytest.approx(got["redundancy"], abs=1e-6)
    rx = [r["rx"] for r in seen]
    assert got["indicators"]["RI_x"] == pytest.approx(sum(rx) / len(rx))
    # control free of error: no deviation, counted as zero in AI
    held = next(p for p in got["points"] if p["point"] == "1")
    assert held["sX"] == held["sY"] == held["sZ"] == 0.0
    mean = sum(p["sX"] for p in got["points"]) / len(got["points"])
    assert got["indicators"]["AI_X"] == pytest.approx(mean / got["sigma0"])
    assert all(math.isfinite(n) for n in numbers(got))
    # w is v over its standard deviation
    row = got["image_points"][5]
    expected = row["vy_um"] / (got["sigma0"] * 5.0 * math.sqrt(row["ry"]))
    assert row["wy"] == pytest.approx(expected)


def test_a_flag_and_its_exit_code(tmp_path: Path) -> None:
    clean, spoilt = write_block(tmp_path / "a"), write_block(tmp_path / "b", error_mm=0.3)
    assert run_adjust(clean, fail_on_flag=True)[0] == 0
    assert run_adjust(spoilt)[0] == 0
    code, out, _ = run_adjust(spoilt, fail_on_flag=True)
    assert code == 1
    assert "remeasure 8 in photo 102 (y) first" in out
    assert "<< REMEASURE" in out
    assert "point 8: photo 102 " in out
    got = json.loads(run_adjust(spoilt, as_json=True)[1])
    accused = got["accused"]["8"]
    assert accused[0]["photo"] == "102"
    assert sum(ray["probability"] for ray in accused) == pytest.approx(1.0)


def test_the_text_says_everything(tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b")
    _, out, _ = run_adjust(folder, additional="ebner", additional_sigma_um=5.0)
    for piece in ("BLOCK small", "redundancy", "PHOTO", "CONTROL", "CHECK", "PRIOR", "PARAMETER",
                  "POINT", "RED-N", "EFFECT", "RI x", "AI X"):  # fmt: skip
        assert piece in out, piece
    lines = [line.split() for line in out.splitlines()]
    for head, units in (("PHOTO", 6 * ["m"] + 6 * ["deg"]), ("POINT", 6 * ["m"])):
        [under] = [lines[k + 1] for k, line in enumerate(lines) if line[:2] == [head, "X"]]
        assert under == units
    _, out, _ = run_adjust(folder, datum="free")
    assert "rank defect 7" in out
    assert "CHECK" in out  # control is compared with, not held
    got = json.loads(
        run_adjust(
            folder, as_json=True, datum="minimal", additional="ebner", additional_sigma_um=5.0
        )[1]
    )
    assert got["datum"] == {"kind": "minimal", "defect": 7}
    assert len(got["additional"]["parameters"]) == 12


@pytest.mark.parametrize("datum", ["control", "free", "minimal"])
def test_every_correlation_is_one(tmp_path: Path, datum: str) -> None:
    folder = write_block(tmp_path / "b")
    asked = {"datum": datum, "additional": "physical", "additional_sigma_um": 50.0}
    got = json.loads(run_adjust(folder, as_json=True, correlations=0.01, **asked)[1])
    found: list[float] = []

    def collect(value: object) -> None:
        if isinstance(value, dict):
            found.extend(v for k, v in value.items() if k == "correlation")
            value = list(value.values())
        for each in value if isinstance(value, list) else ():
            collect(each)

    collect(got)
    assert len(found) > 10
    assert all(-1.0 <= rho <= 1.0 for rho in found)


def test_a_lens_is_given_as_effects_and_as_coefficients(tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b")
    asked = {"additional": "physical", "additional_sigma_um": 50.0}
    text = run_adjust(folder, **asked)[1]
    assert re.search(r"PARAMETER +value \[um\] +s \[um\] +coefficient +s$", text, re.MULTILINE)
    assert "c > 0 makes it longer" in text
    rows = json.loads(run_adjust(folder, as_json=True, **asked)[1])["additional"]["parameters"]
    assert [row["name"] for row in rows] == list(LENS_PARAMETERS)
    for row in rows[:3]:
        assert row["coefficient"] == row["value"]
    for row in rows:
        t = row["value"] / row["s"]
        assert row["coefficient"] / row["s_coefficient"] == pytest.approx(t)
    others = json.loads(run_adjust(folder, as_json=True, additional="ebner")[1])["additional"]
    assert all(row["coefficient"] is None for row in others["parameters"])


def test_undetected_errors_at_control_move_other_points(tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b")
    _, out, _ = run_adjust(folder)
    assert "EFFECT [mm]  LARGEST [mm]  AT" in out
    assert "no function of the unknowns by more than LENGTH of its deviations" in out
    got = json.loads(run_adjust(folder, as_json=True)[1])
    held = [r for r in got["image_points"] if r["point"] == "1" and r["rx"]]
    assert held
    for row in held:
        assert row["effect_x"] == [0.0, 0.0, 0.0]  # control free of error stays where it is
        assert row["largest_effect_at_x"] != "1"
        assert math.hypot(*row["largest_effect_x"]) > 1e-3
        length = math.sqrt((1.0 - row["rx"]) / row["rx"])
        assert row["standardized_effect_x"] == pytest.approx(4.132 * length, rel=1e-3)
    for row in got["priors"]:
        assert row["largest_effect_at"] in {point["point"] for point in got["points"]}


def test_a_row_that_takes_no_part_has_no_numbers(tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b")
    with (folder / "image_points.csv").open("a") as file:
        file.write("101,lonely,1.0,2.0,,\n")
    got = json.loads(run_adjust(folder, as_json=True)[1])
    row = got["image_points"][-1]
    assert row["point"] == "lonely"
    assert row["rx"] is row["wx"] is row["vx_um"] is None
    assert got["left_out"] == [{"kind": "point", "name": "lonely", "reason": "has one ray only"}]


def test_without_redundancy_there_is_no_sigma(tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b")
    block = read_block(folder)
    # two photos, five points, no more than a datum: 20 observations, 27 unknowns, defect 7
    keep = ("101", "102")
    points = ("1", "3", "5", "7", "9")
    rows = tuple(r for r in block.image_points if r.photo in keep and r.point in points)
    small = replace(
        block, image_points=rows, photos=block.photos[:2], control=(),
        strips=(replace(block.strips[0], photos=keep),),
    )  # fmt: skip
    adjusted = adjust_block(small, datum="free")
    assert adjusted.redundancy == 0
    document = adjust_document(adjusted)
    got = document.to_dict()
    assert got["sigma0"] is None
    assert got["sigma0_um"] is None
    assert got["photos"][0]["sX"] is None
    assert all(r["wx"] is None and r["mdb_x_um"] is None for r in got["image_points"])
    assert "no redundancy" in page_text(document.page)
    json.dumps(got, allow_nan=False)


def test_errors_print_nothing(tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b", control=False)
    out = io.StringIO()
    with pytest.raises(NotComputableError, match="no control"):
        run_adjust(folder, out=out)
    with pytest.raises(InputError, match="no set"):
        run_adjust(folder, additional="brown", out=out)
    with pytest.raises(InputError, match="no such folder"):
        run_adjust(tmp_path / "nowhere", out=out)
    assert out.getvalue() == ""


def test_names_cannot_control_the_terminal(tmp_path: Path) -> None:
    block = read_block(write_block(tmp_path / "b"))
    evil = "8\x1b[31m"
    rows = tuple(replace(r, point=evil) if r.point == "8" else r for r in block.image_points)
    text = printout(adjust_block(replace(block, image_points=rows)))
    assert "\x1b" not in text
    assert "8\\x1b[31m" in text


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_shows_late_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("anaplot.report.progress.time.monotonic", lambda: clock[0])
    watched, unwatched = Terminal(), io.StringIO()
    for stream in (watched, unwatched):
        clock[0] = 0.0
        with ProgressLine(stream) as progress:
            progress("factor", 0.1)
            assert stream.getvalue() == ""
            clock[0] = 2.0
            progress("factor", 0.5)
            progress("factor", 0.6)
    assert unwatched.getvalue() == ""
    shown = watched.getvalue()
    assert "factor  50 %" in shown
    assert "60 %" not in shown
    assert shown.endswith("\r")


def test_an_interrupt_clears_the_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = write_block(tmp_path / "b")
    clock = iter(float(k) for k in range(10_000))
    monkeypatch.setattr("anaplot.report.progress.time.monotonic", lambda: next(clock))
    err = Terminal()

    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("anaplot.bundle.adjust.evaluate", interrupted)
    out = io.StringIO()
    with pytest.raises(KeyboardInterrupt):
        run_adjust(folder, out=out, err=err)
    assert out.getvalue() == ""
    assert err.getvalue().endswith("\r")


def test_columns_never_touch(tmp_path: Path, monkeypatch) -> None:
    block = adjust_block(read_block(write_block(tmp_path / "b")))
    usual = printout(block).replace("not testable", "")
    for name in ("photo", "control", "check", "point", "ray"):
        real = getattr(AdjustedBlock, f"{name}_rows")
        # flags apart: they may come with the size
        grown = [wild(row, -1.23456789e9) for row in real(block)]
        monkeypatch.setattr(AdjustedBlock, f"{name}_rows", lambda _, rows=grown: rows)
    large = printout(block).replace("not testable", "")
    assert words(usual.split("PHOTO ", 1)[1]) == words(large.split("PHOTO ", 1)[1])


def test_one_iteration_and_one_spur_are_not_several(tmp_path: Path, monkeypatch) -> None:
    block = adjust_block(read_block(write_block(tmp_path / "b")))
    for number, said in (
        (1, "; 1 iteration, 0 damped\n"),
        (2, "; 2 iterations, 0 damped\n"),
    ):
        convergence = block.convergence._replace(iterations=number, damped=0)
        assert said in printout(replace(block, convergence=convergence))
    for count, said in (
        (1, "1 image coordinate (spurs, r below 0.0001) is checked by"),
        (2, "2 image coordinates (spurs, r below 0.0001) are checked by"),
    ):
        monkeypatch.setattr(AdjustedBlock, "spurs", lambda _, n=count: [("101", "1", "x")] * n)
        assert said in printout(block)


def test_tables_are_written_with_the_keys_of_json(tmp_path: Path) -> None:
    folder, to, file = write_block(tmp_path / "b"), tmp_path / "tables", tmp_path / "points.csv"
    assert run_adjust(folder, csv=file, tables=to)[0] == 0
    got = json.loads(run_adjust(folder, as_json=True)[1])
    for key in ("photos", "points", "image_points", "control", "check"):
        with (to / f"{key}.csv").open(newline="") as lines:
            rows = list(csv.DictReader(lines))
        assert len(rows) == len(got[key]) > 0
        for row, expected in zip(rows, got[key], strict=True):
            for column, value in expected.items():
                if isinstance(value, list) or column.startswith(("effect", "largest_effect")):
                    continue
                text = "" if value is None else str(int(value) if value in (0, 1) else value)
                assert row[column] == text or float(row[column]) == value
            if expected.get("effect_x") is not None:
                assert float(row["effect_x_Z"]) == expected["effect_x"][2]
    assert file.read_bytes() == (to / "points.csv").read_bytes()
    summary = json.loads((to / "summary.json").read_text())
    assert {f"{key}.csv" for key in summary.pop("tables")} == {p.name for p in to.glob("*.csv")}
    assert {**got, **summary} == got
    assert summary["indicators"] == got["indicators"]


def test_a_long_table_is_cut_to_what_needs_a_look(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("anaplot.report.astext.MOST_ROWS", 40)
    block = adjust_block(read_block(write_block(tmp_path / "b")))
    rays = len(block.problem.photo)
    short = page_text(adjust_document(block).page)
    whole = printout(block)
    looked = [line for line in whole.splitlines() if line.endswith(("REMEASURE", "testable"))]
    left = 2 * rays - len(looked)
    count = f"{left} of {2 * rays}" if looked else f"{left}"
    assert f"  ... {count} rows are not shown; --all prints them\n" in short
    assert [line for line in short.splitlines() if line.endswith(("REMEASURE", "testable"))] == (
        looked
    )
    assert "rows are not shown" not in whole
