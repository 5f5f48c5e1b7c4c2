"""The page of the precision of pointing, from which something measured is pointed at again."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

from textual.binding import Binding, BindingType
from textual.content import Content

from anaplot.console.computedpage import ComputedPage
from anaplot.console.dialogs import LINE
from anaplot.console.text import cell, fit, fit_end, number, wrap

if TYPE_CHECKING:
    from anaplot.station.drift import Drift
    from anaplot.station.pointing import GroupTest, Pointing, PooledSigma
    from anaplot.station.pooledrows import Sigma
    from anaplot.station.repeatedpointing import RepeatedPointing

__all__ = ["PointingPage", "pointing_lines"]

_KEYS = (
    "Enter points again at the point under the mark, five times: the plates move 50 µm away before "
    "each, and nothing measured is changed. Escape ends it early; here it closes the page."
)
_NAME = 24


def pointing_lines(found: Pointing | None, width: int) -> list[Content]:
    """Return the page.

    Parameters
    ----------
    found
        What is known; None while it is computed.
    width
        Cells of a line.
    """
    keys = [Content(""), *(Content.styled(s, "$foreground-muted") for s in wrap(_KEYS, width))]
    if found is None:
        return [Content("being computed ..."), *keys]
    lines: list[Content] = []
    if found.offered:
        lines += [Content.styled(s, "bold $text-accent") for s in wrap(found.offered, width)]
        advice = "That agrees: nothing needs to be changed."
        if found.line_to_write:
            advice = (
                f"To take it as the weight, write when the session is over, in block.toml, "
                f"[precision]: {found.line_to_write}"
            )
        lines += [Content(s) for s in wrap(advice, width)]
        lines += [Content.styled(s, "$text-warning") for s in wrap(found.beside_models, width)]
    else:
        lines.append(Content("Nothing was pointed at twice yet."))
    if found.repeated:
        head = f"{'POINTED AGAIN':<{_NAME}}{'N':>5}{'µm':>7}{'FROM':>7}{'TO':>7}"
        lines += [Content(""), _head(f"{head}{'px':>8}{'py':>8}", width)]
        lines += [_repeated(one, width) for one in found.repeated]
        unmoved = sum(one.unmoved for one in found.repeated)
        if unmoved:
            more = f"{unmoved} more do not count: the mark was not seen to move away before them"
            lines += [Content.styled(s, "$text-warning") for s in wrap(more, width)]
    if found.pooled:
        head = f"{'SIGMA0 OF MODELS':<{_NAME}}{'ROWS':>5}{'µm':>7}{'FROM':>7}{'TO':>7}"
        lines += [Content(""), _head(f"{head}{'REDUND':>8}", width)]
        lines += [_pooled(one, width) for one in found.pooled]
    else:
        lines.append(Content("No model with redundancy is accepted yet."))
    words = [*map(_tested, found.tests), *map(_drifted, found.drift)]
    words += [f"remark: {remark}" for remark in found.remarks]
    lines += [Content("")] if words else []
    lines += [Content(s) for one in words for s in wrap(one, width)]
    return [*lines, *keys]


def _head(text: str, width: int) -> Content:
    return Content.styled(fit(text, width), "bold $foreground-muted")


def _interval(sigma: Sigma | None) -> str:
    if sigma is None:
        return cell(None, 7, 2) * 3
    return "".join(number(one, 7, 2) for one in (sigma.um, sigma.low_um, sigma.high_um))


def _repeated(one: RepeatedPointing, width: int) -> Content:
    name = f"{one.kind} {one.who}".strip()
    text = fit_end(name, _NAME - 1) + " " + fit(str(one.pointings), 5, right=True)
    text += _interval(one.sigma) + number(one.px_um, 8, 2) + number(one.py_um, 8, 2)
    return Content(fit(text, width))


def _pooled(one: PooledSigma, width: int) -> Content:
    name = f"{'all' if one.group == 'all' else one.group} {one.name}".strip()
    text = fit_end(name, _NAME - 1) + " " + fit(str(one.rows), 5, right=True)
    return Content(fit(text + _interval(one.sigma) + number(one.redundancy, 8, 1), width))


def _tested(one: GroupTest) -> str:
    verdict = "they differ" if one.differ else "no difference is shown"
    return f"{one.group}s: {one.test.kind} {one.test.statistic:.2f}, {verdict}"


def _drifted(one: Drift) -> str:
    who = f"{one.day} {one.who}".strip()
    if one.why or one.first is None or one.last is None:
        return f"drift, {who}: {one.why}"
    verdict = "DRIFT" if one.drifts else "no drift is shown"
    return (
        f"drift, {who}: first hour {one.first.um:.2f} µm, last hour {one.last.um:.2f} µm: {verdict}"
    )


class PointingPage(ComputedPage):
    """How precise the pointing is; Enter points again.

    Parameters
    ----------
    compute
        Returns what is known; called in a thread of its own.
    again
        Begins to point again.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("P", "close", "Close"),
        Binding("enter", "again", "Point again"),
    ]

    def __init__(self, compute: Callable[[], Pointing], again: Callable[[], None]) -> None:
        lines = pointing_lines(None, LINE)
        super().__init__("How precise the pointing is", lines, compute, self._computed)
        self._again = again

    def _computed(self, found: Pointing) -> None:
        self.show(pointing_lines(found, LINE))

    def action_again(self) -> None:
        """Close the page and point again."""
        self.dismiss(None)
        self._again()
