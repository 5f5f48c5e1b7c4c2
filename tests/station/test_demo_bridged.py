"""`bridge` of a block that was measured gives the tables of the console, to the last digit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.orientation.strip import bridge_strip
from anaplot.session.models import solve
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState
from anaplot.simulation.demo import Demo, run_demo
from anaplot.station.imagepoints import rows_of
from anaplot.station.replay import replay_session

pytestmark = pytest.mark.usefixtures("without_block")


def assert_bridged(folder: Path, state: SessionState) -> None:
    block = read_block(folder)
    [strip] = [bridge_strip(block, strip) for strip in block.strips]
    assert len(strip.models) == len(state.models)
    for model, again in zip(state.models, strip.models, strict=True):
        solution = solve(state, model)
        assert again.listed == solution.listed
        assert {row.key for row in again.off_rows} == model.off
        assert (again.points, again.sigma0_um) == (solution.points, solution.sigma0_um)


def switched(models: tuple[ModelState, ...], seed: int) -> tuple[ModelState, ...]:
    """Return models with rows off: x of a tie, y of another, and a point that nobody else needs."""
    rng = np.random.default_rng(seed)
    out = []
    for k, model in enumerate(models):
        following = {m.point for m in models[k + 1].measured} if k + 1 < len(models) else set()
        ties = [m.point for m in model.measured if len(model.axes(m.point)) == 2]
        free = [m.point for m in model.measured if m.point not in following]
        off = {(name, axis) for name in rng.choice(free, 1) for axis in model.axes(name)}
        chosen = rng.choice(ties, 2, replace=False) if ties else ()
        off |= {(name, axis) for name, axis in zip(chosen, "xy", strict=False)}
        out.append(replace(model, off=frozenset((str(name), axis) for name, axis in off)))
    return tuple(out)


def check_seed(seed: int, folder: Path) -> None:
    demo = Demo.make(4, seed)
    demo.write(folder)
    run_demo(demo, folder, 5000.0)
    replayed = replay_session(folder)
    assert replayed.differences == ()
    assert_bridged(folder, replayed.state)
    state = replace(replayed.state, models=switched(replayed.state.models, seed))
    write_image_points(folder, rows_of(state.models))
    assert_bridged(folder, state)


@pytest.mark.parametrize("seed", [1, 7])
def test_a_measured_demo(seed: int, tmp_path: Path) -> None:
    check_seed(seed, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("tens", range(5))
def test_ten_measured_demos(tens: int, tmp_path: Path) -> None:
    for seed in range(1 + 10 * tens, 11 + 10 * tens):
        check_seed(seed, tmp_path / str(seed))
