"""Twenty strips measured through the real link: what was planted, found, repaired and missed.

`bridge` of each, and of each with rows off, gives the tables of the console to the last digit.
"""

from __future__ import annotations

import json
from dataclasses import replace
from math import exp, sqrt
from pathlib import Path

import numpy as np
import pytest

from anaplot.adjustment.significance import noncentrality
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.orientation.model import orient
from anaplot.orientation.patterns import pattern
from anaplot.orientation.strip import bridge_strip, stereopair
from anaplot.planning.modelplan import plan_positions
from anaplot.report.democommand import demo_document
from anaplot.session.models import solve
from anaplot.session.modelstate import ModelState
from anaplot.session.state import SessionState
from anaplot.simulation.demo import DEFAULT_MODELS, DEFAULT_SEED, Demo, Outcome, run_demo
from anaplot.simulation.mistakes import SMALLEST, Planted
from anaplot.station.imagepoints import rows_of
from anaplot.station.replay import replay_session

MODELS = 4


def run(demo: Demo, folder: Path, time_scale: float = 5000.0) -> Outcome:
    demo.write(folder)
    return run_demo(demo, folder, time_scale)


def standardized(demo: Demo) -> dict[tuple[str, str, str], float]:
    """Return how many sigma0 sqrt(q/r) each detectable mistake is large."""
    block, truth = demo.strip.block, demo.strip.truth
    sigma_um = block.precision.image_um
    before = None
    measured: dict[str, tuple[float, float]] = {}
    out = {}
    for left, right in block.strips[0].models():
        used = {p.point for p in demo.plot.planted if p.model == f"{left}/{right}"}
        plan = plan_positions(
            block,
            (left, right),
            pattern("13"),
            nominal_base=block.strips[0].base,
            preceding=measured,
            candidates=demo.candidates,
        )
        names = sorted({p.point for p in plan})
        measured = {name: truth[right][name] for name in names}
        pair = stereopair(
            (left, right),
            {n: truth[left][n] for n in names},
            {n: truth[right][n] for n in names},
            (block.camera_of(left), block.camera_of(right)),
            preceding=before,
            base=block.strips[0].base,
        )
        before = orient(pair, block.precision, block.test)
        rows = zip(before.table, before.q_l.tolist(), strict=True)
        unit = {row.key: sigma_um * sqrt(q / row.r) for row, q in rows}
        assert used <= set(names)
        for p in demo.plot.planted:
            if p.model == f"{left}/{right}" and p.detectable:
                out[p.model, p.point, p.axis] = abs(p.size_um) / unit[p.point, p.axis]
    return out


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


def assert_bridged_alike(folder: Path, seed: int) -> None:
    replayed = replay_session(folder)
    assert replayed.differences == ()
    assert_bridged(folder, replayed.state)
    state = replace(replayed.state, models=switched(replayed.state.models, seed))
    write_image_points(folder, rows_of(state.models))
    assert_bridged(folder, state)


def missing_power(deviations: float, alpha: float) -> float:
    """Return the probability that the normal test misses an error of so many deviations."""
    from scipy.special import ndtr, ndtri

    critical = -ndtri(alpha / 2.0)
    return float(ndtr(critical - deviations))


def test_the_power_is_that_of_the_normal_test() -> None:
    # conventions: 0.001 and 0.80 give 4.132
    assert noncentrality(0.001, 0.80) == pytest.approx(4.132, abs=5e-4)
    assert missing_power(noncentrality(0.001, 0.80), 0.001) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.long
@pytest.mark.usefixtures("without_block")
@pytest.mark.parametrize("tens", range(2))
def test_ten_seeds_counted_and_bridged(tmp_path: Path, tens: int) -> None:
    predicted_missed = 0.0
    missed: list[tuple[int, Planted]] = []
    false_flags = rows = detectable = 0
    for seed in range(1 + 10 * tens, 11 + 10 * tens):
        demo = Demo.make(MODELS, seed)
        outcome = run(demo, tmp_path / str(seed))
        assert_bridged_alike(tmp_path / str(seed), seed)
        sizes = standardized(demo)
        alpha = demo.strip.block.test.alpha
        assert min(sizes.values()) >= SMALLEST
        predicted_missed += sum(missing_power(size, alpha) for size in sizes.values())
        wanted = [p for p in outcome.planted if p.detectable]
        # every model has one that shows and one that does not
        for record in outcome.models:
            name = f"{record.left}/{record.right}"
            kinds = [p.detectable for p in outcome.planted if p.model == name]
            assert True in kinds
            assert False in kinds
        detectable += len(wanted)
        missed += [(seed, p) for p in outcome.missed]
        missed += [(seed, p) for p in wanted if p not in outcome.repaired and p in outcome.found]
        later = [p for p in outcome.planted if not p.detectable and p.shows_in is not None]
        missed += [(seed, p) for p in later if p not in outcome.repaired]
        false_flags += len(outcome.false_flags)
        for record in outcome.models:
            assert record.before is not None
            assert record.after is not None
            assert not record.after.flagged
            rows += len(record.before.table)
    assert detectable >= 10 * MODELS
    # at least ten deviations: the normal test misses one in a hundred thousand millions
    assert predicted_missed < 1e-6
    assert not missed
    # 0.001 of the rows, twice at most as every flag is measured again; a Poisson bound of 1e-4
    expected = 2 * 0.001 * rows
    assert false_flags <= _bound(expected, 1e-4)


