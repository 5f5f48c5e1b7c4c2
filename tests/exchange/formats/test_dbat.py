"""DBAT's scripts and tables, PhotoModeler's export: in, out, and what is damaged or hostile."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tableblock import measured_of, pixel_table_block, table_block, texts

from anaplot.bundle.adjust import adjust_block
from anaplot.errors import InputError
from anaplot.exchange.formats import dbat, photomodeler
from anaplot.exchange.formats.door import Exporting, ImportOptions
from anaplot.exchange.formats.registry import recognised
from anaplot.photogrammetry.block import BrownLens

CAMERA = ImportOptions(c=100.0, pixels=(8858, 12996), pixel_um=6.0)
SHARED = next(
    (
        p / "shared" / "data" / "sxb"
        for p in Path(__file__).resolve().parents
        if (p / "shared" / "data" / "sxb").is_dir()
    ),
    None,
)


def test_a_block_in_pixels_goes_out_and_comes_in(tmp_path: Path) -> None:
    block = pixel_table_block()
    made = dbat.write(Exporting(block, tmp_path), tmp_path / "out")
    assert [path.name for path in made.files] == [
        "images.txt",
        "imagepts.txt",
        "control.txt",
        "check.txt",
        "out.xml",
    ]
    for source in (tmp_path / "out", tmp_path / "out" / "out.xml"):
        assert recognised(source).kind == "dbat"
        found = dbat.read(source, ImportOptions()).block
        assert found.cameras == block.cameras
        assert found.control == (*block.control[1:], block.control[0])
        assert [p.id for p in found.photos] == [p.id for p in block.photos]
        assert found.precision.image_um == 12.5
        assert [r.sigma_um for r in found.image_points] == [r.sigma_um for r in block.image_points]
        theirs = measured_of(found)
        # half a pixel is added and taken off again
        for key, place in measured_of(block).items():
            assert theirs[key] == pytest.approx(place, abs=4e-12)
    first, again = adjust_block(block), adjust_block(found)
    assert again.sigma0 == pytest.approx(first.sigma0, rel=1e-9)
    assert again.cofactors.r == pytest.approx(first.cofactors.r, abs=1e-9)


def test_what_the_tables_cannot_hold(tmp_path: Path) -> None:
    block = pixel_table_block()
    camera, row = block.cameras[0], block.image_points[0]
    lensed = replace(camera, lens=BrownLens(k1=0.01))
    for changed, message in (
        (replace(block, image_points=(replace(row, point="a1"),)), "points of DBAT are whole"),
        (replace(block, cameras=(lensed,)), "has a lens"),
        (replace(block, cameras=(camera, camera)), "2 cameras"),
        (table_block(), "has no pixels"),
        (replace(block, control=(replace(block.control[1], xyz=(1.0, 2.0, None)),)), "X, Y and Z"),
    ):
        with pytest.raises(InputError, match=message):
            dbat.write(Exporting(changed, tmp_path), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    off = (replace(row, use="off"), *block.image_points[1:])
    made = dbat.write(Exporting(replace(block, image_points=off), tmp_path), tmp_path / "out")
    assert "not held 1 rays with use = off" in texts(made.notes)


def test_tables_alone_need_a_camera(tmp_path: Path) -> None:
    file, control, names = tmp_path / "mark.txt", tmp_path / "control.txt", tmp_path / "names"
    file.write_text("# id, image, x, y\n7, 1, 1.0, 1.0\n7, 2, 4429.5, 6498.5, 0.5\n8, 1, 20, 30\n")
    control.write_text("7, A, 100.5, 200, 30, 0.02, 0.02, 0.04\n")
    names.write_text("# id, path\n1, a/b/101.jpg\n2, a\\102.jpg\n3, x/103.jpg\n")
    assert recognised(file).kind == "dbat"
    with pytest.raises(InputError, match="camera constant is not known: --c"):
        dbat.read(file, ImportOptions())
    stated = replace(CAMERA, files={"control": control, "images": names})
    found = dbat.read(file, stated)
    block = found.block
    # 1, 1 is the middle of the upper left pixel, and (n + 1) / 2 the middle of the image
    assert measured_of(block)["101.jpg", "7"] == (0.5, 0.5)
    assert [(r.x, r.y, r.sigma_um) for r in block.image_points][1] == (0.0, 0.0, 3.0)
    assert block.precision.image_um == 6.0
    assert block.control[0].sigma == (0.02, 0.02, 0.04)
    said = texts(found.notes)
    assert "1, 1 is the middle of the upper left pixel" in said
    assert "dropped 1 labels" in said
    assert "dropped 1 images without a point" in said
    corner = dbat.read(file, replace(CAMERA, order="corner")).block
    assert measured_of(corner)["1", "7"] == (1.0, 1.0)
    with pytest.raises(InputError, match="did you mean 'corner'"):
        dbat.read(file, replace(CAMERA, order="corners"))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("7, 1, nan, 2", "line 2: x and y must be a finite number"),
        ("7, 1, 2", "line 2: no y"),
        ("7, 1, 2, 3, -1", "line 2: sxy must be greater than 0"),
        ("7, 1, 2, 3, 1, 9", "line 2: 6 fields"),
        (f"{'9' * 256}, 1, 2, 3", "is longer than 255 characters"),
        (", 1, 2, 3", "line 2: no id"),
    ],
)
def test_damage_is_one_line(tmp_path: Path, row: str, message: str) -> None:
    file = tmp_path / "mark.txt"
    file.write_text(f"# id, image, x, y\n{row}\n")
    with pytest.raises(InputError) as caught:
        dbat.read(file, CAMERA)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_points_twice_and_outside_are_told(tmp_path: Path) -> None:
    file = tmp_path / "mark.txt"
    file.write_text("7, 1, 20, 30\n7, 1, 21, 30\n8, 1, -90, 30\n")
    found = dbat.read(file, CAMERA)
    assert [(r.point, r.use) for r in found.block.image_points] == [("7", "xy"), ("7~2", "off")]
    assert "doubled 1" in texts(found.notes)
    assert "dropped 1 rays outside their image" in texts(found.notes)


SCRIPT = """<?xml version="1.0"?>
<document dbat_script_version="1.0">
 <input base_dir="$HERE">
  <ctrl_pts><file>g.txt</file><filter id="9">remove</filter></ctrl_pts>
  <check_pts><file>g.txt</file><filter id="9">keep</filter></check_pts>
  <image_pts><file format="id,im,x,y" sxy="0.5">m.txt</file></image_pts>
  <cameras><camera><unit>mm</unit><sensor>60,40</sensor><image>6000,4000</image><cc>50</cc>
   <pp>30.005,20.005</pp><K>0,0,0</K><aspect>1</aspect></camera></cameras>
 </input>
