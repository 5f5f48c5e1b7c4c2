"""The NRC printout: what the operator of the ANAPLOT saw after each model (1983, Figure 6)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import degrees

from anaplot.adjustment.tested import Observation
from anaplot.orientation.results import Diagnosis, ModelSolution, Row
from anaplot.report.columns import cell
from anaplot.textfiles.wording import plain

__all__ = ["model_printout", "table_lines", "verdict"]

_PER_LINE = 6


def verdict(row: Observation[Row], accused: tuple[str, str] | None) -> str:
    """Return what a row's test says, in a word; `accused` is the row most probably wrong."""
    if row.key == accused:
        return "<< REMEASURE"
    if row.flagged:
        return "< flagged"
    if row.w is None:
        return "not testable"
    return ""


def table_lines(
    table: Iterable[Observation[Row]], suspects: Sequence[tuple[str, str]] = ()
) -> list[str]:
    """Return the RED-N / PARX / EXPD / SIGF table, a line each, with a heading.

    Parameters
    ----------
    table
        The rows.
    suspects
        Rows to doubt, the most probably wrong first.
    """
    accused = suspects[0] if suspects else None
    rows = list(table)
    width = max([5, *(len(plain(row.point)) for row in rows)])
    lines = [
        f"  {'POINT':<{width}}     RED-N    PARX    EXPD    SIGF",
        f"  {'':<{width}}{'um':>17}{'um':>8}",
    ]
    for row in rows:
        line = (
            f"  {plain(row.point):<{width}}  {row.axis}  {row.r:6.3f}"
            f"{cell(row.residual, 1, 8)}{cell(row.expected, 1, 8)}{cell(row.size, 2, 8)}"
            f"  {verdict(row, accused)}"
        )
        lines.append(line.rstrip())
    return lines


def _discrepancies(title: str, rows: list[Observation[Row]]) -> list[str]:
    if not rows:
        return []
    width = max(len(plain(row.point)) for row in rows)
    cells = [f"{plain(row.point):>{width}} {row.residual:8.1f}" for row in rows]
    lines = [f"  {title}"]
    lines += ["  " + "   ".join(cells[k : k + _PER_LINE]) for k in range(0, len(cells), _PER_LINE)]
    return lines


def model_printout(
    model: ModelSolution,
    diagnosis: Diagnosis,
    *,
    strip: str,
    number: int,
    count: int,
    pooled_um: float | None = None,
) -> str:
    """Return the printout of one model.

    Parameters
    ----------
    model, diagnosis
        The model and what is said of it.
    strip, number, count
        Name of the strip, which of its models this is (from 1), how many it has.
    pooled_um
        sigma0 pooled over the strip's models so far [um].
    """
    omega, phi, kappa = (degrees(angle) for angle in model.rotation)
    bx, by, bz = model.base
    critical = "none" if model.test.critical is None else f"{model.test.critical:.2f}"
    sigma0 = "none" if model.sigma0_um is None else f"{model.sigma0_um:.2f} um"
    lines = [
        f"STRIP {plain(strip)}  MODEL {plain(model.left)}/{plain(model.right)}"
        f"  ({number} of {count})",
        f"  base      bx {bx:.4f}  by {by:.4f}  bz {bz:.4f} mm",
        f"  rotation  omega {omega:.5f}  phi {phi:.5f}  kappa {kappa:.5f} deg",
        f"  sigma0    {sigma0}, a priori {model.apriori_um:g} um, redundancy {model.redundancy}"
        + (f", pooled {pooled_um:.2f} um" if pooled_um is not None else ""),
        f"  test      {model.test.kind}, alpha {model.test.alpha:g}, critical value {critical}"
        + (f"; tie variance {model.tie_variance}" if model.ties else ""),
        "",
    ]
    lines += _discrepancies("PARALLAXES [um]", [row for row in model.table if row.axis == "y"])
    lines += _discrepancies(
        "TIE DISCREPANCIES [um]", [row for row in model.table if row.axis == "x"]
    )
    lines += ["", *table_lines(model.table, diagnosis.suspects), ""]
    lines += [f"  {plain(sentence)}" for sentence in diagnosis.advice]
    return "\n".join(lines)
