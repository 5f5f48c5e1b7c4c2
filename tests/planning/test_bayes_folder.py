"""The block of the Bayesian paper as a folder: what `adjust` finds there is the simulation's."""

from __future__ import annotations

import json
from dataclasses import replace
from math import sqrt
from pathlib import Path

import numpy as np
import pytest

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block
from anaplot.planning import tiltedscenarios
from anaplot.planning.bayesblock import bayes_block
from anaplot.planning.bayesfolder import bayes_folder
from anaplot.planning.bayesscenarios import bayes_run, scenarios
from anaplot.planning.montecarlo import simulate

GROUPS = {scenario.name: scenario for scenario in scenarios()}


def names_of(run, numbers):
    return {run.rows[k] for k in numbers}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("bayes-G1A", 1), ("bayes-G4B", 5), ("bayes-G3B", 1)])
def test_adjust_rejects_without_control_what_the_simulation_does(name: str, seed: int) -> None:
    run = bayes_run(GROUPS[name], seed=seed, methods=("baarda", "search", "rms"))
    assert run is not None
    assert len(run.planted) == {"A": 2, "B": 6}[name[-1]]
    for strategy, rows in run.rejected.items():
        steps = clean_control_last(run.block, strategy)
        assert steps.datum == "priors"
        found = {(row.name[1], row.name[2], row.name[4]) for row in steps.images.rejected}
        assert found == names_of(run, rows)
        assert found


def test_the_first_run_is_that_of_the_simulation() -> None:
    scenario = GROUPS["bayes-G3B"]
    run = bayes_run(scenario, seed=7, methods=("baarda",))
    assert run is not None
    drawn = []

    class Listening:
        """A geometry of which one hears what the simulation draws and finds."""

        def __init__(self) -> None:
            self._geometry = scenario.geometry()
            self.near = self._geometry.near

        def planted(self, rng, runs, case):
            drawn.append(self._geometry.planted(rng, runs, case))
            return drawn[-1]

        def rejected(self, errors, methods, alpha):
            drawn.append(dict(self._geometry.rejected(errors, methods, alpha)))
            return drawn[-1].items()

    simulated = replace(scenario, geometry=Listening)
    simulate(simulated, runs=3 * scenario.chunk, seed=7, methods=("baarda",))
    (errors, planted), found, *later = drawn
    assert len(errors) == scenario.chunk
    assert len(later) == 4
    assert run.planted == tuple(np.flatnonzero(planted[0]).tolist())
    assert run.rejected["baarda"] == tuple(np.flatnonzero(found["baarda"][0]).tolist())
    assert run.block.image_points == bayes_folder("bayes-G3B", 100.0, errors[0]).image_points
    other = tiltedscenarios.scenarios()[0]
    assert bayes_run(other, seed=7, methods=()) is None


@pytest.mark.parametrize("variance", [10.0, 100.0])
def test_redundancy_numbers_are_those_of_the_linearised_block(variance: float) -> None:
    name = {10.0: "bayes-G0A", 100.0: "bayes-G0B"}[variance]
    run = bayes_run(GROUPS[name], seed=1, methods=())
    assert run is not None
    assert run.planted == ()
    control = tuple(row for row in run.block.control if row.use == "check")
    found = adjust_block(replace(run.block, control=control))
    # 156 image coordinates; priors of 75 coordinates and 60 orientations
    assert (found.problem.observations, found.problem.unknowns) == (291, 135)
    problem = found.problem
    order = {
        (problem.photos[p], problem.points[q]): k
        for k, (p, q) in enumerate(zip(problem.photo, problem.point, strict=True))
    }
    r = [
        found.cofactors.r[order[photo, point], "xy".index(axis)] for photo, point, axis in run.rows
    ]
    np.testing.assert_allclose(r, np.diag(bayes_block(variance).matrix), atol=2e-3)
    assert {row.sigma for row in run.block.priors} == {(sqrt(variance),) * 3}


def test_the_command_writes_a_block(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "g"
    call = ["plan", "simulate", "bayes-G3A", "--to-block", str(folder), "--seed", "2"]
    assert main([*call, "--strategy", "baarda", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert len(answer["planted"]) == 2
    assert list(answer["rejected"]) == ["baarda"]
    block = read_block(folder)
    run = bayes_run(GROUPS["bayes-G3A"], seed=2, methods=())
    assert run is not None
    assert block.image_points == run.block.image_points
    assert (block.control, block.priors) == (run.block.control, run.block.priors)
    assert len(block.priors) == 25
    assert [row.point for row in block.control if row.use == "control"] == ["11", "15", "51", "55"]
    assert main([*call, "--strategy", "baarda"]) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["block.toml", "image_points.csv", "control.csv"])
@pytest.mark.parametrize(
    "call",
    [
        ["simulate", "bayes-G0A", "--strategy", "baarda", "--to-block"],
        ["block", "--strips", "1", "--photos", "3", "--stabilize", "0", "--to"],
    ],
)
def test_a_file_that_is_there_stays_and_no_half_block_is_left(
    tmp_path: Path, capsys, name: str, call: list[str]
) -> None:
    (tmp_path / name).write_text("mine\n")
    assert main(["plan", *call, str(tmp_path)]) == 2
    assert f"{name}: exists already and is not overwritten" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine\n"


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["network-nothing"], "is no block of the Bayesian paper"),
        (
            ["bayes-tables"],
            "'bayes-tables' is no block of the Bayesian paper (bayes-G0A to bayes-G4C)\n",
        ),
        (["bayes-G3A", "--runs", "3"], "--runs goes without --to-block"),
        (["bayes-G3A", "--list"], "--list goes without --to-block"),
        (["bayes-G3A", "--processes", "2"], "--processes goes without --to-block"),
        (["bayes-G3A", "--tie-variance", "paper"], "--tie-variance goes without --to-block"),
        (["bayes-G3A", "--base", "80"], "--base goes without --to-block"),
        (["bayes-G3A", "--strategy", "bard"], "has no method"),
    ],
)
def test_what_cannot_be_written_is_said(tmp_path: Path, capsys, more, words) -> None:
    assert main(["plan", "simulate", *more, "--to-block", str(tmp_path / "g")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "g").exists()
