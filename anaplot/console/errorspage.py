"""What a strategy for gross errors finds in the model in work: a page, and a line of advice."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.content import Content

from anaplot.console.dialogs import Page
from anaplot.console.text import cell, fit, fit_end, number, wrap
from anaplot.orientation.results import ModelSolution
from anaplot.textfiles.wording import plain

if TYPE_CHECKING:
    from anaplot.adjustment.findings import Findings, SearchStep

__all__ = [
    "ABOUT",
    "CHOICES",
    "FIRST",
    "ErrorsPage",
    "errors_line",
    "errors_lines",
    "model_findings",
]

FIRST = "search"
"""The strategy that the page begins with."""

ABOUT = {
    "baarda": "the largest w beyond its critical value goes, one row a step",
    "tau": "the same with the estimated sigma0 and Pope's critical value",
    "rms": "PARX over its root mean square, all beyond the critical value at once",
    "modified": "as baarda by the redundancy numbers of the ideal model, its own only in doubt",
    "huber": "re-weighting, what lies far off counts less",
    "danish": "re-weighting, what lies far off soon counts nothing",
    "l1": "the least absolute sum of residuals, what it leaves far off tested one by one",
    "search": "the best set of rows, found by adding, dropping and exchanging rows",
    "odds": "the most probable set of rows, the sizes of errors learned from the residuals",
}
CHOICES = tuple(ABOUT)
"""Strategies in the order of the page."""

_ROW, _SHOWN_STEPS = 18, 40
_BENDS = 30.0  # w beyond which the second order shows in what the linearised model says


def model_findings(solution: ModelSolution, strategy: str) -> Findings | None:
    """Run a strategy on a model as it is oriented now; None where nothing can be tested."""
    if solution.redundancy < 1:
        return None
    # loaded when a strategy is asked for, not with the first screen
    from anaplot.orientation.grosserrors import strategy_findings

    return strategy_findings(solution, strategy)


def errors_line(solution: ModelSolution | None, strategy: str | None) -> str:
    """Return the line of advice for a chosen strategy, or "" when it has nothing to say."""
    if solution is None or strategy is None:
        return ""
    found = model_findings(solution, strategy)
    if found is None or not found.rows:
        return ""
    rows = ", ".join(_name(solution, row) for row in found.rows)
    return f"{strategy} rejects: {rows}"


def _name(solution: ModelSolution, row: int) -> str:
    point, axis = solution.table[row].key
    return f"{plain(point)} {axis}"


def errors_lines(solution: ModelSolution | None, strategy: str, width: int) -> list[Content]:
    """Return the page of a strategy.

    Parameters
    ----------
    solution
        The model as far as measured; None while it is not determined.
    strategy
        One of `CHOICES`.
    width
        Cells of a line.
    """
    names = "   ".join(f"[{name}]" if name == strategy else name for name in CHOICES)
    lines = [Content.styled(fit(names, width), "bold $text-accent")]
    lines += [Content(line) for line in wrap(f"{strategy}: {ABOUT[strategy]}.", width)]
    lines.append(Content(""))
    found = None if solution is None else model_findings(solution, strategy)
    if solution is None or found is None:
        return [*lines, Content("No row of this model can be tested yet.")]
    if solution.outliers:
        text = f"{', '.join(plain(p) for p in solution.outliers)} pulls the orientation far away: "
        lines += [Content(line) for line in wrap(text + "remeasure it before all else.", width)]
    lines += _rejected(solution, found, width)
    lines += _evidence(solution, found, width)
    sigma0 = found.at_end.sigma0
    left = "" if sigma0 is None else f"sigma0 {sigma0 * solution.apriori_um:.2f} µm, "
    lines += [
        Content(""),
        Content(fit(f"without them: {left}redundancy {found.at_end.redundancy}", width)),
    ]
    if any(abs(found.at_end.w[row]) > _BENDS for row in found.rows):
        text = "Errors this large bend the model: remeasure the first row, then look again."
        lines += [Content(line) for line in wrap(text, width)]
    for remark in found.remarks:
        lines += [Content(line) for line in wrap(plain(remark), width)]
    blind = ", ".join(_name(solution, row) for row in found.untestable)
    if blind:
        lines += [Content(line) for line in wrap(f"cannot be tested: {blind}", width)]
    note = "Nothing is switched off by this page: remeasure the rows, or switch them off (x)."
    lines += [
        Content(""),
        *(Content.styled(line, "$foreground-muted") for line in wrap(note, width)),
    ]
    return lines


def _rejected(solution: ModelSolution, found: Findings, width: int) -> list[Content]:
    if not found.rejected:
        return [Content("No row is rejected.")]
    head = f"{'REJECTED':<{_ROW}}{'W':>8}{'ERROR µm':>11}{'± µm':>8}{'RED-N':>7}"
    lines = [Content.styled(fit(head, width), "bold $foreground-muted")]
    for row, one in zip(found.rows, found.rejected, strict=True):
        gone = one.measured(solution.apriori_um * float(solution.q_l[row]) ** 0.5, "um")
        text = (
            fit_end(_name(solution, row), _ROW - 1)
            + " "
            + number(gone.w, 8, 2)
            + cell(gone.error, 11, 1)
            + cell(gone.sigma, 8, 1)
            + cell(gone.r, 7, 3)
        )
        lines.append(Content.styled(fit(text, width), "bold $text-error"))
        for pair in found.hard_to_tell:
            if pair.rejected == row:
                other = f"  or {_name(solution, pair.kept)} (correlation {pair.correlation:.2f})"
                lines.append(Content(fit(other, width)))
    return lines


def _evidence(solution: ModelSolution, found: Findings, width: int) -> list[Content]:
    """Return the steps in their order, with what decided each; re-weighting in one line."""
    if not found.steps:
        return []
    lines = [Content(""), Content.styled("step by step", "bold $foreground-muted")]
    weighted = [step for step in found.steps if step.action == "reweight"]
    steps = [step for step in found.steps if step.action != "reweight"]
    if weighted:
        times = "once" if len(weighted) == 1 else f"{len(weighted)} times"
        text = f"all rows weighted again {times}; v'Pv {weighted[0].before:.1f} to "
        lines += [Content(line) for line in wrap(f"{text}{weighted[-1].after:.1f}", width)]
    for k, step in enumerate(steps[:_SHOWN_STEPS], 1):
        lines += [Content(line) for line in wrap(f"{k:>2}  {_said(solution, step, found)}", width)]
    if len(steps) > _SHOWN_STEPS:
        lines.append(Content(f"and {len(steps) - _SHOWN_STEPS} more steps"))
    return lines


def _said(solution: ModelSolution, step: SearchStep, found: Findings) -> str:
    searched = found.strategy == "search"
    what = "v'Pv + price" if searched else "v'Pv"
    change = f"{what} {step.before:.1f} to {step.after:.1f}"
    names = [_name(solution, row) for row in step.rows]
    if step.action == "swap":
        return f"{names[0]} out, {names[1]} back in; {change}"
    where = "back in" if step.action == "drop" else "out"
    value = ""
    if not searched and step.statistic is not None and step.critical is not None:
        value = f" ({step.statistic:.2f} against {step.critical:.2f})"
    return f"{', '.join(names)} {where}{value}; {change}"


class ErrorsPage(Page):
    """The page of one strategy; a key shows the next one's.

    Parameters
    ----------
    strategy
        The one to begin with.
    lines
        Makes the page of a strategy.
    chosen
        Told the strategy that is looked at from now on.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("e,right,tab", "other(1)", "Next strategy"),
        Binding("left,shift+tab", "other(-1)", "Previous strategy"),
    ]

    def __init__(
        self,
        strategy: str,
        lines: Callable[[str], list[Content]],
        chosen: Callable[[str], None],
    ) -> None:
        super().__init__("Gross errors of the model; e shows the next strategy", lines(strategy))
        self._strategy, self._make, self._chosen = strategy, lines, chosen

    def renew(self) -> None:
        """Show the strategy's page anew: the model has changed."""
        self.show(self._make(self._strategy))

    def action_other(self, step: int) -> None:
        """Show the next strategy, or the one before."""
        self._strategy = CHOICES[(CHOICES.index(self._strategy) + step) % len(CHOICES)]
        self._chosen(self._strategy)
        self.renew()
