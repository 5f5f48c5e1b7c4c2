"""`anaplot plan simulate` and its call: Monte Carlo over scenarios."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.aliases import Progress
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files
from anaplot.exchange.runsfile import KeptChunk, KeptSums, RunsFile
from anaplot.photogrammetry.block import TieVariance
from anaplot.planning.montecarlo import (
    ChunkDone,
    QuantityKey,
    Scenario,
    SimulatedMean,
    Sums,
    figures,
)
from anaplot.planning.montecarlo import simulate as simulate_scenario
from anaplot.planning.ownerrors import OwnErrors
from anaplot.planning.quantities import Quantity
from anaplot.planning.scenarioalpha import PAPER_ALPHA, alpha_of, with_alpha
from anaplot.planning.scenarios import scenarios
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Column,
    Document,
    Table,
    for_programs,
    name,
    say,
    table,
)
from anaplot.report.keywords import names_in, takes_options
from anaplot.report.output import Output
from anaplot.report.owngeometry import ModelOptions, own_scenario
from anaplot.report.planarguments import add_simulate_arguments
from anaplot.report.running import computed
from anaplot.report.simulatedrun import run_to_block
from anaplot.report.workplace import place_of, said_how_to_go_on
from anaplot.shares.address import LOCAL
from anaplot.shares.work import SharesLostError
from anaplot.textfiles.wording import hint, quoted
from anaplot.version import __version__

__all__ = ["Simulated", "run_simulate", "scenarios_document", "simulate", "simulate_document"]

_LARGEST_ALPHA = 0.5


class Simulated(NamedTuple):
    """A simulation.

    Attributes
    ----------
    scenario
        What was simulated.
    figures
        Means with their 95 % intervals.
    remarks
        What is to be said of it.
    """

    scenario: Scenario
    figures: tuple[SimulatedMean, ...]
    remarks: tuple[str, ...]


def run_simulate(options: argparse.Namespace) -> int:
    """Simulate a scenario and print its figures, or list the scenarios.

    Raises
    ------
    InputError
        No such scenario or method, or a file that cannot be used.
    NotComputableError
        Workers were lost and could not be replaced, or a cluster does not answer.
    """
    if options.to_block is not None:
        return run_to_block(options)
    output = Output.of(options)
    if options.list:
        output.check()
        output.show(scenarios_document(scenarios().values()))
        return 0
    if options.scenario is None:
        raise InputError("which scenario? --list names them")
    source = Path(options.scenario)
    kept_in = () if options.to is None else (options.to,)
    output.check({"is read": (source, *block_files(source)), "keeps the runs": kept_in})
    document = computed(options, simulate).document
    # the report is not lost with the table
    output.print(document)
    output.write(document)
    return 0


@takes_options(add_simulate_arguments)
def simulate(
    scenario: str | os.PathLike[str],
    *,
    base: float | None = None,
    d: float | None = None,
    c: float | None = None,
    tie_variance: TieVariance | None = None,
    errors: str | Sequence[int] | None = None,
    size: str | Sequence[float] | None = None,
    place: str | Sequence[str] | None = None,
    alpha: float | None = None,
    strategy: str | Sequence[str] | None = None,
    runs: int | None = None,
    seed: int = 0,
    processes: int | None = None,
    on: str = LOCAL,
    executor: Executor | None = None,
    to: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> Computed[Simulated]:
    """Simulate how often errors are found, rightly or wrongly (Monte Carlo).

    Parameters
    ----------
    scenario
        One of those that `anaplot plan simulate --list` names; or a pattern, a block's folder, a
        cube ("cube:A") or a network's file, in which errors are planted.
    base, d, c
        Of a pattern: base, half the model in y, camera constant [mm]; None: 90, 100, 152.
    tie_variance
        How the ties of a pattern err; None: exact.
    errors, size
        How many errors in a run, None: 1; and their sizes [sigma], None: 6, 10 and 20.
    place
        Only in rows of these photos, points and axes.
    alpha
        Significance of a single row; None: that of the scenario, 0.001.
    strategy
        Only these of the scenario's methods.
    runs
        None: as many as the scenario has.
    seed
        Of the random numbers; the same seed gives the same figures, whatever the processes.
    processes
        None: as many as processors. With more than one a script needs the guard
        `if __name__ == "__main__"`, as each of them imports it. With an executor: how many shares
        it does at a time, None: 32.
    on
        "local", or "dask://HOST:PORT": the scheduler of a dask cluster. It is sent pickles, and
        so are its answers: it must be trusted.
    executor
        Any executor of `concurrent.futures` instead; it is left open.
    to
        A file that keeps what is done; the same call goes on from there.
    progress
        Called with what is being done and the fraction of it (0 to 1).

    Raises
    ------
    InputError
        No such scenario or method, or a file that cannot be used.
    NotComputableError
        Workers were lost and could not be replaced, or a cluster does not answer.
    """
    where = place_of(on, processes, executor)
    chosen = _scenario(
        os.fspath(scenario), errors, size, place, alpha, ModelOptions(base, d, c, tie_variance)
    )
    count = chosen.runs if runs is None else runs
    methods = None
    if strategy is not None:
        methods = names_in(strategy)
        unknown = [name for name in methods if name not in chosen.methods]
        if unknown or not methods:
            name = unknown[0] if unknown else ""
            raise InputError(
                f"{chosen.name} has no method {quoted(name)}{hint(name, chosen.methods)}"
            )
    trial = chosen.prepare()
    remarks = tuple(trial.remarks())
    # in the scenario's order, whatever the option's
    used = tuple(m for m in chosen.methods if methods is None or m in methods)
    quantities = trial.quantities(used)
    with contextlib.ExitStack() as stack:
        kept: RunsFile | None = None
        if to is not None:
            what = {
                "scenario": chosen.name,
                "seed": seed,
                "methods": list(used),
                "chunk": chosen.chunk,
                "anaplot": __version__,
                **_identity(chosen),
            }
            kept = stack.enter_context(RunsFile(Path(to), what, _largest(quantities), chosen.chunk))
        if progress is not None:
            progress(chosen.name, 0.0)
        try:
            tally = simulate_scenario(
                chosen,
                runs=count,
                seed=seed,
                methods=used,
                place=where,
                done=() if kept is None else [_done(chunk) for chunk in kept.chunks],
                progress=progress,
                store=None if kept is None else partial(_keep, kept),
            )
        except SharesLostError as error:
            raise said_how_to_go_on(error, to) from error
    found = tuple(figures(tally, quantities, chosen.references))
    document = simulate_document(chosen, found, remarks, runs=count, seed=seed)
    return Computed(Simulated(chosen, found, remarks), document)


def _scenario(
    name: str,
    errors: str | Sequence[int] | None,
    size: str | Sequence[float] | None,
    place: Sequence[str] | None,
    alpha: float | None,
    model: ModelOptions,
) -> Scenario:
    if alpha is not None and not alpha < _LARGEST_ALPHA:
        raise InputError(f"--alpha {alpha:g}: must be less than {_LARGEST_ALPHA:g}")
    known = scenarios()
    own = {"--errors": errors, "--size": size, "--place": place}
    if name in known:
        given = [option for option, value in own.items() if value is not None]
        if given:
            raise InputError(f"{given[0]} goes with a pattern, a block or a network of your own")
        if model.given() is not None:
            raise InputError(f"{model.given()} goes with a pattern of your own")
        return _at_alpha(known[name], alpha)
    return own_scenario(
        name,
        numbers=tuple(map(int, errors or (1,))),
        sizes=tuple(map(float, size or (6.0, 10.0, 20.0))),
        places=place or (),
        alpha=alpha or PAPER_ALPHA,
        known=known,
        model=model,
    )


def _at_alpha(scenario: Scenario, alpha: float | None) -> Scenario:
    if alpha is None:
        return scenario
    changed = with_alpha(scenario, alpha)
    if changed is None:
        raise InputError(f"--alpha: {scenario.name} has significances of its own")
    return changed


def _identity(scenario: Scenario) -> dict[str, Any]:
    """Return what tells a simulation in one's own geometry from another one."""
    if not isinstance(scenario, OwnErrors):
        return {"alpha": alpha_of(scenario)}
    digest = hashlib.sha256(_rounded(scenario.matrix) + scenario.places.tobytes())
    if scenario.models is not None:
        digest.update(_rounded(scenario.models))
    return {
        **scenario.settings,
        "errors": list(scenario.numbers),
        "sizes": list(scenario.sizes),
        "alpha": scenario.alpha,
        "geometry": digest.hexdigest()[:16],
    }


