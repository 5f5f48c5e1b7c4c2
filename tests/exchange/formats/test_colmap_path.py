"""The way of one who has a COLMAP model: in, looked at, adjusted, cleaned, out, opened again."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from anaplot.cli import main
from tests.exchange.formats.colmapsamples import Sample, sample

WRONG = 4


def mismatched() -> tuple[Sample, set[tuple[str, str]]]:
    """Return a model in which some features belong to other points, and which they are."""
    made = sample(photos=7, points=36)
    rng = np.random.default_rng(11)
    wrong = set()
    for image in made.images[:WRONG]:
        numbers = [point for _, _, point in image.features]
        once = [k for k, p in enumerate(numbers) if p is not None and numbers.count(p) == 1]
        k = int(rng.choice(once))
        x, y, point = image.features[k]
        image.features[k] = x + 5.0, y - 4.0, point
        wrong.add((image.name, str(point)))
    return made, wrong


def pixels(file: Path) -> list[tuple[str, ...]]:
    """Return what an image_points.csv says of rays, as text."""
    with file.open(newline="") as table:
        names = ("photo", "point", "x_px", "y_px")
        return [tuple(row[name] for name in names) for row in csv.DictReader(table)]


@pytest.mark.slow
def test_a_model_goes_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    monkeypatch.chdir(tmp_path)
    made, wrong = mismatched()
    made.write(Path("project/sparse/0"))

    assert main(["import", "project", "-o", "block", "--sigma-px", "0.3"]) == 0
    said = capsys.readouterr().out
    assert "7 photos, 3 cameras" in said
    assert "next: anaplot status block\n" in said
    file = Path("block/image_points.csv")
    imported, measured = file.read_bytes(), pixels(file)

    assert main(["status", "block", "--json"]) == 0
    command = json.loads(capsys.readouterr().out)["next"]["command"]
    assert command == "anaplot adjust block --datum free"

    assert main(["adjust", "block"]) == 4
    assert "--datum free" in capsys.readouterr().err
    assert main([*command.split()[1:], "--fail-on-flag"]) == 1
    notes = [line for line in capsys.readouterr().out.splitlines() if "note:" in line]
    assert len(notes) == 1  # of rays that images have twice, all in one line
    assert "points are left out: " in notes[0]
    assert "each has no ray left" in notes[0]

    free = ["adjust", "block", "--datum", "free"]
    assert main([*free, "--errors", "baarda", "--apply", "--to", "tables"]) == 0
    page = capsys.readouterr().out
    assert "GROSS ERRORS (baarda)" in page
    assert not re.search(r"\bum\b", page)  # its pixels have no size
    assert pixels(file) == measured  # digit by digit
    with Path("tables/image_points.csv").open(newline="") as table:
        keys = set(csv.DictReader(table).fieldnames or ())
    assert {"photo", "point", "vx_um", "rx", "wx", "mdb_x_um"} <= keys
    summary = json.loads(Path("tables/summary.json").read_text())
    assert summary["sigma0"] == pytest.approx(1.0, abs=0.15)

    assert main(["export", "colmap", "block", "-o", "cleaned"]) == 0
    assert "rays that do not count are in no track" in capsys.readouterr().out
    theirs = pycolmap.Reconstruction("cleaned")
    kept = {
        (theirs.images[element.image_id].name, str(number))
        for number, point in theirs.points3D.items()
        for element in point.track.elements
    }
    assert not kept & wrong
    before = pycolmap.Reconstruction("project/sparse/0")
    assert theirs.num_reg_images() == before.num_reg_images() == 7
    doubled = imported.count(b"~2")
    lost = before.compute_num_observations() - doubled - theirs.compute_num_observations()
    assert WRONG <= lost <= WRONG + 2 * len(made.points) // 10
    theirs.update_point_3d_errors()
    assert theirs.compute_mean_reprojection_error() < 1.0

    assert main([*free, "--apply-undo"]) == 0
    assert file.read_bytes() == imported
    assert main(["export", "colmap", "block", "-o", "again"]) == 0
    for name in ("cameras.bin", "images.bin", "points3D.bin"):
        assert Path("again", name).read_bytes() == Path("project/sparse/0", name).read_bytes()
