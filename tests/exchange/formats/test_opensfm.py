"""OpenSfM models and OpenDroneMap projects: in, adjusted, and out again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from opensfmmodels import CAMERA, HEIGHT, LAT, LON, Flight

from anaplot.bundle.adjust import adjust_block
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats import odm, opensfm
from anaplot.exchange.formats.crs import GroundFrame, local_system
from anaplot.exchange.formats.door import Imported, ImportOptions
from anaplot.exchange.formats.registry import recognised
from anaplot.photogrammetry.groundsystem import GroundSystem

PERSPECTIVE = {
    "projection_type": "perspective", "width": 3000, "height": 4000, "focal": 0.9, "k1": -0.05,
    "k2": 0.01,
}  # fmt: skip


def _read(folder: Path, **options: object) -> Imported:
    return opensfm.read(folder, ImportOptions(**options))  # type: ignore[arg-type]


def _said(found: Imported) -> str:
    return "\n".join(f"{one.what} {one.count} {one.text}" for one in found.notes)


@pytest.mark.parametrize("version", [0, 1, 2])
@pytest.mark.parametrize("camera", [CAMERA, PERSPECTIVE])
def test_what_comes_in_has_no_misclosure(tmp_path: Path, version: int, camera: dict) -> None:
    flight = Flight(camera)
    flight.write(tmp_path, version)
    found = _read(tmp_path)
    block = found.block
    assert len(block.photos) == 12
    assert len(block.image_points) == len(flight.rays)
    assert block.ground == GroundSystem("EPSG:4326", "local", (LON, LAT, HEIGHT))
    assert "no priors without --position-m" in _said(found)
    # the poses of the file, the lens and the pixels agree: rays meet where the points are
    from anaplot.photogrammetry.rotation import rotation_matrix

    photos = {photo.id: photo for photo in block.photos}
    for ray in block.image_points:
        photo = photos[ray.photo]
        down = rotation_matrix(*photo.rotation).T @ (
            flight.points[int(ray.point)] - np.array(photo.position)
        )
        c = block.cameras[0].c
        assert np.abs(-c * down[:2] / down[2] - (ray.x, ray.y)).max() < 1e-9 * c


def test_control_of_a_map_is_where_it_is(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    flight = Flight(noise_px=0.3)
    flight.write(tmp_path)
    frame = GroundFrame.of(local_system("EPSG:32632", (LON, LAT, HEIGHT)))
    map_places = frame.out_of_block(flight.control)
    (tmp_path / "gcp_list.txt").write_text(flight.gcp_list("WGS84 UTM 32N", map_places))
    found = _read(tmp_path, sigma_px=0.5, control_m=0.02, pixel_um=2.4)
    block = found.block
    assert block.precision.control_m == 0.02
    assert block.precision.image_um == pytest.approx(1.2)
    assert block.ground is not None
    assert block.ground.crs == "EPSG:32632"
    assert {row.point for row in block.control} == {f"P{k}" for k in range(6)}
    for row in block.control:
        k = int(row.point[1:])
        assert np.abs(np.array(row.xyz) - flight.control[k]).max() < 1e-6
    adjusted = adjust_block(block)
    assert adjusted.sigma0 is not None
    assert 0.5 < adjusted.sigma0 < 0.7
    for row in adjusted.point_rows():
        if not row.point.startswith("P"):
            assert np.abs(np.array(row.xyz) - flight.points[int(row.point)]).max() < 0.1


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("first", ["longitude", "latitude"])
def test_the_order_of_degrees_is_looked_at(tmp_path: Path, named: bool, first: str) -> None:
    flight = Flight()
    flight.write(tmp_path)
    frame = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT)))
    degrees = frame.out_of_block(flight.control)
    degrees[3, 2] = np.nan
    if first == "latitude":
        degrees[:, :2] = degrees[:, 1::-1]
    (tmp_path / "gcp_list.txt").write_text(flight.gcp_list("EPSG:4326", degrees, named))
    found = _read(tmp_path)
    assert ("latitude first, against the documentation" in _said(found)) == (first == "latitude")
    assert "points without a height" in _said(found)
    assert len(found.block.control) == 6
    heights = 0
    for row in found.block.control:
        x, y, z = row.xyz
        gap = np.abs(flight.control[:, :2] - (x, y)).max(axis=1)
        k = int(np.argmin(gap))
        assert gap[k] < 1e-3 if k == 3 else gap[k] < 1e-7
        assert z == (None if k == 3 else pytest.approx(flight.control[k, 2], abs=1e-7))
        heights += z is not None
        if named:
            assert row.point == f"P{k}"
        else:
            assert row.point.startswith("gcp")
    assert heights == 5
    # a person's word goes before
    wrong = "lonlat" if first == "latitude" else "latlon"
    turned = _read(tmp_path, order=wrong)
    assert "as asked for" in _said(turned)
    assert "km from the images' origin" in _said(turned)


def test_names_of_control_do_not_meet_tracks(tmp_path: Path) -> None:
    flight = Flight()
    flight.write(tmp_path)
    degrees = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT))).out_of_block(flight.control)
    text = flight.gcp_list("WGS84", degrees).replace(" P", " ")
    (tmp_path / "gcp_list.txt").write_text(text + "1 2 3 4 5 nowhere.jpg P9\n")
    found = _read(tmp_path)
    assert {row.point for row in found.block.control} == {f"gcp-{k}" for k in range(6)}
    assert "changed 6 control points that have a track's name" in _said(found)
    assert "dropped 1 lines of gcp_list.txt of images" in _said(found)
    assert len(found.block.image_points) == len(flight.rays) + len(flight.control_rays)


def test_names_that_are_made_are_made_once(tmp_path: Path) -> None:
    flight = Flight()
    flight.write(tmp_path)
    file = tmp_path / "reconstruction.json"
    (model,) = json.loads(file.read_text())
    # cameras: the second has no name, and what it would be called is taken
    (own,) = model["cameras"].values()
    model["cameras"] = {"camera 2": own, "": {**own, "width": own["width"] + 2}}
    for k, shot in enumerate(model["shots"].values()):
        shot["camera"] = "" if k % 2 else "camera 2"
    # tracks: two have names of control, and one of them that of the other behind gcp-
    for old, new in (("0", "a"), ("1", "gcp-a")):
        model["points"][new] = model["points"].pop(old)
    file.write_text(json.dumps([model]))
    rows = [line.split("\t") for line in flight.tracks(2).splitlines()]
    for row in rows[1:]:
        row[1] = {"0": "a", "1": "gcp-a"}.get(row[1], row[1])
    (tmp_path / "tracks.csv").write_text("\n".join(map("\t".join, rows)) + "\n")
    degrees = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT))).out_of_block(flight.control)
    text = flight.gcp_list("WGS84", degrees).replace(" P0 ", " a ").replace(" P1 ", " gcp-a ")
    (tmp_path / "gcp_list.txt").write_text(text)
    block = _read(tmp_path).block
    assert [camera.id for camera in block.cameras] == ["camera 2", "camera 3"]
    widths = {name: block.camera_of(name).pixels for name in model["shots"]}
    assert len(set(widths.values())) == 2
    names = [row.point for row in block.control]
    assert len(set(names)) == len(names) == 6
    assert {"gcp-gcp-a", "gcp-gcp-gcp-a"} < set(names)


def test_names_of_images_in_other_letters_are_told(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    flight = Flight()
    flight.write(tmp_path)
    frame = GroundFrame.of(local_system("EPSG:32632", (LON, LAT, HEIGHT)))
    listed = flight.gcp_list("WGS84 UTM 32N  # zone", frame.out_of_block(flight.control))
    (tmp_path / "gcp_list.txt").write_text(listed.replace("IMG", "img").replace("JPG", "jpg"))
    found = _read(tmp_path)
    (note,) = [note for note in found.notes if "without a pose" in note.text]
    assert note.count == len(flight.control_rays)
    assert "; there is 'run " in note.text
    assert "there is no control" in note.text
    assert note.examples[0] == "line 3: run 0/img_0.jpg"
    # the list's system stays the block's
    assert found.block.ground == local_system("EPSG:32632", (LON, LAT, HEIGHT))
    (tmp_path / "gcp_list.txt").write_text(listed.replace("run 0/IMG_0.JPG", "NEW 7.JPG"))
    found = _read(tmp_path)
    (note,) = [note for note in found.notes if "without a pose" in note.text]
    assert "there is" not in note.text
    assert note.examples[0] == "line 3: NEW 7.JPG"
    assert len(found.block.control) == 6


def test_the_largest_reconstruction_is_taken(tmp_path: Path) -> None:
    flight = Flight()
    small = flight.reconstruction()
    small["shots"] = dict(list(small["shots"].items())[:2])
    odd = json.loads(json.dumps(flight.reconstruction()))
    odd["cameras"]["ball"] = {"projection_type": "spherical", "width": 10, "height": 5}
    for name in list(odd["shots"])[:3]:
        odd["shots"][name]["camera"] = "ball"
    flight.write(tmp_path, more=[small])
    assert "dropped 1 further reconstructions in the file, of 2 photos" in _said(_read(tmp_path))
    (tmp_path / "reconstruction.json").write_text(json.dumps([odd]))
    found = _read(tmp_path)
    assert "dropped 3 photos of a spherical camera" in _said(found)
    assert len(found.block.photos) == 9


def test_a_project_goes_in_and_out_by_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = Flight(noise_px=0.3)
    project, block, out = tmp_path / "project", tmp_path / "block", tmp_path / "out"
    flight.write(project / "opensfm")
    model = project / "opensfm"
    tracks = (model / "tracks.csv").read_text().splitlines(keepends=True)
    twice = tracks[1].replace("\t0\t", "\t999\t", 1)
    (model / "tracks.csv").write_text("".join([*tracks, twice]))
    # the map's reconstruction is not what was adjusted
    (model / "reconstruction.json").rename(model / "reconstruction.topocentric.json")
    (model / "reconstruction.json").write_text("[]")
    degrees = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT))).out_of_block(flight.control)
    (project / "gcp_list.txt").write_text(flight.gcp_list("EPSG:4326", degrees, named=False))
    assert recognised(project).kind == "odm"
    assert recognised(model).kind == "opensfm"
    assert main(["import", str(project), "-o", str(block)]) == 0
    said = capsys.readouterr().out
    assert "topocentric.json is read" in said
    assert "doubled: 1 rays" in said
    # one ray of a point stays; one measurement of control goes
    text = (block / "image_points.csv").read_text().splitlines()
    header = text[0].split(",")
    rows = [dict(zip(header, line.split(","), strict=True)) for line in text[1:]]
    named = [row["point"] for row in rows if not row["point"].startswith("gcp")]
    point = max(set(named), key=named.count)
    mine = [row for row in rows if row["point"] == point]
    assert len(mine) > 2
    for row in mine[1:]:
        row["use"] = "off"
    control = next(row for row in rows if row["point"] == "gcp2")
    control["use"] = "off"
    lines = [",".join(row[key] for key in header) for row in rows]
    (block / "image_points.csv").write_text("\n".join([text[0], *lines]) + "\n")
    assert main(["export", "odm", str(block), "-o", str(out), "--json"]) == 0
    notes = {one["text"]: one["count"] for one in json.loads(capsys.readouterr().out)["notes"]}
    assert notes["rays that do not count, from tracks.csv"] == len(mine)  # and the doubled one
    kept = (out / "opensfm" / "tracks.csv").read_text().splitlines(keepends=True)
    gone = {f"{row['photo']}\t{point}\t" for row in mine[1:]}
    assert kept == [line for line in tracks if not any(line.startswith(one) for one in gone)]
    points = json.loads((out / "opensfm" / "reconstruction.json").read_text())[0]["points"]
    assert point not in points
    assert len(points) == 59
    listed = (out / "gcp_list.txt").read_text().splitlines()
    assert listed[:2] == ["EPSG:4326", "# a remark"]
    assert sum(line.startswith("# off: ") for line in listed) == 1
    words = [line.split()[-3:] for line in listed[2:] if not line.startswith("#")]
    assert len(words) == len(flight.control_rays) - 1
    assert {word for word, _, _ in words} <= {"good", "weak"}
    assert all(r.startswith("r_plan=0.") and z.startswith("r_height=0.") for _, r, z in words)
    # and in again: what was removed is no more, the rest is the same
    again = odm.read(out, ImportOptions()).block
    before = {(row.photo, row.point): row.measured for row in read_block(block).image_points
              if row.use != "off"}  # fmt: skip
    after = {(row.photo, row.point): row.measured for row in again.image_points}
    del before[(mine[0]["photo"], point)]
    assert after == before


def test_rays_are_found_again_by_name_when_their_pixels_are_new(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = Flight()
    project, folder, out = tmp_path / "p", tmp_path / "b", tmp_path / "out"
    flight.write(project / "opensfm")
    degrees = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT))).out_of_block(flight.control)
    listed = flight.gcp_list("EPSG:4326", degrees)
    (project / "gcp_list.txt").write_text(listed)
    tracks = (project / "opensfm" / "tracks.csv").read_text().splitlines()
    assert main(["import", str(project), "-o", str(folder)]) == 0
    csv = folder / "image_points.csv"
    head, *lines = csv.read_text().splitlines()
    keys = head.split(",")
    rows = [dict(zip(keys, line.split(","), strict=True), use="xy") for line in lines]
    first, second, third = (
        next(row for row in rows if row["point"] == point) for point in ("3", "7", "9")
    )
    first |= {"x_px": "100.5", "use": "off"}
    third["y_px"] = repr(float(third["y_px"]) + 0.25)
    rows.remove(second)
    anew = next(row for row in rows if row["point"] == "P4")
    anew["x_px"] = repr(float(anew["x_px"]) - 0.5)
    csv.write_text("\n".join([f"{head},use", *(",".join(row.values()) for row in rows)]) + "\n")
    capsys.readouterr()
    assert main(["export", "odm", str(folder), "-o", str(out), "--json"]) == 0
    notes = {one["text"]: one["count"] for one in json.loads(capsys.readouterr().out)["notes"]}
    assert notes["rays that do not count, from tracks.csv"] == 1
    assert notes["rays that are not in the block stay as they were"] == 1
    assert notes["rays measured anew: tracks.csv keeps the feature's place"] == 1
    assert notes["measurements of control anew: gcp_list.txt has the new pixels"] == 1
    gone = f"{first['photo']}\t3\t"
    kept = (out / "opensfm" / "tracks.csv").read_text().splitlines()
    assert kept == [line for line in tracks if not line.startswith(gone)]
    assert len(kept) == len(tracks) - 1
    mine = [line for line in (out / "gcp_list.txt").read_text().splitlines() if "P4" in line]
    where = [line.split()[3:5] for line in mine if f" {anew['photo']} P4" in line]
    assert where == [[anew["x_px"], anew["y_px"]]]
    assert len(mine) == sum("P4" in line for line in listed.splitlines())
    assert not any(line.startswith("# off") for line in mine)


def test_positions_measured_in_flight_are_priors_when_asked(tmp_path: Path) -> None:
    flight = Flight(noise_px=0.3)
    flight.write(tmp_path)
    model = flight.reconstruction()
    without = next(iter(model["shots"].values()))
    without |= {"gps_position": [0.0, 0.0, 0.0], "gps_dop": 999999.0}
    (tmp_path / "reconstruction.json").write_text(json.dumps([model]))
    found = _read(tmp_path, sigma_px=0.3, position_m=0.02)
    assert "assumed 11 positions measured in flight are priors" in _said(found)
    assert [photo.position_sigma for photo in found.block.photos] == [None] + 11 * [(0.02,) * 3]
    adjusted = adjust_block(found.block)
    for row in adjusted.point_rows():
        assert np.abs(np.array(row.xyz) - flight.points[int(row.point)]).max() < 0.2
    for shot in model["shots"].values():
        del shot["gps_position"]
    (tmp_path / "reconstruction.json").write_text(json.dumps([model]))
    with pytest.raises(InputError, match="no photo has a position"):
        _read(tmp_path, position_m=0.02)


def test_without_a_place_the_control_has_the_origin(tmp_path: Path) -> None:
    flight = Flight(noise_px=0.3)
    flight.write(tmp_path)
    zeros = {"latitude": 0.0, "longitude": 0.0, "altitude": 0.0}
    (tmp_path / "reference_lla.json").write_text(json.dumps(zeros))
    bare = _read(tmp_path)
    assert bare.block.ground is None
    assert "no place on earth" in _said(bare)
    degrees = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT))).out_of_block(flight.control)
    (tmp_path / "gcp_list.txt").write_text(flight.gcp_list("EPSG:4326", degrees))
    found = _read(tmp_path, sigma_px=0.3)
    assert found.block.ground is not None
    assert np.abs(np.array(found.block.ground.origin[:2]) - (LON, LAT)).max() < 1e-3
    assert all(photo.position is None for photo in found.block.photos)
    # the points lie where they are on earth, not where the model's frame has them
    adjusted = adjust_block(found.block)
    rows = {row.point: row.xyz for row in adjusted.point_rows()}
    at = GroundFrame.of(found.block.ground).out_of_block(np.array([rows["P4"]]))
    assert np.abs(at[0, :2] - degrees[4, :2]).max() < 1e-6


def test_heights_above_the_sea_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyproj")
    flight = Flight(noise_px=0.3)
    flight.write(tmp_path / "s")
    system = "EPSG:25832+7837"
    there = GroundFrame.of(local_system(system, (LON, LAT, HEIGHT)))
    text = flight.gcp_list(system, there.out_of_block(flight.control))
    (tmp_path / "s" / "gcp_list.txt").write_text(text)
    assert main(["import", "opensfm", str(tmp_path / "s"), "-o", str(tmp_path / "b")]) == 0
    said = capsys.readouterr().out
    assert "heights of DHHN2016 height are kept as they are: the geoid stays in Z" in said
    out = tmp_path / "o.geojson"
    assert main(["export", "geojson", str(tmp_path / "b"), "-o", str(out)]) == 0
    are = json.loads(out.read_text())["coordinates_are"]
    assert are.endswith("height of DHHN2016 height, not ellipsoidal [m]")


def test_control_far_from_the_images_has_the_origin(tmp_path: Path) -> None:
    """450 km away the frame's up would lean, and heights be kilometres below it."""
    flight = Flight()
    flight.write(tmp_path)
    there = GroundFrame.of(local_system("WGS84", (LON + 6.0, LAT, HEIGHT)))
    degrees = there.out_of_block(flight.control)
    (tmp_path / "gcp_list.txt").write_text(flight.gcp_list("EPSG:4326", degrees))
    found = _read(tmp_path, order="lonlat")
    assert found.block.ground is not None
    assert np.abs(np.array(found.block.ground.origin[:2]) - (LON + 6.0, LAT)).max() < 1e-2
    assert max(abs(v) for point in found.block.control for v in point.xyz) < 200.0
    assert all(photo.position is None for photo in found.block.photos)
    assert "km from the images' origin: the origin is amid the control" in _said(found)
    # one far point is no reason to give up the images' places
    degrees[:, 0] -= 6.0
    degrees[3, 0] += 2.0
    (tmp_path / "gcp_list.txt").write_text(flight.gcp_list("EPSG:4326", degrees))
    found = _read(tmp_path, order="lonlat")
    assert all(photo.position is not None for photo in found.block.photos)
    assert "assumed 1 control points up to 14" in _said(found)


