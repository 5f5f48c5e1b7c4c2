"""Blocks re-weighted and cleaned place by place: as one by one, and without a column."""

from __future__ import annotations

import numpy as np
import pytest
from bundleblocks import aerial
from test_cleaned_apart import CRITICAL, mismatched, scenes, spoiled

from anaplot.adjustment import strategies
from anaplot.adjustment.findings import SearchSettings
from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.errors import blockrows
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.residuals import BlockResiduals

SETTINGS = SearchSettings(alpha=0.001)


def adjusted(scene):
    problem = make_problem(scene.block)
    return adjust_bundle(problem, scene.start(problem))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strategy", "kind", "seed"),
    [
        ("huber", "aerial", 1),
        ("huber", "tilted", 3),
        ("huber", "stated", 6),
        ("danish", "aerial", 1),
        ("danish", "tilted", 2),
        ("danish", "stated", 4),
    ],
)
def test_apart_is_as_one(monkeypatch, strategy: str, kind: str, seed: int) -> None:
    block = adjusted(spoiled(scenes()[kind], seed, 4 + seed % 5))
    one = block_gross_errors(block, strategy, SETTINGS)
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    apart = block_gross_errors(block, strategy, SETTINGS)
    assert {row.name for row in apart.rejected} == {row.name for row in one.rejected}
    errors = {row.name: row for row in one.rejected}
    for row in apart.rejected:
        assert row.error == pytest.approx(errors[row.name].error, rel=1e-7)
        assert row.sigma == pytest.approx(errors[row.name].sigma, rel=1e-7)
    end, other = apart.findings.at_end, one.findings.at_end
    assert end.vtpv == pytest.approx(other.vtpv, rel=1e-9)
    if strategy == "huber":  # Danish weights stand still in more than one place
        assert end.weights == pytest.approx(other.weights, abs=1e-4)
    assert [row.weight for row in apart.rejected] == [
        end.weights[row.row] for row in apart.rejected
    ]
    assert apart.block.sigma0 == pytest.approx(one.block.sigma0, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["huber", "danish"])
@pytest.mark.parametrize(("seed", "count"), [(1, 6), (3, 9), (8, 8)])
def test_mismatches_go_without_a_column_of_the_block(
    monkeypatch, strategy: str, seed: int, count: int
) -> None:
    scene = aerial(3, 6, per_base=3, control_sigma=0.05, noise_um=5.0, seed=seed)
    block = adjusted(mismatched(scene, seed, count))
    assert block.sigma0 > 4.0
    one = block_gross_errors(block, strategy, SETTINGS)
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    monkeypatch.setattr(strategies, "MOST_IN_COLUMNS", 0)
    asked: list[int] = []
    monkeypatch.setattr(BlockResiduals, "columns", lambda self, rows: asked.append(len(rows)))
    apart = block_gross_errors(block, strategy, SETTINGS)
    assert not asked
    assert len(apart.rejected) >= count
    # no worse an end, by v'Pv and the price of what is out
    assert apart.end.score <= one.end.score + 2.0 * CRITICAL**2
    # what is out is beyond its limit, given all that is out
    end, rows = apart.findings.at_end, list(apart.findings.rows)
    assert np.all(np.abs(end.w[rows]) >= CRITICAL)
    assert all(row.weight is not None for row in apart.rejected)
    # each has a step of its own in the last pass, beyond the limit by its weighted adjustment
    assert all(row.statistic > row.critical for row in apart.rejected)


@pytest.mark.parametrize("strategy", ["huber", "danish"])
def test_where_nothing_is_far_off_nothing_goes(monkeypatch, strategy: str) -> None:
    block = adjusted(aerial(2, 5, per_base=2, control_sigma=0.05, noise_um=3.5))
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    found = block_gross_errors(block, strategy, SETTINGS)
    assert not found.rejected
    assert len(found.passes) == 1
    assert not any(step.action == "reject" for step in found.findings.steps)
