"""BINGO's image file, geoin and itera: in, out, and what is damaged."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tableblock import rays_of, table_block, texts

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_block
from anaplot.exchange.formats import bingo
from anaplot.exchange.formats.bingofiles import ORDERS, angles_in, turned_by
from anaplot.exchange.formats.door import Exporting, ExportOptions, Imported, ImportOptions
from anaplot.exchange.formats.registry import recognised
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.report.exportresult import adjusted_result

IMAGES = """\
* flown in May
101 rmk
  7  10.25  -80.5
  8  -3.5D+1  20.125  1
-99
102 rmk
  7  -81.0  -80.25

C the end
103 rmk
  8  1.0  2.0
-99
"""
GEOIN = """\
* control of 1995
CAPA rmk 0 152.40 0.010 -0.020
ECCA rmk 0.1 0.2 1.5
CONT 7 1000.5 2000.25 300.125
CHCK 8 1100.5 2000.25 301
C nothing more
"""
ITERA = """\
ORIA 101 1000.0 2000.0 1950.0 1.5 -2.25 50.0 0
ORIA 999 1000.0 2000.0 1950.0 1.5 -2.25 50.0 0
CORD 7 1 2 3
"""


def folder(tmp_path: Path, images: str = IMAGES, geoin: str = GEOIN, itera: str = ITERA) -> Path:
    for name, text in (("image.dat", images), ("GEOIN.DAT", geoin), ("itera.dat", itera)):
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_folder_is_read(tmp_path: Path) -> None:
    source = folder(tmp_path)
    assert recognised(source).kind == "bingo"
    assert recognised(source / "image.dat").kind == "bingo"
    found = bingo.read(source, ImportOptions())
    block, said = found.block, texts(found.notes)
    assert [(c.id, c.c) for c in block.cameras] == [("rmk", 152.4)]
    rays = rays_of(block)
    assert rays["101", "8"] == pytest.approx((-35.01, 20.145), abs=1e-12)
    assert rays["103", "8"] == pytest.approx((0.99, 2.02), abs=1e-12)
    assert [(row.point, row.use) for row in block.control] == [("7", "control"), ("8", "check")]
    assert block.photos[0].position == (1000.0, 2000.0, 1950.0)
    turned = rotation_matrix(*block.photos[0].rotation)
    # R2(phi) R1(omega) R3(kappa), by its three factors
    phi, omega, kappa = (value * pi / 200 for value in (1.5, -2.25, 50.0))
    factors = [
        rotation_matrix(0, phi, 0),
        rotation_matrix(omega, 0, 0),
        rotation_matrix(0, 0, kappa),
    ]
    assert np.abs(turned - factors[0] @ factors[1] @ factors[2]).max() < 1e-15
    assert block.photos[1].position is None
    for text in (
        "changed 4 rays moved to the principal point, by at most 0.02 mm",
        "dropped 1 rows with further columns",
        "dropped 1 records of GEOIN.DAT of other kinds",
        "dropped 1 orientations of photos without image points",
        "assumed 2 rotations in gon are phi-omega-kappa, image to ground (--order): no known",
        "dropped 1 object points of the itera",
    ):
        assert text in said
    ours = bingo.read(source, ImportOptions(order="omega-phi-kappa")).block
    expected = tuple(value * pi / 200 for value in (1.5, -2.25, 50.0))
    assert ours.photos[0].rotation == pytest.approx(expected, abs=1e-15)


@given(st.sampled_from(ORDERS), st.floats(-3.1, 3.1), st.floats(-1.57, 1.57), st.floats(-3.1, 3.1))
def test_rotations_and_back(order: str, a: float, b: float, c: float) -> None:
    rotation = turned_by(order, a, b, c)
    factors = {
        "phi": rotation_matrix(0, a, 0),
        "omega": rotation_matrix(b, 0, 0),
        "kappa": rotation_matrix(0, 0, c),
    }
    if order == "omega-phi-kappa":
        factors |= {"omega": rotation_matrix(a, 0, 0), "phi": rotation_matrix(0, b, 0)}
    first, second, third = (factors[name] for name in order.split("-"))
    assert np.abs(rotation - first @ second @ third).max() < 1e-15
    assert np.abs(turned_by(order, *angles_in(order, rotation)) - rotation).max() < 1e-14


@pytest.mark.parametrize("order", ORDERS)
def test_a_steep_photo_has_two_angles(order: str) -> None:
    rotation = turned_by(order, 0.3, pi / 2, 0.2)
    assert angles_in(order, rotation)[0] == 0.0
    assert np.abs(turned_by(order, *angles_in(order, rotation)) - rotation).max() < 1e-9


@pytest.mark.parametrize("order", ORDERS)
def test_known_points_tell_the_order_of_rotations(tmp_path: Path, order: str) -> None:
    block = table_block()
    target = tmp_path / "out"
    bingo.write(Exporting(block, tmp_path, ExportOptions(order=order)), target)
    turned = [rotation_matrix(*photo.rotation) for photo in block.photos]

    def off(found: Imported) -> float:
        theirs = [rotation_matrix(*photo.rotation) for photo in found.block.photos]
        return float(np.abs(np.subtract(theirs, turned)).max())

    told = bingo.read(target, ImportOptions())
    assert f"6 rotations in gon are {order}, image to ground (--order): 28" in texts(told.notes)
    assert off(told) < 1e-14
    other = next(one for one in ORDERS if one != order)
    against = bingo.read(target, ImportOptions(order=other))
    assert f"are {other}, image to ground (--order): as stated, although 28" in texts(against.notes)
    assert off(against) > 1e-3
    geoin, itera = target / "geoin.dat", target / "itera.dat"
    lines = geoin.read_text().splitlines()
    points = [line.split()[1:] for line in lines if line.startswith("CONT")]
    geoin.write_text("\n".join(line for line in lines if not line.startswith("CONT")))
    assert "no known points tell it" in texts(bingo.read(target, ImportOptions()).notes)
    with itera.open("a") as file:  # and so do the object points beside the orientations
        file.writelines(f"CORD {' '.join(fields)}\n" for fields in points)
    assert off(bingo.read(target, ImportOptions())) < 1e-14
    with itera.open("a") as file:
        file.write(f"CORD {points[0][0]} 1 2 3\n")
    with pytest.raises(InputError, match=f"point '{points[0][0]}' twice"):
        bingo.read(target, ImportOptions())


def test_upright_photos_do_not_tell_the_order(tmp_path: Path) -> None:
    block = table_block()
    photos = tuple(replace(photo, rotation=(0.0, 0.0, 0.3)) for photo in block.photos)
    bingo.write(Exporting(replace(block, photos=photos), tmp_path), tmp_path / "out")
    said = texts(bingo.read(tmp_path / "out", ImportOptions()).notes)
    assert "are phi-omega-kappa, image to ground (--order): not told by what is known: 28" in said


def test_what_goes_out_comes_in_exactly(tmp_path: Path) -> None:
    block = table_block()
    block = replace(block, control=(replace(block.control[0], use="check"), *block.control[1:]))
    made = bingo.write(Exporting(block, tmp_path), tmp_path / "out")
    assert "not held 2 strips" in texts(made.notes)
    found = bingo.read(tmp_path / "out", ImportOptions(sigma_um=4.0)).block
    assert rays_of(found) == rays_of(block)
    mine = {(p.point, p.xyz, p.use) for p in block.control}
    assert {(p.point, p.xyz, p.use) for p in found.control} == mine
    assert found.cameras == block.cameras
    for ours, theirs in zip(block.photos, found.photos, strict=True):
        assert theirs.position == ours.position
        assert theirs.rotation == pytest.approx(ours.rotation, abs=1e-14)


def called(block: Block, camera: str, photo: str = "101") -> Block:
    """The block with other names of its camera and of its first photo."""
    names = {"101": photo}
    return replace(
        block,
        cameras=tuple(replace(one, id=camera) for one in block.cameras),
        photos=tuple(
            replace(one, id=names.get(one.id, one.id), camera=camera) for one in block.photos
        ),
        image_points=tuple(
            replace(row, photo=names.get(row.photo, row.photo)) for row in block.image_points
        ),
    )


def off_in(block: Block, *photos: str) -> Block:
    """The block without a ray that counts in some photos."""
    rays = tuple(replace(r, use="off") if r.photo in photos else r for r in block.image_points)
    return replace(block, image_points=rays)


@pytest.mark.parametrize(
    "block",
    [
        *(called(table_block(), name) for name in ("15", "152.4", "nan", "1,5", "1e3")),
        called(table_block(), "camera", "a,b"),
        called(table_block(), "k" * 255, "p" * 255),
        off_in(table_block(), "101"),
        off_in(called(table_block(), "15"), "101", "102", "103"),
        off_in(table_block(), *(str(101 + k) for k in range(6))),
        replace(
            off_in(table_block(), "101"),
            photos=(
                *(replace(table_block().photos[0], id="i" * 200 + str(k)) for k in range(60)),
                *table_block().photos,
            ),
        ),
    ],
)
def test_a_folder_that_is_written_is_recognised_and_read(tmp_path: Path, block: Block) -> None:
    bingo.write(Exporting(block, tmp_path), tmp_path / "out")
    assert recognised(tmp_path / "out").kind == "bingo"
    found = bingo.read(tmp_path / "out", ImportOptions()).block
    assert rays_of(found) == {
        (row.photo, row.point): (row.x, row.y) for row in block.image_points if row.use == "xy"
    }
    assert [(p.id, p.camera) for p in found.photos] == [(p.id, p.camera) for p in block.photos]
    write_block(tmp_path / "in", found)
    assert read_block(tmp_path / "in").photos == found.photos


def test_rays_that_no_camera_without_a_format_has_are_left_out(tmp_path: Path) -> None:
    block = table_block()
    (camera,) = block.cameras
    block = replace(
        block,
        cameras=(replace(camera, format=(2000.0, 2000.0)),),
        image_points=(replace(block.image_points[0], x=-620.0), *block.image_points[1:]),
    )
    made = bingo.write(Exporting(block, tmp_path), tmp_path / "out")
    assert "not held 1 rays farther off than 4 c: left out" in texts(made.notes)
    found = bingo.read(tmp_path / "out", ImportOptions()).block
    assert len(found.image_points) == len(block.image_points) - 1


def test_a_damaged_geoin_is_named_in_a_folder_that_is_recognised(tmp_path: Path) -> None:
    source = folder(tmp_path, IMAGES.replace(" rmk", " 15"), GEOIN.replace(" rmk", " 15"))
    with (source / "GEOIN.DAT").open("ab") as file:
        file.write(b"CONT \xff\n")
    assert recognised(source).kind == "bingo"
    with pytest.raises(InputError, match=r"GEOIN\.DAT line 7: "):
        bingo.read(source, ImportOptions())


def test_a_camera_constant_makes_no_image_file_of_bingo(tmp_path: Path) -> None:
    source = folder(tmp_path, IMAGES.replace("101 rmk", "101 152.4"))
    assert not bingo.recognises(source)
    assert not bingo.recognises(source / "image.dat")


@pytest.mark.slow
def test_it_is_the_same_block_by_this_door(tmp_path: Path) -> None:
    block = table_block()
    write_block(tmp_path / "mine", block)
    assert main(["export", "bingo", str(tmp_path / "mine"), "-o", str(tmp_path / "out")]) == 0
    back = ["import", str(tmp_path / "out"), "-o", str(tmp_path / "b"), "--sigma-um", "4"]
    assert main(back) == 0
    first, again = adjusted_result(block), adjusted_result(read_block(tmp_path / "b"))
    assert again.sigma0 == pytest.approx(first.sigma0, rel=1e-9)
    for mine, theirs in zip(first.points, again.points, strict=True):
        assert theirs.redundancy == pytest.approx(mine.redundancy, rel=1e-9)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("image.dat", "10.25", "nan", "line 3: x and y must be a finite number"),
        ("image.dat", "-99\n102", "102", "line 5: a point has a name, x and y: is the -99 of"),
        ("image.dat", "102 rmk", "101 rmk", "line 6: photo '101' twice (first in line 2)"),
        ("image.dat", "102 rmk", "102 rmk 3", "line 6: 3 fields, where a photo and its camera"),
        ("image.dat", "10.25", "10250.0", "they must be mm"),
        ("image.dat", " 8  -3.5", f" {'8' * 256} -3.5", "is longer than 255 characters"),
        ("GEOIN.DAT", "CAPA rmk 0", "CAPA rmk", "line 2: 5 fields, where CAPA"),
        ("GEOIN.DAT", "152.40", "0", "line 2: the camera constant must be greater than 0"),
        ("GEOIN.DAT", "CHCK 8", "CHCK 7", "line 5: point '7' twice"),
        ("GEOIN.DAT", "300.125", "inf", "line 4: a coordinate must be a finite number"),
        ("GEOIN.DAT", " 300.125", "", "line 4: 4 fields, where CONT id E N H"),
        ("GEOIN.DAT", "CAPA", "* CAPA", "line 2: camera 'rmk' has no CAPA"),
        ("itera.dat", "ORIA 999", "ORIA 101", "line 2: photo '101' twice"),
        ("itera.dat", " 50.0 0\nORIA", "\nORIA", "line 1: 7 fields, where ORIA"),
    ],
)
def test_damage_is_one_line(tmp_path: Path, file: str, old: str, new: str, message: str) -> None:
    source = folder(tmp_path)
    text = (source / file).read_text()
    assert old in text
    (source / file).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        bingo.read(source, ImportOptions())
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_left_open_is_told(tmp_path: Path) -> None:
    file = tmp_path / "image.dat"
    file.write_text("101 1\n7 1 2\n7 1.5 2\n")
    found = bingo.read(file, ImportOptions(c=100.0))
    assert "photo 101 ends with the file, without -99" in texts(found.notes)
    assert [(r.point, r.use) for r in found.block.image_points] == [("7", "xy"), ("7~2", "off")]
    with pytest.raises(InputError, match="--order: there are no orientations"):
        bingo.read(file, ImportOptions(c=100.0, order="omega-phi-kappa"))
    (tmp_path / "other.dat").write_text(IMAGES)
    with pytest.raises(InputError, match="name the image file"):
        bingo.read(tmp_path, ImportOptions())


@pytest.mark.parametrize("name", ["two words", "C", "*7", "-99"])
def test_a_name_that_reads_as_something_else_is_refused(tmp_path: Path, name: str) -> None:
    block = table_block()
    rays = (replace(block.image_points[0], point=name), *block.image_points[1:])
    with pytest.raises(InputError, match="point '"):
        bingo.write(Exporting(replace(block, image_points=rays), tmp_path), tmp_path / "out")
    assert not (tmp_path / "out").exists()
