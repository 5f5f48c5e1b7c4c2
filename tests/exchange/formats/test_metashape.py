"""Metashape's camera file: lens, poses, markers as control and check, and the file without some."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tiltedblock import CX, CY, FX, FY, K1, K2, P1, P2, TiltedBlock, tilted_block
from tiltedfiles import camera_file, colmap_model

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats import colmap, metashape
from anaplot.exchange.formats.door import ImportOptions
from anaplot.exchange.formats.metashapewriter import without_locations
from anaplot.photogrammetry.rotation import rotation_matrix

PLAIN = ImportOptions()
UTM = (
    'PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],'
    'AUTHORITY["EPSG","32632"]]'
)


@pytest.fixture(scope="module")
def scene() -> TiltedBlock:
    return tilted_block()


def test_a_camera_file_is_the_block_that_colmap_has(tmp_path: Path, scene: TiltedBlock) -> None:
    model = colmap.read(colmap_model(scene, tmp_path / "m"), PLAIN).block
    found = metashape.read(camera_file(scene, tmp_path / "c.xml"), PLAIN)
    block = found.block
    rays = {(row.photo, row.point): row for row in model.image_points}
    assert len(rays) == len(block.image_points)
    for row in block.image_points:
        other = rays[row.photo.replace(" ", "_"), str(int(row.point.removeprefix("m ")) + 1)]
        assert row.measured == other.measured  # the same corner, no half pixel
        np.testing.assert_allclose((row.x, row.y), (2.5 * other.x, 2.5 * other.y), atol=1e-10)
    poses = {photo.id: photo for photo in model.photos}
    for photo in block.photos:
        other_photo = poses[photo.id.replace(" ", "_")]
        assert photo.rotation is not None
        assert other_photo.rotation is not None
        np.testing.assert_allclose(photo.position, other_photo.position, atol=1e-10)
        np.testing.assert_allclose(
            rotation_matrix(*photo.rotation), rotation_matrix(*other_photo.rotation), atol=1e-12
        )
    assert block.precision.image_um == pytest.approx(1.0)  # 0.4 px of 2.5 um
    assert [row.use for row in block.control] == ["control"] * 4 + ["check"]
    assert block.control[0].sigma == (0.02, 0.02, 0.03)
    said = {note.text: note.count for note in found.notes}
    assert said["cameras without a marker"] == 1
    assert said["sensors' rolling shutters"] == 1
    assert not any("without a sigma" in text for text in said)  # every marker has one
    assert not any("adjusted calibration" in text for text in said)
    first = tmp_path / "first.xml"
    first.write_text(
        (tmp_path / "c.xml").read_text().replace('class="adjusted"', 'class="initial"')
    )
    notes = metashape.read(first, PLAIN).notes
    (initial,) = (note for note in notes if "without an adjusted calibration" in note.text)
    assert (initial.what, initial.count) == ("assumed", 1)
    bare = tmp_path / "bare.xml"
    bare.write_text((tmp_path / "c.xml").read_text().replace(' sx="0.02"', "", 1))
    notes = metashape.read(bare, PLAIN).notes
    assert [note.count for note in notes if "without a sigma" in note.text] == [1]


def test_a_k4_is_taken_off_and_said(tmp_path: Path) -> None:
    """Without noise every ray of the corrected block meets its point, for all of the lens."""
    scene = tilted_block(noise_px=0.0)
    k4 = 0.05
    moved = []
    for k, j, _, _ in scene.pixels:
        x, y, z = scene.rotations[k] @ (scene.points[j] - scene.centres[k])
        u, v = x / z, y / z
        r2 = u * u + v * v
        radial = 1 + K1 * r2 + K2 * r2**2 + k4 * r2**4
        du = u * radial + P2 * (r2 + 2 * u * u) + 2 * P1 * u * v
        dv = v * radial + P1 * (r2 + 2 * v * v) + 2 * P2 * u * v
        moved.append((k, j, float(FX * du + CX), float(FY * dv + CY)))
    bent = TiltedBlock(scene.names, scene.rotations, scene.centres, scene.points, tuple(moved))
    found = metashape.read(camera_file(bent, tmp_path / "c.xml", k4=k4), PLAIN)
    sigmas = [row.sigma_um for row in found.block.image_points]
    assert None not in sigmas
    assert max(sigmas) > min(sigmas) > 0.0  # type: ignore[type-var]
    assert any("times " in note.text and "sensor" in note.text for note in found.notes)
    assert any("with a K4: corrected" in note.text for note in found.notes)
    camera = found.block.cameras[0]
    index = {name: k for k, name in enumerate(scene.names)}
    for row in found.block.image_points:
        k, j = index[row.photo], int(row.point.removeprefix("m "))
        x, y, z = scene.rotations[k] @ (scene.points[j] - scene.centres[k])
        np.testing.assert_allclose((row.x, row.y), camera.c * np.array((x / z, -y / z)), atol=1e-9)


CALIBRATIONS = [
    ("<f>3118.0</f><b1>2.5</b1><b2>-6</b2>", (3118.0, 2.5, -6.0, 0.0)),
    ("<f>3118.0</f><b1>-2.5</b1><b2>6</b2><k4>0.05</k4>", (3118.0, -2.5, 6.0, 0.05)),
    ("<fx>3120.5</fx><fy>3118</fy><skew>6</skew>", (3118.0, 2.5, 6.0, 0.0)),
    ("<fx>3115.5</fx><fy>3118</fy><skew>-6</skew><k4>0.05</k4>", (3118.0, -2.5, -6.0, 0.05)),
]


@pytest.mark.parametrize(("stated", "values"), CALIBRATIONS)
def test_affinity_and_skew_are_those_of_the_manual(
    tmp_path: Path, scene: TiltedBlock, stated: str, values: tuple[float, float, float, float]
) -> None:
    """Without noise every ray meets its point: u = w/2 + cx + x' f + x' B1 + y' B2."""
    f, b1, b2, k4 = values
    pixels = []
    truth: dict[tuple[str, str], tuple[float, float]] = {}
    for k, j, _, _ in scene.pixels:
        x, y, z = scene.rotations[k] @ (scene.points[j] - scene.centres[k])
        x, y = x / z, y / z
        truth[scene.names[k], f"m {j}"] = float(x), float(y)
        r2 = x * x + y * y
        radial = 1 + K1 * r2 + K2 * r2**2 + k4 * r2**4
        # P1 and P2 of Metashape are P2 and P1 of OPENCV
        bent_x = x * radial + P2 * (r2 + 2 * x * x) + 2 * P1 * x * y
        bent_y = y * radial + P1 * (r2 + 2 * y * y) + 2 * P2 * x * y
        u, v = CX + bent_x * f + bent_x * b1 + bent_y * b2, CY + bent_y * f
        pixels.append((k, j, float(u), float(v)))
    bent = TiltedBlock(scene.names, scene.rotations, scene.centres, scene.points, tuple(pixels))
    file = camera_file(bent, tmp_path / "c.xml")
    text, n = re.subn(f"<f>{FY}</f>(.*?)<b1>.*?</b1>", rf"{stated}\1", file.read_text())
    assert n == 1
    file.write_text(text.replace("<k4>0.0</k4>", ""))
    block = metashape.read(file, PLAIN).block
    c = block.cameras[0].c
    for row in block.image_points:
        x, y = truth[row.photo, row.point]
        # 1e-6 px of 2.5 um
        np.testing.assert_allclose((row.x, row.y), (c * x, -c * y), rtol=0.0, atol=2.5e-9)


