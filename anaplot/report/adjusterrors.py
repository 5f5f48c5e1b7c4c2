"""A block without its gross errors: what was rejected and why, as text and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from anaplot.adjustment.findings import SearchStep
from anaplot.adjustment.strategies import deciding_critical, sigma_of
from anaplot.adjustment.tested import Odds
from anaplot.adjustment.watch import Watch
from anaplot.bundle.errors.controllast import ControlLast, clean_control_last
from anaplot.bundle.errors.grosserrors import BlockFindings, RejectedObservation, block_gross_errors
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.residuals import ObservationName
from anaplot.photogrammetry.block import Block
from anaplot.report.columns import cell, column, counted
from anaplot.report.groundchange import change_json, change_lines
from anaplot.report.modelvalues import model_values_json, model_values_line
from anaplot.report.searchoptions import search_settings, sigma0_in_words
from anaplot.textfiles.wording import plain

__all__ = [
    "block_errors_json",
    "block_errors_printout",
    "clean_block",
    "clean_step_by_step",
]

Json = dict[str, Any]

_MOST = 30  # rows of a list in the text; JSON holds them all
_ODDS = 0.01  # smallest probability shown
_BUT_HELD = " but those rejected before"
_DIGITS = {"um": (1.0, "um"), "m": (1e3, "mm"), "rad": (1e6, "urad"), "mm": (1e3, "um")}


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
    block: Block,
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


def _named(name: ObservationName) -> str:
    """Return an observation in words, without control characters."""
    kind, *rest = name
    words = [plain(part) if part is not None else "" for part in rest]
    if kind == "image":
        photo, point, model, axis = words
        inside = f" in {model}" if model else ""
        return f"photo {photo}{inside}  point {point}  {axis}"
    if kind == "control":
        return f"control point {words[0]}  {words[1]}"
    return f"prior of {words[0]}  {words[1]}"


def _short(name: ObservationName) -> str:
    """Return a partner in words: its point is that of the row that it stands beside."""
    if name[0] == "image":
        return f"{name[4]} of photo {plain(str(name[1]))}"
    return _named(name)


def _name_json(name: ObservationName) -> Json:
    keys = {
        "image": ("photo", "point", "model", "axis"),
        "control": ("point", "axis"),
        "prior": ("owner", "unknown"),
    }[str(name[0])]
    return {"kind": name[0], **dict(zip(keys, name[1:], strict=True))}


def block_errors_printout(cleaned: BlockFindings) -> str:
    """Return the rejected observations of a block as text.

    Estimated errors in micrometres (image), millimetres (control) or microradians (priors).
    """
    found, names, settings = cleaned.findings, cleaned.system.names, cleaned.settings
    rejected = cleaned.rejected
    many = "1 observation is" if len(rejected) == 1 else f"{len(rejected)} observations are"
    lines = [
        f"GROSS ERRORS ({found.strategy})",
        f"  alpha {settings.alpha:g}, {_critical(cleaned)}; "
        f"{many} rejected after {counted(len(cleaned.passes), 'pass', 'passes')}",
        *_before_and_after(cleaned),
    ]
    if rejected:
        width = max(len(_named(row.name)) for row in rejected)
        lines.append(
            f"  ORDER  {'OBSERVATION':<{width}}       ERROR     SIGMA           w   RED-N  BECAUSE"
        )
        lines += [_rejected_line(row, width, found.strategy) for row in rejected]
    else:
        lines.append("  nothing is rejected")
    if rejected:
        lines += [f"  {line}" for line in change_lines(cleaned.point_change, "on the ground", "m")]
    lines += _listed("rejected on the way, came back", [_named(name) for name in cleaned.came_back])
    lines += _listed(
        f"hard to tell apart (correlation of residuals {settings.partner:g} or more)",
        [
            f"{_named(names[a])} is rejected, {_named(names[b])} is kept (correlation {rho:.2f})"
            for a, b, rho in found.hard_to_tell
        ],
    )
    lines += _listed(
        "cannot be left out", [f"{_named(r.name)}: {plain(r.reason)}" for r in cleaned.refused]
    )
    lines += _listed(
        "cannot be tested: nothing checks them", [_named(name) for name in cleaned.untestable]
    )
    lines += _odds(cleaned)
    if found.model_values is not None:
        lines.append(f"  {model_values_line(found.model_values)}")
    lines += [f"  note: {plain(remark)}" for remark in cleaned.remarks]
    return "\n".join(lines)


def _critical(cleaned: BlockFindings) -> str:
    """Name the critical value of the strategy's test, at the end where it varies."""
    found = cleaned.findings
    value, f = _deciding(cleaned), found.at_end.redundancy
    what = _measure(found.strategy) if sigma_of(found.strategy) == "tau" else "w"
    if value is None:
        return f"no critical value of {what} at redundancy {f}"
    where = "" if what == "w" else f" at redundancy {f}"
    return f"critical value of {what} {value:.2f}{where}"


