"""The block sxb (Strasbourg): the figures of DBAT's report, without approximate values given."""

from __future__ import annotations

import csv
from dataclasses import replace
from math import degrees
from pathlib import Path

import pytest

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import measured_rays

FOLDER = next(
    (
        p / "shared" / "data" / "sxb"
        for p in Path(__file__).resolve().parents
        if (p / "shared" / "data" / "sxb").is_dir()
    ),
    None,
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(FOLDER is None, reason="the data of sxb is not here"),
]

NAMES = {"1": "8811", "2": "8936", "3": "8937", "4": "8938", "5": "9111"}
# omega, phi, kappa [deg], X, Y, Z [m] and their deviations
REPORT = {
    "8811": ((0.829772, -0.417236, -89.914549), (999660.940086, 112368.368648, 1916.563176),
             (0.0209, 0.0146, 0.00234), (0.465, 0.657, 0.097)),
    "8936": ((-0.124396, 0.007180, 92.621856), (1000062.186284, 112625.534228, 1916.417372),
             (0.0238, 0.0124, 0.00215), (0.397, 0.743, 0.0935)),
    "8937": ((-0.159645, 0.006196, 94.400652), (1000077.371177, 112417.544493, 1910.362078),
             (0.0181, 0.0108, 0.00166), (0.343, 0.565, 0.0567)),
    "8938": ((-0.202540, 0.134993, 96.145997), (1000094.134327, 112202.936957, 1906.983111),
             (0.028, 0.0118, 0.00214), (0.376, 0.869, 0.103)),
    "9111": ((0.521419, -0.220515, -92.540800), (1000482.579395, 112370.473450, 1937.066185),
             (0.0206, 0.0252, 0.00267), (0.797, 0.655, 0.161)),
}  # fmt: skip


def rows(name: str) -> list[list[str]]:
    assert FOLDER is not None
    with (FOLDER / name).open(newline="") as file:
        return [
            [cell.strip() for cell in row]
            for row in csv.reader(file)
            if row and not row[0].startswith("#")
        ]


def sxb(strips: tuple[Strip, ...]) -> Block:
    points = [
        ImagePoint(NAMES[image], point, 0.006 * float(x) - 26.577, 38.811 - 0.006 * float(y), sigma)
        for name, sigma in (("measurements/markpts.txt", 3.0), ("measurements/smartpts.txt", 6.0))
        for point, image, x, y in rows(name)
    ]
    control = [
        ControlPoint(
            row[0],
            (float(row[2]), float(row[3]), float(row[4])),
            (float(row[5]), float(row[6]), float(row[7])),
            "check" if row[0] in ("351", "410") else "control",
        )
        for row in rows("reference/sxb-control.txt")
    ]
    return Block(
        "sxb",
        Precision(image_um=3.0),
        TestSettings(),
        (Camera("c", 123.9392),),
        tuple(Photo(name, "c") for name in NAMES.values()),
        strips,
        tuple(points),
        tuple(control),
    )


@pytest.mark.parametrize("strips", [(), (Strip("1", ("8936", "8937", "8938")),)])
def test_the_report_of_dbat(strips) -> None:
    block = adjust_block(sxb(strips))
    problem = block.problem
    assert (problem.observations, problem.unknowns, block.redundancy) == (2434, 1173, 1261)
    assert block.sigma0 == pytest.approx(1.1786, abs=5e-5)
    for row in block.photo_rows():
        angles, position, s_angles, s_position = REPORT[row.photo]
        assert [degrees(a) for a in row.angles] == pytest.approx(angles, abs=2e-6)
        assert row.position == pytest.approx(position, abs=2e-5)
        assert [degrees(s) for s in row.s_angles] == pytest.approx(s_angles, rel=5e-3)
        assert row.s_position == pytest.approx(s_position, rel=5e-3)
    assert [name for name, _ in block.check_rows()] == ["410", "351"]
    assert not block.remarks


def test_a_lens_of_0_3_mm_is_no_obstacle_stated_or_found() -> None:
    """The same rays through a lens: stated, nothing changes; free, it is found."""
    block = sxb(())
    plain = adjust_block(block)
    [camera] = block.cameras
    strong = replace(camera, lens=BrownLens(k1=0.075, k2=-0.003, p1=2e-4))
    measured = measured_rays(strong, [(row.x, row.y) for row in block.image_points]).tolist()
    away = [max(abs(x - r.x), abs(y - r.y)) for r, (x, y) in zip(block.image_points, measured,
                                                                strict=True)]  # fmt: skip
    assert max(away) > 0.3
    stated = adjust_block(replace(block, cameras=(strong,)))
    # a measuring error is larger by the lens's magnification, a per cent at most
    assert stated.sigma0 == pytest.approx(plain.sigma0, rel=0.01)
    rows = tuple(
        replace(row, x=x, y=y) for row, (x, y) in zip(block.image_points, measured, strict=True)
    )
    free = additional_parameters("physical:k1,k2,p1,p2:camera")
    found = adjust_block(replace(block, image_points=rows), additional=free)
    assert found.sigma0 < 1.01 * stated.sigma0
    for row, wanted in zip(found.parameter_rows(), (0.075, -0.003, 2e-4), strict=False):
        assert abs(row.coefficient - wanted) < 4.0 * row.s_coefficient, row.name
