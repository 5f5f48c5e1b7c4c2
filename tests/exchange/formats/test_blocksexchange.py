"""BlocksExchange: axes, units, half a pixel, control, systems, and XML that means harm."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiltedblock import HEIGHT, WIDTH, TiltedBlock, tilted_block
from tiltedfiles import ORIENTATIONS, blocks_exchange, colmap_model

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats import blocksexchange, colmap
from anaplot.exchange.formats.blocksexchangemodel import ORIENTATIONS as KNOWN
from anaplot.exchange.formats.crs import GroundFrame
from anaplot.exchange.formats.door import Exporting, ImportOptions
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.rotation import rotation_matrix

PLAIN = ImportOptions()
GROUND = "ground coordinates are written as east, north, up of the block's local frame"
CONTROL = """<ControlPoints>
<ControlPoint><Name>A</Name><Position><x>1.5</x><y>2.5</y><z>3.5</z></Position>
<HorizontalAccuracy>0.01</HorizontalAccuracy><VerticalAccuracy>0.03</VerticalAccuracy>
<Measurement><PhotoId>3</PhotoId><x>100</x><y>200.25</y></Measurement></ControlPoint>
<ControlPoint><Name>1</Name><CheckPoint>true</CheckPoint>
<Position><x>4</x><y>5</y><z>6</z></Position></ControlPoint>
<ControlPoint><Id>17</Id><Category>Horizontal</Category>
<Position><x>7</x><y>8</y></Position></ControlPoint>
<ControlPoint><Category>Vertical</Category><Position><x>7</x><y>8</y><z>9</z></Position>
</ControlPoint></ControlPoints>"""


@pytest.fixture(scope="module")
def scene() -> TiltedBlock:
    return tilted_block()


def read(file: Path, options: ImportOptions = PLAIN) -> Block:
    return blocksexchange.read(file, options).block


@pytest.mark.slow
def test_every_orientation_gives_the_poses_and_pixels_that_colmap_has(
    tmp_path: Path, scene: TiltedBlock
) -> None:
    assert set(ORIENTATIONS) == set(KNOWN)
    assert len(KNOWN) == 8
    model = colmap.read(colmap_model(scene, tmp_path / "m"), PLAIN).block
    seen = {(row.photo, row.point): (row.measured, row.x, row.y) for row in model.image_points}
    poses = {photo.id: photo for photo in model.photos}
    for number, orientation in enumerate(ORIENTATIONS):
        for mm in (False, True):
            file = blocks_exchange(
                scene,
                tmp_path / f"{number}{mm}.xml",
                orientation=orientation,
                angles=bool(number % 2),
                mm=mm,
            )
            block = read(file)
            unit = 2.5 if mm else 1.0
            assert block.cameras[0].pixel_um == (2.5 if mm else None)
            assert len(block.image_points) == len(seen)
            for row in block.image_points:
                px, x, y = seen[row.photo.replace(" ", "_"), row.point]
                assert row.measured is not None
                assert px is not None
                np.testing.assert_allclose(row.measured, px, atol=1e-9)
                np.testing.assert_allclose((row.x, row.y), (unit * x, unit * y), atol=1e-9)
            for photo in block.photos:
                other = poses[photo.id.replace(" ", "_")]
                assert photo.rotation is not None
                assert other.rotation is not None
                np.testing.assert_allclose(
                    rotation_matrix(*photo.rotation), rotation_matrix(*other.rotation), atol=1e-12
                )
                np.testing.assert_allclose(photo.position, other.position, atol=1e-12)


def test_the_corner_pixel_and_the_file_differ_by_half_a_pixel(
    tmp_path: Path, scene: TiltedBlock
) -> None:
    block = read(blocks_exchange(scene, tmp_path / "b.xml", control=CONTROL))
    (row,) = [row for row in block.image_points if row.point == "A"]
    assert row.measured == (100.5, 200.75)
    assert row.photo == scene.names[0]


def test_control_points(tmp_path: Path, scene: TiltedBlock) -> None:
    found = blocksexchange.read(blocks_exchange(scene, tmp_path / "b.xml", control=CONTROL), PLAIN)
    control = {row.point: row for row in found.block.control}
    assert list(control) == ["A", "1", "17", "control 4"]
    assert control["A"].sigma == (0.01, 0.01, 0.03)
    assert control["1"].use == "check"
    assert control["17"].xyz == (7.0, 8.0, None)
    assert control["control 4"].xyz == (None, None, 9.0)
    # a tie point may not be taken for the control point of its number
    assert "1 tie" in {row.point for row in found.block.image_points}
    assert found.block.name == "A & B"


@pytest.mark.slow
def test_what_is_written_is_read_back(
    tmp_path: Path, scene: TiltedBlock, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(
        f"<ControlPoint><Name>g{j}</Name><Position><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></Position>"
        f"<HorizontalAccuracy>0.02</HorizontalAccuracy><VerticalAccuracy>0.03</VerticalAccuracy>"
        + "".join(
            f"<Measurement><PhotoId>{10 * k + 3}</PhotoId><x>{px!r}</x><y>{py!r}</y></Measurement>"
            for k, i, px, py in scene.pixels
            if i == j
        )
        + "</ControlPoint>"
        for j, (x, y, z) in enumerate(scene.points[:6].tolist())
    )
    file = blocks_exchange(
        scene, tmp_path / "b.xml", mm=True, control=f"<ControlPoints>{rows}</ControlPoints>"
    )
    assert main(["import", str(file), "-o", str(tmp_path / "b"), "--sigma-px", "0.4"]) == 0
    assert "BlocksExchange XML" in capsys.readouterr().out
    text = (tmp_path / "b" / "image_points.csv").read_text().splitlines()
    text[0], text[1:] = f"{text[0]},use,reason", [f"{line},," for line in text[1:]]
    text[-1] += "x"
    text[-1] = text[-1].removesuffix(",,x") + ",off,blurred"
    (tmp_path / "b" / "image_points.csv").write_text("\n".join(text) + "\n")
    assert (
        main(["export", "blocksexchange", str(tmp_path / "b"), "-o", str(tmp_path / "o.xml")]) == 0
    )
    assert "1 rays with use = off: left out" in capsys.readouterr().out
    first = read_block(tmp_path / "b")
    again = read(tmp_path / "o.xml", ImportOptions(sigma_px=0.4))
    one = {(r.photo, r.point): r.measured for r in first.image_points if r.use != "off"}
    other = {(r.photo, r.point): r.measured for r in again.image_points}
    assert len(one) == len(first.image_points) - 1
    assert one == other
    assert again.control == first.control
    np.testing.assert_allclose(
        again.cameras[0].lens_parameters, first.cameras[0].lens_parameters, rtol=1e-12
    )
    assert again.cameras[0].pixels == (WIDTH, HEIGHT)
    assert again.precision.image_um == pytest.approx(1.0)
    assert main(["adjust", str(tmp_path / "b"), "--json"]) == 0
    adjusted = {row["photo"]: row for row in json.loads(capsys.readouterr().out)["photos"]}
    for photo in again.photos:
        row = adjusted[photo.id]
        np.testing.assert_allclose(photo.position, [row[k] for k in "XYZ"], atol=1e-9)
        np.testing.assert_allclose(
            photo.rotation, [row[k] for k in ("omega", "phi", "kappa")], atol=1e-12
        )


def test_a_local_system_keeps_its_place_on_earth(tmp_path: Path, scene: TiltedBlock) -> None:
    file = blocks_exchange(scene, tmp_path / "b.xml", system="ENU:47.5,8.25", control=CONTROL)
    block = read(file)
    assert block.ground is not None
    assert block.ground.origin == (8.25, 47.5, 0.0)
    assert block.control[0].xyz == (1.5, 2.5, 3.5)
    out = tmp_path / "o.xml"
    higher = replace(block, ground=replace(block.ground, origin=(8.25, 47.5, 400.0)))
    for one, height in ((block, 3.5), (higher, 403.5)):
        notes = blocksexchange.write(Exporting(one, tmp_path), out).notes
        told = [(note.what, note.text) for note in notes if "ground coordinates" in note.text]
        assert told == [("changed", GROUND)]
        assert "ENU:47.5,8.25" in out.read_text()
        assert read(out).control[0].xyz == (1.5, 2.5, height)
        out.unlink()


def test_an_origin_in_another_datum_is_written_in_wgs84(tmp_path: Path, scene: TiltedBlock) -> None:
    pytest.importorskip("pyproj")
    block = read(blocks_exchange(scene, tmp_path / "b.xml", system="ENU:50,9", control=CONTROL))
    assert block.ground is not None
    moved = replace(block, ground=replace(block.ground, crs="EPSG:31467"))
    blocksexchange.write(Exporting(moved, tmp_path), tmp_path / "o.xml")
    again = read(tmp_path / "o.xml")
    assert again.ground is not None
    # the same place on the Earth
    places = [GroundFrame.of(one.ground).degrees(np.zeros((1, 3))) for one in (moved, again)]
    np.testing.assert_allclose(places[1][0, :2], places[0][0, :2], atol=1e-9)
    assert abs(again.ground.origin[0] - 9.0) > 1e-4


def test_projected_coordinates_become_local_ones(tmp_path: Path, scene: TiltedBlock) -> None:
    pytest.importorskip("pyproj")
    far = TiltedBlock(
        scene.names,
        scene.rotations,
        scene.centres + np.array((465000.0, 5250000.0, 400.0)),
        scene.points + np.array((465000.0, 5250000.0, 400.0)),
        scene.pixels,
    )
    control = "".join(
        f"<ControlPoint><Position><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></Position></ControlPoint>"
        for x, y, z in far.points[:3].tolist()
    )
    file = blocks_exchange(
        far,
        tmp_path / "b.xml",
        system="EPSG:32632",
        control=f"<ControlPoints>{control}</ControlPoints>",
    )
    block = read(file)
    assert block.ground is not None
    assert block.ground.crs == "EPSG:32632"
    here = np.array([row.xyz for row in block.control])
    gaps, truth = np.diff(here, axis=0), np.diff(far.points[:3], axis=0)
    # the map's scale near its central meridian is 0.9996, and north is turned by 0.35 degrees
    scale = np.linalg.norm(gaps[:, :2], axis=1) / np.linalg.norm(truth[:, :2], axis=1)
    np.testing.assert_allclose(scale, 1.0 / 0.9996, atol=1e-4)
    np.testing.assert_allclose(gaps[:, 2], truth[:, 2], atol=1e-3)
    assert np.abs(here).max() < 1000.0
    with pytest.raises(InputError, match="--crs EPSG:25832 says"):
        read(blocks_exchange(far, tmp_path / "w.xml", system="PROJCS[&quot;x&quot;]"))


def test_positions_of_metadata_with_accuracies_are_priors(
    tmp_path: Path, scene: TiltedBlock
) -> None:
    file = blocks_exchange(scene, tmp_path / "b.xml")
    text = file.read_text()
    prior = (
        "<Metadata><Center><x>1</x><y>2</y><z>90</z></Center><HorizontalAccuracy>2"
        "</HorizontalAccuracy><VerticalAccuracy>3</VerticalAccuracy></Metadata></Pose>"
    )
    loose = "<Metadata><Center><x>1</x><y>2</y><z>90</z></Center></Metadata></Pose>"
    first, second, rest = text.split("</Pose>", 2)
    file.write_text(first + prior + second + loose + rest)
    found = blocksexchange.read(file, PLAIN)
    photo, other = found.block.photos[:2]
    assert photo.position == (1.0, 2.0, 90.0)
    assert photo.position_sigma == (2.0, 2.0, 3.0)
    assert photo.rotation is not None
    assert other.position_sigma is None
    assert other.position == tuple(scene.centres[1].tolist())
    said = {note.text: note.count for note in found.notes}
    assert said["positions of metadata with accuracies are priors"] == 1
    assert said["positions of metadata without accuracies"] == 1


def test_two_photos_of_one_path_and_a_point_twice(tmp_path: Path, scene: TiltedBlock) -> None:
    file = blocks_exchange(scene, tmp_path / "b.xml", poses=False)
    text = file.read_text().replace(scene.names[1], scene.names[0])
    again = text.split("<TiePoint>", 1)[1].split("</Measurement>")[0] + "</Measurement>"
    file.write_text(text.replace("<TiePoint>", f"<TiePoint>{again}", 1))
    found = blocksexchange.read(file, PLAIN)
    assert [photo.id for photo in found.block.photos[:2]] == [
        scene.names[0],
        f"{scene.names[0]} (13)",
    ]
    off = [row for row in found.block.image_points if row.use == "off"]
    assert [row.point for row in off] == ["1~2"]
    assert {note.what for note in found.notes} >= {"changed", "doubled", "dropped"}


def test_millimetres_beyond_all_numbers_lie_outside(tmp_path: Path, scene: TiltedBlock) -> None:
    file = blocks_exchange(scene, tmp_path / "b.xml", mm=True)
    head, ties = file.read_text().split("<TiePoints>")
    file.write_text(f"{head}<TiePoints>{ties.replace('<xmm>', '<xmm>1e308</xmm><xmm>', 1)}")
    found = blocksexchange.read(file, PLAIN)
    assert [n.count for n in found.notes if n.text == "rays outside their image"] == [1]


def test_skew_is_a_shear_and_said(tmp_path: Path, scene: TiltedBlock) -> None:
    file = blocks_exchange(scene, tmp_path / "b.xml")
    file.write_text(file.read_text().replace("<Skew>0<", "<Skew>3.118<"))
    found = blocksexchange.read(file, PLAIN)
    assert any("Skew" in note.text for note in found.notes)
    lens = found.block.cameras[0].lens
    assert isinstance(lens, BrownLens)
    assert lens.b2 == pytest.approx(-1e-3)  # y is up here


ENTITIES = (
    '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bbbbbbbbbb">'
    + "".join(f'<!ENTITY b{k} "{f"&b{k - 1};" * 10}">' for k in range(1, 12))
    + "]><BlocksExchange>&b11;</BlocksExchange>"
)
HEAD = '<?xml version="1.0" encoding="utf-8"?>\n'
HARM = [
    (ENTITIES, "a document type or entity declaration: not read"),
    (
        '<!DOCTYPE a SYSTEM "file:///etc/passwd"><BlocksExchange/>',
        "a document type or entity declaration",
    ),
    ("<BlocksExchange>&x;</BlocksExchange>", "not XML: undefined entity"),
    ("<BlocksExchange>" + "<a>" * 100_000, "elements within elements, more than 40"),
    ("<BlocksExchange " + " ".join(f'a{k}="1"' for k in range(200)) + "/>", "100 attributes"),
    (f'<BlocksExchange a="{"x" * 30_000}"/>', "attributes of more than 20000"),
    (f"<BlocksExchange><Block><Name>{'x' * 1_100_000}", "more than 1000000 characters"),
    (f"<BlocksExchange {'x' * 3_000_000}", "without an end of a tag|attributes|not XML"),
    ('<?xml version="1.0" encoding="UTF5e15"?><BlocksExchange/>', "not XML: unknown encoding"),
    ("<Blocks/>", "<Blocks> is not <BlocksExchange>"),
    ("<BlocksExchange><Block>", "not XML: no element found"),
    ("<BlocksExchange></Block>", "not XML: mismatched tag"),
    ("\x00\x01", "not XML"),
    ("", "not XML: no element found"),
    ("<BlocksExchange/>", "no Photo in any Photogroup"),
    ("<BlocksExchange>\x1b[2J</BlocksExchange>", "not XML: not well-formed"),
]


@pytest.mark.parametrize(("text", "message"), HARM)
def test_xml_that_means_harm_ends_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    import re

    file = tmp_path / "b.xml"
    file.write_text(text)
    assert main(["import", "blocksexchange", str(file), "-o", str(tmp_path / "b")]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert error.count("\n") == 1
    assert "\x1b" not in error
    assert not (tmp_path / "b").exists()


WRONG = [
    ("<Width>4000<", "<Width>999999999999<", "Width must lie between 1 and"),
    ("<Width>4000<", "<Width>4e3<", "Width must be a whole number"),
    ("<Height>3000</Height>", "", "has no ImageDimensions/Height"),
    ("Perspective", "Fisheye", "camera model 'Fisheye': only Perspective is read"),
    (">XRightYDown<", ">XRightYLeft<", "CameraOrientation 'XRightYLeft': none of"),
    ("<FocalLengthPixels>", "<FocalLengthPixel>", "not XML|mismatched"),
    ("<FocalLengthPixels>3120.5<", "<FocalLengthPixels>-1<", "FocalLengthPixels must be positive"),
    ("<FocalLengthPixels>3120.5<", f"<FocalLengthPixels>{'9' * 400}<", "finite number"),
    ("<K1>-0.08<", "<K1>nan<", "K1 must be a finite number, not 'nan'"),
    ("<Id>13</Id>", "<Id>3</Id>", "line 5: a second Photo of Id '3'"),
    ("<Id>13</Id>", "", "<Photo> has no Id"),
    ("<PhotoId>13<", "<PhotoId>99<", "PhotoId '99': no Photo has that Id"),
    ("<PhotoId>13</PhotoId>", "", "<Measurement> has no PhotoId"),
    ("flight 1/DSC_01.jpg", "a&#10;b", "holds a character that cannot be printed"),
    ("<M_00>", "<M_00>7", "the matrix is no rotation"),
    ("<M_22>", "<M_22>1e300", "finite number|no rotation"),
    ("<Name>A</Name>", "<Name>1</Name>", "a second control point '1'"),
    ("<Category>Vertical<", "<Category>Odd<", "Category 'Odd'"),
    ("<z>6</z>", "", "control point '1' has no z"),
    ("<VerticalAccuracy>0.03<", "<VerticalAccuracy>-1<", "must not be negative"),
    ("<x>100</x>", "<xmm>1</xmm><ymm>2</ymm>", "nothing says how large a pixel is"),
    ("<x>100</x>", "", "<Measurement> has no x and y"),
    ("</Name><SRSId>4", "</Name><SRSId>5", "SRSId '5': no SRS has that Id"),
    ("<ControlPoint><Id>", "<ControlPoint><SRSId>9</SRSId><Id>", "more than one coordinate system"),
    ("ENU:47,8", "ENU:north", "not ENU:latitude,longitude"),
    ("ENU:47,8", "EPSG:99999999", "--crs EPSG:25832 says what it is"),
]


@pytest.mark.parametrize(("old", "new", "message"), WRONG)
def test_what_is_wrong_in_a_file_is_named(
    tmp_path: Path, scene: TiltedBlock, old: str, new: str, message: str
) -> None:
    file = blocks_exchange(scene, tmp_path / "b.xml", control=CONTROL, system="ENU:47,8")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message) as failed:
        read(file)
    assert "\n" not in str(failed.value)


def test_a_cut_file_is_an_error_wherever_it_is_cut(tmp_path: Path, scene: TiltedBlock) -> None:
    file = blocks_exchange(scene, tmp_path / "b.xml", control=CONTROL)
    text = file.read_text()
    for at in range(0, len(text) - 2, len(text) // 40):
        file.write_text(text[:at])
        with pytest.raises(InputError):
            read(file)


def test_more_photos_than_are_kept_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anaplot.exchange.formats.blocksexchange._MOST_KEPT", 2)
    file = tmp_path / "many.xml"
    photos = "<Photo><Id>1</Id></Photo>\n" * 3
    file.write_text(
        "<BlocksExchange><Block><Photogroups><Photogroup>\n"
        f"{photos}</Photogroup></Photogroups></Block></BlocksExchange>"
    )
    with pytest.raises(InputError, match=r"line 4: more than 2 Photos"):
        blocksexchange.read(file, ImportOptions())


def test_groups_of_one_name_are_cameras_of_their_own(tmp_path: Path) -> None:
    names = ("DJI", "DJI 2", "DJI", "", "DJI", "group 4", "DJI")
    groups = "".join(
        f"<Photogroup><Name>{name}</Name><ImageDimensions><Width>4000</Width>"
        f"<Height>3000</Height></ImageDimensions><FocalLengthPixels>{3000 + k}</FocalLengthPixels>"
        f"<Photo><Id>{k}</Id><ImagePath>p{k}.jpg</ImagePath></Photo></Photogroup>"
        for k, name in enumerate(names)
    )
    seen = "".join(
        f"<Measurement><PhotoId>{k}</PhotoId><x>9</x><y>9</y></Measurement>" for k in range(7)
    )
    file = tmp_path / "b.xml"
    file.write_text(
        f"<BlocksExchange><Block><Photogroups>{groups}</Photogroups>"
        f"<TiePoints><TiePoint>{seen}</TiePoint></TiePoints></Block></BlocksExchange>"
    )
    cameras = blocksexchange.read(file, ImportOptions()).block.cameras
    made = ("DJI", "DJI 2", "DJI 3", "group 4", "DJI 4", "group 4 2", "DJI 5")
    assert [camera.id for camera in cameras] == list(made)
    assert [round(1000.0 * camera.c) for camera in cameras] == list(range(3000, 3007))
