from __future__ import annotations

import random

import pytest

from anaplot.errors import InputError
from anaplot.plotter.device.faults import (
    BAD_PARITY,
    FAULTS,
    FRAME_FAULTS,
    LASTING_FAULTS,
    check_fault,
    damaged,
    garbled,
    struck,
)
from anaplot.plotter.profile import load_profile
from anaplot.plotter.readings import Position, Refused
from anaplot.plotter.schema import LineSettings

pytestmark = pytest.mark.slow

PLAIN = LineSettings("main")
EVEN = LineSettings("main", bytesize=7, parity="even")
POINTS = ["101", "103", "105", "107"]


def measured(made, photographs) -> list[Position]:
    """A row of points, each measured until it is recorded; every record must be where it was."""
    places = []
    for point in POINTS:
        left = photographs["1"][point]
        right = left if made.profile.mono else photographs["2"][point]
        settled = made.go(Position(*left, *right))
        assert settled.point == point
        places.append(made.record().position)
    return places


@pytest.fixture
def within(photographs) -> dict:
    """The photographs, with points inside what every profile can reach."""
    return photographs


@pytest.mark.parametrize("fault", FRAME_FAULTS)
def test_a_damaged_record_by_rate_changes_no_measurement(fault, any_profile, bench, within):
    made = bench(any_profile, photographs=within, seed=5)
    expected = measured(made, within)
    hurt = bench(any_profile, photographs=within, seed=5, fault_rates={fault: 0.2})
    hurt.simulator.inject(fault)
    assert measured(hurt, within) == expected
    if fault not in ("duplicate", "garbage"):
        assert any(isinstance(reading, Refused) for reading in hurt.readings)


@pytest.mark.parametrize("fault", LASTING_FAULTS)
def test_a_lasting_fault_changes_no_measurement(fault, any_profile, bench, within, same_place):
    made = bench(any_profile, photographs=within, seed=5)
    expected = measured(made, within)
    hurt = bench(any_profile, photographs=within, seed=5)
    places = []
    for point in POINTS:
        hurt.simulator.inject(fault, seconds=1.3)
        left = within["1"][point]
        right = left if any_profile.mono else within["2"][point]
        hurt.go(Position(*left, *right))
        hurt.simulator.inject(fault, seconds=1.3)
        place = hurt.record().position
        assert same_place(any_profile, place, hurt.simulator.positions())
        places.append(place)
    if fault == "freeze":
        # drives that were not heard were repeated: no pointing was lost by that
        assert hurt.simulator.pointed == made.simulator.pointed
    assert places == expected


def test_everything_at_once(any_profile, bench, within, same_place):
    rates = dict.fromkeys(FRAME_FAULTS, 0.05)
    hurt = bench(any_profile, photographs=within, seed=11, fault_rates=rates)
    for point in POINTS:
        left = within["1"][point]
        right = left if any_profile.mono else within["2"][point]
        hurt.go(Position(*left, *right))
        place = hurt.record().position
        assert same_place(any_profile, place, hurt.simulator.positions())


def test_one_fault_strikes_one_record(simulated, bench):
    made = bench(simulated)
    made.run(0.5)
    assert not any(isinstance(reading, Refused) for reading in made.readings)
    made.simulator.inject("flip")
    made.run(2.0)
    assert len([reading for reading in made.readings if isinstance(reading, Refused)]) == 1


def test_duplicated_records_of_a_numbering_device_are_refused(simulated, bench):
    made = bench(simulated)
    made.simulator.inject("duplicate")
    made.simulator.press()
    made.run(0.5)
    reasons = [reading.reason for reading in made.readings if isinstance(reading, Refused)]
    assert reasons == ["record 1 came twice"]


def test_a_device_that_lost_its_power_is_noticed(bench):
    profile = load_profile("anaplot-ascii")
    made = bench(profile)
    made.simulator.move(5.0, 5.0, 5.0, 5.0)
    for _ in range(3):
        made.record()
    made.simulator.power_cycle()
    made.simulator.press()
    made.run(0.5)
    assert not made.decoder.referenced
    made.run(0.5)
    assert made.decoder.unreferenced_position == Position(0.0, 0.0, 0.0, 0.0)
    made.decoder.reference(Position(5.0, 5.0, 5.0, 5.0))
    made.run(0.5)
    assert made.readings[-1] == Position(5.0, 5.0, 5.0, 5.0)


def test_what_strikes_depends_on_the_record_not_on_time():
    rates = dict.fromkeys(FAULTS, 0.3)
    once = [struck(rates, 1, frame)[0] for frame in range(50)]
    assert once == [struck(rates, 1, frame)[0] for frame in range(50)]
    assert once != [struck(rates, 2, frame)[0] for frame in range(50)]
    assert struck({}, 1, 1)[0] == []


@pytest.mark.parametrize("name", FRAME_FAULTS)
def test_damage(name):
    data = b"P 1234\n"
    for seed in range(50):
        got = damaged(name, data, PLAIN, random.Random(seed))
        if name == "drop":
            assert 1 <= len(data) - len(got) <= 3
        elif name == "flip":
            (at,) = [at for at in range(len(data)) if got[at] != data[at]]
            assert (got[at] ^ data[at]).bit_count() == 1
        elif name == "partial":
            assert data.startswith(got)
            assert got != data
        elif name == "duplicate":
            assert got == data * 2
        else:
            assert got.endswith(data)
            assert 1 <= len(got) - len(data) <= 20
    assert damaged(name, b"", PLAIN, random.Random(1)) == b""


def test_parity_turns_a_flipped_bit_into_a_byte_that_no_record_holds():
    got = damaged("flip", b"1234", EVEN, random.Random(1))
    assert got.count(BAD_PARITY) == 1


def test_another_baud_rate_keeps_no_digit():
    assert not set(garbled(bytes(range(48, 58)), PLAIN, random.Random(1))) & set(range(48, 58))
    assert BAD_PARITY in garbled(b"0123456789", EVEN, random.Random(1))


def test_names_and_rates_are_checked(simulated, bench):
    with pytest.raises(InputError, match="'flip'"):
        check_fault("flop")
    with pytest.raises(InputError, match="between 0 and 1"):
        bench(simulated, fault_rates={"flip": 2.0})
    with pytest.raises(InputError, match="no link"):
        bench(simulated).simulator.inject("flip", "left")