def _rounded(values: NDArray[np.float64]) -> bytes:
    return (np.round(values, 9) + 0.0).tobytes()  # + 0.0: zero has no sign


def _largest(quantities: Mapping[QuantityKey, Quantity]) -> dict[QuantityKey, float | None]:
    return {key: quantity.top for key, quantity in quantities.items()}


def _keep(file: RunsFile, chunk: ChunkDone) -> None:
    file.keep(_kept(chunk))


def _kept(chunk: ChunkDone) -> KeptChunk:
    rows = tuple(KeptSums(*key, *of) for key, of in chunk.tally.items())
    return KeptChunk(chunk.number, chunk.runs, rows)


def _done(chunk: KeptChunk) -> ChunkDone:
    tally = {(s.case, s.method, s.quantity): Sums(s.runs, s.total, s.squares) for s in chunk.sums}
    return ChunkDone(chunk.number, chunk.runs, tally)


def scenarios_document(known: Iterable[Scenario]) -> Document:
    """Return the document of the scenarios that have names."""
    found = list(known)
    named = table("scenarios", _SCENARIOS, ((s.name, s.about, s.methods, s.runs) for s in found))
    width = max(len(s.name) for s in found)
    page = (say("{:<{width}}  {}", s.name, s.about, width=width).folded(width + 2) for s in found)
    return Document({"scenarios": named}, tuple(page), (named,))


