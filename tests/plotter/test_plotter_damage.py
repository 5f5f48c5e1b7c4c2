"""Damaged on the way: fourteen kinds of damage to what every profile's device says.

Parity is not seen here (network adapters, pseudo-terminals): a turned bit arrives as another byte.
Whatever becomes a record must be right to the profile's `still`.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import pytest

from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.hand import Hand
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position, Record
from anaplot.plotter.schema import Profile

pytestmark = pytest.mark.slow

TRIALS = 25
Damage = Callable[[bytes, random.Random], bytes]


def one_bit(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(7)]) + data[at + 1 :]


def bit_in_a_digit(data: bytes, rng: random.Random) -> bytes:
    places = [at for at, byte in enumerate(data) if 48 <= byte <= 57] or range(len(data))
    at = rng.choice(list(places))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(4)]) + data[at + 1 :]


def two_bits_of_a_byte(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    one, other = rng.sample(range(7), 2)
    return data[:at] + bytes([data[at] ^ 1 << one ^ 1 << other]) + data[at + 1 :]


def two_bits_of_two_bytes(data: bytes, rng: random.Random) -> bytes:
    return one_bit(one_bit(data, rng), rng)


def the_same_bit_twice(data: bytes, rng: random.Random) -> bytes:
    one, other = rng.sample(range(len(data)), 2)
    bit, out = 1 << rng.randrange(4), bytearray(data)
    out[one] ^= bit
    out[other] ^= bit
    return bytes(out)


def lost(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + data[at + 1 :]


def several_lost(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + data[at + rng.randint(2, 6) :]


def doubled(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[: at + 1] + data[at:]


def lost_and_doubled(data: bytes, rng: random.Random) -> bytes:
    return doubled(lost(data, rng), rng)


def neighbours_swapped(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) - 1)
    return data[:at] + data[at + 1 : at + 2] + data[at : at + 1] + data[at + 2 :]


def two_swapped(data: bytes, rng: random.Random) -> bytes:
    one, other = rng.sample(range(len(data)), 2)
    out = bytearray(data)
    out[one], out[other] = out[other], out[one]
    return bytes(out)


def a_digit_for_another(data: bytes, rng: random.Random) -> bytes:
    places = [at for at, byte in enumerate(data) if 48 <= byte <= 57] or range(len(data))
    at = rng.choice(list(places))
    return data[:at] + rng.choice(b"0123456789").to_bytes() + data[at + 1 :]


def a_burst(data: bytes, rng: random.Random) -> bytes:
    at, length = rng.randrange(len(data)), rng.randint(2, 8)
    noise = bytes(rng.choice(b"0123456789+-. ") for _ in data[at : at + length])
    return data[:at] + noise + data[at + length :]


def merged(data: bytes, rng: random.Random) -> bytes:
    # the tail of a record of another place, joined to the head of this one
    other = bytes(byte if byte not in b"123456789" else rng.choice(b"0123456789") for byte in data)
    at = rng.randrange(len(data))
    return data[:at] + other[at:]


KINDS: dict[str, Damage] = {
    damage.__name__: damage
    for damage in (
        one_bit,
        bit_in_a_digit,
        two_bits_of_a_byte,
        two_bits_of_two_bytes,
        the_same_bit_twice,
        lost,
        several_lost,
        doubled,
        lost_and_doubled,
        neighbours_swapped,
        two_swapped,
        a_digit_for_another,
        a_burst,
        merged,
    )
}


class Line:
    """A host and a simulated device on simulated time; one record on the way is damaged."""

    def __init__(self, profile: Profile) -> None:
        # without the simulated serial timing: records come whole, one after another
        self.profile = replace(profile, simulate=replace(profile.simulate, byte_timing=False))
        self.simulator = SimulatedPlotter(self.profile, {}, hand=Hand(follow=False))
        self.decoder = Decoder(profile, speed_limits=False)
        self.now = 0.0
        self.damage: Damage | None = None
        self.left = 0
        self.rng = random.Random(0)
        self.readings: list = []

    def carry(self, seconds: float) -> None:
        end = self.now + seconds
        poller = self.decoder.poller
        while self.now < end:
            if poller is not None and self.profile.poll is not None:
                if self.decoder.waiting:
                    poller.urge()
                if poller.wait(self.now) <= 0.0:
                    poller.begin(self.now)
                    for name in self.profile.poll.links:
                        self.decoder.sent(self.profile.poll.request, name, self.now)
                        self.simulator.receive(self.profile.poll.request, name)
            self.now += 0.01
            self.simulator.advance(0.01)
            for name in self.profile.links:
                data = self.simulator.take(name)
                if data:
                    self.readings += self.decoder.feed(self._on_the_way(data), self.now, name)
            self.readings += self.decoder.tick(self.now)

    def _on_the_way(self, data: bytes) -> bytes:
        out = b""
        for record in self._records(data):
            damage = self.damage if self.left == 0 else None
            if damage is not None:
                self.damage = None
            self.left = max(0, self.left - 1)
            out += record if damage is None else damage(record, self.rng)
        return out

    def _records(self, data: bytes) -> list[bytes]:
        framing = self.profile.framing
        if framing.kind != "line":
            size = framing.length
            return [data[at : at + size] for at in range(0, len(data), size)]
        lines = data.split(framing.terminator)[:-1]
        return [
            b"".join(line + framing.terminator for line in lines[at : at + framing.lines])
            for at in range(0, len(lines), framing.lines)
        ]

    def press(self) -> Position:
        """Press and let time pass; return where the carriages stood."""
        switch = next(iter(self.profile.footswitches.values()))
        if switch.source == "key":
            self.decoder.press(switch.name, self.now)
        else:
            self.simulator.press(switch.name)
        self.carry(0.4)
        return self.simulator.positions()


def off(a: Position, b: Position) -> float:
    return max(abs(a.xl - b.xl), abs(a.yl - b.yl), abs(a.xr - b.xr), abs(a.yr - b.yr))


def bound(profile: Profile) -> float:
    """`still`, and what the device's steps make of where the carriages stand."""
    rounded = profile.simulate.resolution_um / 2000.0 + 1e-4
    return max(axis.still for axis in profile.axes.values()) + rounded


