"""The precision of pointing from models and repeated pointing: known truths come back."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri

from anaplot.cli import main
from anaplot.orientation.strip import bridge, pooled_sigma_um
from anaplot.photogrammetry.block import Block, ControlPoint, ImagePoint
from anaplot.planning.synthetic import synthetic_strip
from anaplot.session.pointings import Pointed, Pointings, Run
from anaplot.session.state import start
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.demo import Demo
from anaplot.station.pointing import pointing_of, read_pointing
from anaplot.station.repeatedpointing import repeated_pointing
from anaplot.station.replay import replay_session

BEGIN = datetime(2026, 5, 4, 8, 0, tzinfo=UTC)
SIGMA = 4.0


def strip(seed: int, photos: int = 9, late: float = 1.0) -> Block:
    """A strip measured with 5 um; in its second half with `late` times as much."""
    made = synthetic_strip(photos, seed=seed)
    rng = np.random.default_rng([seed, 77])
    rows = []
    models = made.block.strips[0].models()
    for k, (left, right) in enumerate(models):
        half = k >= len(models) // 2
        for photo in (left, right):
            for point, (x, y) in made.truth[photo].items():
                if point in made.truth[left] and point in made.truth[right]:
                    dx, dy = rng.normal(0.0, 0.005 * (late if half else 1.0), 2)
                    rows.append(ImagePoint(photo, point, x + dx, y + dy, model=f"{left}/{right}"))
    return replace(made.block, image_points=tuple(rows))


def timed(block: Block, hours: float, who: tuple[str, ...] = ("ann",)) -> Pointings:
    """Every model measured at its time of a working day, by one after the other."""
    models = block.strips[0].models()
    times = {
        f"{left}/{right}": (
            who[k * len(who) // len(models)],
            (BEGIN + timedelta(hours=hours * k / (len(models) - 1))).isoformat(),
        )
        for k, (left, right) in enumerate(models)
    }
    measured = {
        (*row.model.split("/"), row.point): Pointed(*times[row.model])
        for row in block.image_points
        if row.model is not None
    }
    return Pointings(start(block), measured)  # type: ignore[arg-type]


def groups(found, group: str):
    return {one.name: one for one in found.pooled if one.group == group}


def test_the_pooled_sigma_is_that_of_the_models() -> None:
    block = strip(1)
    block = replace(block, control=(ControlPoint("103-2", (0.0, 0.0, 0.0)),))
    found = pointing_of(block, timed(block, 7.0, ("ann", "bob")))
    models = bridge(block)[0].models
    whole = groups(found, "all")[""]
    assert whole.sigma.um == pytest.approx(pooled_sigma_um(models))
    assert whole.redundancy == whole.sigma.degrees == sum(m.redundancy for m in models)
    assert whole.sigma.holds(5.0)
    assert groups(found, "strip")["1"].sigma == whole.sigma
    operators = groups(found, "operator")
    assert set(operators) == {"ann", "bob"}
    assert sum(one.redundancy for one in operators.values()) == pytest.approx(whole.redundancy)
    kinds = groups(found, "kind")
    assert set(kinds) == {"new", "tie", "control"}
    assert sum(one.rows for one in kinds.values()) == whole.rows
    assert sum(one.redundancy for one in kinds.values()) == pytest.approx(whole.redundancy)
    assert [test.group for test in found.tests] == ["operator"]
    # without a journal nobody is named, and nothing is said of days
    alone = pointing_of(block, None)
    assert groups(alone, "all")[""] == whole
    assert groups(alone, "operator") == {}
    assert alone.drift == ()


def test_an_operator_who_points_worse_is_told_from_the_other() -> None:
    block = strip(2, late=2.5)
    found = pointing_of(block, timed(block, 7.0, ("ann", "bob")))
    (test,) = found.tests
    assert test.differ
    assert test.test.kind == "F"
    operators = groups(found, "operator")
    assert operators["ann"].sigma.holds(5.0)
    assert not operators["bob"].sigma.holds(5.0)


def test_nothing_drifts_where_nothing_does_as_often_as_is_said() -> None:
    runs, py, x, f = 60, [], [], []
    for seed in range(runs):
        block = strip(100 + seed, photos=7)
        (day,) = pointing_of(block, timed(block, 2.5)).drift
        assert day.test is not None
        f.append(day.test.probability)
        by_axis = {shift.axis: shift.probability for shift in day.shifts}
        py.append(by_axis["y"])
        x.append(by_axis["x"])
    for probabilities in (f, py, x):
        # binomial of 60 at .2: mean 12, standard deviation 3.1; four of them
        few = sum(one < 0.2 for one in probabilities)
        assert abs(few - 0.2 * runs) < 4.0 * sqrt(0.2 * 0.8 * runs)


def test_a_hand_that_tires_is_found() -> None:
    tired = strip(3, photos=11, late=2.5)
    (day,) = pointing_of(tired, timed(tired, 3.0)).drift
    assert (day.day, day.who) == (BEGIN.astimezone().date().isoformat(), "ann")
    assert day.test is not None
    assert day.test.probability < 0.01
    assert day.drifts
    short = strip(3, photos=5)
    (hour,) = pointing_of(short, timed(short, 1.5)).drift
    assert (hour.test, hour.shifts, hour.drifts) == (None, (), False)
    assert hour.why == "90 minutes of work: no first and last hour"


def run_of(rng, point: str, n: int, share: float = 0.0) -> Run:
    """n pointings of 4 um at a point; of the error of the one before a share stays."""
    at, error = rng.uniform(-80.0, 80.0, 4), rng.normal(0.0, SIGMA, 4)
    places = []
    for _ in range(n):
        places.append(tuple(map(tuple, (at + 1e-3 * error).reshape(2, 2).tolist())))
        fresh = rng.normal(0.0, SIGMA, 4)
        error = share * error + sqrt(1.0 - share**2) * fresh
    return Run("1/2", point, False, "tie", "ann", places)


def test_a_known_sigma_comes_back_from_repeated_pointing() -> None:
    seeds, points, n = 200, 4, 6
    total, held = 0.0, 0
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 5])
        ((one,), offer, pointings) = repeated_pointing(
            [run_of(rng, str(k), n) for k in range(points)], set()
        )
        assert (one.points, one.pointings, pointings) == (points, 24, 24)
        assert offer is not None
        assert one.sigma == offer
        total += offer.um**2 * one.degrees * 4
        held += offer.holds(SIGMA)
        # px and py are differences of two independent coordinates
        assert one.px_um is not None
        assert 0.3 < one.px_um / SIGMA / sqrt(2.0) < 1.7
    degrees = seeds * points * (n - 1) * 4
    low, high = chdtri(degrees, [0.9995, 0.0005]).tolist()
    assert low < total / SIGMA**2 < high
    # intervals may be a little wide, for degrees of freedom are estimated; never narrow
    assert held >= 0.95 * seeds - 4.0 * sqrt(0.95 * 0.05 * seeds)


def test_a_mark_that_does_not_move_away_gives_itself_away() -> None:
    rng = np.random.default_rng(8)
    runs = [run_of(rng, str(k), 6, share=0.95) for k in range(4)]
    block = strip(4)
    found = pointing_of(block, replace(timed(block, 7.0), runs=tuple(runs)))
    honest = [run_of(rng, str(k), 6) for k in range(4)]
    truly = pointing_of(block, replace(timed(block, 7.0), runs=tuple(honest)))
    assert found.offer is not None
    assert truly.offer is not None
    assert not found.offer.holds(SIGMA)
    assert truly.offer.holds(SIGMA)
    assert found.against_models is not None
    assert found.against_models.probability < 0.01


def test_kinds_operators_and_single_pointings_are_kept_apart() -> None:
    rng = np.random.default_rng(9)
    tie, control, lonely = (run_of(rng, name, n) for name, n in (("7", 4), ("K", 3), ("9", 1)))
    mono = Run("1/2", "1", True, "", "bob", [((1.0, 2.0),), ((1.004, 2.0),)], unmoved=2)
    found, offer, pointings = repeated_pointing([tie, control, lonely, mono], {"K"})
    assert [(one.who, one.kind, one.pointings, one.unmoved) for one in found] == [
        ("ann", "control", 3, 0),
        ("ann", "tie", 4, 0),
        ("bob", "fiducial", 2, 2),
    ]
    assert pointings == 7
    assert offer is not None
    fiducial = found[2]
    assert (fiducial.px_um, fiducial.py_um) == (None, None)
    assert fiducial.x_um == pytest.approx(4.0 / sqrt(2.0))
    assert fiducial.y_um == 0.0
    # one pointing says nothing
    ((alone,), nothing, none) = repeated_pointing([lonely], set())
    assert (alone.points, alone.sigma, nothing, none) == (0, None, None, 0)


@pytest.mark.usefixtures("without_block")
def test_the_simulated_operator_gives_his_sigma_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # one model, to which he does not return: what he repeats is measured already
    demo, folder = Demo.make(1, 5, fiducials=True), tmp_path / "block"
    demo.write(folder)
    with demo.open(folder, time_scale=2000.0) as station:
        AutomaticOperator(station, repeats=5).run()
    replayed = replay_session(folder)
    assert replayed.differences == ()
    found = read_pointing(folder)
    assert {(one.kind, one.points, one.pointings) for one in found.repeated} == {
        ("new", 1, 6),
        ("fiducial", 2, 12),
    }
    for one in found.repeated:
        # both of sigma 5 um: chi-square of all coordinates, 1 in 1000 outside
        assert one.sigma is not None
        degrees = one.degrees * (2 if one.kind == "fiducial" else 4)
        low, high = chdtri(degrees, [0.9995, 0.0005]).tolist()
        assert low < one.sigma.um**2 / 5.0**2 * degrees < high
    # what was repeated is in no model: the same measurements without
    plain = tmp_path / "plain"
    demo.write(plain)
    with demo.open(plain, time_scale=2000.0) as station:
        AutomaticOperator(station).run()
    rows = (folder / "image_points.csv").read_text()
    assert rows == (plain / "image_points.csv").read_text()
    assert main(["pointing", str(folder), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["offer"]["pointings"] == 6
    assert (answer["offer"]["line"] is None) == answer["offer"]["agrees"]
    assert main(["pointing", str(folder / "sessions")]) == 0
    text = capsys.readouterr().out
    assert "block.toml has sigma 5" in text
