from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
from processes import nothing_stays

from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.hand import Hand, HandSettled, Offsets
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.profile import find_profiles, load_profile
from anaplot.plotter.readings import Position, Reading, Record, Refused
from anaplot.plotter.schema import Profile

WAIT = 30.0  # generous: an event that does not come in this time does not come


@pytest.fixture
def nothing_left() -> Iterator[None]:
    """No descriptor and no thread may be left when the test is over."""
    with nothing_stays():
        yield


class Heard:
    """Collects what a link tells and waits for it."""

    def __init__(self) -> None:
        self.condition = threading.Condition()
        self.readings: list[Reading] = []
        self.states: list[tuple[str, str]] = []
        self.traffic: list[tuple[str, str, bytes]] = []
        self.told: list[tuple[str, str]] = []

    def on_reading(self, reading: Reading) -> None:
        with self.condition:
            self.readings.append(reading)
            self.condition.notify_all()

    def on_state(self, state: str, detail: str) -> None:
        with self.condition:
            self.states.append((state, detail))
            self.condition.notify_all()

    def on_traffic(self, direction: str, link: str, data: bytes) -> None:
        with self.condition:
            self.traffic.append((direction, link, data))
            self.condition.notify_all()

    def on_decoder(self, kind: str, text: str) -> None:
        with self.condition:
            self.told.append((kind, text))
            self.condition.notify_all()

    def wait(self, true: Callable[[], object]) -> None:
        with self.condition:
            assert self.condition.wait_for(true, WAIT), (self.readings[-5:], self.states)

    def wait_state(self, state: str, start: int = 0) -> None:
        self.wait(lambda: any(name == state for name, _ in self.states[start:]))

    def of(self, kind: type) -> list:
        return [reading for reading in self.readings if isinstance(reading, kind)]

    @property
    def callbacks(self) -> dict:
        return {
            "on_reading": self.on_reading,
            "on_state": self.on_state,
            "on_traffic": self.on_traffic,
            "on_decoder": self.on_decoder,
        }


@pytest.fixture
def heard() -> Heard:
    return Heard()


def _photographs(points: int = 12) -> dict[str, dict[str, tuple[float, float]]]:
    left = {str(100 + at): (-40.0 + 12.0 * at, -70.0 + 13.0 * (at % 9)) for at in range(points)}
    return {
        "1": left,
        "2": {name: (x - 80.0, y + 0.3) for name, (x, y) in left.items() if abs(x - 80.0) < 110},
    }


@pytest.fixture
def photographs() -> dict[str, dict[str, tuple[float, float]]]:
    return _photographs()


def all_profiles() -> list[str]:
    return list(find_profiles())


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "any_profile" in metafunc.fixturenames:
        metafunc.parametrize("any_profile", all_profiles(), indirect=True)


@pytest.fixture
def any_profile(request: pytest.FixtureRequest) -> Profile:
    return load_profile(request.param)


@pytest.fixture
def simulated() -> Profile:
    return load_profile("simulated")


@dataclass
class Bench:
    """A simulated plotter and a decoder on simulated time: a host without ports and threads.

    It does what a link and an operator do: asks, presses again when nothing was recorded, and
    drives again when nothing happened.
    """

    profile: Profile
    simulator: SimulatedPlotter
    decoder: Decoder
    now: float = 0.0
    step: float = 0.004
    readings: list[Reading] = field(default_factory=list)
    settled: deque[HandSettled] = field(default_factory=deque)
    presses: int = 0

    def tick(self) -> None:
        poll, poller = self.profile.poll, self.decoder.poller
        if poll is not None and poller is not None:
            if self.decoder.waiting:
                poller.urge()
            if poller.wait(self.now) <= 0.0:
                poller.begin(self.now)
                for name in poll.links:
                    self.decoder.sent(poll.request, name, self.now)
                    self.simulator.receive(poll.request, name)
        self.simulator.advance(self.step)
        self.now += self.step
        heard_any = False
        for name in self.profile.links:
            data = self.simulator.take(name)
            if not data:
                continue
            heard_any = True
            self.readings += self.decoder.feed(data, self.now, name)
        if not heard_any:
            self.readings += self.decoder.tick(self.now)

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.tick()

    def until(self, true: Callable[[], object], seconds: float) -> bool:
        end = self.now + seconds
        while self.now < end:
            if true():
                return True
            self.tick()
        return bool(true())

    def go(self, target: Position) -> HandSettled:
        for _ in range(20):
            self.settled.clear()
            if self.profile.drive is not None:
                self.simulator.receive(self.decoder.drive_command(target))
            else:
                self.simulator.hand_to(target)
            if self.until(lambda: self.settled, 10.0):
                return self.settled[-1]
        raise AssertionError("the hand never settled")

    def record(self) -> Record:
        """Press until a record comes; what was refused was seen by the operator."""
        switch = next(
            (s for s in self.profile.footswitches.values() if s.source in ("record", "every")),
            None,
        )
        for _ in range(60):
            start = len(self.readings)
            self.presses += 1
            if switch is not None:
                self.simulator.press(switch.name)
            else:
                self.decoder.press("key", self.now)

            def done(start: int = start) -> bool:
                return any(isinstance(r, Record | Refused) for r in self.readings[start:])

            self.until(done, 3.0)
            self.run(1.5)
            records = [r for r in self.readings[start:] if isinstance(r, Record)]
            if records:
                return records[-1]
        raise AssertionError("nothing was ever recorded")


@pytest.fixture
def bench() -> Callable[..., Bench]:
    def make(profile: Profile, **settings: object) -> Bench:
        truth = settings.pop("photographs", None) or _photographs()
        hand = settings.pop("hand", Hand(settle_time=0.2))
        simulator = SimulatedPlotter(profile, truth, hand=hand, **settings)  # type: ignore[arg-type]
        simulator.lay("1", None if profile.mono else "2")
        made = Bench(profile, simulator, Decoder(profile, speed_limits=False))
        simulator.set_on_settled(made.settled.append)
        return made

    return make


def tolerance(profile: Profile) -> float:
    """Largest difference between the carriages and what the device can tell of them [mm]."""
    return profile.simulate.resolution_um / 1000.0 + 1e-4


@pytest.fixture
def same_place() -> Callable[[Profile, Position, Position], bool]:
    def check(profile: Profile, a: Position, b: Position) -> bool:
        limit = tolerance(profile)
        return all(
            abs(one - other) <= limit
            for one, other in ((a.xl, b.xl), (a.yl, b.yl), (a.xr, b.xr), (a.yr, b.yr))
        )

    return check


@pytest.fixture
def offsets() -> type[Offsets]:
    return Offsets
