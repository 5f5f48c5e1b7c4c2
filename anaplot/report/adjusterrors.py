"""A block without its gross errors: what was rejected and why, as a part of its document."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TypeVar

import numpy as np

from anaplot.adjustment.findings import Rejection, SearchStep
from anaplot.adjustment.strategies import deciding_critical, sigma_of
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array
from anaplot.bundle.errors.controllast import ControlLast, clean_control_last
from anaplot.bundle.errors.grosserrors import BlockFindings, block_gross_errors
from anaplot.bundle.errors.misnamed import MisnamedRay
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry import block as photogrammetry
from anaplot.report.astext import MOST_ROWS, line_text
from anaplot.report.columns import counted
from anaplot.report.document import (
    Answer,
    Block,
    Column,
    Document,
    Later,
    Line,
    Listed,
    Table,
    for_programs,
    name,
    named,
    number,
    say,
    table,
    whole,
)
from anaplot.report.groundchange import change_json, change_lines
from anaplot.report.modelvalues import model_values_json, model_values_line
from anaplot.report.observationnames import SHOWN_UNITS, in_words, name_json
from anaplot.report.searchoptions import search_settings, sigma0_in_words

__all__ = [
    "clean_block",
    "clean_step_by_step",
    "errors_document",
    "rejected_table",
]

_T = TypeVar("_T")

_MOST = 30  # rows of a list in the text; JSON holds them all
_ODDS = 0.01  # smallest probability shown
_BUT_HELD = " but those rejected before"
_AGAINST = "the control on which photos and other control agree tells against it"
_FAR = "its ray misses the point by more than a twentieth of the principal distance"


def clean_block(
    problem: Problem,
    strategy: str,
    partner: float | None = None,
    *,
    pairs: bool = False,
    as_given: bool = False,
    watch: Watch | None = None,
) -> BlockFindings:
    """Search a block for gross errors with the alpha and power of its test.

    Parameters
    ----------
    problem
        The bundle.
    strategy
        Name of the strategy.
    partner
        Residual correlation from which two observations are hard to tell apart; None: the default.
    pairs
        Whether the odds over pairs of gross errors are computed.
    as_given, watch
        As `block_gross_errors` has them.

    Raises
    ------
    InputError
        Odds over pairs of too many observations.
    NotComputableError
        The block has no solution, also without what fits nowhere, or none without what the
        strategy rejects.
    """
    settings = search_settings(problem.test, partner, pairs=pairs)
    return block_gross_errors(problem, strategy, settings, as_given=as_given, watch=watch)


def clean_step_by_step(
    block: photogrammetry.Block,
    strategy: str,
    partner: float | None = None,
    *,
    pairs: bool = False,
    additional: AdditionalParameters | None = None,
    as_given: bool = False,
    watch: Watch | None = None,
) -> ControlLast:
    """Clean the image coordinates of a block without control, then the control.

    Parameters, units and errors as `clean_block` and `clean_control_last` have them.
    """
    settings = search_settings(block.test, partner, pairs=pairs)
    return clean_control_last(
        block, strategy, settings, additional=additional, as_given=as_given, watch=watch
    )


def _short(name: ObservationName) -> Line:
    """Return a partner in words: its point is that of the row that it stands beside."""
    if name[0] == "image":
        return say("{} of photo {}", name[4], name[1])
    return in_words(name)


def errors_document(cleaned: BlockFindings) -> Document:
    """Return the document of the rejected observations of a block.

    For programs errors and sigmas in the unit that stands beside them; people read micrometres
    (image), millimetres (control, distances) or microradians (priors, angles).
    """
    found, settings = cleaned.findings, cleaned.settings
    rejected = cleaned.rejected
    page: list[Block] = [
        say("GROSS ERRORS ({})", found.strategy).of("heading"),
        say(
            "  alpha {:g}, {}; {} rejected after {}",
            settings.alpha,
            _critical(cleaned),
            _how_many(cleaned),
            counted(len(cleaned.passes), "pass", "passes"),
        ),
        *_before_and_after(cleaned),
    ]
    if rejected:
        width = max(len(line_text(in_words(row.name))) for row in rejected)
        page.append(
            say("  ORDER  {:<{width}}       ERROR     SIGMA           w   RED-N  BECAUSE",
                "OBSERVATION", width=width)
        )  # fmt: skip
        why = dict.fromkeys(cleaned.far, _FAR) | dict.fromkeys(cleaned.against, _AGAINST)

        def lines(some: Sequence[int]) -> list[Line]:
            return [_rejected_line(rejected[k], width, found.strategy, why) for k in some]

        page.append(Listed(Later(len(rejected), lines), MOST_ROWS, "  and {} more"))
        page += change_lines(cleaned.point_change, "on the ground", "m", indent=2)
    elif not cleaned.points:
        page.append(say("  nothing is rejected"))
    page += _listed(
        "left out with all rays, which are far apart: they, or its control, may be wrong",
        [say("point {}", point) for point in cleaned.points],
    )
    page += _listed("under a wrong name, it seems", [_misnamed(ray) for ray in cleaned.misnamed])
    page += _listed("rejected on the way, came back", [*map(in_words, cleaned.came_back)])
    page += _listed(
        f"hard to tell apart (correlation of residuals {settings.partner:g} or more)",
        [
            say("{} is rejected, {} is kept (correlation {:.2f})", in_words(a), in_words(b), rho)
            for a, b, rho in cleaned.hard_to_tell
        ],
    )  # fmt: skip
    page += _listed(
        "cannot be left out", [say("{}: {}", in_words(r.name), r.reason) for r in cleaned.refused]
    )
    page += _listed(
        "cannot be tested: nothing checks them", [in_words(name) for name in cleaned.untestable]
    )
    page += _odds(cleaned)
    if found.model_values is not None:
        page.append(say("  {}", model_values_line(found.model_values)))
    page += [say("  note: {}", remark).of("remark") for remark in cleaned.remarks]
    return Document(_json(cleaned), tuple(page), (rejected_table(rejected),))


def _how_many(cleaned: BlockFindings) -> str:
    """Count what is out, with the verb."""
    rejected, points = len(cleaned.rejected), len(cleaned.points)
    if not points:
        return f"{counted(rejected, 'observation')} {'is' if rejected == 1 else 'are'}"
    rays = counted(len(cleaned.rays_of_points), "ray")
    return f"{counted(rejected, 'observation')} and {counted(points, 'point')} with {rays} are"


def _misnamed(ray: MisnamedRay) -> Line:
    inside = "" if ray.model is None else say(" in {}", ray.model)
    what = say(
        "photo {}{}: {} and {} interchanged? With the two exchanged"
        if ray.interchanged
        else "photo {}{}: {} is {}? With that name",
        ray.photo,
        inside,
        ray.point,
        ray.meant,
    )
    return what + say(
        " sigma0 is {:.4f}, {} taken back", ray.sigma0, counted(ray.taken_back, "coordinate")
    )


def _short_number(value: float) -> str:
    return f"{value:.4g}"


_REJECTED = (
    name("kind", "KIND", 4),
    *(name(key, key.upper(), none="") for key in ("photo", "point", "model", "axis")),
    *(name(key, key.upper(), none="") for key in ("owner", "unknown")),
    whole("order", "ORDER", 6),
    number("statistic", "statistic", 2, 10),
    number("critical", "critical", 2, 9),
    Column("error", "error", 10, form=_short_number),
    Column("sigma", "sigma", 10, form=_short_number),
    name("unit", "UNIT", 4),
    number("w", "w", 2, 8),
    number("r", "RED-N", 3, 7),
    number("redundancy_number", "RED-N then", 3, 11),
    number("weight", "weight", 3, 7),
)


def rejected_table(rejected: Sequence[Rejection[ObservationName]]) -> Table:
    """Return what was rejected, in its order; `adjust` tells a person in lines."""
    rows = []
    for row in rejected:
        name = name_json(row.name)
        rows.append(
            (*(name.get(column.key) for column in _REJECTED[:7]), row.order, row.statistic,
             row.critical, row.error, row.sigma, row.unit, row.w, row.r_back, row.r,
             row.weight)
        )  # fmt: skip
    if all(row.name[0] != "condition" for row in rejected):
        return table("rejected", _REJECTED, rows)
    names = [name_json(row.name) for row in rejected]
    whole = [(*row, one.get("id"), one.get("what")) for row, one in zip(rows, names, strict=True)]
    return table("rejected", (*_REJECTED, *for_programs("id", "what")), whole)


def _critical(cleaned: BlockFindings) -> Line:
    """Name the critical value of the strategy's test, at the end where it varies."""
    found = cleaned.findings
    value, f = _deciding(cleaned), found.at_end.redundancy
    what = _measure(found.strategy) if sigma_of(found.strategy) == "tau" else "w"
    if value is None:
        return say("no critical value of {} at redundancy {}", what, f)
    where = "" if what == "w" else say(" at redundancy {}", f)
    return say("critical value of {} {:.2f}{}", what, value, where)


