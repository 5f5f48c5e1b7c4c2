"""Strips bridged without their gross errors: text and JSON."""

from __future__ import annotations

import json
import sys
from typing import Any

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.grosserrors import CleanedModel, strip_gross_errors
from anaplot.orientation.strip import pooled_sigma_um
from anaplot.photogrammetry.block import Block
from anaplot.report.contract import bridge_json
from anaplot.report.modelvalues import model_values_json, model_values_line
from anaplot.report.printable import printable
from anaplot.report.text import model_printout

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

    Returns
    -------
    int
        Exit code: 4 when a model cannot be computed, 1 for `fail_on_flag` with rejected or flagged
        rows, else 0.
    """
    settings = SearchSettings(
        alpha=block.test.alpha,
        power=block.test.power,
        partner=HARD_TO_TELL if partner is None else partner,
        pairs=pairs,
    )
    strips = [strip_gross_errors(block, strip, strategy, settings) for strip in block.strips]
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
                        diagnose(cleaned.solution, block.test.power),
                        strip=strip.bridged.strip,
                        number=k + 1,
                        count=len(declared.models()),
                        pooled_um=pooled_sigma_um(models[: k + 1]),
                    )
                )
                print(errors_printout(cleaned), end="\n\n")
    errors = [strip.bridged.error for strip in strips if strip.bridged.error is not None]
    for error in errors:
        print(f"anaplot: {printable(error)}", file=sys.stderr)
    if errors:
        return 4
    found = any(m.rejected or m.solution.flagged for strip in strips for m in strip.models)
    return 1 if fail_on_flag and found else 0


def errors_printout(cleaned: CleanedModel) -> str:
    """Return the rejected rows of a model as text."""
    lines = [f"  GROSS ERRORS ({cleaned.findings[0].strategy})"]
    for row in cleaned.rejected:
        line = f"    {printable(row.point)} {row.axis}  rejected"
        if row.w is None:
            line += ": no orientation with it that could be tested"
        else:
            line += f"  RED-N {row.redn:.3f}  PARX {row.parx_um:.1f} um  w {row.w:.2f} with it in"
        lines.append(line + _because(cleaned, (row.point, row.axis)))
    for point, axis in cleaned.came_back:
        lines.append(f"    {printable(point)} {axis}  rejected at first, came back")
    if not cleaned.rejected:
        lines.append("    nothing is rejected")
    for (point, axis), (other, other_axis), rho in cleaned.hard_to_tell:
        lines.append(
            f"    {printable(point)} {axis} and {printable(other)} {other_axis} are hard to tell "
            f"apart (correlation {rho:.2f})"
        )
    blind = [f"{printable(p)} {a}" for p, a in _untestable(cleaned)]
    if blind:
        lines.append(f"    cannot be tested: {', '.join(blind)}")
    values = cleaned.findings[0].model_values
    if values is not None:
        lines.append(f"    {model_values_line(values)}")
    lines += _odds_lines(cleaned)
    lines += [f"    note: {printable(remark)}" for remark in cleaned.remarks]
    return "\n".join(lines)


def _because(cleaned: CleanedModel, key: tuple[str, str]) -> str:
    """Return when a row went and what decided; a row may go again in a later pass."""
    for number, found in reversed(list(enumerate(cleaned.findings, 1))):
        for gone in found.rejected:
            if gone.name != key:
                continue
            when = f"; pass {number}, step {gone.order}"
            if gone.statistic is None or gone.critical is None:
                return when
            if found.strategy in ("search", "odds"):
                return f"{when}, the sum falls by {-gone.statistic:.1f}"
            return f"{when}, {gone.statistic:.2f} above {gone.critical:.2f}"
    return "; so far off that there is no orientation with it"


def _odds_lines(cleaned: CleanedModel) -> list[str]:
    """Return the odds over pairs, all rows in, where they were asked for."""
    odds = cleaned.findings[0].pair_odds
    if odds is None:
        return []
    keys = cleaned.first_rows
    lines = [
        f"    odds over none, one and two, all rows in: none {100.0 * odds.none:.1f} %, one "
        f"{100.0 * float(odds.single.sum()):.1f} %, two {100.0 * odds.pairs:.1f} %"
    ]
    for a, b, chance in zip(
        odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True
    ):
        if chance >= _SHOWN_ODDS:
            (one, axis), (other, other_axis) = keys[a], keys[b]
            lines.append(
                f"      {100.0 * chance:5.1f} %  {printable(one)} {axis} and "
                f"{printable(other)} {other_axis}"
            )
    return lines


def _pair_odds_json(cleaned: CleanedModel) -> Json | None:
    odds, keys = cleaned.findings[0].pair_odds, cleaned.first_rows
    if odds is None:
        return None
    return {
        "none": odds.none,
        "single": [
            {"point": p, "axis": a, "probability": float(v)}
            for (p, a), v in zip(keys, odds.single.tolist(), strict=True)
        ],
        "pairs": [
            {"first": list(keys[a]), "second": list(keys[b]), "probability": float(v)}
            for a, b, v in zip(
                odds.rows.tolist(), odds.others.tolist(), odds.probability.tolist(), strict=True
            )
        ],
    }


def errors_json(cleaned: CleanedModel) -> Json:
    """Return the rejected rows of a model for programs."""
    out = {
        "strategy": cleaned.findings[0].strategy,
        "rejected": [row._asdict() for row in cleaned.rejected],
        "came_back": [{"point": p, "axis": a} for p, a in cleaned.came_back],
        "hard_to_tell": [
            {"rejected": list(a), "kept": list(b), "correlation": rho}
            for a, b, rho in cleaned.hard_to_tell
        ],
        "untestable": [{"point": p, "axis": a} for p, a in _untestable(cleaned)],
        "passes": len(cleaned.findings),
        "evidence": [
            {
                "pass": number,
                "point": gone.name[0],
                "axis": gone.name[1],
                "order": gone.order,
                "statistic": gone.statistic,
                "critical": gone.critical,
                "redundancy_number": gone.redundancy_number,
            }
            for number, found in enumerate(cleaned.findings, 1)
            for gone in found.rejected
            if isinstance(gone.name, tuple)
        ],
        "pair_odds": _pair_odds_json(cleaned),
        "remarks": list(cleaned.remarks),
    }
    first = cleaned.findings[0].model_values
    if first is not None:
        out["model_values"] = model_values_json(
            first, lambda row: dict(zip(("point", "axis"), cleaned.first_rows[row], strict=True))
        )
    return out


def _untestable(cleaned: CleanedModel) -> list[tuple[str, str]]:
    return [row.key for row in cleaned.solution.table if row.sigf is None]
