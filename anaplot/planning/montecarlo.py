"""Monte Carlo: many runs of a scenario as shares of work, the same whoever does them.

Runs are done in chunks of a fixed size. Chunk i draws from the i-th child of the seed, so that its
sums depend on scenario, seed, methods and i alone: not on how many workers there are, nor on
which of them does it, nor on where an interrupted simulation went on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from anaplot.aliases import Bools, Progress
from anaplot.errors import InputError
from anaplot.planning.quantities import Quantity, mean_interval
from anaplot.shares.local import LocalProcesses
from anaplot.shares.work import Place, carry_out

__all__ = [
    "MOST_RUNS",
    "ChunkDone",
    "QuantityKey",
    "Scenario",
    "SimulatedMean",
    "Sums",
    "Tally",
    "Trial",
    "add",
    "chunk_sizes",
    "figures",
    "simulate",
    "sums",
]

QuantityKey = tuple[str, str, str]
"""(case, method, quantity)."""

MOST_RUNS = 100_000_000
"""Runs of a simulation, at most."""


class Sums(NamedTuple):
    """Number of runs, sum and sum of squares of a value that every run has."""

    runs: int
    total: float
    squares: float


Tally = dict[QuantityKey, Sums]


class Trial(Protocol):
    """A scenario made ready in one process: it holds the geometry."""

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        """Do some runs."""
        ...

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        """Return what every run with these methods counts, in the order of the report."""
        ...

    def remarks(self) -> tuple[str, ...]:
        """Return facts of the geometry: sentences."""
        ...


class Scenario(Protocol):
    """What is simulated; small, immutable and known by name.

    Attributes
    ----------
    name, about
        What it is called, and one sentence.
    methods
        All methods (mostly strategies for gross errors) that it compares.
    runs
        How many runs are usual.
    chunk
        Runs of one chunk.
    references
        Known values of some figures: printed in the papers, or found independently.
    """

    @property
    def name(self) -> str: ...  # noqa: D102 - see the class
    @property
    def about(self) -> str: ...  # noqa: D102
    @property
    def methods(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def runs(self) -> int: ...  # noqa: D102
    @property
    def chunk(self) -> int: ...  # noqa: D102
    @property
    def references(self) -> Mapping[QuantityKey, float]: ...  # noqa: D102

    def prepare(self) -> Trial:
        """Make it ready in this process."""
        ...


class ChunkDone(NamedTuple):
    """The sums of one chunk."""

    number: int
    runs: int
    tally: Tally


@dataclass(frozen=True, slots=True)
class SimulatedMean:
    """The mean of a quantity over all runs, with its two-sided confidence interval.

    Attributes
    ----------
    case, method, quantity
        What it is.
    runs
        Number of runs.
    mean
        Mean per run.
    low, high
        Its interval, see `mean_interval`; None for a count in a single run.
    reference
        The known value, or None.
    """

    case: str
    method: str
    quantity: str
    runs: int
    mean: float
    low: float | None
    high: float | None
    reference: float | None


def sums(values: ArrayLike | Bools) -> Sums:
    """Return the sums of a value of (runs,) runs."""
    x = np.asarray(values, dtype=float)
    return Sums(len(x), float(x.sum()), float(x @ x))


def add(a: Mapping[QuantityKey, Sums], b: Mapping[QuantityKey, Sums]) -> Tally:
    """Return the sums of two sets of runs taken together."""
    out = dict(a)
    for key, more in b.items():
        one = out.get(key, Sums(0, 0.0, 0.0))
        out[key] = Sums(one.runs + more.runs, one.total + more.total, one.squares + more.squares)
    return out


def figures(
    tally: Mapping[QuantityKey, Sums],
    quantities: Mapping[QuantityKey, Quantity],
    references: Mapping[QuantityKey, float],
    confidence: float = 0.95,
) -> tuple[SimulatedMean, ...]:
    """Return the means with their intervals, in the order of the quantities.

    Parameters
    ----------
    tally
        Sums over all runs.
    quantities
        What was counted, see `Trial`.
    references
        Known values.
    confidence
        Of the intervals.
    """
    out = []
    for key, quantity in quantities.items():
        of = tally[key]
        low, high = mean_interval(quantity, *of, confidence) or (None, None)
        out.append(SimulatedMean(*key, of.runs, of.total / of.runs, low, high, references.get(key)))
    return tuple(out)


def chunk_sizes(runs: int, chunk: int) -> tuple[int, ...]:
    """Return the number of runs of every chunk; only the last one may be smaller.

    Raises
    ------
    InputError
        Less than one run, or more than can be meant.
    """
    if not 1 <= runs <= MOST_RUNS:
        raise InputError(f"{runs} runs: 1 to {MOST_RUNS} are possible")
    whole, rest = divmod(runs, chunk)
    return (chunk,) * whole + ((rest,) if rest else ())


def simulate(
    scenario: Scenario,
    *,
    runs: int | None = None,
    seed: int = 0,
    methods: Sequence[str] | None = None,
    place: Place | None = None,
    done: Iterable[ChunkDone] = (),
    progress: Progress | None = None,
    store: Callable[[ChunkDone], None] | None = None,
) -> Tally:
    """Run a scenario.

    Parameters
    ----------
    scenario
        What is simulated.
    runs, methods
        None: those of the scenario.
    seed
        Not negative; the same seed gives the same sums.
    place
        Where chunks are done; None: in this process.
    done
        Chunks of an earlier simulation with the same scenario, seed and methods; those that are
        whole for the runs asked are not done again.
    progress
        Told what is done and how much of it (0 to 1).
    store
        Given every chunk as soon as it is done; chunks come in any order. An interrupt ends the
        work at once, after what is finished was given.

    Returns
    -------
    dict
        Sums over all runs, added in the order of the chunks.

    Raises
    ------
    InputError
        A method that the scenario does not know, or impossible numbers.
    SharesLostError
        Workers died, and could not be replaced.
    """
    chosen = _chosen(scenario, methods)
    if seed < 0:
        raise InputError("the seed must not be negative")
    sizes = chunk_sizes(scenario.runs if runs is None else runs, scenario.chunk)
    # chunks whose turn to be added has not come
    waiting = {
        c.number: c.tally for c in done if c.number < len(sizes) and c.runs == sizes[c.number]
    }
    known = frozenset(waiting)
    total, finished = sum(sizes), sum(sizes[number] for number in known)
    tally: Tally = {}
    added = 0

    def add_in_order() -> None:
        nonlocal tally, added
        while added in waiting:
            tally = add(tally, waiting.pop(added))
            added += 1

    def take(chunk: ChunkDone) -> None:
        nonlocal finished
        waiting[chunk.number] = chunk.tally
        add_in_order()
        finished += chunk.runs
        if store is not None:
            store(chunk)
        if progress is not None:
            progress(scenario.name, finished / total)

    add_in_order()
    if len(known) < len(sizes):
        tasks = (
            _Task(seed, chosen, number, size)
            for number, size in enumerate(sizes)
            if number not in known
        )
        left = len(sizes) - len(known)
        where = place or LocalProcesses(1)
        carry_out(_Runs(scenario), tasks, left, where, take, lambda task: f"chunk {task.number}")
    return tally


class _Task(NamedTuple):
    seed: int
    methods: tuple[str, ...]
    number: int
    runs: int


def _chosen(scenario: Scenario, methods: Sequence[str] | None) -> tuple[str, ...]:
    if methods is None:
        return scenario.methods
    for method in methods:
        if method not in scenario.methods:
            known = ", ".join(scenario.methods)
            raise InputError(f"{scenario.name} has no method {method!r}; it has: {known}")
    # the scenario's order, whatever the caller's: the same sums then
    return tuple(method for method in scenario.methods if method in methods)


@dataclass(frozen=True, slots=True)
class _Runs:
    """Runs of a scenario as `Work`."""

    scenario: Scenario

    def prepare(self) -> Callable[[_Task], ChunkDone]:
        return partial(_do, self.scenario.prepare())


def _do(trial: Trial, task: _Task) -> ChunkDone:
    rng = np.random.default_rng(np.random.SeedSequence(task.seed, spawn_key=(task.number,)))
    return ChunkDone(task.number, task.runs, trial.run(rng, task.runs, task.methods))
