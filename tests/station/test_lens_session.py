"""Sessions in blocks whose image points are stored in pixels, or through a lens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.photogrammetry.block import in_pixels
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import plate_calibration
from anaplot.planning.syntheticcamera import with_calibration
from anaplot.report.applyerrors import applied, taken_back
from anaplot.session.plates import PlateSystem
from anaplot.simulation.automatic import AutomaticOperator, ModelRecord
from anaplot.simulation.demo import Demo
from anaplot.simulation.laidplates import laid_photographs, random_placements
from anaplot.station.journaled import journaled
from anaplot.station.station import Station

LENS = BrownLens(k1=-0.02, k2=0.004, p1=1e-4)
KINDS = ("file", "inline", "pixels")


class Stop(Exception):
    """The first model is accepted."""


def stop(record: ModelRecord) -> None:
    raise Stop(record.left)


def demo_of(kind: str) -> Demo:
    demo = Demo.make(2, 3)
    (camera,) = demo.strip.block.cameras
    if kind == "file":
        made = with_calibration(camera)
        assert made.calibration is not None
        calibration = replace(made.calibration, radial=None, lens=LENS)
        camera = replace(made, lens=LENS, calibration=calibration)
    elif kind == "inline":
        camera = replace(camera, lens=LENS)
    else:
        camera = in_pixels(replace(camera, format=None), (23000, 23000), 10.0, (11400.0, 11600.0))
    block = replace(demo.strip.block, cameras=(camera,), in_pixels=kind == "pixels")
    placements = random_placements(block, 3)
    return replace(demo, strip=replace(demo.strip, block=block), placements=placements)


def begun(kind: str, folder: Path) -> Demo:
    """Begin a block; the file in pixels has its header, as no session makes it one of pixels."""
    demo = demo_of(kind)
    demo.write(folder)
    if kind == "pixels":
        (folder / "image_points.csv").write_text(
            "photo,point,x_px,y_px\n101,elsewhere,1234.5,2345.25\n"
        )
    return demo


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_session_goes_on_and_takes_over_what_adjust_switched(kind: str, tmp_path: Path) -> None:
    folder = tmp_path / "b"
    demo = begun(kind, folder)
    with demo.open(folder, 5000.0) as station, pytest.raises(Stop):
        AutomaticOperator(station, stop).run()
    file = (folder / "image_points.csv").read_bytes()
    assert journaled(folder, read_block(folder)).edited == ()
    with Station(folder) as station:
        assert len(station.state.models) == 1
        # what is on the plate is what stands in the file
        for row in read_block(folder).image_points:
            if row.photo == "101" and row.model is not None:
                assert row.measured is not None
                assert row.measured != (row.x, row.y)
    assert (folder / "image_points.csv").read_bytes() == file
    with demo.open(folder, 5000.0) as station:
        AutomaticOperator(station).run()
        after = station.state.models
    block = read_block(folder)
    assert [m.name for m in after] == ["101/102", "102/103"]
    names = [(row.photo, row.point, row.model) for row in block.image_points]
    assert (
        len(names)
        == len(set(names))
        == 2 * sum(len(m.measured) for m in after) + (kind == "pixels")
    )
    # but for the demonstration's mistakes they lie where they do in truth
    truth = demo.strip.truth
    off = [
        np.hypot(row.x - truth[row.photo][row.point][0], row.y - truth[row.photo][row.point][1])
        for row in block.image_points
        if row.model is not None
    ]
    assert np.median(off) < 0.015
    # a strategy switches a row off, and on again
    point = after[0].used[0].point
    rejected = applied(block.image_points, [("image", "102", point, "101/102", "y")], "tau")
    write_image_points(folder, rejected, block)
    with Station(folder) as station:
        assert (point, "y") in station.state.models[0].off
    back = taken_back(read_block(folder).image_points, ["tau"])
    write_image_points(folder, back, block)
    with Station(folder) as station:
        assert station.state.models[0].off == after[0].off
    # what a person moved is still told
    moved = [replace(row, x=row.x + 1e-5, measured=None) for row in back]
    write_image_points(folder, moved, block)
    assert "was changed outside" in journaled(folder, read_block(folder)).remark(folder)


def test_a_simulated_plate_lies_as_its_lens_images_it() -> None:
    demo = demo_of("inline")
    left, _ = laid_photographs(demo.strip.block, demo.strip.truth, {})
    plates = PlateSystem(calibration=plate_calibration(demo.strip.block, "101"))
    truth, laid = demo.strip.truth["101"], left["101"]
    corner = max(truth, key=lambda name: np.hypot(*truth[name]))
    assert np.hypot(*np.subtract(laid[corner], truth[corner])) > 0.1
    for name, place in truth.items():
        assert plates.to_image(*laid[name]) == pytest.approx(place, abs=1e-7)
        assert plates.to_plate(*place) == pytest.approx(laid[name], abs=1e-9)