def test_what_is_not_from_there_cannot_go_there(tmp_path: Path) -> None:
    flight = Flight()
    flight.write(tmp_path / "s")
    assert main(["import", "opensfm", str(tmp_path / "s"), "-o", str(tmp_path / "b")]) == 0
    (tmp_path / "b" / "source" / "tracks.csv").unlink()
    assert main(["export", "opensfm", str(tmp_path / "b"), "-o", str(tmp_path / "o")]) == 2
    assert not (tmp_path / "o").exists()


def _with(path: Path, change: Callable[[bytes], bytes]) -> None:
    path.write_bytes(change(path.read_bytes()))


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data,
        lambda data: data.replace(b"\n", b"\r\n"),
        lambda data: data.replace(b"\n", b"\r\n", 3),
        lambda data: b"\xef\xbb\xbf" + data,
        lambda data: data.rstrip(b"\n"),
        lambda data: data + b"\r\n\n",
        # blanks behind the version, and in a line of nothing else
        lambda data: data.replace(b"_v2", b"_v2 \t") + b" \n",
    ],
)
def test_nothing_changed_is_byte_for_byte(tmp_path: Path, change: Callable[[bytes], bytes]) -> None:
    flight = Flight()
    flight.write(tmp_path / "s")
    _with(tmp_path / "s" / "tracks.csv", change)
    assert main(["import", "opensfm", str(tmp_path / "s"), "-o", str(tmp_path / "b")]) == 0
    assert main(["export", "opensfm", str(tmp_path / "b"), "-o", str(tmp_path / "o")]) == 0
    for name in ("reconstruction.json", "tracks.csv", "reference_lla.json"):
        assert (tmp_path / "o" / name).read_bytes() == (tmp_path / "s" / name).read_bytes()


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_lines_that_stay_keep_their_ends(tmp_path: Path, end: str) -> None:
    flight = Flight()
    flight.write(tmp_path / "s")
    places = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT))).out_of_block(flight.control)
    listed = flight.gcp_list("WGS84", places).splitlines()
    (tmp_path / "s" / "gcp_list.txt").write_bytes(end.join(listed).encode())
    _with(tmp_path / "s" / "tracks.csv", lambda data: data.replace(b"\n", end.encode()))
    assert main(["import", "opensfm", str(tmp_path / "s"), "-o", str(tmp_path / "b")]) == 0
    _with(tmp_path / "b" / "image_points.csv", _first_and_last_off)
    assert main(["export", "opensfm", str(tmp_path / "b"), "-o", str(tmp_path / "o")]) == 0
    before = (tmp_path / "s" / "tracks.csv").read_bytes().splitlines(keepends=True)
    after = (tmp_path / "o" / "tracks.csv").read_bytes().splitlines(keepends=True)
    assert len(after) == len(before) - 1
    assert set(after) < set(before)
    control = (tmp_path / "o" / "gcp_list.txt").read_bytes().decode()
    assert control.count(end) == len(listed) - 1 == control.count("\n")
    assert control.count(f"{end}# off: ") == 1
    assert control.startswith(f"WGS84{end}# a remark{end}")


