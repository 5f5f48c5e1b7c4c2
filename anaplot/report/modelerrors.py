"""Strips bridged without their gross errors: text and JSON."""

from __future__ import annotations

import json
import sys
from typing import Any

from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.grosserrors import CleanedModel, strip_gross_errors
from anaplot.orientation.strip import pooled_sigma_um
from anaplot.photogrammetry.block import Block
from anaplot.report.contract import bridge_json
from anaplot.report.printable import printable
from anaplot.report.text import model_printout

__all__ = ["errors_json", "errors_printout", "run_bridge_errors"]

Json = dict[str, Any]


def run_bridge_errors(block: Block, strategy: str, *, as_json: bool, fail_on_flag: bool) -> int:
    """Bridge every strip with a strategy for gross errors and print it.

    Returns
    -------
    int
        Exit code: 4 when a model cannot be computed, 1 for `fail_on_flag` with rejected or flagged
        rows, else 0.
    """
    strips = [strip_gross_errors(block, strip, strategy) for strip in block.strips]
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
        lines.append(line)
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
    return "\n".join(lines)


def errors_json(cleaned: CleanedModel) -> Json:
    """Return the rejected rows of a model for programs."""
    return {
        "strategy": cleaned.findings[0].strategy,
        "rejected": [row._asdict() for row in cleaned.rejected],
        "came_back": [{"point": p, "axis": a} for p, a in cleaned.came_back],
        "hard_to_tell": [
            {"rejected": list(a), "kept": list(b), "correlation": rho}
            for a, b, rho in cleaned.hard_to_tell
        ],
        "untestable": [{"point": p, "axis": a} for p, a in _untestable(cleaned)],
        "passes": len(cleaned.findings),
    }


def _untestable(cleaned: CleanedModel) -> list[tuple[str, str]]:
    return [row.key for row in cleaned.solution.table if row.sigf is None]
