"""`anaplot adjust --errors`: text, JSON and exit codes."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandbench import run_adjust
from wild import text_of, words

from anaplot import cli
from anaplot.adjustment.cleaning import Cleaning
from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.adjustment.strategies import STRATEGIES
from anaplot.bundle.solve.problem import make_problem
from anaplot.errors import InputError
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.report.adjustdocument import adjust_document
from anaplot.report.adjusterrors import (
    _rejected_line,
    clean_block,
    errors_document,
)
from anaplot.report.astext import line_text


def make(*, error_mm: float = 0.15, height_m: float = 0.0, name: str = "p8") -> Block:
    """Two strips of four photos; an error in y of `name` in photo 11, one in the height of p0."""
    rng = np.random.default_rng(12)
    grid = [(x, y) for x in range(0, 1801, 300) for y in (-500, 0, 300, 600, 1100)]
    points = {f"p{k}": np.array([x, y, rng.uniform(-40, 40)]) for k, (x, y) in enumerate(grid)}
    rows = []
    for i in range(8):
        centre = np.array([600.0 * (i % 4), 600.0 * (i // 4), 1000.0])
        rotation = rotation_matrix(*rng.normal(size=3) * 0.01)
        for point, at in points.items():
            if np.abs(at[:2] - centre[:2]).max() > 650:
                continue
            seen = project(centre[None], rotation[None], np.array([150.0]), at[None]).xy[0]
            x, y = (seen + rng.normal(size=2) * 0.005).tolist()
            if i == 1 and point == "p8":
                y += error_mm
            rows.append(ImagePoint(f"1{i}", name if point == "p8" else point, x, y, None, None))
    control = []
    for point in ("p0", "p4", "p15", "p19", "p30", "p34", "p2", "p32"):
        x, y, z = points[point].tolist()
        lift = height_m if point == "p0" else 0.0
        control.append(ControlPoint(point, (x, y, z + lift), (0.02,) * 3))
    return Block(
        "twostrips",
        Precision(image_um=5.0),
        TestSettings(),
        (Camera("c", 150.0),),
        tuple(Photo(f"1{i}", "c") for i in range(8)),
        (),
        tuple(rows),
        tuple(control),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    block, folder = make(height_m=1.5), tmp_path / "two"
    folder.mkdir()
    lines = ['format = 1\nname = "twostrips"\n[precision]\nimage_um = 5.0\n[[camera]]\nid = "c"\n'
             'c = 150.0\n[[strip]]\nid = "1"\nphotos = ["10", "11", "12", "13"]']  # fmt: skip
    lines += [f'[[photo]]\nid = "{photo.id}"\ncamera = "c"' for photo in block.photos]
    (folder / "block.toml").write_text("\n".join(lines) + "\n")
    rows = ["photo,point,x,y"]
    rows += [f"{r.photo},{r.point},{r.x!r},{r.y!r}" for r in block.image_points]
    (folder / "image_points.csv").write_text("\n".join(rows) + "\n")
    rows = ["point,X,Y,Z,sX,sY,sZ,use"]
    for r in block.control:
        rows.append(",".join([r.point, *map(str, r.xyz), *map(str, r.sigma), r.use]))
    (folder / "control.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_what_a_person_has_switched_off_is_not_called_rejected(folder: Path) -> None:
    path = folder / "image_points.csv"
    head, first, second, third, *rest = path.read_text().splitlines()
    rows = [f"{head},use", f"{first},x", f"{second},y", f"{third},off", *(f"{r}," for r in rest)]
    path.write_text("\n".join(rows) + "\n")
    _, text, _ = run_adjust(folder)
    assert "  2 image coordinates are switched off" in text
    assert "rejected" not in text[: text.index("PHOTO")]
    _, text, _ = run_adjust(folder, errors="search")
    assert "  1 image coordinate is rejected" in text
    assert "  2 image coordinates are switched off" in text


def test_the_text_says_what_was_rejected_and_why(folder: Path) -> None:
    code, text, _ = run_adjust(folder, errors="search")
    assert code == 0
    assert "  1 image coordinate is rejected" in text
    at = text.index("GROSS ERRORS (search)")
    section = text[at:]
    assert "2 observations are rejected after" in section
    [control] = [line for line in section.splitlines() if "control point p0  Z" in line][:1]
    assert " mm " in control
    assert "the sum falls by" in control
    [image] = [line for line in section.splitlines() if "photo 11  point p8  y" in line][:1]
    assert " um " in image
    table = [line for line in text[:at].splitlines() if line.endswith("rejected")]
    assert len([line for line in table if " p8 " in line]) == 1
    code, text, _ = run_adjust(folder, errors="baarda", fail_on_flag=True)
    assert code == 1
    assert "w " in text[text.index("GROSS ERRORS (baarda)") :]


def test_the_json_stays_and_gains_errors(folder: Path) -> None:
    plain = json.loads(run_adjust(folder, as_json=True)[1])
    found = json.loads(
        run_adjust(folder, as_json=True, errors="search", partner=0.5, pairs=True)[1]
    )
    assert set(found) == set(plain) | {"errors"}
    errors = found["errors"]
    assert errors["strategy"] == "search"
    assert errors["partner"] == 0.5
    assert errors["redundancy_before"] == plain["redundancy"]
    assert errors["sigma0_before"] == plain["sigma0"]
    assert found["observations"] == plain["observations"] - 2
    assert found["redundancy"] == plain["redundancy"] - 2
    assert found["unknowns"] == plain["unknowns"]
    image, control = sorted(errors["rejected"], key=lambda row: row["kind"], reverse=True)
    assert [image[k] for k in ("photo", "point", "model", "axis")] == ["11", "p8", None, "y"]
    assert image["error"] == pytest.approx(150.0, abs=4 * image["sigma"])
    assert [control[k] for k in ("point", "axis", "unit")] == ["p0", "Z", "m"]
    assert control["error"] == pytest.approx(1.5, abs=4 * control["sigma"])
    # every row stays; only the rejected coordinate has lost its test
    assert len(found["image_points"]) == len(plain["image_points"])
    keys = set(plain["image_points"][0])
    for row in found["image_points"]:
        assert set(row) == keys | {"rejected", "rejected_axes"}
    [row] = [row for row in found["image_points"] if row["rejected"]]
    assert (row["photo"], row["point"], row["rejected_axes"]) == ("11", "p8", ["y"])
    assert row["vy_um"] == pytest.approx(-image["error"], rel=1e-6)
    assert row["ry"] is row["wy"] is row["mdb_y_um"] is row["effect_y"] is None
    assert row["rx"] is not None
    assert len(found["control"]) == len(plain["control"])
    [row] = [row for row in found["control"] if row["rejected"]]
    assert set(row) == set(plain["control"][0]) | {"rejected"}
    assert row["v"] == pytest.approx(-control["error"])
    assert [step["action"] for step in errors["steps"]][:2] == ["add", "add"]
    single = errors["odds"]["single"]
    assert errors["odds"]["none"] < 0.01
    assert single[0]["probability"] == max(row["probability"] for row in single)
    assert 0.9 < sum(row["probability"] for row in single) <= 1.0 + 1e-9
    odds = errors["pair_odds"]
    assert odds["none"] + odds["one"] + odds["two"] == pytest.approx(1.0)
    first, second = odds["pairs"][0]["first"], odds["pairs"][0]["second"]
    assert {first["kind"], second["kind"]} == {"image", "control"}
    assert all(abs(pair["correlation"]) >= 0.5 for pair in errors["hard_to_tell"])
    assert errors["hard_to_tell"]


def test_the_command_line(folder: Path, capsys) -> None:
    for name in ("tau", "danish", "modified"):
        assert name in STRATEGIES
        assert cli.main(["adjust", str(folder), "--errors", name, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["errors"]["strategy"] == name
    assert cli.main(["adjust", str(folder), "--errors", "search", "--fail-on-flag"]) == 1
    assert cli.main(["adjust", str(folder), "--pairs"]) == 2
    assert "--pairs, --as-given and --control-last go with --errors" in capsys.readouterr().err
    assert cli.main(["adjust", str(folder), "--errors", "modified", "--snooping"]) == 0
    text = capsys.readouterr().out
    assert "model values decided" in text
    assert "MODIFIED DATA SNOOPING" in text
    with pytest.raises(InputError):
        run_adjust(folder, partner=0.9)


@pytest.mark.parametrize(
    ("strategy", "what", "sigma0"),
    [("tau", "tau", "estimated"), ("rms", "v/rms", "estimated"), ("baarda", "w", "a-priori")],
)
def test_the_text_names_the_sigma_and_the_critical_value(what, strategy, sigma0) -> None:
    cleaned = clean_block(make_problem(make()), strategy, pairs=True)
    text, found = text_of(errors_document(cleaned)), errors_document(cleaned).to_dict()
    assert text.count(f"all observations in, by the {sigma0} sigma0: ") == 2
    assert found["odds"]["sigma0"] == found["pair_odds"]["sigma0"] == sigma0
    f = cleaned.block.redundancy
    critical = critical_normal(0.001) if what == "w" else critical_tau(0.001, f)
    assert found["critical"] == critical
    assert f"critical value of {what} {critical:.2f}" in text
    assert (f" at redundancy {f};" in text) == (what != "w")


def test_nothing_rejected_is_said(tmp_path: Path) -> None:
    cleaned = clean_block(make_problem(make(error_mm=0.0)), "baarda")
    assert cleaned.rejected == ()
    text = text_of(errors_document(cleaned))
    assert "nothing is rejected" in text
    assert errors_document(cleaned).to_dict()["rejected"] == []


def test_names_are_text_and_never_control_sequences() -> None:
    problem = make_problem(make(name="p\x1b[31m8"))
    cleaned = clean_block(problem, "search", 0.3, pairs=True)
    assert any("p\x1b[31m8" in row.name for row in cleaned.rejected)
    assert "\x1b" not in text_of(errors_document(cleaned))


def test_a_rejected_prior_stands_in_the_rows_of_priors() -> None:
    block = make(error_mm=0.0)
    photos = list(block.photos)
    photos[3] = replace(photos[3], position=(1803.0, 0.0, 1000.0), position_sigma=(0.1,) * 3)
    cleaned = clean_block(make_problem(replace(block, photos=tuple(photos))), "search")
    [row] = cleaned.rejected
    assert row.name == ("prior", "13", "X")
    assert "prior of 13  X" in text_of(errors_document(cleaned))
    document = adjust_document(cleaned.block, [(row.name, row.error)])
    priors = document.to_dict()["priors"]
    assert [(one["unknown"], one["rejected"]) for one in priors] == [
        ("Y", False),
        ("Z", False),
        ("X", True),
    ]
    assert priors[2]["v"] == pytest.approx(-3.0, abs=0.3)


def test_columns_never_touch() -> None:
    row = clean_block(make_problem(make()), "search").rejected[0]
    for unit in ("um", "m", "rad"):
        usual = row._replace(error=-1.23e-4, sigma=1e-5, unit=unit)
        for size in (-99.99, -123.45, 1e12):
            large = usual._replace(order=123456, error=-(size**2), sigma=-size)
            lines = [line_text(_rejected_line(one, 30, "search", {})) for one in (usual, large)]
            assert words(lines[0]) == words(lines[1])


def test_what_was_done_to_the_ground_is_said() -> None:
    cleaned = clean_block(make_problem(make(error_mm=0.3)), "search")
    first, block = cleaned.first, cleaned.block
    assert first is not None
    xyz = {row.point: np.array(row.xyz) for row in first.whole().point_rows()}
    moved = {row.point: np.array(row.xyz) - xyz[row.point] for row in block.point_rows()}
    farthest = max(moved, key=lambda point: np.abs(moved[point]).max())
    ground = errors_document(cleaned).to_dict()["ground"]
    assert ground["point"] == farthest == "p8"
    assert ground["change_m"] == pytest.approx(moved["p8"]["XYZ".index(ground["axis"])], abs=1e-9)
    assert ground["sigma_point"] == "p8"
    assert ground["sigma_after_m"] > ground["sigma_before_m"] > 0.0
    rms = np.sqrt(np.mean([m**2 for m in moved.values()], axis=0))
    assert [ground[f"rms_{axis}_m"] for axis in "XYZ"] == pytest.approx(rms.tolist(), abs=1e-9)
    text = text_of(errors_document(cleaned))
    assert f"p8 moves most, {ground['axis']} by {ground['change_m']:.4f} m" in text


def test_partners_stand_beside_the_row() -> None:
    """A point of two rays: which of the four coordinates is wrong nobody can say."""
    block = make(error_mm=0.0)
    rows = [r for r in block.image_points if r.point != "p8" or r.photo in ("10", "11")]
    rows = [replace(r, y=r.y + 0.3) if (r.photo, r.point) == ("11", "p8") else r for r in rows]
    cleaned = clean_block(make_problem(replace(block, image_points=tuple(rows))), "baarda")
    (row,) = errors_document(cleaned).to_dict()["rejected"]
    assert (row["point"], row["axis"]) == ("p8", "y")
    assert {(p["photo"], p["axis"]) for p in row["partners"]} == {
        (photo, axis) for photo in ("10", "11") for axis in "xy"
    } - {(row["photo"], "y")}
    other = "10" if row["photo"] == "11" else "11"
    assert f"or y of photo {other}" in text_of(errors_document(cleaned))


@pytest.mark.parametrize("strategy", ["baarda", "search"])
def test_a_sigma_far_from_the_truth_cleans_nothing(strategy: str, folder: Path, capsys) -> None:
    toml = folder / "block.toml"
    toml.write_text(toml.read_text().replace("image_um = 5.0", "image_um = 0.08"))
    assert cli.main(["adjust", str(folder), "--errors", strategy]) == 4
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "is image_um = 0.08 right?" in said.err
    if strategy == "baarda":
        assert cli.main(["adjust", str(folder), "--errors", "tau"]) == 0
        assert cli.main(["adjust", str(folder), "--errors", strategy, "--as-given"]) == 0
        assert "half of the redundancy" in capsys.readouterr().out
        assert cli.main(["adjust", str(folder), "--as-given"]) == 2


def test_an_interrupt_ends_with_the_best_and_the_next_one_leaves(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    real = Cleaning.run
    interrupts = 1

    def run(self, *args):
        for _ in range(interrupts):
            signal.raise_signal(signal.SIGINT)
        return real(self, *args)

    monkeypatch.setattr(Cleaning, "run", run)
    before = signal.getsignal(signal.SIGINT)
    assert cli.main(["adjust", str(folder), "--errors", "baarda", "--json"]) == 0
    said = capsys.readouterr()
    assert "again to leave at once" in said.err
    remarks = json.loads(said.out)["errors"]["remarks"]
    assert any("interrupted: the best found so far" in remark for remark in remarks)
    assert signal.getsignal(signal.SIGINT) is before
    interrupts = 2
    assert cli.main(["adjust", str(folder), "--errors", "baarda"]) == 130
    assert signal.getsignal(signal.SIGINT) is before
