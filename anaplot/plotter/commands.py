"""What stands behind ``anaplot plotter``: list, check, watch, sim."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TextIO

from anaplot.aliases import Side
from anaplot.errors import AnaplotError, InputError
from anaplot.plotter.device.faults import FAULTS
from anaplot.plotter.device.hand import Hand, HandSettled, Photographs
from anaplot.plotter.device.mishaps import MISHAP_USAGE, MISHAPS, plant
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.examples import check_examples
from anaplot.plotter.link import Link, LinkState
from anaplot.plotter.profile import find_profiles, load_profile
from anaplot.plotter.readings import Fault, InPosition, Position, Reading, Record, Refused
from anaplot.plotter.schema import Profile
from anaplot.plotter.serialport import ports
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = [
    "UNCHECKED",
    "check_profile",
    "grid_photographs",
    "list_instruments",
    "parse_ports",
    "run_simulator",
    "watch",
]

UNCHECKED = "parity is not checked by this line"
_POSITION_PERIOD = 0.1
_CROWDED = 200  # lines waiting, from which on positions and bytes are left out
_FULL = 2000  # lines waiting, from which on the port is read no further
_ATTENDED: dict[str, Side | None] = {"left": "left", "right": "right", "points": None}
_LOOKS_FOR = {
    "left": "fiducials of the left photograph",
    "right": "fiducials of the right photograph",
    "points": "points in both photographs",
}
_HELP = (
    "press [SWITCH] | move DXL DYL DXR DYR (mm) | lay LEFT [RIGHT] | FAULT [SECONDS] | "
    "attend left|right|points | MISTAKE | power | quit; faults: "
    + ", ".join(FAULTS)
    + f"; mistakes: {MISHAP_USAGE}"
)


def list_instruments(out: TextIO) -> int:
    """Print the ports of this computer and the device profiles.

    Parameters
    ----------
    out
        Where to.

    Returns
    -------
    int
        Exit code: 0, or 2 when a profile cannot be read (its line says why).
    """
    code = 0
    out.write("ports\n")
    found = ports()
    for info in found:
        identity = f"  usb:{info.identity}" if info.identity else ""
        out.write(f"  {plain(info.address, 120):20}  {info.description}{identity}\n")
    if not found:
        out.write("  none found; socket://host:port and rfc2217://host:port work as well\n")
    out.write("profiles\n")
    for name, path in find_profiles().items():
        try:
            profile = load_profile(path)
        except AnaplotError as error:
            out.write(f"  {name:20}  {error}\n")
            code = 2
            continue
        out.write(f"  {name:20}  {profile.status:12}  {profile.title}\n")
    return code


def check_profile(name: str, out: TextIO) -> int:
    """Read a profile, decode its examples and print what it is.

    Parameters
    ----------
    name
        Name or path.
    out
        Where to.

    Returns
    -------
    int
        Exit code 0.

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


def parse_ports(profile: Profile, texts: Iterable[str]) -> dict[str, str]:
    """Read port addresses as a person types them.

    Parameters
    ----------
    profile
        Whose links they are.
    texts
        One address for a profile with one link, else ``LINK=ADDRESS`` for each, also parted by
        commas.

    Returns
    -------
    dict of str to str
        Link -> address.

    Raises
    ------
    InputError
        When a link is unknown, missing or given twice.
    """
    items = list(texts)
    if len(profile.links) == 1 and len(items) == 1:
        address = items[0]
        head = f"{profile.default_link}="
        return {profile.default_link: address.removeprefix(head)}
    found: dict[str, str] = {}
    for item in (part for text in items for part in text.split(",")):
        name, equals, address = item.partition("=")
        if not equals or not address:
            raise InputError(
                f'"{plain(item, 60)}": {profile.id} needs LINK=PORT for each of its links '
                f"({', '.join(profile.links)})"
            )
        if name not in profile.links:
            near = hint(name, profile.links)
            raise InputError(f"{profile.id} has no link {quoted(name)}{near}")
        if name in found:
            raise InputError(f'{profile.id}: link "{name}" is given twice')
        found[name] = address
    for name in profile.links:
        if name not in found:
            raise InputError(f'{profile.id}: no port is given for its link "{name}"')
    return found


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

    Returns
    -------
    int
        Exit code 0.

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
            return f"position  {_place(reading)}"
        case Record(position, switch, number):
            count = f" {number}" if number is not None else ""
            return f"record{count}  {_place(position)}  {plain(switch, 40)}"
        case InPosition(position):
            return f"arrived   {_place(position) if position is not None else ''}".rstrip()
        case Fault(code, text):
            return f"fault     {code} {text}".rstrip()
        case Refused(data, why):
            return f"refused   {plain(why, 200)}  <{plain(data, 100)}>"


def _place(position: Position) -> str:
    return (
        f"x' {position.xl:+10.4f}  y' {position.yl:+10.4f}  "
        f'x" {position.xr:+10.4f}  y" {position.yr:+10.4f} mm'
    )


