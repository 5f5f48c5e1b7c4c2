"""Whether ground coordinates of measured blocks are as good as predicted, and what one costs.

    python tests/benchmarks/whole_block.py [blocks] [fiducials]

Blocks of two strips of five photos, each with a seed of its own, are made by the options of
`anaplot new`, measured by the automatic operator through the simulated plotter, and adjusted. Of
all ground coordinates, with their whole covariance matrix and the a-priori sigma0, d' C^-1 d is a
chi-square if the prediction is right; so is v'Pv. With `fiducials` the camera has some, and every
photo's inner orientation is measured with the same precision: its errors are common to all points
of a photo in a model, of which the block's weights know nothing.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from math import sqrt
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "session"))

from plotterscene import Workplace, block_of_options, misfit
from scipy.special import chdtri
from syntheticblocks import synthetic_block

from anaplot.bundle.adjust import adjust_block
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.exchange.camerafile import write_camera
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.planning.syntheticcamera import with_calibration
from anaplot.station.imagepoints import rows_of


def main(blocks: int = 50, fiducials: str = "") -> int:
    """Print the sums and their bounds; 0 when all lie within, of one in 20 000 by chance."""
    total, count, vtpv, redundancy, worst = 0.0, 0, 0.0, 0, 0.0
    start = process_time()
    with tempfile.TemporaryDirectory() as name:
        calibration = with_calibration(synthetic_block(seed=1).block.cameras[0]).calibration
        assert calibration is not None
        camera = Path(name) / "camera.toml"
        bare = CameraCalibration("camera", calibration.c, format=calibration.format)
        write_camera(camera, calibration if fiducials else bare)
        for seed in range(1, blocks + 1):
            made = synthetic_block(2, 5, seed=seed)
            with contextlib.redirect_stdout(io.StringIO()):
                folder = block_of_options(made, Path(name) / str(seed), str(camera))
            place = Workplace(read_block(folder), made.truth, seed=seed, watched=False)
            place.measured()
            write_image_points(folder, rows_of(place.state.models))
            adjusted = adjust_block(read_block(folder))
            square, coordinates = misfit(adjusted, made)
            total, count = total + square, count + coordinates
            worst = max(worst, abs(square - coordinates) / sqrt(2.0 * coordinates))
            vtpv, redundancy = vtpv + adjusted.vtpv, redundancy + adjusted.redundancy
    print(f"{blocks} blocks, {(process_time() - start) / blocks:.2f} s of processor each")
    print(f"worst block: {worst:.2f} standard deviations of its chi-square")
    good = True
    for what, value, free in (("d' C^-1 d", total, count), ("v'Pv", vtpv, redundancy)):
        low, high = chdtri(free, [1.0 - 2.5e-5, 2.5e-5]).tolist()
        good &= low < value < high
        print(f"{what:10} {value:8.0f} of {free}, bounds {low:.0f} and {high:.0f}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2]), *sys.argv[2:3]))
