"""The command `anaplot plan simulate`: Monte Carlo over scenarios, as a table, JSON or CSV."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import sys
import textwrap
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anaplot import __version__
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files
from anaplot.exchange.runsfile import KeptChunk, KeptSums, RunsFile
from anaplot.planning.montecarlo import (
    ChunkDone,
    QuantityKey,
    Scenario,
    SimulatedMean,
    Sums,
    figures,
    simulate,
)
from anaplot.planning.ownerrors import OwnErrors
from anaplot.planning.quantities import Quantity
from anaplot.planning.scenarioalpha import PAPER_ALPHA, alpha_of, with_alpha
from anaplot.planning.scenarios import scenarios
from anaplot.report.columns import counted
from anaplot.report.csvoutput import check_csv, write_csv
from anaplot.report.owngeometry import ModelOptions, own_scenario
from anaplot.report.progress import ProgressLine
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = ["run_simulate"]

_WIDTH = 80
_LARGEST_ALPHA = 0.5
_COLUMNS = ("case", "method", "quantity", "runs", "mean", "low", "high", "reference")


def run_simulate(options: argparse.Namespace) -> int:
    """Simulate a scenario and print its figures, or list the scenarios.

    Raises
    ------
    InputError
        No such scenario or method, or a file that cannot be used.
    NotComputableError
        A process died.
    """
    if options.list:
        return _list(as_json=options.json)
    if options.scenario is None:
        raise InputError("which scenario? --list names them")
    scenario = _scenario(options)
    runs = scenario.runs if options.runs is None else options.runs
    methods = None
    if options.strategy is not None:
        methods = tuple(name.strip() for name in options.strategy.split(",") if name.strip())
        unknown = [name for name in methods if name not in scenario.methods]
        if unknown or not methods:
            name = unknown[0] if unknown else ""
            raise InputError(
                f"{scenario.name} has no method {quoted(name)}{hint(name, scenario.methods)}"
            )
    source = Path(options.scenario)
    kept_in = () if options.to is None else (options.to,)
    check_csv(options.csv, {"is read": (source, *block_files(source)), "keeps the runs": kept_in})
    trial = scenario.prepare()
    remarks = trial.remarks()
    # in the scenario's order, whatever the option's
    used = tuple(m for m in scenario.methods if methods is None or m in methods)
    quantities = trial.quantities(used)
    processes = options.processes or max(os.cpu_count() or 1, 1)
    with contextlib.ExitStack() as stack:
        kept: RunsFile | None = None
        if options.to is not None:
            what = {
                "scenario": scenario.name,
                "seed": options.seed,
                "methods": list(used),
                "chunk": scenario.chunk,
                "anaplot": __version__,
                **_identity(scenario),
            }
            kept = stack.enter_context(
                RunsFile(options.to, what, _largest(quantities), scenario.chunk)
            )
        progress = stack.enter_context(ProgressLine(sys.stderr))
        progress(scenario.name, 0.0)
        tally = simulate(
            scenario,
            runs=runs,
            seed=options.seed,
            methods=used,
            processes=processes,
            done=() if kept is None else [_done(chunk) for chunk in kept.chunks],
            progress=progress,
            store=None if kept is None else partial(_keep, kept),
        )
    found = figures(tally, quantities, scenario.references)
    if options.json:
        print(json.dumps(_json(scenario, found, remarks, runs, options.seed), indent=1))
    else:
        print(_printout(scenario, found, remarks, runs, options.seed))
    if options.csv is not None:
        # after the report, which is not lost with it
        write_csv(options.csv, _COLUMNS, (_row(figure).values() for figure in found))
    return 0


def _scenario(options: argparse.Namespace) -> Scenario:
    if options.alpha is not None and not options.alpha < _LARGEST_ALPHA:
        raise InputError(f"--alpha {options.alpha:g}: must be less than {_LARGEST_ALPHA:g}")
    known = scenarios()
    own = {"--errors": options.errors, "--size": options.size, "--place": options.place}
    model = ModelOptions(options.base, options.d, options.c, options.tie_variance)
    if options.scenario in known:
        given = [name for name, value in own.items() if value is not None]
        if given:
            raise InputError(f"{given[0]} goes with a pattern, a block or a network of your own")
        if model.given() is not None:
            raise InputError(f"{model.given()} goes with a pattern of your own")
        return _at_alpha(known[options.scenario], options.alpha)
    return own_scenario(
        options.scenario,
        numbers=options.errors or (1,),
        sizes=options.size or (6.0, 10.0, 20.0),
        places=options.place or (),
        alpha=options.alpha or PAPER_ALPHA,
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


def _list(*, as_json: bool) -> int:
    known = scenarios().values()
    if as_json:
        rows = [
            {"name": s.name, "about": s.about, "methods": list(s.methods), "runs": s.runs}
            for s in known
        ]
        print(json.dumps({"scenarios": rows}, indent=1))
        return 0
    width = max(len(s.name) for s in known)
    for s in known:
        hanging = " " * (width + 2)
        start = f"{s.name:<{width}}  "
        lines = textwrap.wrap(s.about, _WIDTH, initial_indent=start, subsequent_indent=hanging)
        print("\n".join(lines))
    return 0


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


def _json(
    scenario: Scenario, found: Iterable[SimulatedMean], remarks: Iterable[str], runs: int, seed: int
) -> dict[str, Any]:
    return {
        "scenario": scenario.name,
        "about": scenario.about,
        "runs": runs,
        "seed": seed,
        "confidence": 0.95,
        "alpha": alpha_of(scenario),
        **({"settings": dict(scenario.settings)} if isinstance(scenario, OwnErrors) else {}),
        "figures": [_row(figure) for figure in found],
        "remarks": list(remarks),
    }


def _row(figure: SimulatedMean) -> dict[str, Any]:
    return {name: getattr(figure, name) for name in _COLUMNS}


def _printout(
    scenario: Scenario,
    found: tuple[SimulatedMean, ...],
    remarks: Iterable[str],
    runs: int,
    seed: int,
) -> str:
    title = textwrap.wrap(f"{plain(scenario.name)}: {plain(scenario.about)}", _WIDTH)
    alpha = alpha_of(scenario)
    level = "" if alpha in (None, PAPER_ALPHA) else f", alpha {alpha:g}"
    lines = [*title, f"{counted(runs, 'run')}, seed {seed}{level}", ""]
    method = max([len("method"), *(len(plain(f.method)) for f in found)])
    quantity = max([len("quantity"), *(len(plain(f.quantity)) for f in found)])
    head = f"  {'method':<{method}}  {'quantity':<{quantity}}  {'mean':>8}  95 % interval"
    known = any(f.reference is not None for f in found)
    lines.append(head + ("        known" if known else ""))
    case = None
    for figure in found:
        if figure.case != case:
            case = figure.case
            lines.append(plain(case))
        interval = "-"
        if figure.low is not None and figure.high is not None:
            interval = f"{_number(figure.low)} to {_number(figure.high)}"
        line = (
            f"  {plain(figure.method):<{method}}  {plain(figure.quantity):<{quantity}}  "
            f"{_number(figure.mean):>8}  {interval:<19}"
        )
        if figure.reference is not None:
            line += f"  {_number(figure.reference)}"
        lines.append(line.rstrip())
    for remark in remarks:
        lines += ["", *textwrap.wrap(plain(remark), _WIDTH)]
    return "\n".join(lines)


def _number(value: float) -> str:
    size = abs(value)
    return f"{value:.2f}" if size >= 10.0 else f"{value:.3f}" if size >= 0.1 else f"{value:.5f}"
