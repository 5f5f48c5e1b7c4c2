"""Faults of a line, by name: what happens to a record on its way to the host."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Mapping

from anaplot.errors import InputError
from anaplot.plotter.schema import LineSettings
from anaplot.textfiles.wording import hint, quoted

__all__ = [
    "FAULTS",
    "FRAME_FAULTS",
    "LASTING_FAULTS",
    "check_fault",
    "damaged",
    "garbled",
    "struck",
]

FRAME_FAULTS = ("drop", "flip", "partial", "duplicate", "garbage")
LASTING_FAULTS = ("freeze", "disconnect", "slow", "wrong-baud")
FAULTS = FRAME_FAULTS + LASTING_FAULTS
BAD_PARITY = 0xFF
_GARBLED = (0x00, 0x06, 0x18, 0x1E, 0x66, 0x78, 0x7E, 0x80, 0x86, 0x98, 0xE0, 0xE6, 0xF8, 0xFE)


def check_fault(name: str) -> None:
    """Refuse the name of a fault that there is not; raises InputError that names the nearest."""
    if name not in FAULTS:
        raise InputError(f"no fault {quoted(name)}{hint(name, FAULTS)}")


def struck(rates: Mapping[str, float], seed: int, frame: int) -> tuple[list[str], random.Random]:
    """Decide which faults strike a record.

    Parameters
    ----------
    rates
        Fault -> probability for one record.
    seed
        Of the simulated plotter.
    frame
        Number of the record on its line; the decision depends on it, not on time.

    Returns
    -------
    names : list of str
        Faults, in the order of `FAULTS`.
    generator : random.Random
        For where and how.
    """
    digest = hashlib.sha256(repr((seed, "fault", frame)).encode()).digest()
    generator = random.Random(digest)
    names = [name for name in FAULTS if generator.random() < rates.get(name, 0.0)]
    return names, generator


def damaged(name: str, data: bytes, line: LineSettings, generator: random.Random) -> bytes:
    """Return what arrives of one record that is damaged.

    Parameters
    ----------
    name
        One of `FRAME_FAULTS`.
    data
        The record as sent, terminator included.
    line
        The line it goes over: with parity, the host's port sees a turned bit and gives
        `BAD_PARITY` instead of the byte.
    generator
        Where and how.
    """
    if not data:
        return data
    if name == "drop":
        at = generator.randrange(len(data))
        return data[:at] + data[at + generator.randint(1, 3) :]
    if name == "flip":
        at = generator.randrange(len(data))
        turned = data[at] ^ (1 << generator.randrange(line.bytesize))
        byte = turned if line.parity == "none" else BAD_PARITY
        return data[:at] + bytes([byte]) + data[at + 1 :]
    if name == "partial":
        return data[: generator.randrange(1, max(2, len(data)))]
    if name == "duplicate":
        return data + data
    top = 1 << line.bytesize
    return bytes(generator.randrange(top) for _ in range(generator.randint(1, 20))) + data


def garbled(data: bytes, line: LineSettings, generator: random.Random) -> bytes:
    """Return what a port set to another baud rate makes of bytes.

    Parameters
    ----------
    data
        As sent.
    line
        The line; with parity most bytes come with wrong parity.
    generator
        Which bytes come out.
    """
    out = bytearray()
    for _ in data:
        byte = generator.choice(_GARBLED)
        out.append(BAD_PARITY if line.parity != "none" and byte % 3 else byte)
    return bytes(out)