</document>
"""


def test_a_script_says_what_is_read(tmp_path: Path) -> None:
    (tmp_path / "s.xml").write_text(SCRIPT)
    (tmp_path / "m.txt").write_text("7, 1, 3000.5, 2000.5\n9, 1, 10, 20\n")
    (tmp_path / "g.txt").write_text("7,, 1, 2, 3\n9,, 4, 5, 6, 0, 0, 0.1\n")
    block = dbat.read(tmp_path, ImportOptions()).block
    assert [(row.point, row.use, row.sigma) for row in block.control] == [
        ("7", "control", (None, None, None)),
        ("9", "check", (0.0, 0.0, 0.1)),
    ]
    assert block.image_points[0].sigma_um == 5.0
    assert (block.image_points[0].x, block.image_points[0].y) == (0.0, 0.0)
    with pytest.raises(InputError, match="the script says what is read"):
        dbat.read(tmp_path, ImportOptions(files={"check": tmp_path / "g.txt"}))
    for old, new, message in (
        ("<K>0,0,0</K>", "<K>1e-5,0,0</K>", "line 8: K: is not read"),
        (">m.txt<", ">../m.txt<", "leads out of the folder"),
        (">m.txt<", ">/etc/passwd<", "leads out of the folder"),
        (">m.txt<", "><", "is not a file name"),
        ("id,im,x,y", "id,im,x,q", "column 'q'"),
        ("6000,4000", "6000,4000.5", "whole pixels"),
        ("60,40<", "60,41<", "not square"),
        ("<cc>50</cc>", "", "states no cc"),
        ("<cc>50</cc>", "<cc>inf</cc>", "cc must be a finite number"),
        ("keep", "drop", "only keep and remove"),
        ("remove</filter>", "keep</filter>", "twice"),
        ("</input>", "", "line 10: not XML"),
        ('version="1.0"?>', 'version="1.0" encoding="x-none"?>', "not XML"),
    ):
        assert old in SCRIPT
        (tmp_path / "s.xml").write_text(SCRIPT.replace(old, new))
        with pytest.raises(InputError) as caught:
            dbat.read(tmp_path / "s.xml", ImportOptions())
        assert message in str(caught.value), (new, str(caught.value))
        assert "\n" not in str(caught.value)


def test_hostile_xml_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.xml"
    head = '<document dbat_script_version="1.0">'
    entity = '<!DOCTYPE document [<!ENTITY b "c"><!ENTITY d "&b;&b;">]>'
    for text, message in (
        (f"{entity}{head}<input>&d;</input></document>", "document type or entity"),
        (f'<!DOCTYPE document SYSTEM "file:///etc/passwd">{head}</document>', "document type"),
        (head + "<a>" * 100 + "</a>" * 100 + "</document>", "elements within elements"),
        (f"{head}<input>&x;</input></document>", "not XML"),
        ("", "not XML"),
        (f"{head}</document>", "no script of DBAT"),
        ("<other/>", "is not <document>"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=message):
            dbat.read(file, ImportOptions())


def test_photomodeler(tmp_path: Path) -> None:
    file = tmp_path / "pm.csv"
    file.write_text(
        "Object Point ID,Photo #,X,Y,Residual X,Residual Y\n7,1,10.5,20.5,.1,.2\n7,2,11,21,0,0\n"
    )
    assert recognised(file).kind == "photomodeler"
    found = photomodeler.read(file, replace(CAMERA, sigma_px=0.5))
    assert measured_of(found.block) == {("1", "7"): (10.0, 20.0), ("2", "7"): (10.5, 20.5)}
    assert found.block.precision.image_um == 3.0
    assert "dropped 2 columns are not read" in texts(found.notes)
    for text, message in (
        ("Object Point ID,Photo #,X\n1,1,1\n", "names no column Y"),
        ("Object Point ID,Photo #,X,Y\n1,1,1\n", "line 2: 3 fields"),
        ("Object Point ID,Photo #,X,Y\n1,1,1,inf\n", "line 2: X and Y must be a finite"),
        ("Object Point ID,Photo #,X,Y\n", "no image point"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=message):
            photomodeler.read(file, CAMERA)


@pytest.mark.slow
@pytest.mark.skipif(SHARED is None, reason="the data of sxb is not here")
def test_a_real_script_gives_what_dbat_printed() -> None:
    assert SHARED is not None
    found = dbat.read(SHARED, ImportOptions())
    adjusted = adjust_block(found.block)
    problem = adjusted.problem
    assert (problem.observations, problem.unknowns, adjusted.redundancy) == (2434, 1173, 1261)
    assert adjusted.sigma0 == pytest.approx(1.1786, abs=5e-5)
    assert [name for name, _ in adjusted.check_rows()] == ["410", "351"]
    place = next(row for row in adjusted.photo_rows() if row.photo == "8811.jpg").position
    assert place == pytest.approx((999660.940086, 112368.368648, 1916.563176), abs=2e-5)
