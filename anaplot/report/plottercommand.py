"""What stands behind ``anaplot plotter check`` and ``watch``."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterable
from typing import TextIO

from anaplot.errors import InputError
from anaplot.plotter.examples import check_examples
from anaplot.plotter.link import Link, LinkState
from anaplot.plotter.ports import UNCHECKED, parse_ports
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Fault, InPosition, Position, Reading, Record, Refused
from anaplot.textfiles.wording import plain

__all__ = ["check_profile", "describe", "describe_place", "watch"]

_POSITION_PERIOD = 0.1
_CROWDED = 200  # lines waiting, from which on positions and bytes are left out
_FULL = 2000  # lines waiting, from which on the port is read no further


def check_profile(name: str, out: TextIO) -> int:
    """Read a profile, decode its examples and print what it is.

    Parameters
    ----------
    name
        Name or path.
    out
        Where to.

    Raises
    ------
    InputError
        When the profile is not valid or an example means something else.
    """
    profile = load_profile(name)
    out.write(f"{profile.id}: {profile.title}\n")
    out.write(f"  status    {profile.status}\n")
    for source in profile.sources:
        out.write(f"  source    {source}\n")
    for line in profile.links.values():
        parity = line.parity[0].upper()
        out.write(
            f"  link      {line.name}: {line.baud} baud {line.bytesize}{parity}{line.stopbits:g}\n"
        )
    out.write(f"  axes      {', '.join(profile.axes)}{' (mono)' if profile.mono else ''}\n")
    asked = f"asked every {profile.poll.period:g} s" if profile.poll else "speaks by itself"
    out.write(f"  positions {asked}\n")
    out.write(f"  drive     {'yes' if profile.drive else 'no: moved by hand'}\n")
    out.write(f"  switches  {', '.join(profile.footswitches) or 'none: the keyboard records'}\n")
    out.write(f"  sha256    {profile.sha256}\n")
    problems = check_examples(profile)
    if problems:
        raise InputError(f"{profile.origin}: {problems[0]}")
    out.write(f"  examples  {len(profile.examples)}, all right\n")
    return 0


def watch(
    addresses: Iterable[str],
    name: str,
    out: TextIO,
    *,
    seconds: float | None = None,
    raw: bool = False,
    stop: threading.Event | None = None,
) -> int:
    """Print what an instrument says, as the profile understands it.

    Parameters
    ----------
    addresses
        Ports, see `parse_ports`.
    name
        Profile, name or path.
    out
        Where to.
    seconds
        End after so long; None: until interrupted.
    raw
        Print the bytes as well, made safe.
    stop
        Ends the watch when set.

    Raises
    ------
    InputError
        When profile or ports are wrong.
    LinkError
        When a port cannot be opened.
    """
    profile = load_profile(name)
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    shown = [float("-inf")]

    def on_reading(reading: Reading) -> None:
        if isinstance(reading, Position):
            now = time.monotonic()
            if now - shown[0] < _POSITION_PERIOD:
                return
            shown[0] = now
            if lines.qsize() >= _CROWDED:
                return
        lines.put(describe(reading))

    def on_state(state: LinkState, detail: str) -> None:
        lines.put(f"link      {state}{': ' if detail else ''}{detail}")

    def on_traffic(direction: str, link: str, data: bytes) -> None:
        if raw and lines.qsize() < _CROWDED:
            lines.put(f"{direction:9} {link}: {plain(data, 400)}")

    link = Link(
        profile,
        parse_ports(profile, addresses),
        on_reading=on_reading,
        on_state=on_state,
        on_traffic=on_traffic,
        # behind a pager that stands still nothing is read on
        room=lambda: lines.qsize() < _FULL,
    )
    end = None if seconds is None else time.monotonic() + seconds
    with link:
        if unchecked := link.unchecked_parity:
            lines.put(f"link      {', '.join(unchecked)}: {UNCHECKED}")
        try:
            while not (stop is not None and stop.is_set()):
                if end is not None and time.monotonic() >= end:
                    break
                try:
                    out.write(lines.get(timeout=0.1) + "\n")
                    out.flush()
                except queue.Empty:
                    continue
        except KeyboardInterrupt:
            # nobody reads on: what is left may have nowhere to go
            return 0
    while not lines.empty():
        out.write(lines.get() + "\n")
    return 0


def describe(reading: Reading) -> str:
    """Return a reading as one safe line.

    Parameters
    ----------
    reading
        What the instrument said.
    """
    match reading:
        case Position():
            return f"position  {describe_place(reading)}"
        case Record(position, switch, number):
            count = f" {number}" if number is not None else ""
            return f"record{count}  {describe_place(position)}  {plain(switch, 40)}"
        case InPosition(position):
            return f"arrived   {describe_place(position) if position is not None else ''}".rstrip()
        case Fault(code, text):
            return f"fault     {code} {text}".rstrip()
        case Refused(data, why):
            return f"refused   {plain(why, 200)}  <{plain(data, 100)}>"


def describe_place(position: Position) -> str:
    """Return plate coordinates as text."""
    return (
        f"x' {position.xl:+10.4f}  y' {position.yl:+10.4f}  "
        f'x" {position.xr:+10.4f}  y" {position.yr:+10.4f} mm'
    )
