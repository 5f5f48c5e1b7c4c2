"""Values in a few classes: a colour and a size each, so that either alone tells them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import floor, log10

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.drawing.legend import Entry
from anaplot.drawing.palette import RAMP
from anaplot.drawing.plot import Plot

__all__ = ["Classes", "classes_of", "draw_classes"]

_SIZES = (2.0, 2.8, 3.6, 4.6, 5.8)  # half of what a mark is wide, by class
_RIMMED = 1500  # marks up to which each has a rim


@dataclass(frozen=True, slots=True)
class Classes:
    """Classes of values.

    Attributes
    ----------
    limits
        (k - 1,) ascending; a value belongs to the class above a limit that it reaches.
    labels
        k texts.
    """

    limits: tuple[float, ...]
    labels: tuple[str, ...]

    def of(self, values: Array) -> Index:
        """Return (n,) classes of values, from 0."""
        return np.searchsorted(np.array(self.limits), values, side="right")

    def step(self, of: int) -> int:
        """Return which step of the ramp a class has, 1 to `RAMP`."""
        count = len(self.labels)
        return RAMP if count == 1 else 1 + round(of * (RAMP - 1) / (count - 1))


def classes_of(values: Array, unit: str = "", count: int = RAMP) -> Classes:
    """Return classes that hold about as many values each, with limits of two digits.

    Parameters
    ----------
    values
        (n,) finite numbers, n > 0.
    unit
        Stands behind them in the labels.
    count
        How many at most; fewer where limits would be the same.
    """
    quantiles = np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1])
    low, high = float(values.min()), float(values.max())
    limits = sorted({_two_digits(value) for value in quantiles.tolist()})
    limits = [limit for limit in limits if low < limit <= high]
    unit = f" {unit}" if unit else ""
    texts = [f"{limit:.4g}".replace("-", "−") for limit in limits]
    if not limits:
        return Classes((), (f"{low:.2g}{unit} to {high:.2g}{unit}".replace("-", "−"),))
    labels = [f"below {texts[0]}{unit}"]
    labels += [f"{a} to {b}{unit}" for a, b in pairwise(texts)]
    return Classes(tuple(limits), (*labels, f"from {texts[-1]}{unit}"))


def _two_digits(value: float) -> float:
    if value == 0.0:
        return 0.0
    return round(value, 1 - floor(log10(abs(value))))


def draw_classes(
    plot: Plot,
    at: Array,
    values: Array,
    classes: Classes,
    *,
    what: str = "",
    turned: bool = False,
    size: float = 1.0,
    every: Array | None = None,
) -> None:
    """Draw (n, 2) points by the classes of (n,) values, the highest class above the others.

    Parameters
    ----------
    plot, at, values, classes
        Where, and what.
    what
        Stands before the labels of the legend.
    turned
        Whether the lowest class is the most conspicuous one.
    size
        Factor of the size of the marks.
    every
        The values that the legend counts, where not all of them are drawn.
    """
    of = classes.of(values)
    counts = np.bincount(
        classes.of(values if every is None else every), minlength=len(classes.labels)
    )
    rim = " rim" if len(at) <= _RIMMED else ""
    steps = [classes.step(k) for k in range(len(classes.labels))]
    if turned:
        steps.reverse()
    for k, step in sorted(enumerate(steps), key=lambda pair: pair[1]):
        label = classes.labels[k]
        half = size * _SIZES[step - 1]
        plot.marks("circle", at[of == k], f"f-ramp-{step}{rim}", half)
        named = f"{what} {label} ({counts[k]})".strip()
        plot.explain(Entry("mark", named, f"f-ramp-{step} rim", "circle", half))
