"""What stands behind ``anaplot plotter sim``: the simulated plotter by itself, and its control."""

from __future__ import annotations

import shlex
import threading
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TextIO

from anaplot.aliases import Side
from anaplot.errors import AnaplotError, InputError
from anaplot.photogrammetry.selection import model_splits
from anaplot.plotter.device.faults import FAULTS
from anaplot.plotter.device.hand import Hand, HandSettled, Photographs
from anaplot.plotter.device.mishaps import MISHAP_USAGE, MISHAPS, plant
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.device.server import SimulatorServer
from anaplot.plotter.profile import load_profile
from anaplot.report.plottercommand import describe_place
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = ["grid_photographs", "laid_pair", "obey", "run_simulator"]

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


def grid_photographs() -> Photographs:
    """Return two photographs with a grid of true points, for a simulated plotter without truth.

    Photos "left" and "right", 200 mm wide, with points 20 mm apart, named by column and row, of an
    x-parallax of 92 mm.
    """
    base, step, half = 92.0, 20.0, 100.0
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


def laid_pair(text: str, there: Collection[str]) -> tuple[str, str]:
    """Return the photographs that `--lay` names, LEFT/RIGHT or one for both carriages.

    Names may hold slashes: that one counts at whose sides there are photographs.

    Raises
    ------
    InputError
        No slash is such a one, or several are.
    """
    alone = text.removesuffix("/")
    pairs = [pair for pair in model_splits(text) if pair[0] in there and pair[1] in there]
    pairs += [(name, name) for name in dict.fromkeys((text, alone)) if name in there]
    if len(pairs) > 1:
        shown = ", or ".join(f"{quoted(left)} and {quoted(right)}" for left, right in pairs[:4])
        raise InputError(f"--lay {quoted(text)} may be {shown}: in which carriage is what?")
    if not pairs:
        raise InputError(
            f"--lay {quoted(text)}: neither LEFT/RIGHT nor one of the photographs"
            f"{hint(text, there)}"
        )
    return pairs[0]


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
        speed = profile.simulate.speed * time_scale
        limits = [axis.fastest for axis in profile.axes.values() if axis.fastest is not None]
        if limits and speed > min(limits):
            tell(
                f"SIMULATED  --time-scale {time_scale:g} moves axes at {speed:g} mm/s: what minds "
                f"the profile's fastest = {min(limits):g} takes that for counters that jumped"
            )
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
        words = _words(line)
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


def _words(line: str) -> list[str]:
    """Return the words of a control line; a name with blanks stands in double quotes."""
    reader = shlex.shlex(line, posix=True)
    reader.whitespace_split, reader.quotes, reader.escape, reader.commenters = True, '"', "", ""
    try:
        return list(reader)
    except ValueError:  # a quote that is not closed is part of a name
        return line.split()


def obey(simulator: SimulatedPlotter, words: list[str]) -> str:
    """Carry out one control line of a running simulated plotter, and say what was done.

    Parameters
    ----------
    simulator
        The plotter.
    words
        The line's words, at least one.

    Raises
    ------
    InputError
        When the line is not understood.
    """
    verb, rest = words[0], words[1:]
    if words == ["help"]:
        return _HELP
    if verb == "press" and len(rest) <= 1:
        sent = simulator.press(rest[0] if rest else None)
        return "pressed" if sent else "pressed; the host must notice this switch itself"
    if verb == "move" and len(rest) == 4:
        place = simulator.move(*(_number(word) for word in rest))
        return f"at {describe_place(place)}"
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
