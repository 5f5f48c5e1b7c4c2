"""`anaplot plan simulate SCENARIO --to-block FOLDER`: one run of a simulation as a block."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files, write_block
from anaplot.planning.bayesscenarios import BayesRun, bayes_run
from anaplot.planning.scenarios import scenarios
from anaplot.report.columns import counted
from anaplot.report.document import Answer, Document, Line, Names, named, say
from anaplot.report.keywords import names_in
from anaplot.report.output import Output
from anaplot.shares.address import LOCAL
from anaplot.textfiles.wording import hint, quoted

__all__ = ["run_to_block"]

_ALONE = ("errors", "size", "place", "alpha", "runs", "to", "csv", "list", "processes", "on",
          "base", "d", "c", "tie_variance")  # fmt: skip


def run_to_block(options: argparse.Namespace) -> int:
    """Write the first run of a named simulation as a block, and say what is in it.

    Raises
    ------
    InputError
        Not a scenario that can be written as a block, or the folder is one already.
    """
    folder: Path = options.to_block
    output = Output.of(options)
    given = next(
        (name for name in _ALONE if getattr(options, name, None) not in (None, False, LOCAL)), None
    )
    if given is not None:
        option = f"--{given.replace('_', '-')}"
        raise InputError(f"{option} goes without --to-block: that writes one run of a scenario")
    output.check({"is written": block_files(folder)})
    found = _run(options.scenario, options.seed, options.strategy)
    write_block(folder, found.block)
    output.show(_document(found, options.seed, folder))
    return 0


def _run(name: str | None, seed: int, strategy: str | None) -> BayesRun:
    known = scenarios()
    scenario = known.get(name or "")
    mine = [
        one.name
        for one in known.values()
        if one.name.startswith("bayes-") and bayes_run(one, seed=0, methods=()) is not None
    ]
    found = None
    if scenario is not None:
        methods = scenario.methods if strategy is None else names_in(strategy)
        wrong = next((one for one in methods if one not in scenario.methods), None)
        if wrong is not None:
            raise InputError(
                f"{scenario.name} has no method {quoted(wrong)}{hint(wrong, scenario.methods)}"
            )
        found = bayes_run(scenario, seed=seed, methods=tuple(methods))
    if found is None:
        meant = "" if scenario is not None else hint(name or "", mine)
        raise InputError(
            f"--to-block: {quoted(name or '')} is no block of the Bayesian paper "
            f"({mine[0]} to {mine[-1]}){meant}"
        )
    return found


def _document(found: BayesRun, seed: int, folder: Path) -> Document:
    def rows(numbers: tuple[int, ...]) -> list[Answer]:
        keys = ("photo", "point", "axis")
        return [dict(zip(keys, found.rows[k], strict=True)) for k in numbers]

    answer: Answer = {
        "scenario": found.block.name,
        "seed": seed,
        "folder": str(folder),
        "planted": rows(found.planted),
        "rejected": {method: rows(numbers) for method, numbers in found.rejected.items()},
    }
    page = [
        say("{}, seed {}: the first run, written to {}", found.block.name, seed, folder).of(
            "heading"
        ),
        say("  planted   {}", _named(found, found.planted)),
        *(
            say("  {:9} {}", method, _named(found, numbers))
            for method, numbers in found.rejected.items()
        ),
        say(
            "  photo:point axis; what each strategy rejects without control, {} linearised",
            counted(len(found.rows), "image coordinate"),
        ),
    ]
    return Document(answer, tuple(page), ())


def _named(found: BayesRun, numbers: tuple[int, ...]) -> Line | Names:
    if not numbers:
        return say("nothing")
    return named([say("{}:{} {}", *found.rows[k]) for k in numbers])
