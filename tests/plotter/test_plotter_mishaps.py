from __future__ import annotations

import pytest

from anaplot.errors import InputError
from anaplot.plotter.device.hand import Hand, HandSettled, fiducial_name
from anaplot.plotter.device.mishaps import MISHAPS
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position
from anaplot.report.simulatorcommand import obey

LEFT = {"a": (10.0, 20.0), "b": (30.0, -40.0), fiducial_name("left", "1"): (-100.0, 100.0)}
RIGHT = {"a": (-80.0, 21.0), "b": (-60.0, -41.0), fiducial_name("right", "1"): (-99.0, 101.0)}


class Made:
    def __init__(self) -> None:
        self.settled: list[HandSettled] = []
        self.simulator = SimulatedPlotter(
            load_profile("simulated"),
            {"1": LEFT, "2": RIGHT},
            in_right={"1": LEFT, "2": RIGHT},
            noise_um=0.0,
            hand=Hand(),
            on_settled=self.settled.append,
        )
        self.simulator.lay("1", "2")

    def say(self, line: str) -> str:
        return obey(self.simulator, line.split())

    def point(self, near: tuple[float, float], right: tuple[float, float]) -> Position:
        self.simulator.hand_to(Position(*near, *right))
        count = len(self.settled)
        for _ in range(1000):
            self.simulator.advance(0.1)
            if len(self.settled) > count:
                return self.settled[-1].position
        raise AssertionError("the hand never settled")

    def at(self, point: str) -> Position:
        return self.point(LEFT[point], RIGHT[point])


def close(position: Position, *place: float) -> None:
    assert (position.xl, position.yl, position.xr, position.yr) == pytest.approx(place, abs=2e-3)


@pytest.mark.parametrize(
    ("line", "first"),
    [
        ("parallax a 150", (10.0, 20.0, -80.0, 21.15)),
        ("transfer a 100 -50", (10.1, 19.95, -79.9, 20.95)),
        ("wrong-point a b", (30.0, -40.0, -60.0, -41.0)),
        ("swap a b", (30.0, -40.0, -60.0, -41.0)),
    ],
)
def test_a_mistake_is_made_once(line: str, first: tuple[float, ...]) -> None:
    made = Made()
    made.say(line)
    close(made.at("a"), *first)
    close(made.at("a"), 10.0, 20.0, -80.0, 21.0)
    if line.startswith("swap"):
        close(made.at("b"), 10.0, 20.0, -80.0, 21.0)
    close(made.at("b"), 30.0, -40.0, -60.0, -41.0)


def test_a_drift_grows() -> None:
    made = Made()
    made.say("drift 10")
    shifts = [made.at("a").yr - 21.0 for _ in range(3)]
    assert shifts[1] - shifts[0] == pytest.approx(0.01, abs=2e-3)
    assert shifts[2] - shifts[1] == pytest.approx(0.01, abs=2e-3)


def test_the_hand_attends_to_fiducials() -> None:
    made = Made()
    assert "fiducials of the right" in made.say("attend right")
    close(made.point((-100.0, 100.0), (-98.0, 100.0)), -100.0, 100.0, -99.0, 101.0)
    made.say("attend points")
    close(made.at("b"), 30.0, -40.0, -60.0, -41.0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("parallax a", "POINT UM"),
        ("parallax c 5", "point c does not lie in both"),
        ("parallax a much", '"much" is not a number'),
        ("transfer a 1 nan", '"nan" is not a number'),
        ("swap a c", "point c"),
        ("attend both", "is not understood"),
    ],
)
def test_mistakes_in_the_words(line: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Made().say(line)


def test_every_mistake_is_told_of() -> None:
    with pytest.raises(InputError) as caught:
        Made().say("nonsense")
    assert all(name in str(caught.value) for name in MISHAPS)
