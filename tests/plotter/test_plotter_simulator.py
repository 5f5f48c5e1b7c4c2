from __future__ import annotations

import pytest

from anaplot.errors import InputError
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.hand import Hand, Offsets, transfer_error
from anaplot.plotter.device.plotter import SimulatedPlotter
from anaplot.plotter.profile import find_profiles, load_profile, parse_profile
from anaplot.plotter.readings import Fault, InPosition, Position, Record


def difference(a: Position, b: Position) -> float:
    return max(abs(a.xl - b.xl), abs(a.yl - b.yl), abs(a.xr - b.xr), abs(a.yr - b.yr))


def truth(photographs, point, left="1", right="2") -> Position:
    return Position(*photographs[left][point], *photographs[right][point])


def test_carriages_start_at_the_plates_centre_and_keep_their_travel(simulated):
    plotter = SimulatedPlotter(simulated, {})
    assert plotter.positions() == Position(0.0, 0.0, 0.0, 0.0)
    assert plotter.move(1.0, 2.0, -3.0, 0.5) == Position(1.0, 2.0, -3.0, 0.5)
    assert plotter.move(1000.0, 0.0, 0.0, -1000.0) == Position(160.0, 2.0, -3.0, -160.0)


def test_a_drive_takes_its_time_and_ends_in_position(simulated):
    plotter = SimulatedPlotter(simulated, {}, hand=Hand(follow=False))
    decoder = Decoder(simulated)
    plotter.receive(decoder.drive_command(Position(60.0, 30.0, -15.0, 0.0)))
    assert plotter.step(0.5) == b""
    assert difference(plotter.positions(), Position(30.0, 15.0, -7.5, 0.0)) < 1e-9
    plotter.receive(decoder.poll_request())
    assert decoder.feed(plotter.step(0.01), 0.0) == [Position(30.0, 15.0, -7.5, 0.0)]
    assert plotter.next_event() == pytest.approx(0.49)
    readings = decoder.feed(plotter.step(0.495), 0.0)
    assert readings == [InPosition(Position(60.0, 30.0, -15.0, 0.0))]


def test_a_hand_moves_no_faster_than_the_profile_says():
    profile = load_profile("anaplot-ascii")
    fastest = min(axis.fastest for axis in profile.axes.values())
    # tilts: the right plate is 17 mm away from where it is driven to
    far = {"1": {"7": (10.0, 20.0)}, "2": {"7": (-65.0, 3.0)}}
    settled = []
    plotter = SimulatedPlotter(profile, far, on_settled=settled.append)
    plotter.lay("1", "2")
    decoder = Decoder(profile)
    plotter.receive(decoder.drive_command(Position(10.0, 20.0, -82.0, 20.0)))
    before, tick = plotter.positions(), 0.02
    while not settled:
        plotter.step(tick)
        now = plotter.positions()
        assert difference(now, before) <= fastest * tick
        before = now
    assert settled[0].point == "7"
    assert difference(settled[0].position, Position(10.0, 20.0, -65.0, 3.0)) < 0.05
    # a new drive while the hand is under way ends that
    plotter.receive(decoder.drive_command(Position(10.0, 20.0, -82.0, 20.0)))
    plotter.step(profile.simulate.speed / 60.0 * 0.29 + Hand().settle_time + 0.1)
    plotter.receive(decoder.drive_command(Position(0.0, 0.0, 0.0, 0.0)))
    plotter.set_hand(Hand(follow=False))
    plotter.step(20.0)
    assert difference(plotter.positions(), Position(0.0, 0.0, 0.0, 0.0)) < 1e-9
    assert len(settled) == 1


def test_stop_holds_the_carriages_and_ends_nothing(simulated):
    plotter = SimulatedPlotter(simulated, {}, hand=Hand(follow=False))
    decoder = Decoder(simulated)
    plotter.receive(decoder.drive_command(Position(60.0, 0.0, 0.0, 0.0)))
    plotter.step(0.25)
    plotter.receive(decoder.stop_command())
    assert plotter.step(10.0) == b""
    assert plotter.positions().xl == pytest.approx(15.0)


def test_commands_that_make_no_sense_are_answered_with_a_fault(simulated):
    plotter = SimulatedPlotter(simulated, {})
    decoder = Decoder(simulated)
    good = decoder.drive_command(Position(1.0, 1.0, 1.0, 1.0))
    beyond = b"G +900.0000 +000.0000 +000.0000 +000.0000"
    assert simulated.checksum is not None
    for command, code in [
        (good.replace(b"+001.0", b"+002.0", 1), "4"),
        (b"hello\n", "4"),
        (b"x" * 300, "4"),
        (beyond + simulated.checksum.digits(beyond) + b"\n", "1"),
    ]:
        plotter.receive(command)
        (fault,) = decoder.feed(plotter.step(1.0), 0.0)
        assert isinstance(fault, Fault)
        assert fault.code == code
    assert plotter.positions() == Position(0.0, 0.0, 0.0, 0.0)