def grid_photographs(base: float = 92.0, step: float = 20.0, half: float = 100.0) -> Photographs:
    """Return two photographs with a grid of true points, for a simulated plotter without truth.

    Parameters
    ----------
    base
        x-parallax of all points [mm].
    step
        Between points [mm].
    half
        Half the width of a plate [mm].

    Returns
    -------
    Photographs
        Photos "left" and "right" with points named by column and row.
    """
    left: dict[str, tuple[float, float]] = {}
    right: dict[str, tuple[float, float]] = {}
    count = int(half // step)
    for column in range(-count, count + 1):
        for row in range(-count, count + 1):
            x, y = column * step, row * step
            if abs(x - base) <= half:
                name = f"{column + count:02d}{row + count:02d}"
                left[name] = (x, y)
                right[name] = (x - base, y)
    return {"left": left, "right": right}


def run_simulator(
    name: str,
    out: TextIO,
    *,
    photographs: Photographs | None = None,
    in_right: Photographs | None = None,
    laid: tuple[str, str] | None = None,
    mistakes: Iterable[Sequence[str]] = (),
    symlink: str | Path | None = None,
    tcp: bool = False,
    tcp_port: int = 0,
    seed: int = 0,
    noise_um: float = 5.0,
    time_scale: float = 1.0,
    fault_rates: Mapping[str, float] | None = None,
    hand: Hand | None = None,
    control: TextIO | None = None,
    stop: threading.Event | None = None,
) -> int:
    """Run the simulated plotter by itself until it is stopped.

    Parameters
    ----------
    name
        Profile, name or path.
    out
        Where the port and what happens are printed.
    photographs
        True plate coordinates; None: a grid.
    in_right
        The same where a photograph lies otherwise in the right carriage.
    laid
        Photographs laid into the carriages; None: the first two.
    mistakes
        Of the hand, see `anaplot.plotter.device.mishaps`.
    symlink, tcp, tcp_port, time_scale
        See `SimulatorServer`.
    seed, noise_um, fault_rates, hand
        See `SimulatedPlotter`.
    control
        Lines that press, move and plant faults while it runs; its end changes nothing.
    stop
        Ends the run when set.

    Returns
    -------
    int
        Exit code 0.

    Raises
    ------
    InputError
        When the profile, a fault's name or a photograph is wrong.
    LinkError
        When the line cannot be made.
    """
    profile = load_profile(name)
    truth = photographs if photographs is not None else grid_photographs()
    names = list(truth)
    pair = laid if laid is not None else (names[0], names[min(1, len(names) - 1)])
    lock = threading.Lock()

    def tell(text: str) -> None:
        with lock:
            out.write(text + "\n")
            out.flush()

    def on_settled(settled: HandSettled) -> None:
        point = settled.point if settled.point is not None else "no point"
        tell(f"SIMULATED  mark on {plain(point, 40)}")

    simulator = SimulatedPlotter(
        profile,
        truth,
        in_right=in_right,
        seed=seed,
        noise_um=noise_um,
        hand=hand,
        on_settled=on_settled,
        fault_rates=fault_rates,
    )
    simulator.lay(pair[0], None if profile.mono else pair[1])
    for words in mistakes:
        plant(simulator, words)
    ended = stop if stop is not None else threading.Event()
    server = SimulatorServer(
        simulator, symlink=symlink, tcp=tcp, tcp_port=tcp_port, time_scale=time_scale
    )
    with server:
        for link, address in server.ports.items():
            tell(f"SIMULATED  {profile.id}  {link}={address}")
        if control is not None:
            tell(f"SIMULATED  {_HELP}")
            threading.Thread(
                target=_obey_lines,
                args=(control, simulator, tell, ended),
                name="plotter control",
                daemon=True,
            ).start()
        try:
            while not ended.wait(0.2):
                if not server.running:
                    break
        except KeyboardInterrupt:
            pass
    tell("SIMULATED  ended")
    return 0


def _obey_lines(
    control: TextIO,
    simulator: SimulatedPlotter,
    tell: Callable[[str], None],
    ended: threading.Event,
) -> None:
    """Read control lines until they end."""
    for line in control:
        words = line.split()
        if not words:
            continue
        if words[0] in ("quit", "q"):
            ended.set()
            return
        try:
            answer = obey(simulator, words)
        except AnaplotError as error:
            answer = str(error)
        if not ended.is_set():
            tell(f"SIMULATED  {answer}")
        if ended.is_set():
            return


def obey(simulator: SimulatedPlotter, words: list[str]) -> str:
    """Carry out one control line of a running simulated plotter.

    Parameters
    ----------
    simulator
        The plotter.
    words
        The line's words, at least one.

    Returns
    -------
    str
        What was done.

    Raises
    ------
    InputError
        When the line is not understood.
    """
    verb, rest = words[0], words[1:]
    if verb == "press" and len(rest) <= 1:
        sent = simulator.press(rest[0] if rest else None)
        return "pressed" if sent else "pressed; the host must notice this switch itself"
    if verb == "move" and len(rest) == 4:
        place = simulator.move(*(_number(word) for word in rest))
        return f"at {_place(place)}"
    if verb == "lay" and len(rest) in (1, 2):
        simulator.lay(rest[0], rest[1] if len(rest) == 2 else None)
        return "laid " + plain(" ".join(rest), 120)
    if verb == "attend" and len(rest) == 1 and rest[0] in _ATTENDED:
        simulator.attend(_ATTENDED[rest[0]])
        return f"the hand looks for {_LOOKS_FOR[rest[0]]}"
    if verb in MISHAPS:
        return plant(simulator, words)
    if verb == "power" and not rest:
        simulator.power_cycle()
        return "switched off and on"
    if verb in FAULTS and len(rest) <= 1:
        simulator.inject(verb, seconds=_number(rest[0]) if rest else None)
        return f"fault {verb}"
    raise InputError(f'"{plain(" ".join(words), 60)}" is not understood: {_HELP}')


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e6:
        raise InputError(f'"{plain(word, 30)}" is not a number')
    return value