def _bound(mean: float, beyond: float) -> int:
    """Return the count that a Poisson variable of this mean exceeds with this probability."""
    term = total = exp(-mean)
    k = 0
    while 1.0 - total > beyond:
        k += 1
        term *= mean / k
        total += term
    return k


def test_the_default_seed_misses_none_and_accuses_nobody(tmp_path: Path) -> None:
    outcome = run(Demo.make(DEFAULT_MODELS, DEFAULT_SEED), tmp_path / "demo")
    assert outcome.missed == ()
    assert outcome.false_flags == ()
    detectable = tuple(p for p in outcome.planted if p.detectable)
    # what only a later model or the block shows is repaired where it was made, by returning there
    assert outcome.repaired == outcome.found
    assert {p.kind for p in detectable} == {
        *("gross parallax", "wrong point", "swapped pair", "x error")
    }
    # what this model cannot show is said to show in a later one, and does
    hidden = [p for p in outcome.planted if not p.detectable]
    assert {p.kind for p in hidden} == {"x error", "pair swapped alike"}
    for p in hidden:
        assert (p.shows_in is not None) == (p in outcome.repaired)
    # and nothing has to be switched off
    assert {row.key for record in outcome.models for row in record.after.off_rows} == set()
    assert all(not record.after.flagged for record in outcome.models)


def test_the_same_seed_tells_the_same_whatever_the_speed(tmp_path: Path) -> None:
    texts = []
    for k, scale in enumerate((300.0, 3000.0, 30000.0)):
        outcome = run(Demo.make(2, 6), tmp_path / str(k), scale)
        texts.append(json.dumps(demo_document(6, outcome).to_dict(), allow_nan=False))
    assert texts[0] == texts[1] == texts[2]
    other = run(Demo.make(2, 7), tmp_path / "other")
    assert json.dumps(demo_document(7, other).to_dict(), allow_nan=False) != texts[0]
    contents = {(tmp_path / str(k) / "image_points.csv").read_bytes() for k in range(3)}
    assert len(contents) == 1


def test_the_json_is_what_the_contract_says(tmp_path: Path) -> None:
    demo = Demo.make(2, 3)
    outcome = run(demo, tmp_path / "demo")
    answer = json.loads(json.dumps(demo_document(3, outcome).to_dict(), allow_nan=False))
    assert answer["seed"] == 3
    for key in ("planted", "found", "repaired", "missed", "false_flags"):
        for entry in answer[key]:
            assert entry.keys() >= {
                *("model", "point", "photo", "axis", "size_um", "kind", "detectable")
            }
            assert entry["axis"] in ("x", "y")
            assert isinstance(entry["size_um"], float)
    assert answer["planted"]
    assert [p for p in answer["found"] if p not in answer["planted"]] == []
    where = ("model", "point", "photo", "axis", "kind")
    told = {tuple(entry[key] for key in where): entry for entry in answer["stages"]}
    assert [tuple(p[key] for key in where) for p in answer["found"]] == list(told)
    for entry in told.values():
        assert entry["stage"] == entry["earliest"]
    for model in answer["models"]:
        for table in (model["before"], model["after"]):
            assert table
            for row in table:
                assert row.keys() - {"off"} == {
                    *("point", "axis", "redn", "parx_um", "expd_um", "sigf", "flagged")
                }
                assert (row["redn"] is None) == row.get("off", False)
        assert any(row["flagged"] for row in model["before"])
        assert not any(row["flagged"] for row in model["after"])


@pytest.mark.parametrize("models", [1, 7])
def test_any_number_of_models(tmp_path: Path, models: int) -> None:
    outcome = run(Demo.make(models, 2), tmp_path / "demo", 20000.0)
    assert len(outcome.models) == models
    assert outcome.missed == ()