def _deciding(cleaned: BlockFindings) -> float | None:
    found = cleaned.findings
    return deciding_critical(found.strategy, cleaned.settings.alpha, found.at_end.redundancy)


def _before_and_after(cleaned: BlockFindings) -> list[Block]:
    first, block = cleaned.first, cleaned.block
    after = say("{:.4f} without the rejected", block.sigma0)
    if first is not None:
        but = _BUT_HELD if cleaned.held else ""
        return [
            say("  sigma0 {:.4f} with all observations{}, {}; redundancy {} and {}", first.sigma0,
                but, after, first.redundancy, block.redundancy)
        ]  # fmt: skip
    return [
        say("  sigma0 {}; redundancy {}", after, block.redundancy),
        *_listed(
            say("{}; the search began without", cleaned.begun.reason),
            [
                *map(in_words, cleaned.begun.left_out),
                *(say("point {}", point) for point in cleaned.begun.points),
            ],
        ),
    ]


def _rejected_line(
    row: Rejection[ObservationName],
    width: int,
    strategy: str,
    why: Mapping[ObservationName, str],
) -> Line:
    scale, unit = SHOWN_UNITS[row.unit]
    error = None if row.error is None else row.error * scale
    sigma = None if row.sigma is None else row.sigma * scale
    ends = []
    if row.statistic is not None and row.critical is not None:
        if strategy == "search":
            ends.append(say("the sum falls by {:.2f}", -row.statistic))
        else:
            ends.append(
                say("{} {:.2f} above {:.2f}", _measure(strategy), row.statistic, row.critical)
            )
    elif row.order == 0:
        ends.append(say(why.get(row.name, "no solution is found with it")))
    if row.weight is not None:
        ends.append(say(", weight {:.2g}", row.weight))
    if row.partners:
        alike = named(map(_short, row.partners), _MOST, "", separator=", or ")
        ends.append(say("; or {}", alike))
    name = in_words(row.name)
    blank = " " * (width - len(line_text(name)))
    line = say(
        # the unit is a word of ours: it is one that lengths in px replace
        "  {:5c}  {}{}  {:10.1c}{:10.1c} " + unit + "{:{wide}.2c}{:8.3c}",
        *(row.order, name, blank, error, sigma, row.w, row.r),
        wide=11 - len(unit),
    )
    return sum(ends, line + "  ") if ends else line


