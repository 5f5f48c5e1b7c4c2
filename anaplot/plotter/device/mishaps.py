"""The simulated operator's mistakes, by name, in the words of a command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from anaplot.errors import InputError
from anaplot.plotter.device.hand import Offsets, transfer_error
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = ["MISHAPS", "MISHAP_USAGE", "plant"]

_UM = 1000.0

MISHAPS: Mapping[str, tuple[str, ...]] = {
    "parallax": ("POINT", "UM"),
    "wrong-point": ("POINT", "OTHER"),
    "swap": ("POINT", "OTHER"),
    "transfer": ("POINT", "DX_UM", "DY_UM"),
    "drift": ("DY_UM",),
}
"""Name -> its words: a y parallax set wrong, another point taken for it, two taken for each other,
a tie transferred wrongly (both marks beside it), the right y plate creeping at every pointing."""

MISHAP_USAGE = " | ".join(f"{name} {' '.join(words)}" for name, words in MISHAPS.items())


def plant(simulator: SimulatedPlotter, words: Sequence[str]) -> str:
    """Have the simulated operator make a mistake in the model that lies in the plotter; says which.

    Parameters
    ----------
    simulator
        The plotter.
    words
        Name of the mistake, and what `MISHAPS` says of it. Pointings count once, a drift stays.

    Raises
    ------
    InputError
        There is no such mistake or point, or a number is none.
    """
    name, rest = words[0], list(words[1:])
    if name not in MISHAPS:
        raise InputError(f"no mistake {quoted(name)}{hint(name, MISHAPS)}")
    if len(rest) != len(MISHAPS[name]):
        raise InputError(f"{name} asks for {' '.join(MISHAPS[name])}")
    left, right = simulator.laid
    if name == "drift":
        simulator.set_drift(Offsets(dyr=_mm(rest[0])))
        return f"the right plate creeps by {rest[0]} um at every pointing"
    point = rest[0]
    here = _place(simulator, point)
    if name == "parallax":
        simulator.add_mistakes({(left, right, point): Offsets(dyr=_mm(rest[1]))})
        return f"the parallax at {plain(point, 40)} will be set wrong once"
    if name == "transfer":
        dx, dy = _mm(rest[1]), _mm(rest[2])
        simulator.add_mistakes(transfer_error(left, right, point, dx, dy))
        return f"{plain(point, 40)} will be transferred wrongly once"
    other = rest[1]
    there = _place(simulator, other)
    mistakes = {(left, right, point): _from_to(here, there)}
    if name == "swap":
        mistakes[left, right, other] = _from_to(there, here)
    simulator.add_mistakes(mistakes)
    return f"{plain(other, 40)} will be taken for {plain(point, 40)} once" + (
        ", and the other way round" if name == "swap" else ""
    )


_Place = tuple[float, float, float, float]


def _from_to(here: _Place, there: _Place) -> Offsets:
    dxl, dyl, dxr, dyr = (b - a for a, b in zip(here, there, strict=True))
    return Offsets(dxl, dyl, dxr, dyr)


def _place(simulator: SimulatedPlotter, point: str) -> _Place:
    left, right = simulator.laid
    in_left, in_right = simulator.points_of(left), simulator.points_of(right, "right")
    if point not in in_left or point not in in_right:
        raise InputError(f"point {plain(point, 40)} does not lie in both photographs")
    return (*in_left[point], *in_right[point])


def _mm(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not abs(value) <= 1e6:
        raise InputError(f'"{plain(word, 30)}" is not a number of um')
    return value / _UM
