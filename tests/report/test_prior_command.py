"""`adjust --prior` as a user calls it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.planning.blockplan import BlockPlan, plan_block


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A block whose control is three times as bad as it says, its image coordinates as stated."""
    made = plan_block(BlockPlan(3, 5, 0.60, 0.60, 5, control_m=0.05))
    rng = np.random.default_rng(3)
    rows = [
        replace(row, x=row.x + dx, y=row.y + dy)
        for row, (dx, dy) in zip(
            made.block.image_points,
            (rng.normal(size=(len(made.block.image_points), 2)) * 0.005).tolist(),
            strict=True,
        )
    ]
    control = [
        replace(row, xyz=tuple(v if v is None else v + rng.normal() * 0.15 for v in row.xyz))
        for row in made.block.control
    ]
    path = tmp_path / "block"
    write_new_block(path, made.block)
    write_image_points(path, rows)
    write_control(path, control)
    return path


def prior(capsys, folder: Path, estimator: str) -> tuple[dict, dict]:
    assert main(["adjust", str(folder), "--prior", estimator, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    return found, found["prior_estimate"]


def test_every_estimator_says_what_it_takes_for_good(folder: Path, capsys) -> None:
    known, said = prior(capsys, folder, "known")
    assert [
        said[group]["variance_factor"] for group in ("image_coordinates", "prior_knowledge")
    ] == [1, 1]
    common, said = prior(capsys, folder, "common")
    factor = said["prior_knowledge"]["variance_factor"]
    assert factor == said["image_coordinates"]["variance_factor"]
    assert factor == pytest.approx(common["sigma0"] ** 2)
    for one, other in zip(known["points"], common["points"], strict=True):
        assert one["X"] == pytest.approx(other["X"])
        assert other["sX"] == pytest.approx(one["sX"] * common["sigma0"])
    separate, said = prior(capsys, folder, "separate")
    low, high = said["prior_knowledge"]["variance_factor_interval"]
    assert low < 9.0 < high
    low, high = said["image_coordinates"]["variance_factor_interval"]
    assert low < 1.0 < high
    assert said["converged"]
    assert separate["sigma0"] == pytest.approx(1.0, abs=1e-5)
    assert said["image_coordinates"]["observations"] == 2 * len(separate["image_points"])


def test_the_report_shows_both_groups(folder: Path, capsys) -> None:
    assert main(["adjust", str(folder), "--prior", "separate"]) == 0
    text = capsys.readouterr().out
    assert "PRIOR KNOWLEDGE, separate unknown variance factors" in text
    assert "\n  image coordinates  " in text
    assert "\n  prior knowledge    " in text


def test_what_does_not_go(folder: Path, capsys) -> None:
    call = ["adjust", str(folder), "--prior", "separate"]
    assert main([*call, "--components"]) == 2
    assert "one of them" in capsys.readouterr().err
    lines = (folder / "control.csv").read_text().replace(",0.05", ",0").splitlines()
    (folder / "control.csv").write_text("\n".join(lines) + "\n")
    assert main(call) == 2
    err = capsys.readouterr().err
    assert "nothing is known beforehand" in err
    assert "Traceback" not in err