def _measure(strategy: str) -> str:
    return {"tau": "tau", "rms": "v/rms", "huber": "v/sigma", "danish": "v/sigma"}.get(
        strategy, "w"
    )


def _odds(cleaned: BlockFindings) -> list[Block]:
    found, names = cleaned.findings, cleaned.names
    sigma0 = sigma0_in_words(found.strategy)
    weighed = f"all observations in{_but(cleaned)}, by the {sigma0} sigma0"
    page = _listed(
        say(
            "if there is one gross error at most, {}: none {:.1f} %",
            weighed,
            100.0 * found.odds.none,
        ),
        _probable(found.odds.rows, names),
    )
    odds = found.pair_odds
    if odds is None:
        return page
    page.append(
        say(
            "  odds over none, one and two, {}: no gross error {:.1f} %, one {:.1f} %, "
            "two {:.1f} %",
            weighed,
            100.0 * odds.none,
            100.0 * float(odds.single.sum()),
            100.0 * odds.pairs,
        )
    )
    page += _listed("one gross error", _probable(odds.single, names))
    return page + _listed(
        "two gross errors",
        [
            say("{:5.1f} %  {}  and  {}", 100.0 * p, in_words(names[a]), in_words(names[b]))
            for a, b, p in zip(
                odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True
            )
            if p >= _ODDS
        ],
    )


def _probable(odds: Array, names: Sequence[ObservationName]) -> list[Line]:
    """Return the observations that are probable enough, the most probable first."""
    return [say("{:5.1f} %  {}", 100.0 * odds[k], in_words(names[k])) for k in _most_probable(odds)]


