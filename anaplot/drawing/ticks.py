"""Round numbers along an axis: steps of 1, 2 or 5 times a power of ten."""

from __future__ import annotations

from math import ceil, floor, isfinite, log10
from typing import NamedTuple

__all__ = ["Ticks", "covering", "round_down", "ticks", "written"]

_FINEST = 1e-12  # of the numbers: a shorter axis
_ROUND = 1000.0  # steps
_GROUPED = 10_000.0  # from here on digits stand in groups of three


class Ticks(NamedTuple):
    """Where an axis is marked.

    Attributes
    ----------
    values
        Whole multiples of the step, ascending.
    step
        1, 2 or 5 times a power of ten.
    decimals
        With which they are written.
    """

    values: tuple[float, ...]
    step: float
    decimals: int

    def less(self) -> tuple[float, Ticks]:
        """Return a round number near the values, and what they are more than that."""
        base = _ROUND * self.step * floor(self.values[0] / (_ROUND * self.step))
        return base, self._replace(values=tuple(value - base for value in self.values))

    @property
    def labels(self) -> tuple[str, ...]:
        """The values as they are written."""
        grouped = any(abs(value) >= _GROUPED for value in self.values)
        return tuple(written(value, self.decimals, grouped=grouped) for value in self.values)


def ticks(low: float, high: float, most: int = 7) -> Ticks:
    """Return the round numbers between two, at most `most` of them.

    Raises
    ------
    ValueError
        The two are not finite, not ascending, or too close for numbers of their size.
    """
    return _between(low, high, most, outwards=False)


def covering(low: float, high: float, most: int = 7) -> Ticks:
    """Return at most `most` round numbers the first and last of which enclose two.

    Two that are the same are enclosed as well.

    Raises
    ------
    ValueError
        As `ticks`; `most` is below 3.
    """
    if low == high:
        margin = 0.5 * abs(low) or 0.5
        low, high = low - margin, high + margin
    return _between(low, high, max(most, 3), outwards=True)


def _between(low: float, high: float, most: int, *, outwards: bool) -> Ticks:
    if not (isfinite(low) and isfinite(high) and low < high):
        raise ValueError(f"no axis from {low} to {high}")
    if high - low < _FINEST * max(abs(low), abs(high)):
        raise ValueError(f"an axis from {low} to {high} is too fine for its numbers")
    exponent = floor(log10(high - low)) - 2
    while True:
        for digit in (1, 2, 5):
            # negative powers of ten are no floats: divide by the positive ones
            unit = 10.0 ** abs(exponent)
            step = digit * unit if exponent >= 0 else digit / unit
            first, last = low / step, high / step
            one, other = (
                (floor(first + 1e-9), ceil(last - 1e-9))
                if outwards
                else (ceil(first - 1e-9), floor(last + 1e-9))
            )
            if other - one + 1 <= most:
                values = tuple(
                    k * digit * unit if exponent >= 0 else k * digit / unit
                    for k in range(one, other + 1)
                )
                return Ticks(values, step, max(0, -exponent))
        exponent += 1


def round_down(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above a positive number."""
    exponent = floor(log10(value))
    unit = 10.0 ** abs(exponent)
    for digit in (5, 2, 1):
        step = digit * unit if exponent >= 0 else digit / unit
        if step <= value * (1.0 + 1e-9):
            return step
    return value


def written(value: float, decimals: int, *, grouped: bool = False) -> str:
    """Return a number with decimals, a true minus and groups of three digits in large ones.

    `grouped`: also in those of four digits, beside larger ones.
    """
    if decimals > 6:
        text = f"{value:.3g}"
    else:
        value = round(value, decimals) + 0.0
        text = (
            f"{value:,.{decimals}f}"
            if grouped or abs(value) >= _GROUPED
            else f"{value:.{decimals}f}"
        )
    return text.replace(",", " ").replace("-", "−")
