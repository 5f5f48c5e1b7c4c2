"""The Monte Carlo: the same whatever the processes, resumable, with honest intervals."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.runsfile import KeptChunk, KeptSums, RunsFile
from anaplot.planning import montecarlo
from anaplot.planning.modelscenarios import OneError, SizeOfTests
from anaplot.planning.montecarlo import (
    MOST_RUNS,
    ChunkDone,
    QuantityKey,
    Scenario,
    SimulatedMean,
    Sums,
    Tally,
    add,
    chunk_sizes,
    figures,
    simulate,
    sums,
)
from anaplot.planning.quantities import COUNT, YES_OR_NO
from anaplot.planning.scenarios import scenarios
from anaplot.shares.local import LocalProcesses

SMALL = OneError("small", "6/3", chunk=50, runs=220)


@pytest.mark.slow
@pytest.mark.parametrize("processes", [2, 3])
def test_the_number_of_processes_does_not_matter(processes: int) -> None:
    one = simulate(SMALL, seed=3)
    assert simulate(SMALL, seed=3, place=LocalProcesses(processes)) == one
    assert simulate(SMALL, seed=4) != one
    assert all(of.runs == 220 for of in one.values())


def test_resumed_is_undisturbed_and_does_nothing_twice() -> None:
    chunks = []
    whole = simulate(SMALL, seed=3, store=chunks.append)
    assert [chunk.number for chunk in chunks] == [0, 1, 2, 3, 4]
    more = []
    assert simulate(SMALL, seed=3, done=chunks[1:4], store=more.append) == whole
    assert [chunk.number for chunk in more] == [0, 4]
    # fewer or more runs use what is whole for them: the smaller last chunk is done again
    longer = []
    simulate(SMALL, seed=3, runs=300, done=chunks, store=longer.append)
    assert [chunk.number for chunk in longer] == [4, 5]


class Draws(NamedTuple):
    """A scenario that tells what it draws."""

    name: str = "draws"
    about: str = ""
    methods: tuple[str, ...] = ("m",)
    runs: int = 9
    chunk: int = 3
    references: Mapping[QuantityKey, float] = MappingProxyType({})

    def prepare(self) -> Draws:
        return self

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        return {("c", "m", "q"): sums(rng.random(runs))}


def test_every_chunk_draws_from_a_child_of_the_seed() -> None:
    chunks: list[ChunkDone] = []
    simulate(Draws(), seed=5, store=chunks.append)
    children = [np.random.default_rng(child) for child in np.random.SeedSequence(5).spawn(3)]
    assert [chunk.tally["c", "m", "q"] for chunk in chunks] == [
        sums(child.random(3)) for child in children
    ]


def test_many_chunks_are_thought_of_one_after_the_other(monkeypatch) -> None:
    task, made = montecarlo._Task, []

    def counted(*of: object) -> object:
        made.append(of)
        return task(*of)

    def full(chunk: ChunkDone) -> None:
        raise OSError(f"no room for chunk {chunk.number}")

    monkeypatch.setattr(montecarlo, "_Task", counted)
    with pytest.raises(OSError, match="no room for chunk 0"):
        simulate(SMALL, runs=MOST_RUNS // 10, store=full)
    assert len(made) == 1


def test_methods_of_the_scenario_only() -> None:
    assert {key[1] for key in simulate(SMALL, runs=10, methods=("tau",))} == {"tau"}
    with pytest.raises(InputError, match="has no method 'guess'; it has: baarda"):
        simulate(SMALL, methods=("guess",))
    with pytest.raises(InputError, match="0 runs"):
        simulate(SMALL, runs=0)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=30), st.integers(1, 29))
def test_sums_add_up(values: list[float], at: int) -> None:
    key = ("a", "b", "c")
    together = add({key: sums(values[:at])}, {key: sums(values[at:])})[key]
    assert together.runs == len(values)
    assert together.total == pytest.approx(sum(values), abs=1e-6)
    assert together.squares == pytest.approx(sum(v * v for v in values), abs=1e-3)


@given(st.integers(1, 10_000), st.integers(1, 999))
def test_chunks_make_up_the_runs(runs: int, chunk: int) -> None:
    sizes = chunk_sizes(runs, chunk)
    assert sum(sizes) == runs
    assert set(sizes[:-1]) <= {chunk}
    assert 0 < sizes[-1] <= chunk


def test_intervals() -> None:
    rng = np.random.default_rng(5)
    counts = rng.poisson(3.0, 400)
    mean, rate = figures(
        {("a", "m", "count"): sums(counts), ("a", "m", "rate"): sums(counts > 3)},
        {("a", "m", "count"): COUNT, ("a", "m", "rate"): YES_OR_NO},
        {("a", "m", "count"): 3.0},
    )
    assert mean.mean == pytest.approx(counts.mean())
    assert mean.high - mean.low == pytest.approx(2 * 1.96 * counts.std() / 20.0, rel=0.01)
    assert mean.reference == 3.0
    assert 0.0 < rate.low < rate.mean < rate.high < 1.0
    assert rate.reference is None
    (alone,) = figures({("a", "m", "x"): Sums(1, 2.0, 4.0)}, {("a", "m", "x"): COUNT}, {})
    assert (alone.mean, alone.low, alone.high) == (2.0, None, None)


CHUNK = KeptChunk(0, 5, (KeptSums("a", "m", "q", 5, 2.0, 4.0),))
WHAT = {"scenario": "s", "seed": 1}
LARGEST = {("a", "m", "q"): None}


def kept_in(path: Path) -> RunsFile:
    return RunsFile(path, WHAT, LARGEST, 5)


def test_the_file_keeps_and_cuts_what_was_torn(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    with kept_in(path) as file:
        file.keep(CHUNK)
    whole = path.read_bytes()
    for cut in range(len(whole)):
        path.write_bytes(whole[:cut])
        with kept_in(path) as file:
            assert file.chunks == ((CHUNK,) if cut == len(whole) else ())
            file.keep(CHUNK)
        assert path.read_bytes() == whole
    with kept_in(path) as file:
        assert file.chunks == (CHUNK,)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (b"not json\n", "line 2: not a line"),
        (b"[1]\n", "line 2: not a line"),
        (b'{"chunk":-1,"runs":5,"sums":[]}\n', "line 2: chunk: must be a whole number from 0"),
        (b'{"chunk":0,"runs":true,"sums":[]}\n', "line 2: runs: must be a whole number, not"),
        (b'{"chunk":0,"runs":5}\n', "line 2: no key 'sums'"),
        (b'{"chunk":0,"runs":5,"sum":[]}\n', r"line 2: sum: unknown key.*sums"),
        (b'{"chunk":0,"runs":5,"sums":[[1,2]]}\n', r"line 2: sums\[0\]: must hold 6 items, not 2"),
        (
            b'{"chunk":0,"runs":5,"sums":[["a","b",3,1,1,1]]}\n',
            r"line 2: sums\[0\]\[2\]: must be text, not a number",
        ),
        (
            b'{"chunk":0,"runs":6,"sums":[["a","m","q",6,1,1]]}\n',
            "runs: must be a whole number from 1 to 5",
        ),
        (
            b'{"chunk":0,"runs":5,"sums":[["a","m","q",-1,1,1]]}\n',
            "must be a whole number from 1 to 5",
        ),
        (b'{"chunk":0,"runs":5,"sums":[["a","m","q",4,1,1]]}\n', "is not the chunk's 5 runs"),
        (b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,NaN,1]]}\n', "must be a finite number"),
        (b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,1,-1]]}\n', "must be 0 or greater, not -1"),
        (b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,-1,1]]}\n', "must be 0 or greater, not -1"),
        (b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,1e308,1]]}\n', "are no sums"),
        (
            b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,1' + b"0" * 400 + b",1]]}\n",
            "must be a finite number",
        ),
        (b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,10,19]]}\n', "are no sums"),
        (b'{"chunk":0,"runs":5,"sums":[]}\n', "line 2: 0 sums, 0 of them different; this"),
        (b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,1,1],["a","m","q",5,1,1]]}\n', "2 sums, 1"),
        (
            b'{"chunk":0,"runs":5,"sums":[["a","\\u001b[31mm","q",5,1,1]]}\n',
            r"line 2: sums of 'a', '\\x1b\[31mm', 'q', which is not in this simulation",
        ),
        (b"[" * 100_000 + b"\n", "line 2: not a line"),
        (b"\xff\xfe\n", "line 2: not a line"),
    ],
)
def test_a_damaged_file_is_refused_by_its_line(tmp_path: Path, line: bytes, said: str) -> None:
    path = tmp_path / "runs.jsonl"
    with kept_in(path):
        pass
    path.write_bytes(path.read_bytes() + line)
    before = path.read_bytes()
    with pytest.raises(InputError, match=said):
        kept_in(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("data", [b"precious", b'{"format":2', b"\0"])
def test_a_foreign_file_is_not_overwritten(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "pr.csv"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"pr\.csv line 1: not a simulation's file"):
        kept_in(path)
    assert path.read_bytes() == data


def test_sums_beyond_the_largest_value_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    largest = {("a", "m", "q"): 1.0}
    with RunsFile(path, WHAT, largest, 5) as file:
        file.keep(KeptChunk(0, 5, (KeptSums("a", "m", "q", 5, 2.0, 2.0),)))
    head = path.read_bytes().splitlines(keepends=True)[0]
    with RunsFile(path, WHAT, largest, 5) as file:
        assert len(file.chunks) == 1
    for sums_of in (b"6,6", b"2,4"):
        path.write_bytes(head + b'{"chunk":0,"runs":5,"sums":[["a","m","q",5,%s]]}\n' % sums_of)
        with pytest.raises(InputError, match=r"line 2: .* are no sums"):
            RunsFile(path, WHAT, largest, 5)


def test_only_regular_files_keep_runs(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, what in ((tmp_path / "pipe", "not a regular file"), (tmp_path, "a folder, not a")):
        with pytest.raises(InputError, match=what):
            kept_in(path)


def test_a_file_of_another_simulation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    with kept_in(path):
        pass
    with pytest.raises(InputError, match="line 1: belongs to another simulation: seed is 1"):
        RunsFile(path, {**WHAT, "seed": 2}, LARGEST, 5)
    path.write_bytes(b"x" * 100 + b"\n")
    with pytest.raises(InputError, match="line 1"):
        kept_in(path)


def shown(scenario: Scenario, tally: Tally, confidence: float = 0.95) -> tuple[SimulatedMean, ...]:
    """Return the figures of all methods of a scenario."""
    quantities = scenario.prepare().quantities(scenario.methods)
    return figures(tally, quantities, scenario.references, confidence)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.slow) if n == "strategies-tilted" else n
        for n in scenarios()
    ],
)
def test_every_scenario_says_what_it_counts(name: str) -> None:
    scenario = scenarios()[name]
    methods = tuple(m for m in scenario.methods if m not in ("search", "odds", "sure"))
    trial = scenario.prepare()
    tally = trial.run(np.random.default_rng(3), 2, methods)
    quantities = trial.quantities(methods)
    assert set(tally) == set(quantities)
    for key, (top, parts) in quantities.items():
        count = tally[key]
        assert count.runs == 2
        assert top is None or 0.0 <= count.total <= 2 * top
        if top:  # values of so many answers
            assert count.total / top * parts == pytest.approx(round(count.total / top * parts))
        assert count.total**2 <= 2 * count.squares * (1 + 1e-12)


@pytest.mark.slow
def test_errors_are_located_as_often_as_found_independently() -> None:
    for name in ("kratky-1983-6-3", "kratky-1983-9-3", "kratky-1983-13-5"):
        scenario = scenarios()[name]
        for figure in shown(scenario, simulate(scenario, runs=4000, seed=1)):
            if figure.reference is not None:
                assert figure.mean == pytest.approx(figure.reference, abs=0.05)


def test_larger_errors_and_better_patterns_are_found_more_often() -> None:
    known = scenarios()
    poor, good = (simulate(known[f"kratky-1983-{p}"], runs=3000) for p in ("9-3", "13-5"))
    for method in ("baarda", "tau"):
        rates = [poor[f"{k} sigma", method, "right"].total for k in (6, 10, 20)]
        assert rates == sorted(rates)
        assert poor["6 sigma", method, "right"].total < good["6 sigma", method, "right"].total
    key = ("10 sigma", "baarda")
    parts = [poor[(*key, quantity)].total for quantity in ("right", "wrong", "missed")]
    assert sum(parts) == 3000


def test_size_and_power_are_the_predicted_ones() -> None:
    scenario = SizeOfTests(patterns=("9/3", "13/5"))
    found = shown(scenario, simulate(scenario, runs=40_000, seed=7), 0.9999)
    assert {figure.quantity for figure in found} == {"size", "power"}
    for figure in found:
        assert figure.reference is not None
        assert figure.low <= figure.reference <= figure.high


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept, table = tmp_path / "kept.jsonl", tmp_path / "table.csv"
    call = ["plan", "simulate", "kratky-1983-6-3", "--runs", "300", "--processes", "1"]
    assert main([*call, "--json", "--to", str(kept), "--csv", str(table)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["scenario"] == "kratky-1983-6-3"
    assert {f["method"] for f in answer["figures"]} == {"baarda", "tau", "largest parallax"}
    assert len(table.read_text().splitlines()) == 1 + len(answer["figures"])
    size = kept.stat().st_size
    assert main([*call, "--json", "--to", str(kept)]) == 0
    assert json.loads(capsys.readouterr().out) == answer
    assert kept.stat().st_size == size
    assert main([*call, "--to", str(kept), "--seed", "1"]) == 2
    assert "belongs to another simulation" in capsys.readouterr().err
    assert main([*call, "--strategy", "largest parallax"]) == 0
    assert "baarda" not in capsys.readouterr().out


def test_the_command_refuses_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    for call, said in (
        (["kratky-1983-6-4"], "'kratky-1983-6-4' is no scenario (did you mean"),
        ([], "which scenario?"),
        (["size-models", "--strategy", "search"], "size-models has no method 'search'"),
        (["size-models", "--strategy", ","], "size-models has no method ''"),
    ):
        assert main(["plan", "simulate", *call]) == 2
        assert said in capsys.readouterr().err
    assert main(["plan", "simulate", "--list"]) == 0
    listed = capsys.readouterr().out
    assert main(["plan", "simulate", "--list", "--json"]) == 0
    known = json.loads(capsys.readouterr().out)["scenarios"]
    assert [row["name"] for row in known] == list(scenarios())
    assert all(f"\n{row['name']} " in f"\n{listed}" for row in known)


@pytest.mark.long
@pytest.mark.slow
def test_lines_fit_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "simulate", "--list"]) == 0
    for name in (*scenarios(), "cube:E", "9/3"):
        methods = scenarios()[name].methods if name in scenarios() else ("tau", "baarda")
        # a search takes seconds, and has a short name
        chosen = ",".join(m for m in methods if m not in ("search", "odds", "sure"))
        call = ["plan", "simulate", name, "--runs", "2", "--processes", "1"]
        assert main([*call, "--strategy", chosen]) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


@pytest.mark.long
@pytest.mark.slow
def test_sizes_in_bridged_strips() -> None:
    scenario = scenarios()["size-strips"]
    tally = simulate(scenario, runs=300, seed=2, methods=("baarda",))
    known = scenario.prepare().quantities(("baarda",))
    of = {(f.case, f.quantity): f for f in figures(tally, known, scenario.references, 0.9999)}
    # what the ties have in common is not in their variance: slightly more than alpha is flagged
    for axis in "xy":
        found = of["propagated", f"{axis} rows flagged"]
        assert found.low < 0.0015
        assert found.mean < 0.0035
    # the variance is six times the one tested with: 2 (1 - Phi(3.29 / sqrt 6)) = 0.179 of them
    assert of["paper", "x rows flagged"].mean == pytest.approx(0.165, abs=0.03)
    power = of["propagated", "power (y)"]
    assert power.low < 0.8 < power.high
    for axis in "xy":
        found = of["exact", f"{axis} rows flagged"]
        assert found.low < 0.001 < found.high
