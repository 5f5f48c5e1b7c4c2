"""Movements of small objects are shown with the decimals that their deviations ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from epochblocks import epoch, written

import anaplot
from anaplot.cli import main
from anaplot.photogrammetry.block import Block
from anaplot.report.movementdecimals import movement_decimals

SMALL = 1e-5  # of 1200 m, so that displacements are known to a micrometre or less


def shrunk(block: Block) -> Block:
    def less(values):
        return tuple(None if value is None else value * SMALL for value in values)

    control = tuple(replace(row, xyz=less(row.xyz), sigma=less(row.sigma)) for row in block.control)
    return replace(block, control=control)


@pytest.mark.parametrize("count", [2, 3])
def test_a_page_of_a_small_object_shows_its_movements(count) -> None:
    large = [epoch(11 + k) for k in range(count)]
    blocks = [shrunk(block) for block in large]
    found = anaplot.compare(*blocks, points="p8")
    of = found.result.series if count > 2 else found.result.differences
    s = 1e3 * np.sqrt(np.median(np.diag(of.cofactors)))
    decimals = movement_decimals(of)
    assert 10.0 ** (1 - decimals) <= s < 10.0 ** (2 - decimals)
    rows = [line.split() for line in found.text().splitlines() if line.startswith("  p8 ")]
    shown = rows[-1][2 if count > 2 else 1]
    assert len(shown.partition(".")[2]) == decimals
    assert float(shown) != 0.0
    # what is as large as ever is shown as ever
    usual = anaplot.compare(*large, points="p8").result
    assert movement_decimals(usual.series if count > 2 else usual.differences) == 2


def test_its_report_as_well(tmp_path, capsys) -> None:
    moved = {"p8": (0.0, 0.5, 1.5)}
    blocks = [shrunk(epoch(11)), shrunk(epoch(12, moved=moved))]
    folders = written(tmp_path, *blocks)[:2]
    path = tmp_path / "page.html"
    assert main(["compare", *folders, "--report", str(path)]) == 0
    capsys.readouterr()
    page = path.read_text(encoding="utf-8")
    assert "p8</bdi> by 0.0" in page
    for nothing in ("by 0.0 mm", "deviations of 0.0 mm", "largest 0.0 mm", "from 0.0 mm on"):
        assert nothing not in page