def _most_probable(odds: Array) -> list[int]:
    """Return the rows that are probable enough, the most probable first."""
    enough = np.flatnonzero(odds >= _ODDS)
    rows: list[int] = enough[np.argsort(-odds[enough], kind="stable")].tolist()
    return rows


def _but(cleaned: BlockFindings) -> str:
    """Say which observations the search has not looked at."""
    if not cleaned.kept_out:
        return _BUT_HELD if cleaned.held else ""
    before = f"{_BUT_HELD} and" if cleaned.held else " but"
    return f"{before} those out from the beginning"


def _listed(title: str | Line, lines: list[Line]) -> list[Block]:
    if not lines:
        return []
    return [say("  {}:", title), Listed(tuple(say("    {}", line) for line in lines), _MOST)]


def _each(rows: Sequence[_T], one: Callable[[_T], Answer]) -> Sequence[Answer]:
    """Return what programs are told of each of thousands of rows: made when they ask, once."""
    made = cache(lambda: [*map(one, rows)])
    return Later(len(rows), lambda some: [made()[k] for k in some])


def _rejection_json(row: Rejection[ObservationName]) -> Answer:
    return {
        **name_json(row.name),
        "order": row.order,
        "statistic": row.statistic,
        "critical": row.critical,
        "error": row.error,
        "sigma": row.sigma,
        "unit": row.unit,
        "w": row.w,
        "r": row.r_back,
        "redundancy_number": row.r,
        "weight": row.weight,
        "partners": [name_json(name) for name in row.partners],
    }


def _json(cleaned: BlockFindings) -> Answer:
    """Return the rejected observations of a block for programs.

    Errors and sigmas in the unit that stands beside them.
    """
    found, names, settings = cleaned.findings, cleaned.names, cleaned.settings
    out: Answer = {
        "strategy": found.strategy,
        "alpha": settings.alpha,
        "power": settings.power,
        "critical": _deciding(cleaned),
        "partner": settings.partner,
        "passes": len(cleaned.passes),
        "sigma0_before": None if cleaned.first is None else cleaned.first.sigma0,
        "redundancy_before": None if cleaned.first is None else cleaned.first.redundancy,
        "no_solution": cleaned.begun.reason or None,
        "begun_without": _each(cleaned.begun.left_out, name_json),
        "points_left_out": list(cleaned.points),
        "rejected": _each(cleaned.rejected, _rejection_json),
        "ground": change_json(cleaned.point_change, "m"),
        "misnamed": [ray._asdict() for ray in cleaned.misnamed],
        "came_back": _each(cleaned.came_back, name_json),
        "hard_to_tell": _each(
            cleaned.hard_to_tell,
            lambda pair: {
                "rejected": name_json(pair[0]),
                "kept": name_json(pair[1]),
                "correlation": pair[2],
            },
        ),
        "untestable": _each(cleaned.untestable, name_json),
        "refused": [{**name_json(r.name), "reason": r.reason} for r in cleaned.refused],
        "steps": _each(found.steps, lambda step: _step_json(step, names)),
        "odds": {
            "sigma0": sigma0_in_words(found.strategy),
            "none": found.odds.none,
            "single": [
                {**name_json(names[k]), "probability": float(found.odds.rows[k])}
                for k in _most_probable(found.odds.rows)
            ],
        },
        "remarks": list(cleaned.remarks),
    }
    if found.model_values is not None:
        out["model_values"] = model_values_json(
            found.model_values, lambda row: name_json(names[row])
        )
    if found.pair_odds is not None:
        odds = found.pair_odds
        out["pair_odds"] = {
            "sigma0": sigma0_in_words(found.strategy),
            "none": odds.none,
            "one": float(odds.single.sum()),
            "two": odds.pairs,
            "single": [
                {**name_json(names[k]), "probability": float(odds.single[k])}
                for k in _most_probable(odds.single)
            ],
            "pairs": [
                {"first": name_json(names[a]), "second": name_json(names[b]), "probability": p}
                for a, b, p in zip(
                    odds.rows.tolist(),
                    odds.others.tolist(),
                    odds.probability.tolist(),
                    strict=True,
                )
            ],
        }
    return out


def _step_json(step: SearchStep, names: Sequence[ObservationName]) -> Answer:
    return {
        "action": step.action,
        "rows": [name_json(names[k]) for k in step.rows],
        "statistic": step.statistic,
        "critical": step.critical,
        "before": step.before,
        "after": step.after,
    }
