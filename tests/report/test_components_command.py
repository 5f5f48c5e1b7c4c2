"""`adjust --components` as a user calls it."""

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
    """A block whose x has twice, and whose y half, the noise that it states."""
    made = plan_block(BlockPlan(3, 5, 0.60, 0.60, 5, control_m=0.05))
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(len(made.block.image_points), 2)) * (0.010, 0.0025)
    rows = [
        replace(row, x=row.x + dx, y=row.y + dy)
        for row, (dx, dy) in zip(made.block.image_points, noise.tolist(), strict=True)
    ]
    path = tmp_path / "block"
    write_new_block(path, made.block)
    write_image_points(path, rows)
    write_control(path, made.block.control)
    return path


def components(capsys, *call: str) -> dict[str, dict]:
    assert main([*call, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["components"]
    return {row["group"]: row for row in found["groups"]}


def test_axes_find_both_sigmas(folder: Path, capsys) -> None:
    found = components(capsys, "adjust", str(folder), "--components")
    assert found["image x"]["variance_factor"] == pytest.approx(4.0, rel=0.25)
    assert found["image y"]["variance_factor"] == pytest.approx(0.25, rel=0.25)
    for row, sigma in ((found["image x"], 2.0), (found["image y"], 0.5)):
        low, high = row["sigma_factor_interval"]
        assert low < sigma < high
        assert row["variance_factor_interval"] == pytest.approx([low**2, high**2])
        assert row["vtpv"] / row["redundancy"] == pytest.approx(row["variance_factor"], rel=1e-4)
    assert main(["adjust", str(folder), "--components", "strips"]) == 0
    text = capsys.readouterr().out
    assert "VARIANCE COMPONENTS, by strips" in text
    assert "from, to (95 %)" in text


def test_operators_come_from_a_file(folder: Path, tmp_path: Path, capsys) -> None:
    who = tmp_path / "who.csv"
    who.write_text("photo,operator\n" + "".join(f"{p},anna\n" for p in (101, 102, 103)))
    call = ["adjust", str(folder), "--components", "operators"]
    found = components(capsys, *call, "--operators", str(who))
    assert set(found) >= {"operator anna", "(no operator)"}
    for wrong, text, said in (
        (call, None, "--components operators and --operators FILE go together"),
        ([*call[:2], "--operators", str(who)], None, "go together"),
        ([*call, "--operators", str(who)], "photo,operator\n101,a\n101,b\n", "line 3"),
        (
            [*call, "--operators", str(who)],
            "photo,operator\n101,b\n999,a\n",
            "who.csv line 3: photo: unknown photo '999'",
        ),
        ([*call, "--operators", str(who)], "photo,operator\n", "who.csv: no rows"),
        ([*call, "--operators", str(who)], "photo\n101\n", "operator"),
        ([*call, "--operators", str(who)], "photo,operator\n101,\n", "line 2"),
    ):
        if text is not None:
            who.write_text(text)
        assert main(wrong) == 2
        assert said in capsys.readouterr().err