def test_sensors_of_one_label_stay_two_cameras(tmp_path: Path, scene: TiltedBlock) -> None:
    text = camera_file(scene, tmp_path / "c.xml").read_text()
    start, end = text.index("<sensor id="), text.index("</sensors>")
    one = text[start:end]
    other = one.replace('id="0"', 'id="1"').replace(f"<f>{FY}</f>", f"<f>{FY + 7.0}</f>")
    text = text.replace('camera id="1" sensor_id="0"', 'camera id="1" sensor_id="1"')
    two = tmp_path / "two.xml"
    two.write_text(text[:start] + one + other + text[end:])
    block = metashape.read(two, PLAIN).block
    assert [camera.id for camera in block.cameras] == ["FC", "FC (1)"]
    assert block.cameras[1].c - block.cameras[0].c == pytest.approx(7.0 * 0.0025)
    assert block.camera_of(scene.names[1]).id == "FC (1)"
    # what the second would be called is taken: its camera would be that of a third
    third = one.replace('id="0"', 'id="2"').replace('"FC"', '"FC (1)"')
    text = text.replace('camera id="2" sensor_id="0"', 'camera id="2" sensor_id="2"')
    two.write_text(text[:start] + one + third + other + text[end:])
    with pytest.raises(InputError, match=r"sensor 'FC \(1\)' stands twice"):
        metashape.read(two, PLAIN)


