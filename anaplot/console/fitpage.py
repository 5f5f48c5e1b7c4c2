"""The page of the strip on its control: at any time, and nothing of it touches the measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, cast

from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content

from anaplot.console.computedpage import ComputedPage
from anaplot.console.dialogs import LINE
from anaplot.console.text import cell, fit, fit_end, number, wrap

if TYPE_CHECKING:
    from anaplot.orientation.stripfit import Degree, FittedPoint, StripFit
    from anaplot.station.stripcontrol import StripOnControl

__all__ = ["FitChoice", "FitPage", "fit_lines"]

_TITLES: Mapping[int, str] = {
    1: "similarity",
    2: "similarity and polynomials of degree 2",
    3: "similarity and polynomials of degree 3",
}
_POINT = 16
_KEYS = "x in or out · 1 2 3 + - degree · ← → strip · b the bundle · esc closes"


@dataclass(frozen=True, slots=True)
class FitChoice:
    """What is fitted: degree of the polynomials, points put aside, the strip that is looked at."""

    degree: Degree = 1
    without: frozenset[str] = frozenset()
    strip: str = ""

    def bent(self, step: int) -> FitChoice:
        """Return the choice of another degree, of those that there are."""
        return replace(self, degree=cast("Degree", min(max(self.degree + step, 1), 3)))

    def switched(self, point: str) -> FitChoice:
        """Return the choice with a point put out, or in again."""
        return replace(self, without=self.without ^ {point})


def fit_lines(
    strips: tuple[StripOnControl, ...] | None, choice: FitChoice, cursor: str, width: int
) -> list[Content]:
    """Return the page.

    Parameters
    ----------
    strips
        The fits; None while they are computed.
    choice
        What was asked for.
    cursor
        The point that the keys mean.
    width
        Cells of a line.
    """
    keys = [Content(""), *(Content.styled(s, "$foreground-muted") for s in wrap(_KEYS, width))]
    one = chosen(strips, choice)
    if one is None:
        return [Content("being computed ..."), *keys]
    names = "   ".join(f"[{s.strip}]" if s is one else s.strip for s in strips or ())
    lines = [Content.styled(fit(f"strip {names}", width), "bold $text-accent")]
    found = one.fit
    if isinstance(found, str):
        lines += [Content.styled(s, "$text-warning") for s in wrap(f"no fit: {found}", width)]
        if not one.control:
            lines += [Content("No control point is measured in this strip yet.")]
    else:
        lines += _figures(found, one, width)
        for remark in found.remarks:
            lines += [Content.styled(s, "$text-warning") for s in wrap(remark, width)]
    rows = shown_points(one, choice)
    if rows:
        lines += [Content(""), _head(width)]
        lines += [_row(point, point.point == cursor, width) for point in rows]
    return [*lines, *keys]


def chosen(strips: tuple[StripOnControl, ...] | None, choice: FitChoice) -> StripOnControl | None:
    """Return the strip that is looked at: the one chosen, else the first."""
    named = next((one for one in strips or () if one.strip == choice.strip), None)
    return named or (strips[0] if strips else None)


def shown_points(one: StripOnControl, choice: FitChoice) -> tuple[FittedPoint, ...]:
    """Return the rows of a strip; without a fit its control has no discrepancies."""
    if not isinstance(one.fit, str):
        return one.fit.points
    from anaplot.orientation.stripfit import FittedPoint  # loaded with the page

    unknown = (None, None, None)
    return tuple(
        FittedPoint(name, name not in choice.without, unknown, None, None, flagged=False)
        for name in one.control
    )


def _figures(found: StripFit, one: StripOnControl, width: int) -> list[Content]:
    used = sum(point.used for point in found.points)
    tested = found.tested
    sigma0 = "none" if tested.sigma0 is None else f"{tested.sigma0:.2f}"
    models = "1 model" if one.models == 1 else f"{one.models} models"
    x, y, z = (number(value, 8, 3).strip() for value in found.rms)
    return [
        Content(fit(text, width))
        for text in (
            f"{_TITLES[found.degree]}; {models}, {used} control points",
            f"scale 1 : {found.similarity.scale * 1e3:.0f}, redundancy {tested.redundancy}, "
            f"sigma0 {sigma0}",
            f"RMS  X {x} m   Y {y} m   Z {z} m",
        )
    ]


def _head(width: int) -> Content:
    text = f"  {'POINT':<{_POINT}}{'IN':<4}{'dX m':>10}{'dY m':>10}{'dZ m':>10}{'R':>7}{'W':>8}"
    return Content.styled(fit(text, width), "bold $foreground-muted")


def _row(point: FittedPoint, here: bool, width: int) -> Content:
    text = (
        ("▶ " if here else "  ")
        + fit_end(point.point, _POINT - 1)
        + " "
        + fit("yes" if point.used else "no", 4)
        + "".join(cell(value, 10, 3) for value in point.difference)
        + cell(point.r, 7, 2)
        + cell(point.w, 8, 2)
        + ("  <<" if point.flagged else "")
    )
    style = "bold $text-error" if point.flagged else "" if point.used else "$foreground-muted"
    return Content.styled(fit(text, width), f"{style} reverse".strip() if here else style)


class FitPage(ComputedPage):
    """The strips on their control; keys put points in and out and choose degree and strip.

    Parameters
    ----------
    choice
        What to begin with.
    compute
        Fits the strips; called in a thread of its own.
    decided
        Told what is chosen from now on.
    bundle
        Opens the block page.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("F", "close", "Close"),
        Binding("x", "switch", "In or out"),
        *(Binding(str(k), f"set_degree({k})", f"Degree {k}") for k in _TITLES),
        Binding("+,plus", "degree(1)", "Higher degree"),
        Binding("-,minus", "degree(-1)", "Lower degree"),
        Binding("right,tab", "strip(1)", "Next strip"),
        Binding("left,shift+tab", "strip(-1)", "Previous strip"),
        Binding("b", "bundle", "The block as one bundle"),
        Binding("up,k", "move(-1)", "Up"),
        Binding("down,j", "move(1)", "Down"),
    ]

    def __init__(
        self,
        choice: FitChoice,
        compute: Callable[[FitChoice], tuple[StripOnControl, ...]],
        decided: Callable[[FitChoice], None],
        bundle: Callable[[], None],
    ) -> None:
        super().__init__(
            "Strip on its control",
            fit_lines(None, choice, "", LINE),
            lambda: compute(self._choice),
            self._computed,
        )
        self._choice, self._decided, self._bundle = choice, decided, bundle
        self._strips: tuple[StripOnControl, ...] | None = None
        self._cursor = ""

    def _computed(self, strips: tuple[StripOnControl, ...]) -> None:
        self._strips = strips
        points = self._points
        if points and self._cursor not in points:
            self._cursor = points[0]
        self._draw()

    @property
    def _points(self) -> tuple[str, ...]:
        one = chosen(self._strips, self._choice)
        return () if one is None else tuple(p.point for p in shown_points(one, self._choice))

    def _draw(self) -> None:
        self.show(fit_lines(self._strips, self._choice, self._cursor, LINE))

    def _decide(self, choice: FitChoice) -> None:
        if choice != self._choice:
            before, self._choice = self._choice, choice
            self._decided(choice)
            self._draw()
            if choice != replace(before, strip=choice.strip):  # all strips are fitted at once
                self.renew()

    def action_switch(self) -> None:
        """Put the point under the cursor out, or in again."""
        if self._cursor in self._points:
            self._decide(self._choice.switched(self._cursor))

    def action_degree(self, step: int) -> None:
        """Fit polynomials of the next degree, or of the one before."""
        self._decide(self._choice.bent(step))

    def action_set_degree(self, degree: Degree) -> None:
        """Fit polynomials of a degree; 1 is the similarity alone."""
        self._decide(replace(self._choice, degree=degree))

    def action_strip(self, step: int) -> None:
        """Look at the next strip, or the one before."""
        names = [one.strip for one in self._strips or ()]
        one = chosen(self._strips, self._choice)
        if one is not None:
            place = (names.index(one.strip) + step) % len(names)
            self._decide(replace(self._choice, strip=names[place]))

    def action_bundle(self) -> None:
        """Show what the block as one bundle says."""
        self._bundle()

    def action_move(self, step: int) -> None:
        """Move the cursor, and what is seen with it."""
        points = self._points
        if points:
            place = points.index(self._cursor) if self._cursor in points else 0
            place = min(max(place + step, 0), len(points) - 1)
            self._cursor = points[place]
            self._draw()
            view = self.query_one(VerticalScroll)
            row = self._first_row + place
            top, height = view.scroll_offset.y, view.size.height
            if not top <= row < top + height:
                view.scroll_to(y=row if row < top else row - height + 1, animate=False)

    @property
    def _first_row(self) -> int:
        lines = fit_lines(self._strips, self._choice, "", LINE)
        return next(k for k, line in enumerate(lines) if line.plain.startswith("  POINT")) + 1