def _deciding(cleaned: BlockFindings) -> float | None:
    found = cleaned.findings
    return deciding_critical(found.strategy, cleaned.settings.alpha, found.at_end.redundancy)


def _before_and_after(cleaned: BlockFindings) -> list[str]:
    first, block = cleaned.first, cleaned.block
    after = f"{_number(block.sigma0, 4)} without the rejected"
    if first is not None:
        but = _BUT_HELD if cleaned.held else ""
        return [
            f"  sigma0 {_number(first.sigma0, 4)} with all observations{but}, {after}; redundancy "
            f"{first.redundancy} and {block.redundancy}"
        ]
    return [
        f"  sigma0 {after}; redundancy {block.redundancy}",
        *_listed(
            f"{plain(cleaned.begun.reason)}; the search began without",
            [_named(name) for name in cleaned.begun.left_out],
        ),
    ]


def _rejected_line(row: RejectedObservation, width: int, strategy: str) -> str:
    scale, unit = _DIGITS[row.unit]
    error = None if row.error is None else row.error * scale
    sigma = None if row.sigma is None else row.sigma * scale
    because = "no solution is found with it" if row.order == 0 else ""
    if row.statistic is not None and row.critical is not None:
        if strategy == "search":
            because = f"the sum falls by {-row.statistic:.2f}"
        else:
            because = f"{_measure(strategy)} {row.statistic:.2f} above {row.critical:.2f}"
    weight = "" if row.weight is None else f", weight {row.weight:.2g}"
    alike = f"; or {', or '.join(map(_short, row.partners[:_MOST]))}" if row.partners else ""
    return (
        f"  {column(row.order, 5)}  {_named(row.name):<{width}}  {cell(error, 1, 10)}"
        f"{cell(sigma, 1, 10)} {unit}{cell(row.w, 2, 11 - len(unit))}"
        f"{cell(row.r_rejected, 3, 8)}  {because}{weight}{alike}"
    ).rstrip()


def _measure(strategy: str) -> str:
    return {"tau": "tau", "rms": "v/rms", "huber": "v", "danish": "v"}.get(strategy, "w")


def _odds(cleaned: BlockFindings) -> list[str]:
    found, names = cleaned.findings, cleaned.system.names
    sigma0 = sigma0_in_words(found.strategy)
    weighed = f"all observations in{_but(cleaned)}, by the {sigma0} sigma0"
    lines = _single_odds(found.odds, names, weighed)
    odds = found.pair_odds
    if odds is None:
        return lines
    lines.append(
        f"  odds over none, one and two, {weighed}: "
        f"no gross error {100.0 * odds.none:.1f} %, one "
        f"{100.0 * float(odds.single.sum()):.1f} %, two {100.0 * odds.pairs:.1f} %"
    )
    singles = np.argsort(-odds.single, kind="stable")
    shown = [k for k in singles.tolist() if odds.single[k] >= _ODDS]
    lines += _listed(
        "one gross error", [f"{100.0 * odds.single[k]:5.1f} %  {_named(names[k])}" for k in shown]
    )
    lines += _listed(
        "two gross errors",
        [
            f"{100.0 * p:5.1f} %  {_named(names[a])}  and  {_named(names[b])}"
            for a, b, p in zip(
                odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True
            )
            if p >= _ODDS
        ],
    )
    return lines


def _but(cleaned: BlockFindings) -> str:
    """Say which observations the search has not looked at."""
    if not cleaned.kept_out:
        return _BUT_HELD if cleaned.held else ""
    return (f"{_BUT_HELD} and" if cleaned.held else " but") + " those no solution is found with"