def _first_and_last_off(data: bytes) -> bytes:
    """Switch off the first and the last row of an image_points.csv: a track's and control's."""
    head, first, *rows, last = data.decode().splitlines()
    assert head.split(",")[-1] == "model"
    off = (f"{row},{'off' if row in (first, last) else ''}" for row in (first, *rows, last))
    return "\n".join((f"{head},use", *off, "")).encode()


BROKEN = {
    "nesting": ("reconstruction.json", lambda t: "[" * 10**5, "nested too deeply"),
    "objects": ("reconstruction.json", lambda t: '{"a":' * 10**5, "nested too deeply"),
    "nan": ("reconstruction.json", lambda t: t.replace('"focal_x": 0.85', '"focal_x": NaN'), "NaN"),
    "inf": ("reconstruction.json", lambda t: t.replace('": 0.85', '": -Infinity'), "Infinity"),
    "large": ("reconstruction.json", lambda t: t.replace("0.852", "1e999"), "not finite"),
    "digits": ("reconstruction.json", lambda t: t.replace("0.852", "9" * 9999), "too many digits"),
    "claims": ("reconstruction.json", lambda t: t.replace("4000,", "4000000000,"), "width: must"),
    "no key": ("reconstruction.json", lambda t: t.replace("focal_y", "fokal"), "no 'focal_y'"),
    "no camera": ("reconstruction.json", lambda t: t.replace('": "v2', '": "v3'), "no camera"),
    "kind": ("reconstruction.json", lambda t: t.replace('"shots": {', '"shots": [{'), "no JSON"),
    "number": ("reconstruction.json", lambda t: t.replace("0.852", '"x"'), "must be a number"),
    "empty": ("reconstruction.json", lambda t: "[]", "no reconstruction"),
    "cut": ("reconstruction.json", lambda t: t[: len(t) // 2], "no JSON"),
    "text": ("reconstruction.json", lambda t: '"text"', "must be a list"),
    "name": ("reconstruction.json", lambda t: t.replace("run 0", "\\u001b[2J"), "cannot be print"),
    "row": ("tracks.csv", lambda t: t.rsplit("\t", 2)[0], "fields between"),
    "version": ("tracks.csv", lambda t: t.replace("_v2", "_v9"), "0, 1 and 2 are read"),
    "place": ("tracks.csv", lambda t: t.replace("\t0\t0.", "\t0\tnan", 1), "finite number"),
    "bytes": ("tracks.csv", lambda t: "\udcff\udcfe", "not UTF-8"),
    "latitude": ("reference_lla.json", lambda t: t.replace("48.1", "98.1"), "between -90 and 90"),
    "no latitude": ("reference_lla.json", lambda t: "{}", "no 'longitude'"),
    "system": ("gcp_list.txt", lambda t: "hello\n", "no coordinate system"),
    "no ray": ("tracks.csv", lambda t: t.replace("IMG_", "XMG_"), "no ray lies in its image"),
    "no system": ("gcp_list.txt", lambda t: "# nothing\n", "no line says"),
    "short": ("gcp_list.txt", lambda t: "WGS84\n1 2 3 4 5\n", "line 2: 5 fields"),
    "gcp number": ("gcp_list.txt", lambda t: "WGS84\n1e999 2 3 4 5 a b\n", "finite number"),
    "height": (
        "gcp_list.txt", lambda t: "WGS84\n11.6 48.1 1e6 4 5 run 0/IMG_0.JPG A\n", "line 2: a hei",
    ),
    "overflow": (
        "gcp_list.txt", lambda t: "WGS84\n11.6 48.1 1e308 4 5 run 0/IMG_0.JPG A\n", "line 2: a hei",
    ),
    "too far": ("gcp_list.txt", lambda t: "WGS84\n1e300 2 3 4 5 a b\n", "line 2: a coordinate"),
    "two places": (
        "gcp_list.txt",
        lambda t: "WGS84\n11.6 48.1 3 4 5 run 0/IMG_0.JPG A\n11.6 48.2 3 4 5 run 0/IMG_1.JPG A\n",
        "line 3: point 'A' has other coordinates before$",
    ),
    "blank": (
        "gcp_list.txt",
        lambda t: "WGS84\n1 2 3 4 5 run 0/IMG_0.JPG A 1\n1 3 3 4 5 run 0/IMG_1.JPG A 2\n",
        "before; a name ends at a blank$",
    ),
    "gcp name": (
        "gcp_list.txt", lambda t: "WGS84\n1 2 3 4 5 run 0/IMG_0.JPG \x1b[2J\n", "cannot be printed",
    ),
    "off earth": (
        "gcp_list.txt", lambda t: "WGS84\n950 480 3 4 5 run 0/IMG_0.JPG A\n", "is no place",
    ),
}  # fmt: skip


@pytest.mark.parametrize("damage", BROKEN)
def test_damage_is_one_line(tmp_path: Path, damage: str) -> None:
    name, broken, message = BROKEN[damage]
    Flight().write(tmp_path)
    path = tmp_path / name
    text = path.read_text() if path.exists() else ""
    path.write_bytes(broken(text).encode(errors="surrogateescape"))
    assert path.read_bytes() != text.encode()
    with pytest.raises(InputError, match=message) as caught:
        _read(tmp_path)
    said = str(caught.value)
    assert name in said
    assert said.isprintable()
    assert len(said) < 500


def test_any_cut_of_a_file_is_told_or_read(tmp_path: Path) -> None:
    flight = Flight()
    flight.write(tmp_path)
    text = (tmp_path / "reconstruction.json").read_text()
    for k in range(0, len(text) - 1, len(text) // 40):
        (tmp_path / "reconstruction.json").write_text(text[:k])
        with pytest.raises(InputError):
            _read(tmp_path)
