"""From scanned photographs over a round earth under air to the ground, by files alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from test_innercommand import options

from anaplot import adjust
from anaplot.exchange.camerafile import parse_camera
from anaplot.photogrammetry.platetransformation import Placement
from anaplot.photogrammetry.refinement import Refinement
from anaplot.report.innercommand import run_inner

CAMERA = """\
format = 1
[camera]
id = "k"
c = 152.4
format = [230.0, 230.0]
principal_point = [0.012, -0.004]
[fiducials]
1 = [-106.0, 106.0]
2 = [106.0, 106.0]
3 = [106.0, -106.0]
4 = [-106.0, -106.0]
[distortion]
radial = [0.0, 2e-8, 0.0, 0.0]
"""
EARTH = 6.371e6
FLYING, GROUND = 4500.0, 300.0
SCAN = Placement(4700.0, 4800.0, -0.02, 2e-4, 40.01, 40.02, mirrored=True)
BASE = 2500.0


def bending(flying: float, ground: float) -> float:
    """Return K of a ray in the air, by summing n over a barometric atmosphere."""

    def index(height: np.ndarray) -> np.ndarray:
        return 2.77e-4 * (1.0 - 0.0065 * height / 288.15) ** 4.2559

    heights = np.linspace(ground, flying, 20_001)
    return float(np.mean(index(heights)) - index(np.array(flying)))


def imaged(camera: np.ndarray, point: np.ndarray) -> list[float]:
    """Return where a camera that looks along its own plumb line images a point of the map [mm].

    Map distances are arcs at sea level; rays are straight lines past a sphere, bent by the air.
    """
    away = point[:2] - camera[:2]
    arc = float(np.hypot(*away)) / EARTH
    across = (EARTH + point[2]) * np.sin(arc)
    down = EARTH + camera[2] - (EARTH + point[2]) * np.cos(arc)
    angle = np.arctan2(across, down)
    angle += bending(camera[2], point[2]) * np.tan(angle)
    return (152.4 * np.tan(angle) * away / np.hypot(*away)).tolist()


def survey(folder: Path, refinement: str, hills: float = 0.0) -> np.ndarray:
    """Measure, apply and adjust; return the height errors of the check points [m]."""
    calibration = parse_camera(CAMERA, Path("k.toml"))
    block = folder / "block"
    block.mkdir(parents=True)
    for at in (folder, block):
        (at / "k.toml").write_text(CAMERA)
    (block / "block.toml").write_text(
        f'format = 1\nname = "t"\n{refinement}[[camera]]\nfile = "k.toml"\n'
    )
    draw = np.random.default_rng(7)
    cameras = {str(k): np.array([k * BASE, 0.0, FLYING]) for k in range(4)}
    grid = [(x, y) for x in np.arange(-1000.0, 8600.0, 1200.0) for y in (-2700.0, 0.0, 2700.0)]
    above = draw.uniform(-hills, hills, len(grid)).tolist()
    points = {
        str(k): np.array([x + 3.0, y + 5.0, GROUND + h])
        for k, ((x, y), h) in enumerate(zip(grid, above, strict=True))
    }
    lie = SCAN.transformation()
    fiducials = ["format = 1", 'camera = "k.toml"', 'unit = "px"']
    rows = ["photo,point,x,y"]
    for photo, camera in cameras.items():
        marks = lie.to_plate(np.array([(m.x, m.y) for m in calibration.fiducials])).tolist()
        fiducials.append(f"[photo.{photo}]")
        fiducials += [f"{m.id} = {at}" for m, at in zip(calibration.fiducials, marks, strict=True)]
        seen = {name: imaged(camera, point) for name, point in points.items()}
        seen = {name: at for name, at in seen.items() if max(map(abs, at)) < 112.0}
        plate = lie.to_plate(Refinement.of(calibration).distort(np.array(list(seen.values()))))
        rows += [f"{photo},{n},{x!r},{y!r}" for n, (x, y) in zip(seen, plate.tolist(), strict=True)]
    (folder / "fid.toml").write_text("\n".join(fiducials) + "\n")
    (folder / "scan.csv").write_text("\n".join(rows) + "\n")
    ends = {name for name, point in points.items() if abs(point[1]) > 100.0 and (
        point[0] < 0.0 or point[0] > 7000.0)}  # fmt: skip
    (block / "control.csv").write_text("point,X,Y,Z,sX,sY,sZ,use\n" + "".join(
        f"{n},{p[0]},{p[1]},{p[2]},0.01,0.01,0.01,{'control' if n in ends else 'check'}\n"
        for n, p in points.items()
    ))  # fmt: skip
    given = ("--points", folder / "scan.csv", "--apply", block)
    assert run_inner(options(folder / "fid.toml", *given)) == 0
    found = adjust(block).to_dict()
    assert len(found["check"]) > 10
    return np.array([row["dZ"] for row in found["check"]])


def test_heights_over_a_round_earth_under_air(tmp_path, capsys):
    heights = f"flying_height = {FLYING}\nground_height = {GROUND}\n"
    both = f"[refinement]\nrefraction = true\nearth_curvature = true\n{heights}"
    only = f"[refinement]\nearth_curvature = true\n{heights}"
    bare = survey(tmp_path / "bare", "")
    curved = survey(tmp_path / "curved", only)
    refined = survey(tmp_path / "refined", both)
    capsys.readouterr()
    # 4200 m above ground: metres without it, millimetres with it; the air alone is decimetres
    assert np.abs(bare).max() > 1.5
    assert 0.2 < np.abs(curved).max() < 0.3
    assert np.abs(refined).max() < 3e-3


def test_hills_are_not_at_the_mean_height(tmp_path, capsys):
    """A hundredth of the flying height off the mean leaves that share, a few times over."""
    heights = f"flying_height = {FLYING}\nground_height = {GROUND}\n"
    both = f"[refinement]\nrefraction = true\nearth_curvature = true\n{heights}"
    hilly = survey(tmp_path, both, hills=42.0)
    capsys.readouterr()
    assert 3e-3 < np.abs(hilly).max() < 3 * 0.01 * 1.7