@pytest.mark.parametrize("kind", KINDS)
def test_no_damaged_record_is_a_measurement(kind: str, any_profile: Profile) -> None:
    line = Line(any_profile)
    line.rng = random.Random(f"{any_profile.id} {kind}")
    middle = [(a.low + a.high) / 2.0 for a in any_profile.axes.values()]
    ends = any_profile.stage.to_plate(tuple(middle))
    base = Position(*(ends if len(ends) == 4 else (*ends, *ends)))
    wrong = []
    for _ in range(TRIALS):
        dx, dy, dz, dw = (line.rng.uniform(-60.0, 60.0) for _ in range(4))
        line.simulator.hand_to(Position(base.xl + dx, base.yl + dy, base.xr + dz, base.yr + dw))
        line.carry(0.6)
        line.readings.clear()
        # any of the records about the press: the read-outs around it, and its own
        line.damage, line.left = KINDS[kind], line.rng.randrange(4)
        place = line.press()
        line.damage = None
        wrong += [
            reading
            for reading in line.readings
            if isinstance(reading, Record) and off(reading.position, place) > bound(any_profile)
        ]
        if not line.decoder.referenced:
            # a number below the last one counts as a restart
            line.decoder.confirm_reference()
    assert wrong == []
    line.carry(8.0)
    line.readings.clear()
    place = line.press()
    (record,) = (reading for reading in line.readings if isinstance(reading, Record))
    assert off(record.position, place) <= bound(any_profile)


def test_the_exclusive_or_alone_misses_what_changed_places() -> None:
    """What the table is about: the checksum of old misses swapped neighbours, the CRC none."""
    text = b"R 17 1 +012.3456 -034.5678 +012.0000 -034.5000"
    for name, missed in (("anaplot-ascii", True), ("anaplot-ascii-crc", False)):
        profile = replace(load_profile(name), confirm=False)
        assert profile.checksum is not None
        found = []
        for at in range(8, len(text) - 1):
            swapped = bytearray(text)
            swapped[at], swapped[at + 1] = swapped[at + 1], swapped[at]
            if bytes(swapped) != text:
                data = bytes(swapped) + profile.checksum.digits(text) + b"\n"
                found += [r for r in Decoder(profile).feed(data, 0.0) if isinstance(r, Record)]
        assert bool(found) is missed


@pytest.mark.parametrize(("kind", "digits"), [("crc8", b"*F4"), ("crc16", b"*29B1")])
def test_the_check_values_of_the_standards(kind: str, digits: bytes) -> None:
    checksum = load_profile("anaplot-ascii-crc").checksum
    assert checksum is not None
    assert replace(checksum, kind=kind).digits(b"123456789") == digits
