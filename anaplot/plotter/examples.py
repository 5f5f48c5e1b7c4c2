"""The examples of a profile: bytes, and what a decoder makes of them."""

from __future__ import annotations

from dataclasses import replace

from anaplot.plotter.decoder import Decoder
from anaplot.plotter.readings import Fault, InPosition, Position, Reading, Record, Refused
from anaplot.plotter.schema import Profile
from anaplot.textfiles.wording import plain

__all__ = ["check_examples"]


def check_examples(profile: Profile) -> list[str]:
    """Decode a profile's examples and compare.

    Parameters
    ----------
    profile
        With its examples.

    Returns
    -------
    list of str
        One line for each example that means something else; empty when all are right.
    """
    problems: list[str] = []
    for at, example in enumerate(profile.examples, 1):
        # what its records say by themselves: no example has read-outs around it
        decoder = Decoder(replace(profile, confirm=False))
        readings = decoder.feed(example.data, 0.0, example.link)
        got = [_described(profile, reading) for reading in readings]
        wanted: list[str] = []
        for meaning in example.meanings:
            if meaning.kind == "axes":
                for name, value in (meaning.axes or {}).items():
                    heard = decoder.axes.get(name)
                    if heard is None or abs(heard - value) > 5e-7:
                        shown = "nothing" if heard is None else f"{heard:.6f}"
                        problems.append(f"example {at}: axis {name} is {shown}, not {value:.6f}")
            else:
                wanted.append(
                    _line(
                        meaning.kind,
                        meaning.position,
                        meaning.switch,
                        meaning.number,
                        meaning.text,
                    )
                )
        for index in range(max(len(got), len(wanted))):
            have = got[index] if index < len(got) else "nothing"
            want = wanted[index] if index < len(wanted) else "nothing"
            if have != want and not (want.startswith("refused") and _refused_as(have, want)):
                problems.append(f"example {at}: it means {have}, not {want}")
    return problems


def _refused_as(have: str, want: str) -> bool:
    return have.startswith("refused") and want.removeprefix("refused ") in have


def _described(profile: Profile, reading: Reading) -> str:
    def plate(position: Position | None) -> tuple[float, ...]:
        return () if position is None else profile.stage.plates(position)

    match reading:
        case Position():
            return _line("position", plate(reading))
        case Record(position, switch, number):
            return _line("record", plate(position), switch, number)
        case InPosition(position):
            return _line("in-position", plate(position))
        case Fault(code):
            return _line("fault", text=code)
        case Refused(_, reason):
            return _line("refused", text=reason)


def _line(
    kind: str,
    position: tuple[float, ...] = (),
    switch: str = "",
    number: int | None = None,
    text: str = "",
) -> str:
    parts = [kind]
    if number is not None:
        parts.append(f"number {number}")
    if switch:
        parts.append(f"of {plain(switch, 40)}")
    if position:
        parts.append("at " + " ".join(f"{value + 0.0:.6f}" for value in position))
    if text:
        parts.append(plain(text, 120))
    return " ".join(parts)