def test_a_checksum_that_is_not_required_may_be_left_out():
    profile = load_profile("anaplot-ascii")
    assert profile.checksum is not None
    assert not profile.checksum.required
    decoder, place = Decoder(profile), Position(1.0, 2.0, 3.0, 4.0)
    whole = decoder.drive_command(place)
    bare = whole[: whole.index(profile.checksum.marker)]
    for command, understood in (
        (whole, True),
        (bare + b"\n", True),
        (whole.replace(b"1.0", b"1.5", 1), False),
    ):
        plotter = SimulatedPlotter(profile, {}, hand=Hand(follow=False))
        plotter.receive(command)
        heard = [type(reading) for reading in Decoder(profile).feed(plotter.step(60.0), 0.0)]
        assert (Fault not in heard) == understood
        assert (difference(plotter.positions(), place) < 0.01) == understood
    # where one is required nothing is understood without
    strict = load_profile("anaplot-ascii-crc")
    plotter = SimulatedPlotter(strict, {}, hand=Hand(follow=False))
    plotter.receive(bare + b"\n")
    (fault,) = Decoder(strict).feed(plotter.step(60.0), 0.0)
    assert isinstance(fault, Fault)


def test_commands_may_come_byte_by_byte(simulated):
    plotter = SimulatedPlotter(simulated, {}, hand=Hand(follow=False))
    decoder = Decoder(simulated)
    command = decoder.poll_request() + decoder.drive_command(Position(6.0, 0.0, 0.0, 0.0))
    for at in range(len(command)):
        plotter.receive(command[at : at + 1])
    readings = decoder.feed(plotter.step(1.0), 0.0)
    assert [type(reading) for reading in readings] == [Position, InPosition]


def test_the_hand_sets_the_mark_on_the_nearest_common_point(simulated, photographs):
    settled = []
    plotter = SimulatedPlotter(
        simulated, photographs, noise_um=0.0, on_settled=settled.append, hand=Hand()
    )
    plotter.lay("1", "2")
    point = truth(photographs, "103")
    plotter.receive(
        Decoder(simulated).drive_command(
            Position(point.xl + 3.0, point.yl - 2.0, point.xr + 9.0, point.yr)
        )
    )
    plotter.advance(20.0)
    assert settled[0].point == "103"
    assert settled[0].times == 1
    assert difference(plotter.positions(), point) < 1e-9
    plotter.hand_to(Position(100.0, -100.0, 0.0, 0.0))
    plotter.advance(20.0)
    assert settled[1].point is None


def test_a_point_in_one_photograph_only_is_not_found(simulated, photographs):
    alone = {"1": photographs["1"], "2": {}}
    settled = []
    plotter = SimulatedPlotter(simulated, alone, on_settled=settled.append)
    plotter.lay("1", "2")
    plotter.hand_to(truth(photographs, "103"))
    plotter.advance(5.0)
    assert [event.point for event in settled] == [None]


def pointed(profile, photographs, visits, **settings):
    """Positions at which the pedal was pressed, by drives to the visited points."""
    plotter = SimulatedPlotter(profile, photographs, hand=Hand(auto_pedal=True), **settings)
    plotter.lay("1", "2")
    decoder = Decoder(profile)
    found = []
    for at, visit in enumerate(visits):
        plotter.receive(decoder.drive_command(truth(photographs, visit)))
        readings = decoder.feed(plotter.step(20.0), float(at))
        found += [reading for reading in readings if isinstance(reading, Record)]
    return [record.position for record in found]


def test_pointings_depend_on_seed_model_point_and_count_alone(simulated, photographs):
    one = pointed(simulated, photographs, ["101", "102", "101"], seed=3)
    other = pointed(simulated, photographs, ["102", "101", "101"], seed=3)
    assert one[0] == other[1]
    assert one[1] == other[0]
    assert one[2] == other[2]
    assert one[0] != one[2]
    assert pointed(simulated, photographs, ["101"], seed=4)[0] != one[0]
    again = pointed(simulated, photographs, ["101"], seed=3, pointed={("1", "2", "101"): 1})
    assert again == [one[2]]


def test_the_noise_has_the_size_that_was_asked_for(simulated, photographs):
    visits = ["101"] * 150
    places = pointed(simulated, photographs, visits, noise_um=20.0, seed=1)
    here = truth(photographs, "101")
    squares = [
        ((a - b) * 1000.0) ** 2
        for place in places
        for a, b in (
            (place.xl, here.xl),
            (place.yl, here.yl),
            (place.xr, here.xr),
            (place.yr, here.yr),
        )
    ]
    # 600 values: the deviation lies within four of its own standard deviations
    assert (sum(squares) / len(squares)) ** 0.5 == pytest.approx(20.0, rel=4 / (2 * 600) ** 0.5)


