"""Strips bridged without their gross errors: text and JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anaplot.adjustment.advice import hard_to_tell_apart
from anaplot.adjustment.watch import Watch
from anaplot.errors import NotComputableError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.grosserrors import CleanedModel, RejectedRow, strip_gross_errors
from anaplot.orientation.strip import pooled_sigma_um
from anaplot.photogrammetry.block import Block
from anaplot.report.astext import line_text
from anaplot.report.contract import bridge_json
from anaplot.report.groundchange import change_json, change_lines
from anaplot.report.interrupts import ending_early
from anaplot.report.modelvalues import model_values_json, model_values_line
from anaplot.report.progress import ProgressLine
from anaplot.report.searchoptions import search_settings, sigma0_in_words
from anaplot.report.text import model_printout
from anaplot.textfiles.wording import plain

__all__ = ["errors_json", "errors_printout", "run_bridge_errors"]

Json = dict[str, Any]

_SHOWN_ODDS = 0.01  # smallest probability in the text


def run_bridge_errors(
    block: Block,
    strategy: str,
    *,
    as_json: bool,
    fail_on_flag: bool,
    partner: float | None = None,
    pairs: bool = False,
    as_given: bool = False,
) -> int:
    """Bridge every strip with a strategy for gross errors and print it.

    Parameters
    ----------
    block
        The block.
    strategy
        Name of the strategy.
    as_json, fail_on_flag
        As the command has them.
    partner
        Residual correlation from which two rows are hard to tell apart; None: the default.
    pairs
        Whether the odds over pairs of gross errors are added.
    as_given
        Whether it cleans also where the a-priori sigma0 cannot be right.

    Returns
    -------
    int
        Exit code: 4 when a model cannot be computed, 1 for `fail_on_flag` with rejected or flagged
        rows, else 0.
    """
    settings = search_settings(block.test, partner, pairs=pairs)
    with (
        ProgressLine(sys.stderr) as progress,
        ending_early(Watch(progress), sys.stderr) as watch,
    ):
        strips = [
            strip_gross_errors(block, strip, strategy, settings, as_given=as_given, watch=watch)
            for strip in block.strips
        ]
    if as_json:
        answer = bridge_json(strip.bridged for strip in strips)
        for item, strip in zip(answer["strips"], strips, strict=True):
            for model, cleaned in zip(item["models"], strip.models, strict=True):
                model["errors"] = errors_json(cleaned)
        print(json.dumps(answer, indent=1, allow_nan=False))
    else:
        for strip, declared in zip(strips, block.strips, strict=True):
            models = strip.bridged.models
            for k, cleaned in enumerate(strip.models):
                print(
                    model_printout(
                        cleaned.solution,
                        diagnose(cleaned.solution),
                        strip=strip.bridged.strip,
                        number=k + 1,
                        count=len(declared.models()),
                        pooled_um=pooled_sigma_um(models[: k + 1]),
                    )
                )
                print(errors_printout(cleaned), end="\n\n")
    errors = [strip.bridged.error for strip in strips if strip.bridged.error is not None]
    for error in errors:
        print(f"anaplot: {plain(error)}", file=sys.stderr)
    if errors:
        return NotComputableError.exit_code
    found = any(m.rejected or m.solution.flagged for strip in strips for m in strip.models)
    return 1 if fail_on_flag and found else 0


def errors_printout(cleaned: CleanedModel) -> str:
    """Return the rejected rows of a model as text."""
    found = cleaned.findings
    lines = [f"  GROSS ERRORS ({found.strategy})"]
    if cleaned.begun_without:
        lines.append(f"    far off, the search began without: {_listed(cleaned.begun_without)}")
    for row in cleaned.rejected:
        line = f"    {plain(row.point)} {row.axis}  rejected"
        if row.w is None:
            line += ": with it the orientation goes astray, and the others cannot test it"
        else:
            line += f"  RED-N {row.r:.3f}  PARX {row.residual:.1f} um  w {row.w:.2f} with it in"
        lines.append(line + _because(row, found.strategy))
    if cleaned.came_back:
        lines.append(f"    left out on the way, came back: {_listed(cleaned.came_back)}")
    if not cleaned.rejected:
        lines.append("    nothing is rejected")
    else:
        lines += [
            line_text(line)
            for line in change_lines(cleaned.point_change, "in the model", "mm", indent=4)
        ]
    for (point, axis), (other, other_axis), rho in cleaned.hard_to_tell:
        alike = hard_to_tell_apart((plain(point), axis), (plain(other), other_axis), rho)
        lines.append(f"    {alike}")
    for key, reason in cleaned.refused:
        lines.append(f"    {_listed((key,))} cannot be left out: {plain(reason)}")
    blind = _untestable(cleaned)
    if blind:
        lines.append(f"    cannot be tested: {_listed(blind)}")
    if found.model_values is not None:
        lines.append(f"    {line_text(model_values_line(found.model_values))}")
    lines += _odds_lines(cleaned)
    lines += [f"    note: {plain(remark)}" for remark in cleaned.remarks]
    return "\n".join(lines)


def _listed(keys: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{plain(point)} {axis}" for point, axis in keys)


def _because(row: RejectedRow, strategy: str) -> str:
    """Return when a row went and what decided."""
    if row.order == 0:
        return "" if row.w is None else "; with it the orientation goes astray"
    if row.statistic is None or row.critical is None:
        return f"; step {row.order}"
    if strategy == "search":
        return f"; step {row.order}, the sum falls by {-row.statistic:.1f}"
    return f"; step {row.order}, {row.statistic:.2f} above {row.critical:.2f}"


def _odds_lines(cleaned: CleanedModel) -> list[str]:
    """Return the odds over single errors, all rows in, and over pairs where asked for."""
    found, keys = cleaned.findings, cleaned.residuals.keys
    single = found.odds
    but = " but those far off" if cleaned.held else ""
    weighed = f"all rows in{but}, by the {sigma0_in_words(found.strategy)} sigma0"
    lines = [
        f"    if there is one gross error at most, {weighed}: none {100.0 * single.none:.1f} %"
    ]
    for row in np.argsort(-single.rows, kind="stable").tolist():
        if single.rows[row] >= _SHOWN_ODDS:
            lines.append(f"      {100.0 * single.rows[row]:5.1f} %  {_listed((keys[row],))}")
    odds = found.pair_odds
    if odds is None:
        return lines
    lines.append(
        f"    odds over none, one and two, {weighed}: none {100.0 * odds.none:.1f} %, one "
        f"{100.0 * float(odds.single.sum()):.1f} %, two {100.0 * odds.pairs:.1f} %"
    )
    for a, b, chance in zip(
        odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True
    ):
        if chance >= _SHOWN_ODDS:
            pair = f"{_listed((keys[a],))} and {_listed((keys[b],))}"
            lines.append(f"      {100.0 * chance:5.1f} %  {pair}")
    return lines


def _pair_odds_json(cleaned: CleanedModel) -> Json | None:
    odds, keys = cleaned.findings.pair_odds, cleaned.residuals.keys
    if odds is None:
        return None
    return {
        "sigma0": sigma0_in_words(cleaned.findings.strategy),
        "none": odds.none,
        "single": _probabilities(cleaned, odds.single),
        "pairs": [
            {"first": list(keys[a]), "second": list(keys[b]), "probability": float(v)}
            for a, b, v in zip(
                odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True
            )
        ],
    }


def _probabilities(cleaned: CleanedModel, values: NDArray[np.float64]) -> list[Json]:
    """Return the probability of every row that was weighed."""
    return [
        {**_key_json(key), "probability": value}
        for key, value in zip(cleaned.residuals.keys, values.tolist(), strict=True)
        if key not in cleaned.held
    ]


def _key_json(key: tuple[str, str]) -> Json:
    return {"point": key[0], "axis": key[1]}


def _rejected_json(row: RejectedRow) -> Json:
    return {
        "point": row.point,
        "axis": row.axis,
        "w": row.w,
        "parx_um": row.residual,
        "redn": row.r,
        "order": row.order,
        "statistic": row.statistic,
        "critical": row.critical,
        "error_um": row.error_um,
    }


def errors_json(cleaned: CleanedModel) -> Json:
    """Return the rejected rows of a model for programs."""
    found, keys = cleaned.findings, cleaned.residuals.keys
    out = {
        "strategy": found.strategy,
        "begun_without": [_key_json(key) for key in cleaned.begun_without],
        "rejected": [_rejected_json(row) for row in cleaned.rejected],
        "ground": change_json(cleaned.point_change, "mm"),
        "came_back": [_key_json(key) for key in cleaned.came_back],
        "hard_to_tell": [
            {"rejected": list(a), "kept": list(b), "correlation": rho}
            for a, b, rho in cleaned.hard_to_tell
        ],
        "refused": [{**_key_json(key), "reason": reason} for key, reason in cleaned.refused],
        "untestable": [_key_json(key) for key in _untestable(cleaned)],
        "passes": len(cleaned.passes),
        "evidence": [
            {
                "pass": number,
                **_key_json(keys[gone.row]),
                "order": gone.order,
                "statistic": gone.statistic,
                "critical": gone.critical,
                "redundancy_number": gone.r,
            }
            for number, one in enumerate(cleaned.passes, 1)
            for gone in one.rejected
        ],
        "held": [_key_json(key) for key in sorted(cleaned.held)],
        "odds": {
            "sigma0": sigma0_in_words(found.strategy),
            "none": found.odds.none,
            "single": _probabilities(cleaned, found.odds.rows),
        },
        "pair_odds": _pair_odds_json(cleaned),
        "remarks": list(cleaned.remarks),
    }
    if found.model_values is not None:
        out["model_values"] = model_values_json(
            found.model_values, lambda row: _key_json(keys[row])
        )
    return out


def _untestable(cleaned: CleanedModel) -> list[tuple[str, str]]:
    return [row.key for row in cleaned.solution.table if row.w is None]
