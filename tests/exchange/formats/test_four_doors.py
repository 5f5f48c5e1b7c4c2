"""One block through five doors is one block; and files that are changed anywhere are one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tiltedblock import CX, CY, FX, FY, HEIGHT, K1, K2, P1, P2, WIDTH, TiltedBlock, tilted_block
from tiltedfiles import blocks_exchange, camera_file, colmap_model, opensfm_model, pixel_table

from anaplot.bundle.adjust import adjust_block
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.camerafile import write_camera
from anaplot.exchange.formats import blocksexchange, metashape, pixels
from anaplot.exchange.formats.door import ImportOptions
from anaplot.exchange.formats.registry import module_of
from anaplot.exchange.importedfolder import write_imported
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.camera import BrownLens, CameraCalibration

Doors = dict[str, Block]
SIGMA = ImportOptions(sigma_px=0.4)


def through(kind: str, source: Path, folder: Path, options: ImportOptions = SIGMA) -> Block:
    """Return a block as it is read again from its folder."""
    write_imported(folder, module_of(kind).read(source, options), source)
    return read_block(folder)


@pytest.fixture(scope="module")
def doors(tmp_path_factory: pytest.TempPathFactory) -> Doors:
    at = tmp_path_factory.mktemp("doors")
    scene = tilted_block(noise_px=0.5, seed=11)
    write_camera(
        at / "c.toml",
        CameraCalibration(
            "c",
            FY / 1000.0,
            lens=BrownLens(K1, K2, 0.0, P1, P2, FX / FY - 1.0),
            pixels=(WIDTH, HEIGHT),
            principal_px=(CX, CY),
        ),
    )
    table = ImportOptions(sigma_px=0.4, camera=at / "c.toml", order="up")
    return {
        "colmap": through("colmap", colmap_model(scene, at / "m"), at / "1"),
        "pixels": through("pixels", pixel_table(scene, at / "p.txt"), at / "2", table),
        "blocksexchange": through(
            "blocksexchange", blocks_exchange(scene, at / "b.xml", mm=True), at / "3"
        ),
        "opensfm": through("opensfm", opensfm_model(scene, at / "o"), at / "4"),
        "metashape": through("metashape", camera_file(scene, at / "c.xml", control=0), at / "5"),
    }


def test_every_door_gives_the_same_sigma0_and_redundancy_numbers(doors: Doors) -> None:
    found = {}
    for kind, block in doors.items():
        adjusted = adjust_block(block, datum="free")
        rays = {
            (
                ray.photo.replace(" ", "_"),
                int(ray.point.removeprefix("m ")) + (kind == "metashape"),
            ): [value for one in ray.xy for value in (one.r, one.w)]
            for ray in adjusted.ray_rows()
        }
        assert adjusted.sigma0 is not None
        found[kind] = adjusted.sigma0, rays
    sigma0, rays = found["colmap"]
    assert 1.0 < sigma0 < 1.5  # 0.5 px were planted and 0.4 are believed
    numbers = np.array(list(rays.values()), dtype=float)
    assert numbers[:, [0, 2]].min() < 0.3  # points of two rays: there is something to differ in
    for other, its in found.values():
        assert other == pytest.approx(sigma0, abs=1e-9)
        assert its.keys() == rays.keys()
        gaps = np.array([its[key] for key in rays], dtype=float) - numbers
        assert np.abs(gaps[:, [0, 2]]).max() < 1e-9
        assert np.abs(gaps[:, [1, 3]]).max() < 1e-6


Reader = Callable[[Path, ImportOptions], object]
READERS: dict[str, tuple[Callable[[TiltedBlock, Path], Path], Reader, ImportOptions]] = {
    "pixels": (pixel_table, pixels.read, ImportOptions(c=3000.0, pixels=(WIDTH, HEIGHT))),
    "blocksexchange": (blocks_exchange, blocksexchange.read, ImportOptions()),
    "metashape": (camera_file, metashape.read, ImportOptions()),
}
BITS = [
    "",
    "<",
    ">",
    "</a>",
    "&",
    "&#0;",
    "\0",
    "1e999",
    "-",
    "nan",
    "9" * 400,
    '"',
    "\x1b[2J",
    ";",
]


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    at = tmp_path_factory.mktemp("samples")
    whole = tilted_block()
    few = TiltedBlock(
        whole.names[:2],
        whole.rotations,
        whole.centres,
        whole.points[:3],
        tuple(row for row in whole.pixels if row[0] < 2 and row[1] < 3),
    )
    return {kind: write(few, at / kind).read_bytes() for kind, (write, _, _) in READERS.items()}


@pytest.mark.parametrize("kind", READERS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_file_that_is_changed_is_read_or_refused_in_one_line(
    tmp_path: Path, samples: dict[str, bytes], kind: str, data: st.DataObject
) -> None:
    text = samples[kind]
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.sampled_from([0, 0, 1, 2, 7, 40]))
        new = data.draw(st.sampled_from(BITS).map(str.encode) | st.binary(max_size=4))
        text = text[:at] + new + text[at + cut :]
    file = tmp_path / "changed"
    file.write_bytes(text)
    _, read, options = READERS[kind]
    said = ""
    try:
        read(file, options)
    except InputError as error:
        said = str(error)
    assert not said or said.isprintable()  # a line end is not printable
