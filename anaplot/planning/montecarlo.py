"""Monte Carlo: many runs of a scenario in parallel processes, the same whatever their number.

Runs are done in chunks of a fixed size. Chunk i draws from the i-th child of the seed, so that its
sums depend on scenario, seed, methods and i alone: not on how many processes there are, nor on
which of them does it, nor on where an interrupted simulation went on.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import (
    active_children,
    connection,
    get_context,
    parent_process,
    resource_tracker,
)
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from anaplot.aliases import Bools, Progress
from anaplot.errors import InputError, NotComputableError
from anaplot.planning.quantities import Quantity, mean_interval

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

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
_LOOK = 0.5  # seconds after which a waiting parent looks round
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
    processes: int = 1,
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
    processes
        With 1 nothing is started beside this process.
    done
        Chunks of an earlier simulation with the same scenario, seed and methods; those that are
        whole for the runs asked are not done again.
    progress
        Told what is done and how much of it (0 to 1).
    store
        Given every chunk as soon as it is done; chunks come in any order. An interrupt ends the
        processes at once, after what they have finished was given.

    Returns
    -------
    dict
        Sums over all runs, added in the order of the chunks.

    Raises
    ------
    InputError
        A method that the scenario does not know, or impossible numbers.
    NotComputableError
        A process died.
    """
    chosen = _chosen(scenario, methods)
    if seed < 0 or processes < 1:
        raise InputError("the seed must not be negative, and there must be at least one process")
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
        # made one after the other: there may be millions
        tasks = (
            _Task(seed, chosen, number, size)
            for number, size in enumerate(sizes)
            if number not in known
        )
        _carry_out(scenario, tasks, min(processes, len(sizes) - len(known)), take)
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


class _Worker:
    """What a process that was started for a simulation holds: the scenario made ready."""

    trial: Trial | None = None


def _start(scenario: Scenario) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # interrupts are the parent's business
    _end_with_the_parent()
    _Worker.trial = scenario.prepare()


def _do_there(task: _Task) -> ChunkDone:
    assert _Worker.trial is not None
    return _do(_Worker.trial, task)


def _do(trial: Trial, task: _Task) -> ChunkDone:
    rng = np.random.default_rng(np.random.SeedSequence(task.seed, spawn_key=(task.number,)))
    return ChunkDone(task.number, task.runs, trial.run(rng, task.runs, task.methods))


def _carry_out(
    scenario: Scenario, tasks: Iterator[_Task], processes: int, take: Callable[[ChunkDone], None]
) -> None:
    if processes == 1:
        trial = scenario.prepare()
        for task in tasks:
            take(_do(trial, task))
        return
    running: set[Future[ChunkDone]] = set()
    others = set(active_children())
    with _one_thread_each(), _pool(scenario, processes) as pool:
        try:
            while True:
                with _interrupts_held():
                    for task in islice(tasks, 2 * processes - len(running)):
                        running.add(pool.submit(_do_there, task))
                if not running:
                    return
                # never one endless wait: an interrupt just before it would be seen after it
                done = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED).done
                _take_done(done, running, take)
        except BrokenProcessPool:
            raise NotComputableError("a process of the simulation died before its time") from None
        except (KeyboardInterrupt, SystemExit):
            _take_done({f for f in running if f.done() and not f.exception()}, running, take)
            raise
        finally:
            # what is still running belongs to a simulation that has ended
            for child in set(active_children()) - others if running else ():
                child.terminate()
            pool.shutdown(wait=True, cancel_futures=True)


def _take_done(
    done: Iterable[Future[ChunkDone]],
    running: set[Future[ChunkDone]],
    take: Callable[[ChunkDone], None],
) -> None:
    for future in done:
        take(future.result())
        running.discard(future)


def _pool(scenario: Scenario, processes: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        processes, mp_context=get_context("spawn"), initializer=_start, initargs=(scenario,)
    )


def _end_with_the_parent() -> None:
    """Let this process end when its parent does, also when that was killed."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep interrupts until the end, and from processes that start meanwhile for good.

    A process would otherwise complain of an interrupt that comes before it can ignore it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # starting it later would let interrupts through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let the processes started meanwhile do linear algebra with one thread each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
