"""PAT-B and the -99 files in use: in, out, and what is damaged."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tableblock import C, rays_of, table_block, texts

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_block
from anaplot.exchange.formats import patb
from anaplot.exchange.formats.door import Exporting, ExportOptions, ImportOptions
from anaplot.exchange.formats.patbfiles import SENSES, read_orientations
from anaplot.exchange.formats.patbwriter import orientation_records
from anaplot.exchange.formats.registry import recognised
from anaplot.photogrammetry.block import Precision
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.report.exportresult import adjusted_result

IM = """\
 101   152400.0
   1   10250.125  -80123.5
   2  -10250.125   80123.5   2
 -99
 102   152400.0
   1   -9.5D+04      123.25
 -99
"""
IN_USE = """\
    1    2    3.5    4
         101         0
   900000001      10.2501      -8.1235
   900000002     -90.2501      -8.1235
         -99       0         0
        -102         0
   900000001     -81.2501      -8.0035
         -99       0         0
         103         0
   900000001       1.2501      -8.0035
         -99       0         0
"""
CAMERA = """\
 header
 152.2500 0.0100 -0.0200
 0 0 0
 1 -115 115
 2 115 115
 3 115 -115
 4 -115 -115
 -99
"""
OPTIONS = ImportOptions(sigma_um=4.0)


def test_a_project_goes_out_and_comes_in_exactly(tmp_path: Path) -> None:
    block = table_block()
    for unit in ("um", "mm"):
        target = tmp_path / unit
        out = patb.write(Exporting(block, tmp_path, ExportOptions(unit=unit)), target)
        assert [path.name for path in out.files] == [f"{unit}.{k}" for k in ("im", "con", "ori")]
        assert "not held 2 strips" in texts(out.notes)
        assert recognised(target).kind == "patb"
        found = patb.read(target, replace(OPTIONS, order="image-to-ground")).block
        assert rays_of(found) == rays_of(block)
        assert {(p.point, p.xyz) for p in found.control} == {
            (p.point, p.xyz) for p in block.control
        }
        assert found.cameras[0].c == C
        for mine, theirs in zip(block.photos, found.photos, strict=True):
            assert theirs.position == pytest.approx(mine.position, abs=5.1e-6)
            assert theirs.rotation == pytest.approx(mine.rotation, abs=2e-12)


@pytest.mark.slow
def test_it_is_the_same_block_by_this_door(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = table_block()
    write_block(tmp_path / "mine", block)
    assert main(["export", "patb", str(tmp_path / "mine"), "-o", str(tmp_path / "out")]) == 0
    assert "not held: 2 strips" in capsys.readouterr().out
    back = ["import", str(tmp_path / "out"), "-o", str(tmp_path / "b"), "--sigma-um", "4"]
    assert main(back) == 0
    said = capsys.readouterr().out
    assert "image coordinates are in um" in said
    found, first = read_block(tmp_path / "b"), adjusted_result(block)
    again = adjusted_result(found)
    assert again.sigma0 == pytest.approx(first.sigma0, rel=1e-9)
    for mine, theirs, given_ in zip(first.photos, again.photos, found.photos, strict=True):
        assert theirs.redundancy == pytest.approx(mine.redundancy, rel=1e-9)
        assert given_.position == pytest.approx(mine.position, abs=1e-5)  # adjusted ones went out


def test_micrometres_groups_and_a_number_of_fortran(tmp_path: Path) -> None:
    file = tmp_path / "a.im"
    file.write_text(IM)
    found = patb.read(file, ImportOptions(sigma_classes={"2": 9.0}))
    assert rays_of(found.block) == {
        ("101", "1"): (10.250125, -80.1235),
        ("101", "2"): (-10.250125, 80.1235),
        ("102", "1"): (-95.0, 0.12325),
    }
    assert [row.sigma_um for row in found.block.image_points] == [None, 9.0, None]
    assert found.block.cameras[0].c == 152.4
    assert "are in um: the largest is 95000" in texts(found.notes)
    assert "sigma of image coordinates 5 um" in texts(found.notes)
    assert "groups of image points" in texts(patb.read(file, OPTIONS).notes)
    with pytest.raises(InputError, match="--sigma-class 3: no such group"):
        patb.read(file, ImportOptions(sigma_classes={"3": 9.0}))
    with pytest.raises(InputError, match=r"outside 4 c .* is mm the unit"):
        patb.read(file, ImportOptions(unit="mm"))


@pytest.mark.parametrize("scale", [0.01, 1.0, 4.0])
@pytest.mark.parametrize(("of_c", "of_rays"), [(1.0, 1.0), (0.001, 1.0), (0.001, 0.001)])
def test_a_camera_constant_has_the_coordinates_unit_where_they_fit(
    tmp_path: Path, scale: float, of_c: float, of_rays: float
) -> None:
    rays = [(10250.125, -80123.5), (-10250.125, 80123.5)]
    rows = [f"{k} {x * of_rays * scale!r} {y * of_rays * scale!r}" for k, (x, y) in enumerate(rays)]
    file = tmp_path / "a.im"
    file.write_text("\n".join((f"101 {152400.0 * of_c * scale!r}", *rows, "-99", "")))
    found = patb.read(file, ImportOptions(unit="um" if of_rays == 1.0 else "mm"))
    assert found.block.cameras[0].c == pytest.approx(152.4 * scale)
    told = "camera constants are in" in texts(found.notes)
    assert told is (of_c != of_rays)


def test_the_files_in_use_have_strips_and_a_camera_file(tmp_path: Path) -> None:
    file, camera, control = tmp_path / "flight.dat", tmp_path / "cam", tmp_path / "control"
    file.write_text(IN_USE)
    camera.write_text(CAMERA)
    control.write_text("900000001 1000.5 2000.25 300 3\n-99\n")
    assert recognised(file).kind == "patb"
    found = patb.read(file, ImportOptions(files={"camera": camera, "control": control}))
    block = found.block
    assert block.cameras[0].c == 152.25
    assert block.cameras[0].format == (230.02, 230.04)
    assert [strip.photos for strip in block.strips] == [("101", "102")]
    assert rays_of(block)["101", "900000001"] == pytest.approx((10.2401, -8.1035), abs=1e-12)
    assert block.control[0].xyz == (1000.5, 2000.25, 300.0)
    said = texts(found.notes)
    assert "changed 4 rays moved to the principal point, by 0.01, -0.02 mm" in said
    assert "dropped 1 strips of one photo" in said
    assert "photos after the last end of a strip" in said
    with pytest.raises(InputError, match="line 2: the camera constant is 0: state it"):
        patb.read(file, ImportOptions())
    control.write_text("900000001 1000.5 2000.25 300 1\n-99\n")
    with pytest.raises(InputError, match="line 1: code '1': only 3"):
        patb.read(file, ImportOptions(c=152.0, files={"control": control}))


def test_a_point_twice_is_kept_and_does_not_count(tmp_path: Path) -> None:
    file = tmp_path / "a.im"
    file.write_text(IM.replace("   2  -10250", "   1  -10250"))
    found = patb.read(file, ImportOptions())
    assert [(r.point, r.use) for r in found.block.image_points][:2] == [("1", "xy"), ("1~2", "off")]
    assert "doubled 1 rays" in texts(found.notes)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("10250.125", "nan", "line 2: x must be a finite number, not 'nan'"),
        ("80123.5   2", "1e999  2", "line 3: y must be a finite number"),
        (" -99\n 102", " 102", "line 4: a point has a name, x and y: is the -99 of photo '101'"),
        ("123.25\n -99\n", "123.25\n", "photo '102' has no -99 at its end"),
        ("-99\n 102", "-99\n 101", "line 5: photo '101' twice (first in line 1)"),
        (" 102   152400.0", f" {'9' * 300} 152400.0", "is longer than 255 characters"),
        ("101   152400.0", "101   -152400.0", "line 1: the camera constant must be greater than 0"),
        ("101   152400.0", "101   x", "line 1: the camera constant must be a finite number"),
        (" 102   152400.0", "-99\n 7 8 9", "line 6: 3 fields, where a photo"),
    ],
)
def test_damage_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "a.im"
    assert old in IM
    file.write_text(IM.replace(old, new))
    with pytest.raises(InputError) as caught:
        patb.read(file, ImportOptions())
    assert message in str(caught.value)
    assert "a.im" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_control_lists(tmp_path: Path) -> None:
    image, control = tmp_path / "a.im", tmp_path / "a.con"
    image.write_text(IM)

    def read(text: str):
        control.write_text(text)
        return patb.read(image, ImportOptions(files={"control": control}))

    found = read("1 10 20\n2 30 40 1\n-99\n1 5.5 2\n3 6\n-99\n")
    assert [row.xyz for row in found.block.control] == [
        (10.0, 20.0, 5.5),
        (30.0, 40.0, None),
        (None, None, 6.0),
    ]
    assert "the fourth column is a group" in texts(found.notes)
    found = read("1 10 20 1.5\n-99\n")
    assert found.block.control[0].xyz == (10.0, 20.0, 1.5)
    assert "the fourth column is Z" in texts(found.notes)
    for text, message in (
        ("1 10 20\n", "no -99 at the end of the last list"),
        ("1 10 20\n1 10 21\n-99\n", "line 2: point '1' twice"),
        ("1 10 20 3.5 1\n-99\n1 4\n-99\n", "line 3: point '1' has a height already"),
        ("1 10\n-99\n", "line 1: 2 fields"),
        ("1 10 inf\n-99\n", "line 1: a coordinate must be a finite number"),
        ("-99\n-99\n1 2\n-99\n", "line 3: a third list"),
    ):
        with pytest.raises(InputError) as caught:
            read(text)
        assert message in str(caught.value), text


ANGLES = st.floats(-3.1, 3.1)
PHI = st.floats(-1.5, 1.5)
PLACES = st.floats(-9e6, 9e6)


@given(ANGLES, PHI, ANGLES, PLACES, PLACES, st.sampled_from(["image-to-ground", "ground-to-image"]))
def test_orientations_read_back(tmp_path_factory, omega, phi, kappa, x, y, sense) -> None:
    path = tmp_path_factory.mktemp("ori") / "a.ori"
    path.write_text("".join(orientation_records([("7", (x, y, 9.5), (omega, phi, kappa))], sense)))
    (found,), read_as, said = read_orientations(path, None)
    assert (read_as, said) == (sense, True)  # the comment says it
    assert found.position == pytest.approx((x, y, 9.5), abs=5.1e-6)
    assert (
        np.abs(rotation_matrix(*found.rotation) - rotation_matrix(omega, phi, kappa)).max() < 4e-12
    )


def test_an_orientation_stands_in_its_columns(tmp_path: Path) -> None:
    pose = ("a" * 15, (-123456.5, 0.0, 1950.25), (0.0, 0.0, math.pi / 2))
    text = "".join(orientation_records([pose], "image-to-ground"))
    assert text.splitlines()[1:] == [
        f" {'a' * 15}{'':16}   -123456.50000         0.00000      1950.25000",
        "  0.000000000000 -1.000000000000  0.000000000000  1.000000000000  0.000000000000",
        "  0.000000000000  0.000000000000  0.000000000000  1.000000000000",
    ]
    path = tmp_path / "a.ori"
    path.write_text("\n".join(text.splitlines()[1:]))
    (plain,), sense, said = read_orientations(path, None)
    assert (sense, said) == ("image-to-ground", False)
    assert plain.rotation == pytest.approx((0.0, 0.0, math.pi / 2))
    (turned,), sense, said = read_orientations(path, "ground-to-image")
    assert (sense, said) == ("ground-to-image", True)
    assert turned.rotation == pytest.approx((0.0, 0.0, -math.pi / 2))
    lines = text.splitlines()
    for bad, message in (
        (lines[:3], "a photo has three records"),
        ([*lines, *lines[1:]], "twice"),
        ([lines[0], lines[1], lines[2].replace("-1.0", " 1.0"), lines[3]], "is no rotation"),
        (
            [*lines[:2], lines[2].replace("-1.000000000000", "   -1.0000e+200"), lines[3]],
            "is no rotation",
        ),
        ([lines[0], lines[1], lines[2].replace("-1.000000000000", "  nan"), lines[3]], "finite"),
    ):
        path.write_text("\n".join(bad))
        with pytest.raises(InputError, match=message):
            read_orientations(path, None)
    path.write_text(text)
    with pytest.raises(InputError, match="says image-to-ground itself"):
        read_orientations(path, "ground-to-image")


def test_control_tells_which_way_matrices_turn(tmp_path: Path) -> None:
    block = table_block()
    for sense in SENSES:
        target = tmp_path / sense
        patb.write(Exporting(block, tmp_path, ExportOptions(order=sense)), target)
        ori = target / f"{sense}.ori"
        lines = ori.read_text().splitlines(keepends=True)
        ori.write_text("".join(lines[1:]))  # without the comment that says it
        found = patb.read(target, OPTIONS)
        for mine, theirs in zip(block.photos, found.block.photos, strict=True):
            assert theirs.rotation == pytest.approx(mine.rotation, abs=2e-12)
        assert f"matrices of the .ori are {sense} (--order): 28 rays of known" in texts(found.notes)
        assert "matrices" not in texts(patb.read(target, replace(OPTIONS, order=sense)).notes)
        other = SENSES[1 - SENSES.index(sense)]
        against = patb.read(target, replace(OPTIONS, order=other))
        assert f"are {other} (--order): as stated, although 28 rays" in texts(against.notes)
        turned = rotation_matrix(*against.block.photos[4].rotation)
        assert np.abs(turned.T - rotation_matrix(*block.photos[4].rotation)).max() < 4e-12
        (target / f"{sense}.con").unlink()
        said = texts(patb.read(target, OPTIONS).notes)
        assert "are image-to-ground (--order): no known points tell it" in said


@pytest.mark.parametrize("name", ["a" * 16, "two words", "-7", "ä"])
def test_a_name_is_never_cut(tmp_path: Path, name: str) -> None:
    block = table_block(strips=False)
    photos = (replace(block.photos[0], id=name), *block.photos[1:])
    rays = tuple(row for row in block.image_points if row.photo != "101")
    with pytest.raises(InputError, match="photo '"):
        patb.write(
            Exporting(replace(block, photos=photos, image_points=rays), tmp_path), tmp_path / "o"
        )
    rays = (replace(block.image_points[0], point=name), *block.image_points[1:])
    with pytest.raises(InputError, match="point '"):
        patb.write(Exporting(replace(block, image_points=rays), tmp_path), tmp_path / "o")
    assert not (tmp_path / "o").exists()
    huge = [("7", (1e12, 0.0, 0.0), (0.0, 0.0, 0.0))]
    with pytest.raises(InputError, match=r"too large for F16\.5"):
        list(orientation_records(huge, "image-to-ground"))


def test_what_has_no_place_is_told(tmp_path: Path) -> None:
    block = table_block()
    first, second, third, *rest = block.image_points
    rays = (
        replace(first, use="off"),
        replace(second, use="x"),
        replace(third, sigma_um=9.0),
        *rest,
    )
    control = (replace(block.control[0], use="check"), *block.control[1:])
    made = patb.write(
        Exporting(replace(block, image_points=rays, control=control), tmp_path), tmp_path / "o"
    )
    said = texts(made.notes)
    assert "not held 1 rays with use = off" in said
    assert "not held 1 rays of which one coordinate counts" in said
    assert "not held 1 check points" in said
    assert "not held 2 standard deviations: groups stand for them" in said
    found = patb.read(tmp_path / "o", ImportOptions(sigma_classes={"1": 9.0})).block
    assert [row.sigma_um for row in found.image_points][:2] == [9.0, None]
    assert len(found.image_points) == len(rays) - 2


def test_control_of_x_without_y_is_refused(tmp_path: Path) -> None:
    block = table_block()
    for xyz in ((1.0, None, 10.0), (None, 2.0, 10.0)):
        control = (replace(block.control[0], xyz=xyz), *block.control[1:])
        with pytest.raises(InputError, match="X without Y, or Y without X"):
            patb.write(Exporting(replace(block, control=control), tmp_path), tmp_path / "o")


def test_folders_and_projects(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no file \.im"):
        patb.read(tmp_path, ImportOptions())
    (tmp_path / "a.im").write_text(IM)
    (tmp_path / "a.con").write_text("1 10 20 30.5\n-99\n")
    (tmp_path / "a.pro").write_text("IMAGE UNITS: um\n")
    for source in (tmp_path, tmp_path / "a.pro"):
        assert recognised(source).kind == "patb"
        found = patb.read(source, ImportOptions())
        assert len(found.block.control) == 1
        assert "um, the only unit that the .pro names" in texts(found.notes)
    (tmp_path / "b.IM").write_text(IM)
    with pytest.raises(InputError, match="2 files"):
        patb.read(tmp_path, ImportOptions())
    with pytest.raises(InputError, match="did you mean 'control'"):
        patb.read(tmp_path / "a.im", ImportOptions(files={"contrl": tmp_path / "a.con"}))
    with pytest.raises(InputError, match="--order: there are no orientations"):
        patb.read(tmp_path / "a.im", ImportOptions(order="image-to-ground"))


def test_what_is_something_else_is_not_recognised(tmp_path: Path) -> None:
    for k, data in enumerate((b"", b"photo,point,x,y\n", b"\xff\xfe\x00", b"1 2 3 4\n5 6 7 8\n")):
        file = tmp_path / f"f{k}.im"
        file.write_bytes(data)
        assert not patb.recognises(file)
    assert not patb.recognises(tmp_path / "nothing")


@pytest.mark.slow
def test_strips_of_the_files_in_use_are_bridged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = replace(table_block(), precision=Precision(image_um=4.0, tie_variance="exact"))
    write_block(tmp_path / "mine", block)
    out = ["1 2 3 4"]
    for photo in block.photos:
        name = f"-{photo.id}" if photo.id in ("103", "106") else photo.id
        out.append(f"{name:>12} 0")
        mine = (row for row in block.image_points if row.photo == photo.id)
        out += [f"{row.point:>12}{row.x:14.4f}{row.y:14.4f}" for row in mine]
        out.append("-99 0 0")
    (tmp_path / "flight.dat").write_text("\n".join(out) + "\n")
    source = [str(tmp_path / "flight.dat"), "--c", str(C), "--sigma-um", "4"]
    assert main(["import", *source, "-o", str(tmp_path / "b")]) == 0
    capsys.readouterr()
    found = []
    for name in ("mine", "b"):
        assert main(["bridge", str(tmp_path / name), "--json"]) == 0
        strips = json.loads(capsys.readouterr().out)["strips"]
        models = [model for strip in strips for model in strip["models"]]
        found.append({(m["left"], m["right"]): m["sigma0_um"] for m in models})
    assert list(found[1]) == [("101", "102"), ("102", "103"), ("104", "105"), ("105", "106")]
    for pair, sigma in found[0].items():
        assert found[1][pair] == pytest.approx(sigma, abs=0.2)  # four digits of a millimetre