def test_a_pixel_is_one_of_its_own_sensor(tmp_path: Path, scene: TiltedBlock) -> None:
    text = camera_file(scene, tmp_path / "c.xml").read_text()
    start, end = text.index("<sensor id="), text.index("</sensors>")
    one = text[start:end]
    other = one.replace('id="0"', 'id="1"').replace("0.0025", "0.01")
    text = text.replace('camera id="1" sensor_id="0"', 'camera id="1" sensor_id="1"')
    two = tmp_path / "two.xml"
    two.write_text(text[:start] + one + other + text[end:])
    same, mixed = (metashape.read(file, PLAIN).block for file in (tmp_path / "c.xml", two))
    assert mixed.precision.image_um == same.precision.image_um
    per_pixel = {1e3 * camera.pixel_mm for camera in mixed.cameras}
    assert per_pixel == {2.5, 10.0}
    for a, b in zip(same.image_points, mixed.image_points, strict=True):
        larger = b.photo == scene.names[1]
        assert a.sigma_um is None
        assert b.sigma_um == (4.0 * mixed.precision.image_um if larger else None)


def test_what_is_off_is_left_out_of_the_file_and_nothing_else(
    tmp_path: Path, scene: TiltedBlock, capsys: pytest.CaptureFixture[str]
) -> None:
    file = camera_file(scene, tmp_path / "c.xml")
    block, out = tmp_path / "b", tmp_path / "o.xml"
    assert main(["import", str(file), "-o", str(block)]) == 0
    assert "Metashape's camera XML" in capsys.readouterr().out
    assert main(["export", "metashape", str(block), "-o", str(out)]) == 0
    assert out.read_bytes() == file.read_bytes()
    out.unlink()
    rows = (block / "image_points.csv").read_text().splitlines()
    header = rows[0].split(",")
    assert header == ["photo", "point", "x_px", "y_px", "model"]
    gone = [rows[3], rows[8]]
    rows[0] += ",use"
    rows[1:] = [f"{row},{'off' if row in gone else ''}" for row in rows[1:]]
    (block / "image_points.csv").write_text("\n".join(rows) + "\n")
    capsys.readouterr()
    assert main(["export", "metashape", str(block), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "2 measurements with use = off" in said
    assert "not in the block" not in said
    before, after = file.read_text().splitlines(), out.read_text().splitlines()
    lost = [line for line in before if line not in after]
    assert len(before) - len(after) == len(lost) == 2
    for line, row in zip(lost, gone, strict=True):
        assert f'x="{row.split(",")[2]}"' in line
    again = metashape.read(out, PLAIN).block.image_points
    assert len(again) == len(read_block(block).image_points) - 2
    (block / "image_points.csv").write_text("\n".join([*rows[:12], *rows[13:]]) + "\n")
    assert main(["export", "metashape", str(block), "-o", str(tmp_path / "p.xml")]) == 0
    assert "1 measurements that are not in the block stay as they were" in capsys.readouterr().out
    assert (tmp_path / "p.xml").read_bytes() == out.read_bytes()


@pytest.mark.parametrize("end", ["\n", "\r\n", ""])
@pytest.mark.parametrize("close", ["/>", "></location>"])
def test_a_location_goes_with_its_line_and_nothing_else(
    tmp_path: Path, end: str, close: str
) -> None:
    rows = [f'  <location camera_id="{k}" x=">"{close}{end}' for k in range(3)]
    head, tail = f'<a><marker marker_id="7">{end}', "</marker><!-- b --></a>"
    (tmp_path / "f").write_bytes("".join((head, *rows, tail)).encode())
    data, count = without_locations(tmp_path / "f", {("7", "1"), ("6", "2")})
    left = (rows[0], rows[2]) if end else (rows[0], "  ", rows[2])
    assert data.decode() == "".join((head, *left, tail))
    assert count == 1


def test_adjusted_it_gives_the_points_that_were_there(
    tmp_path: Path, scene: TiltedBlock, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    file = camera_file(scene, tmp_path / "c.xml", control=6)
    assert main(["import", "metashape", str(file), "-o", str(tmp_path / "b")]) == 0
    capsys.readouterr()
    assert main(["adjust", str(tmp_path / "b"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert 0.8 < found["sigma0"] < 1.2
    for point in found["points"]:
        truth = scene.points[int(point["point"].removeprefix("m "))]
        for axis, value in zip("XYZ", truth, strict=True):
            assert abs(point[axis] - value) < 5.0 * point[f"s{axis}"] + 1e-3


def test_geocentric_poses_and_projected_markers_meet(tmp_path: Path, scene: TiltedBlock) -> None:
    pyproj = pytest.importorskip("pyproj")
    # the scene stands in the plane that touches the ellipsoid at a place in zone 32
    lon, lat, height = np.radians(9.2), np.radians(47.5), 420.0
    axes = np.array(
        [
            [-np.sin(lon), np.cos(lon), 0.0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )
    world = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    origin = np.array(world.transform(9.2, 47.5, height))
    utm = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:32632", always_xy=True)
    geocentric = origin + scene.points @ axes
    maps = np.array([utm.transform(*xyz) for xyz in geocentric])
    moved = TiltedBlock(
        scene.names,
        scene.rotations @ axes,
        origin + scene.centres @ axes,
        maps,
        scene.pixels,
    )
    block = metashape.read(camera_file(moved, tmp_path / "c.xml", system=UTM), PLAIN).block
    assert block.ground is not None
    assert block.ground.crs == "EPSG:32632"
    # both are seen from the block's own origin: distances and directions between them hold
    first = block.photos[0]
    assert first.rotation is not None
    assert first.position is not None
    ours = rotation_matrix(*first.rotation)
    for row in block.control:
        j = int(row.point.removeprefix("m "))
        away = ours.T @ (np.array(row.xyz) - first.position)
        truth = scene.rotations[0] @ (scene.points[j] - scene.centres[0])
        np.testing.assert_allclose(away, truth * (1, -1, -1), atol=1e-3)


def test_rays_that_metashape_does_not_use_do_not_count(tmp_path: Path, scene: TiltedBlock) -> None:
    file = camera_file(scene, tmp_path / "c.xml")
    text = file.read_text().replace(
        '<location camera_id="1"', '<location valid="false" camera_id="1"', 1
    )
    file.write_text(text.replace('<camera id="2"', '<camera enabled="false" id="2"'))
    rows = metashape.read(file, PLAIN).block.image_points
    off = [row for row in rows if row.use == "off"]
    assert {row.photo for row in off} == {scene.names[1], scene.names[2]}
    assert sum(row.photo == scene.names[1] for row in off) == 1
    assert all(row.use == "off" for row in rows if row.photo == scene.names[2])


def test_positions_with_accuracies_are_priors(tmp_path: Path, scene: TiltedBlock) -> None:
    file = camera_file(scene, tmp_path / "c.xml")
    prior = '<reference x="1" y="2" z="95" sxyz="0.5"/></camera>'
    file.write_text(file.read_text().replace("</camera>", prior, 1))
    photo = metashape.read(file, PLAIN).block.photos[0]
    assert photo.position == (1.0, 2.0, 95.0)
    assert photo.position_sigma == (0.5, 0.5, 0.5)


WRONG = [
    ('sensor_id="0" component_id="0"', 'sensor_id="7" component_id="0"', "sensor_id '7'"),
    ('<camera id="1"', '<camera id="0"', "a second camera of id '0'"),
    ('<camera id="1"', "<camera", "<camera> has no id"),
    ('type="frame">', 'type="fisheye">', "sensor type 'fisheye': only frame"),
    ("<f>3118.0<", "<f>0<", "f must be positive"),
    ("<f>3118.0<", f"<f>{'9' * 400}<", "f must be a finite number"),
    ("<k1>-0.08<", "<k1>inf<", "k1 must be a finite number"),
    ("<k1>", "<p3>0.1</p3><k1>", "p3 is not 0"),
    ('width="4000"', 'width="1000000000000"', "width must lie between"),
    ("<scale>2<", "<scale>0<", "a scale of 0"),
    ("<rotation>", "<rotation>1 ", "<rotation> has 10 numbers, not 9"),
    ("<rotation>0.0", "<rotation>0.5", "the matrix is no rotation"),
    ("0.0 0.0 0.0 1.0</transform>", "0.0 0.0 1.0 1.0</transform>", "last row is not 0 0 0 1"),
    ('location camera_id="0"', 'location camera_id="77"', "camera_id '77'"),
    ('marker marker_id="0"', 'marker marker_id="77"', "marker_id '77': no such marker"),
    (' pinned="true" x="', ' pinned="true" z="', "<location> has no x"),
    ('label="m 0"', 'label="&#9;m"', "begins or ends|cannot be printed"),
    ('sx="0.02"', 'sx="-1"', "sx must not be negative"),
    ('_projections" value="0.4"', '_projections" value="1e308"', "accuracy_projections of 1e"),
    ("LOCAL_CS", "FOREIGN_CS", "--crs EPSG:25832 says what it is"),
    ("<frames>", "<framed>", "not XML"),
    ('<?xml version="1.0" encoding="UTF-8"?>', "<!DOCTYPE a [<!ENTITY b 'c'>]>", "document type"),
]


@pytest.mark.parametrize(("old", "new", "message"), WRONG)
def test_what_is_wrong_is_named(
    tmp_path: Path, scene: TiltedBlock, old: str, new: str, message: str
) -> None:
    file = camera_file(scene, tmp_path / "c.xml")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message) as failed:
        metashape.read(file, PLAIN)
    assert "\n" not in str(failed.value)


def test_a_file_without_markers_says_where_tie_points_are(
    tmp_path: Path, scene: TiltedBlock, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "c.xml"
    camera_file(scene, file)
    head, _, _ = file.read_text().partition("<frames>")
    file.write_text(head + "</chunk></document>")
    assert main(["import", str(file), "-o", str(tmp_path / "b")]) == 2
    assert "BlocksExchange and COLMAP have them" in capsys.readouterr().err


def test_a_pose_that_is_no_rotation_is_refused(tmp_path: Path, scene: TiltedBlock) -> None:
    file = camera_file(scene, tmp_path / "c.xml")
    head, start, rest = file.read_text().partition("</component></components>")
    pose, first, others = rest.partition("<transform>")
    number, _, others = others.partition(" ")
    file.write_text(f"{head}{start}{pose}{first}{float(number) + 0.3} {others}")
    with pytest.raises(InputError, match="the matrix is no rotation"):
        metashape.read(file, PLAIN)