def test_mistakes_are_made_the_first_times_only(simulated, photographs):
    mistakes = {("1", "2", "101"): Offsets(dyr=0.1, count=2)}
    clean = pointed(simulated, photographs, ["101"] * 3, noise_um=0.0)
    wrong = pointed(simulated, photographs, ["101"] * 3, noise_um=0.0, mistakes=mistakes)
    offs = [round(b.yr - a.yr, 6) for a, b in zip(clean, wrong, strict=True)]
    assert offs == [0.1, 0.1, 0.0]


def test_transfer_error_gives_no_parallax(simulated, photographs):
    mistakes = transfer_error("1", "2", "101", 0.3, -0.2)
    (clean,) = pointed(simulated, photographs, ["101"], noise_um=0.0)
    (wrong,) = pointed(simulated, photographs, ["101"], noise_um=0.0, mistakes=mistakes)
    assert wrong.xl - wrong.xr == pytest.approx(clean.xl - clean.xr)
    assert wrong.xl - clean.xl == pytest.approx(0.3)


def test_drift_grows_with_every_pointing(simulated, photographs):
    visits = ["101", "102", "103"]
    clean = pointed(simulated, photographs, visits, noise_um=0.0)
    drifted = pointed(simulated, photographs, visits, noise_um=0.0, drift=Offsets(dyl=0.01))
    offs = [round(b.yl - a.yl, 6) for a, b in zip(clean, drifted, strict=True)]
    assert offs == [0.01, 0.02, 0.03]


def test_moving_by_hand_cancels_what_the_hand_was_about_to_do(simulated, photographs):
    settled = []
    plotter = SimulatedPlotter(
        simulated, photographs, hand=Hand(auto_pedal=True), on_settled=settled.append
    )
    plotter.lay("1", "2")
    plotter.hand_to(truth(photographs, "101"))
    plotter.advance(0.1)
    plotter.move(0.1)
    assert plotter.step(30.0) == b""
    assert settled == []


def test_photographs_must_be_there(simulated, photographs):
    plotter = SimulatedPlotter(simulated, photographs)
    with pytest.raises(InputError, match="no photograph 9"):
        plotter.lay("1", "9")
    with pytest.raises(InputError, match="two photographs"):
        plotter.lay("1")
    with pytest.raises(InputError, match="no footswitch"):
        plotter.press("knee")
    mono = SimulatedPlotter(load_profile("heidenhain-nd720"), photographs)
    mono.lay("2")
    assert mono.laid == ("2", "2")
    assert mono.press("key") is False


def variant(name: str, **simulate: float) -> object:
    """A shipped profile with other [simulate] values."""
    text = (load_profile_source(name)).split("[simulate]")
    table = "\n".join(f"{key} = {value}" for key, value in simulate.items())
    rest = text[1].split("\n\n", 1)[1]
    return parse_profile(f"{text[0]}[simulate]\n{table}\n\n{rest}".encode(), "v.toml")


def load_profile_source(name: str) -> str:
    return find_profiles()[name].read_text()


def read_position(profile, plotter) -> Position:
    plotter.receive(b"?\n")
    (position,) = Decoder(profile).feed(plotter.step(1.0), 0.0)
    assert isinstance(position, Position)
    return position


def test_encoder_resolution(simulated):
    profile = variant("simulated", resolution_um=5.0)
    plotter = SimulatedPlotter(profile, {})
    plotter.move(0.0123, -0.0078, 0.0, 0.0)
    assert read_position(profile, plotter) == Position(0.01, -0.01, 0.0, 0.0)


def test_backlash_depends_on_the_side_from_which_a_place_was_reached():
    profile = variant("simulated", backlash_um=10.0)
    plotter = SimulatedPlotter(profile, {})
    plotter.move(dxl=2.0)
    up = read_position(profile, plotter).xl
    plotter.move(dxl=2.0)
    plotter.move(dxl=-2.0)
    down = read_position(profile, plotter).xl
    assert down - up == pytest.approx(0.01)


def test_encoder_noise_differs_from_reading_to_reading():
    profile = variant("simulated", noise_um=3.0)
    plotter = SimulatedPlotter(profile, {})
    values = {read_position(profile, plotter).xl for _ in range(20)}
    assert len(values) > 3


def test_bytes_take_their_time_at_the_links_baud_rate():
    profile = load_profile("heidenhain-nd281b")
    plotter = SimulatedPlotter(profile, {})
    plotter.receive(b"\x02", "xl")
    per_byte = 11 / 9600
    assert plotter.step(0.001 + 4.5 * per_byte, "xl") == b"+   "
    assert plotter.step(12 * per_byte, "xl") == b" 0.0000   A\r"
    assert plotter.step(10.0, "xl") == b"\n"