def simulate_document(
    scenario: Scenario,
    found: Sequence[SimulatedMean],
    remarks: Iterable[str],
    *,
    runs: int,
    seed: int,
) -> Document:
    """Return the document of a simulated scenario.

    Parameters
    ----------
    scenario
        The scenario.
    found
        Its figures.
    remarks
        What is to be said of it.
    runs, seed
        How often it was run, and the seed of its random numbers.
    """
    alpha = alpha_of(scenario)
    simulated = _figures(found)
    said = tuple(remarks)
    answer: Answer = {
        "scenario": scenario.name,
        "about": scenario.about,
        "runs": runs,
        "seed": seed,
        "confidence": 0.95,
        "alpha": alpha,
        **({"settings": scenario.settings} if isinstance(scenario, OwnErrors) else {}),
        "figures": simulated,
        "remarks": said,
    }
    level = say("") if alpha in (None, PAPER_ALPHA) else say(", alpha {:g}", alpha)
    page: list[Block] = [
        say("{scenario}: {about}", **answer).folded().of("heading"),
        say("{}, seed {}{}", counted(runs, "run"), seed, level),
        BLANK,
        simulated,
    ]
    for remark in said:
        page += [BLANK, say("{}", remark).folded().of("remark")]
    return Document(answer, tuple(page), (simulated,))


def _number(value: float) -> str:
    size = abs(value)
    return f"{value:.2f}" if size >= 10.0 else f"{value:.3f}" if size >= 0.1 else f"{value:.5f}"


_INTERVAL = "95 % interval"
_SCENARIOS = for_programs("name", "about", "methods", "runs")
_FIGURES = (
    *for_programs("case"),
    name("method", "method"),
    name("quantity", "quantity"),
    *for_programs("runs"),
    Column("mean", "mean", 10, form=_number),
    *for_programs("low", "high"),
    name("reference", "known", form=_number, none=""),
    name("", _INTERVAL, 19, form=lambda ends: " to ".join(map(_number, ends))),
)


def _figures(found: Sequence[SimulatedMean]) -> Table:
    rows = []
    for one in found:
        ends = None if one.low is None or one.high is None else (one.low, one.high)
        rows.append((one.case, one.method, one.quantity, one.runs, one.mean, one.low, one.high,
                     one.reference, ends))  # fmt: skip
    shown: tuple[str, ...] = ("method", "quantity", "mean", _INTERVAL)
    if any(one.reference is not None for one in found):
        shown += ("reference",)
    return table("figures", _FIGURES, rows, shown=shown, most=len(rows), group="case")
