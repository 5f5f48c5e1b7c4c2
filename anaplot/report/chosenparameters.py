"""The choice of additional parameters, step by step, as a part of a block's document."""

from __future__ import annotations

from math import sqrt
from typing import Any

from anaplot.bundle.hypotheses.chosenparameters import ChosenParameters, ParameterStep, TriedSet
from anaplot.report.columns import counted
from anaplot.report.document import (
    BLANK,
    Block,
    Column,
    Document,
    Line,
    for_programs,
    name,
    named,
    number,
    say,
    table,
    whole,
)
from anaplot.report.groundchange import change_json, change_lines
from anaplot.report.verdicts import probability, verdict_json

__all__ = ["choice_document"]

_STAGE = {
    "all": "all together",
    "group": "group",
    "single": "single",
    "rejected": "all rejected",
    "kept": "what is kept",
}
_OUTCOME = {
    "significant": "significant",
    "rejected": "rejected",
    "kept": "kept",
    "back": "brought back",
}
_COLUMNS = (
    name("set", "SET"),
    name("stage", "STEP", form=lambda stage: _STAGE[stage]),
    *for_programs("parameters"),
    name("", "PARAMETERS", 12),
    whole("dimension", "b", 4),
    number("statistic", "T", 3, 10),
    number("critical", "critical", 3, 9),
    Column("P", "P", 8, form=probability),
    number("noncentrality", "lambda", 1, 9),
    number("power", "power", 2, 7),
    number("largest_m", "moved [m]", 4, 11, unit="m"),
    name("at", "AT", 2, gap=1),
    number("rms_m", "rms [m]", 4, 9, unit="m"),
    number("sigma_before_m", "s was", 4, 8, unit="m"),
    number("sigma_after_m", "is [m]", 4, 8, unit="m"),
    name("outcome", "", head="", form=lambda outcome: _OUTCOME[outcome]),
)
_SHOWN_NAMES = 4


def choice_document(found: ChosenParameters) -> Document:
    """Return the document of the sets that were tried, and what became of them.

    "moved" is the coordinate that a step moves farthest, "rms" the root mean square over all
    coordinates, "s" the standard deviation that changes most, for the a-priori sigma0: of all
    together and of what is kept against the block without parameters, else of rejecting.
    """
    cells = [_cells(one.name, step) for one in found.sets for step in one.steps]
    shown = tuple(one.key or one.title for one in _COLUMNS if one.width is not None)
    steps = table("choice", _COLUMNS, cells, shown=shown[1:], group="set")
    page: list[Block] = [
        say(
            "CHOICE OF ADDITIONAL PARAMETERS  alpha {:g}: {:.4g} for each of {}, {}-invariant",
            *(found.alpha, found.set_alpha, counted(len(found.sets), "set"), found.scope),
        ).of("heading"),
        *(_chosen(found)),
    ]
    for one in found.sets:
        page += _set_lines(one)
    if cells:
        page += [
            BLANK,
            steps,
            say(
                "  lambda, power: against values of the a-priori sigma0; moved, rms and s: of all "
                "together and of"
            ),
            say("  what is kept against the block without them, else of holding them at zero"),
        ]
    answer = {
        "alpha": found.alpha,
        "set_alpha": found.set_alpha,
        "scope": found.scope,
        "chosen": None if found.chosen is None else found.chosen.name,
        "parameters": [] if found.chosen is None else list(found.chosen.kept),
        "sets": [_set_json(one) for one in found.sets],
    }
    return Document(answer, tuple(page), (steps,) if cells else ())


def _chosen(found: ChosenParameters) -> list[Line]:
    if found.chosen is None:
        return [say("  none is taken: nothing systematic is proved")]
    lines = [say("  taken: {}, {}", found.chosen.name, named(found.chosen.kept, 12, " ..."))]
    change = found.chosen.steps[-1].change
    return lines + change_lines(change, "on the ground, against none", "m", indent=2)


def _set_lines(one: TriedSet) -> list[Line]:
    lines = []
    if one.not_determined:
        lines.append(
            say(
                "  {}: not determined, left out: {}",
                one.name,
                named(one.not_determined, 12, " ..."),
            )
        )
    if one.failure is not None:
        lines.append(say("  {}: {}", one.name, one.failure))
    elif one.kept:
        lines.append(
            say(
                "  {}: kept {}; Schwarz's criterion {:+.1f}",
                *(one.name, named(one.kept, 12, " ..."), one.criterion),
            )
        )
    elif one.parameters:
        lines.append(say("  {}: rejected", one.name))
    return lines


def _cells(of: str, step: ParameterStep) -> tuple[Any, ...]:
    test = None if step.verdict is None else step.verdict.decisive
    change, sigma = step.change, None if step.change is None else step.change.sigma
    shown = ", ".join(step.parameters[:_SHOWN_NAMES])
    if len(step.parameters) > _SHOWN_NAMES:
        shown = f"{len(step.parameters)}: {step.parameters[0]} ... {step.parameters[-1]}"
    return (
        of,
        step.stage,
        " ".join(step.parameters),
        shown,
        *(
            (None,) * 4
            if test is None
            else (test.dimension, test.statistic, test.critical, test.significance)
        ),
        step.noncentrality,
        step.power,
        None if change is None else change.change,
        None if change is None else f"{change.point} {change.axis}",
        None if change is None else sqrt(sum(one * one for one in change.rms) / 3.0),
        None if sigma is None else sigma.before,
        None if sigma is None else sigma.after,
        step.outcome,
    )


def _set_json(one: TriedSet) -> dict[str, Any]:
    return {
        "set": one.name,
        "tested": list(one.parameters),
        "not_determined": list(one.not_determined),
        "error": one.failure,
        "kept": list(one.kept),
        "criterion": one.criterion if one.kept else None,
        "steps": [
            {
                "stage": step.stage,
                "parameters": list(step.parameters),
                "verdict": verdict_json(step.verdict),
                "noncentrality": step.noncentrality,
                "power": step.power,
                "outcome": step.outcome,
                "ground": change_json(step.change, "m"),
            }
            for step in one.steps
        ],
    }
