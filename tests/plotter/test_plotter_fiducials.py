"""Fiducials in the simulated plotter: pointed at in one plate, apart from the points."""

from __future__ import annotations

import pytest

from anaplot.errors import InputError
from anaplot.plotter.decoder import Decoder
from anaplot.plotter.device.hand import HandSettled, Offsets, fiducial_name
from anaplot.plotter.device.plotter import Side, SimulatedPlotter
from anaplot.plotter.readings import Position

# a point lies beside the fiducial, and its twin has a name like a fiducial's
IN_LEFT = {
    "1": {"a": (10.0, 10.0), "left 1": (-90.0, 0.0), fiducial_name("left", "1"): (-100.0, 3.0)},
    "2": {"a": (11.0, 10.0), "left 1": (-91.0, 0.0), fiducial_name("left", "1"): (-101.0, 4.0)},
}
IN_RIGHT = {
    "1": {"a": (20.0, 30.0), "left 1": (-80.0, 0.0), fiducial_name("right", "1"): (-90.0, 5.0)},
    "2": {"a": (21.0, 30.0), "left 1": (-81.0, 0.0), fiducial_name("right", "1"): (-91.0, 6.0)},
}


def plotter_of(simulated, **options) -> tuple[SimulatedPlotter, list[HandSettled]]:
    settled: list[HandSettled] = []
    made = SimulatedPlotter(
        simulated,
        IN_LEFT,
        in_right=IN_RIGHT,
        on_settled=settled.append,
        **{"noise_um": 0.0, **options},
    )
    made.lay("1", "2")
    return made, settled


def drive(plotter: SimulatedPlotter, side: Side | None, target: Position) -> None:
    plotter.attend(side)
    plotter.receive(Decoder(plotter.profile).drive_command(target))
    plotter.advance(30.0)


def test_no_point_can_be_named_like_a_fiducial() -> None:
    from anaplot.textfiles.names import name_fault

    for side in ("left", "right"):
        assert name_fault(fiducial_name(side, "1")) is not None


@pytest.mark.parametrize(
    ("side", "ends"),
    [
        ("left", Position(-100.0, 3.0, 5.0, 6.0)),
        ("right", Position(-94.0, 1.0, -91.0, 6.0)),
        (None, Position(-90.0, 0.0, -81.0, 0.0)),
    ],
)
def test_the_hand_points_where_it_attends(simulated, side, ends) -> None:
    plotter, settled = plotter_of(simulated)
    target = Position(-94.0, 1.0, 5.0 if side != "right" else -95.0, 6.0 if side == "left" else 1.0)
    drive(plotter, side, target)
    assert plotter.positions() == ends
    name = "left 1" if side is None else fiducial_name(side, "1")
    assert [s.point for s in settled] == [name]
    assert plotter.pointed == {("1", "2", name): 1}


def test_a_photograph_lies_differently_in_either_carriage(simulated) -> None:
    plotter, _ = plotter_of(simulated)
    assert plotter.points_of("1")["a"] == (10.0, 10.0)
    assert plotter.points_of("1", "right")["a"] == (20.0, 30.0)
    drive(plotter, None, Position(9.0, 9.0, 0.0, 0.0))
    assert plotter.positions() == Position(10.0, 10.0, 21.0, 30.0)
    plotter.lay("2", "1")
    drive(plotter, None, Position(9.0, 9.0, 0.0, 0.0))
    assert plotter.positions() == Position(11.0, 10.0, 20.0, 30.0)
    for bad in (("1", "3"), ("3", "1")):
        with pytest.raises(InputError, match="no photograph 3"):
            plotter.lay(*bad)
    with pytest.raises(InputError, match="no photograph 3"):
        plotter.points_of("3", "right")


def test_a_fiducial_too_far_away_is_not_found(simulated) -> None:
    plotter, settled = plotter_of(simulated)
    drive(plotter, "left", Position(-60.0, 0.0, 0.0, 0.0))
    assert settled[-1].point is None
    # nor does the hand take a point for it
    drive(plotter, "left", Position(10.0, 10.0, 20.0, 30.0))
    assert settled[-1].point is None


def test_mistakes_and_noise_at_fiducials_are_their_own(simulated) -> None:
    key = ("1", "2", fiducial_name("right", "1"))
    plotter, _ = plotter_of(simulated, mistakes={key: Offsets(dxl=9.0, dxr=0.1, dyr=-0.2)})
    near = Position(0.0, 0.0, -95.0, 1.0)
    drive(plotter, "right", near)
    assert plotter.positions() == Position(0.0, 0.0, -90.9, 5.8)
    drive(plotter, "right", near)
    assert plotter.positions() == Position(0.0, 0.0, -91.0, 6.0)
    noisy = [plotter_of(simulated, noise_um=5.0, seed=seed)[0] for seed in (1, 1, 2)]
    for one in noisy:
        drive(one, "right", near)
    at = [one.positions() for one in noisy]
    assert at[0] == at[1] != at[2]
    assert 0.0 < abs(at[0].xr + 91.0) < 0.03


def test_drift_counts_points_only(simulated) -> None:
    plotter, _ = plotter_of(simulated, drift=Offsets(dxl=0.001))
    for _ in range(3):
        drive(plotter, "left", Position(-95.0, 1.0, 0.0, 0.0))
        assert plotter.positions().xl == -100.0
    drive(plotter, None, Position(9.0, 9.0, 0.0, 0.0))
    assert plotter.positions().xl == pytest.approx(10.001)


def test_a_session_that_goes_on_tomorrow_meets_the_same_pointings(simulated) -> None:
    near = Position(-95.0, 1.0, 0.0, 0.0)
    today, _ = plotter_of(simulated, noise_um=5.0)
    drive(today, "left", near)
    drive(today, "left", near)
    tomorrow, _ = plotter_of(
        simulated, noise_um=5.0, pointed={("1", "2", fiducial_name("left", "1")): 1}
    )
    drive(tomorrow, "left", near)
    assert tomorrow.positions() == today.positions()
