"""Two strips of five photos with cross ties and control, from `anaplot new` to the adjusted block.

`tests/benchmarks/whole_block.py` does the same with fifty seeds, and with fiducials.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from plotterscene import Workplace, block_of_options, misfit
from scipy.special import chdtri
from syntheticblocks import synthetic_block

from anaplot.bundle.adjust import adjust_block
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.exchange.camerafile import write_camera
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.station.imagepoints import rows_of

SEEDS = 6


@pytest.mark.slow
@pytest.mark.long
def test_ground_coordinates_lie_within_their_predicted_deviations(tmp_path: Path) -> None:
    camera = tmp_path / "camera.toml"
    write_camera(camera, CameraCalibration("camera", 152.4, format=(230.0, 230.0)))
    total, count, vtpv, redundancy = 0.0, 0, 0.0, 0
    for seed in range(1, SEEDS + 1):
        made = synthetic_block(2, 5, seed=seed)
        folder = block_of_options(made, tmp_path / str(seed), str(camera))
        block = read_block(folder)
        place = Workplace(block, made.truth, seed=seed, watched=False)
        place.measured()
        models = place.state.models
        # nothing is switched off, whatever chance flags
        assert all(not model.off for model in models)
        write_image_points(folder, rows_of(models))
        adjusted = adjust_block(read_block(folder))
        square, coordinates = misfit(adjusted, made)
        # one block in 20 000 lies outside these
        low, high = chdtri(coordinates, [1.0 - 2.5e-5, 2.5e-5]).tolist()
        assert low < square < high
        total, count = total + square, count + coordinates
        vtpv, redundancy = vtpv + adjusted.vtpv, redundancy + adjusted.redundancy
        # what is offered was measured: ties across the strips, and all control
        measured = [{m.point for m in model.used} for model in models]
        first, second = set().union(*measured[:4]), set().union(*measured[4:])
        assert len(first & second) >= 6
        assert {c.point for c in block.control} <= first | second
    low, high = chdtri(count, [1.0 - 2.5e-5, 2.5e-5]).tolist()
    assert low < total < high
    low, high = chdtri(redundancy, [1.0 - 2.5e-5, 2.5e-5]).tolist()
    assert low < vtpv < high