def _single_odds(odds: Odds, names: tuple[ObservationName, ...], weighed: str) -> list[str]:
    order = np.argsort(-odds.rows, kind="stable")
    shown = [k for k in order.tolist() if odds.rows[k] >= _ODDS]
    return _listed(
        f"if there is one gross error at most, {weighed}: none {100.0 * odds.none:.1f} %",
        [f"{100.0 * odds.rows[k]:5.1f} %  {_named(names[k])}" for k in shown],
    )


def _listed(title: str, rows: list[str]) -> list[str]:
    if not rows:
        return []
    lines = [f"  {title}:", *(f"    {row}" for row in rows[:_MOST])]
    if len(rows) > _MOST:
        lines.append(f"    and {len(rows) - _MOST} more")
    return lines


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def block_errors_json(cleaned: BlockFindings) -> Json:
    """Return the rejected observations of a block for programs.

    Errors and sigmas in the unit that stands beside them.
    """
    found, names, settings = cleaned.findings, cleaned.system.names, cleaned.settings
    out: Json = {
        "strategy": found.strategy,
        "alpha": settings.alpha,
        "power": settings.power,
        "critical": _deciding(cleaned),
        "partner": settings.partner,
        "passes": len(cleaned.passes),
        "sigma0_before": None if cleaned.first is None else cleaned.first.sigma0,
        "redundancy_before": None if cleaned.first is None else cleaned.first.redundancy,
        "no_solution": cleaned.begun.reason or None,
        "begun_without": [_name_json(name) for name in cleaned.begun.left_out],
        "rejected": [
            {
                **_name_json(row.name),
                "order": row.order,
                "statistic": row.statistic,
                "critical": row.critical,
                "error": row.error,
                "sigma": row.sigma,
                "unit": row.unit,
                "w": row.w,
                "r": row.r,
                "redundancy_number": row.r_rejected,
                "weight": row.weight,
                "partners": [_name_json(name) for name in row.partners],
            }
            for row in cleaned.rejected
        ],
        "ground": change_json(cleaned.point_change, "m"),
        "came_back": [_name_json(name) for name in cleaned.came_back],
        "hard_to_tell": [
            {"rejected": _name_json(names[a]), "kept": _name_json(names[b]), "correlation": rho}
            for a, b, rho in found.hard_to_tell
        ],
        "untestable": [_name_json(name) for name in cleaned.untestable],
        "refused": [{**_name_json(r.name), "reason": r.reason} for r in cleaned.refused],
        "steps": [_step_json(step, names) for step in found.steps],
        "odds": {
            "sigma0": sigma0_in_words(found.strategy),
            "none": found.odds.none,
            "single": [
                {**_name_json(names[k]), "probability": float(found.odds.rows[k])}
                for k in np.argsort(-found.odds.rows, kind="stable").tolist()
                if found.odds.rows[k] >= _ODDS
            ],
        },
        "remarks": list(cleaned.remarks),
    }
    if found.model_values is not None:
        out["model_values"] = model_values_json(
            found.model_values, lambda row: _name_json(names[row])
        )
    if found.pair_odds is not None:
        odds = found.pair_odds
        out["pair_odds"] = {
            "sigma0": sigma0_in_words(found.strategy),
            "none": odds.none,
            "one": float(odds.single.sum()),
            "two": odds.pairs,
            "single": [
                {**_name_json(names[k]), "probability": float(odds.single[k])}
                for k in np.argsort(-odds.single, kind="stable").tolist()
                if odds.single[k] >= _ODDS
            ],
            "pairs": [
                {"first": _name_json(names[a]), "second": _name_json(names[b]), "probability": p}
                for a, b, p in zip(
                    odds.rows.tolist(),
                    odds.others.tolist(),
                    odds.probability.tolist(),
                    strict=True,
                )
            ],
        }
    return out


def _step_json(step: SearchStep, names: tuple[ObservationName, ...]) -> Json:
    return {
        "action": step.action,
        "rows": [_name_json(names[k]) for k in step.rows],
        "statistic": step.statistic,
        "critical": step.critical,
        "before": step.before,
        "after": step.after,
    }
