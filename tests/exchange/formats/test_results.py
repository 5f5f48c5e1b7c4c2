"""Results out: GeoJSON, CSV and Parquet say what the adjustment says, in the person's system."""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from opensfmmodels import HEIGHT, LAT, LON, Flight

from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.formats.crs import GroundFrame, local_system
from anaplot.exchange.formats.geojson import standard_ellipse
from anaplot.report.exportresult import adjusted_result


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block with control in degrees; a point's name has what CSV and JSON quote."""
    folder = tmp_path_factory.mktemp("results")
    flight = Flight(noise_px=0.3)
    flight.write(folder / "model")
    degrees = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT))).out_of_block(flight.control)
    text = flight.gcp_list("EPSG:4326", degrees).replace(" P1 ", ' a"b,ö ')
    (folder / "model" / "gcp_list.txt").write_text(text)
    source, out = str(folder / "model"), str(folder / "block")
    assert main(["import", "opensfm", source, "--sigma-px", "0.3", "-o", out]) == 0
    return folder / "block"


def _local(block: Path, to: Path) -> Path:
    """Copy a block without its coordinate system."""
    to.mkdir()
    for name in ("image_points.csv", "control.csv"):
        (to / name).write_bytes((block / name).read_bytes())
    text = (block / "block.toml").read_text()
    start, end = text.index("\n[ground]"), text.index("\n[[camera]]")
    (to / "block.toml").write_text(text[:start] + text[end:])
    return to


def _valid(answer: dict[str, Any], world: bool) -> None:
    """What RFC 7946 asks for."""
    assert answer["type"] == "FeatureCollection"
    assert "crs" not in answer
    for feature in answer["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        assert feature["type"] == "Feature"
        geometry = feature["geometry"]
        assert set(geometry) == {"type", "coordinates"}
        places = [geometry["coordinates"]]
        if geometry["type"] == "Polygon":
            (ring,) = geometry["coordinates"]
            assert len(ring) >= 4
            assert ring[0] == ring[-1]
            x, y = np.array(ring)[:, :2].T - np.array(ring)[0, :2, None]
            assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0.0  # counterclockwise
            places = ring
        else:
            assert geometry["type"] == "Point"
        for place in places:
            assert len(place) == 3
            assert all(isinstance(v, float) and math.isfinite(v) for v in place)
            if world:
                assert abs(place[0]) <= 180.0
                assert abs(place[1]) <= 90.0


def test_geojson_has_places_ellipses_and_verdicts(
    block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "o.geojson"
    assert main(["export", "geojson", str(block), "-o", str(out), "--ellipses", "1000"]) == 0
    assert "1000 times as large" in capsys.readouterr().out

    def refuse(word: str) -> None:
        raise AssertionError(word)

    answer = json.loads(out.read_text(), parse_constant=refuse)
    _valid(answer, world=True)
    found = adjusted_result(read_block(block))
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for feature in answer["features"]:
        by_kind.setdefault(feature["properties"]["kind"], []).append(feature)
    assert {kind: len(some) for kind, some in by_kind.items()} == {
        "photo": 12, "point": 66, "ellipse": 66,
    }  # fmt: skip
    frame = GroundFrame.of(local_system("WGS84", (LON, LAT, HEIGHT)))
    for one, feature in zip(found.points, by_kind["point"], strict=True):
        lon, lat, h = frame.degrees(np.array([one.xyz]))[0].tolist()
        assert feature["geometry"]["coordinates"] == pytest.approx([lon, lat, h], abs=1e-6)
        said = feature["properties"]
        assert said["name"] == one.point
        plan = np.array(one.covariance)[:2, :2]
        # the ellipse has the covariance's area and trace, and its long axis varies most
        a, b, t = (
            said["ellipse_a_m"],
            said["ellipse_b_m"],
            math.radians(said["ellipse_azimuth_deg"]),
        )
        assert a * b == pytest.approx(math.sqrt(np.linalg.det(plan)))
        along = np.array([math.sin(t), math.cos(t)])
        assert along @ plan @ along == pytest.approx(a * a)
        assert said["sigma_height_m"] == pytest.approx(math.sqrt(one.covariance[2][2]))
        assert said["verdict"] in ("good", "weak", "look", "unchecked")
    control = [one for one in by_kind["point"] if one["properties"]["use"] == "control"]
    assert {one["properties"]["name"] for one in control} >= {'a"b,ö', "P0"}
    # the drawn ellipse reaches its semi-axis, enlarged
    ring = np.array(by_kind["ellipse"][0]["geometry"]["coordinates"][0])
    places = frame.into_block(ring) - np.array(found.points[0].xyz)
    reach = np.linalg.norm(places[:, :2], axis=1).max()
    assert reach == pytest.approx(1000 * by_kind["point"][0]["properties"]["ellipse_a_m"], rel=1e-6)


@pytest.mark.parametrize(
    ("covariance", "azimuth"),
    [
        ([[1.0, 0.0], [0.0, 4.0]], 0.0),
        ([[4.0, 0.0], [0.0, 1.0]], 90.0),
        ([[2.0, 1.0], [1.0, 2.0]], 45.0),
        ([[2.0, -1.0], [-1.0, 2.0]], 135.0),
    ],
)
def test_azimuths_count_clockwise_from_north(covariance: list[list[float]], azimuth: float) -> None:
    found = standard_ellipse(covariance)
    assert found.azimuth == pytest.approx(azimuth)
    assert found.a >= found.b


@pytest.mark.slow
def test_ellipses_are_cut_at_the_180th_meridian(
    block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there = tmp_path / "b"
    _local(block, there)
    toml = there / "block.toml"
    text = toml.read_text()
    ground = '\n[ground]\ncrs = "{}"\nframe = "local"\norigin = [{}, -17.0, 30.0]\n'
    areas = []
    for k, longitude in enumerate((180.0, 178.0)):
        toml.write_text(text + ground.format("EPSG:4326", longitude))
        out = tmp_path / f"{k}.geojson"
        assert main(["export", "geojson", str(there), "-o", str(out), "--ellipses", "5000"]) == 0
        answer = json.loads(out.read_text())
        area = {}
        several = 0
        for feature in answer["features"]:
            geometry = feature["geometry"]
            if geometry["type"] == "Point":
                continue
            parts = geometry["coordinates"]
            if geometry["type"] == "Polygon":
                parts = [parts]
            several += len(parts) > 1
            total = 0.0
            for (ring,) in parts:
                assert ring[0] == ring[-1]
                x, y = np.array(ring)[:, :2].T
                assert np.abs(x).max() <= 180.0
                assert np.ptp(x) < 0.1
                x, y = x - x[0], y - y[0]
                part = 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])
                assert part > 0.0  # counterclockwise
                total += part
            area[feature["properties"]["name"]] = total
        assert (several > 5) == (k == 0)
        areas.append(area)
    assert areas[0] == pytest.approx(areas[1], rel=1e-6)
    toml.write_text(text + ground.format("hello", 0))
    for kind in ("geojson", "csv"):
        capsys.readouterr()
        assert main(["export", kind, str(there), "-o", str(tmp_path / "no")]) == 2
        said = capsys.readouterr().err
        assert "block.toml: [ground]: no coordinate system 'hello'" in said


def test_local_coordinates_are_no_degrees_and_say_so(
    block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    local, out = _local(block, tmp_path / "local"), tmp_path / "o.json"
    assert main(["export", "geojson", str(local), "-o", str(out)]) == 0
    assert "against RFC 7946" in capsys.readouterr().out
    answer = json.loads(out.read_text())
    _valid(answer, world=False)
    assert "no WGS84" in answer["coordinates_are"]
    one = answer["features"][0]
    assert one["geometry"]["coordinates"][0] == pytest.approx(one["properties"]["X"], abs=1e-6)


@pytest.mark.slow
def test_csv_is_what_adjust_writes_and_theirs(block: Path, tmp_path: Path) -> None:
    assert main(["export", "csv", str(block), "-o", str(tmp_path / "out")]) == 0
    assert main(["adjust", str(block), "--to", str(tmp_path / "to")]) == 0
    for name in ("photos", "points", "image_points", "control"):
        with (tmp_path / "out" / f"{name}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        with (tmp_path / "to" / f"{name}.csv").open(newline="") as file:
            ours = list(csv.DictReader(file))
        assert len(rows) == len(ours) > 0
        assert set(ours[0]) <= set(rows[0])
        for row, mine in zip(rows, ours, strict=True):
            assert {key: row[key] for key in mine} == mine
    with (tmp_path / "out" / "points.csv").open(newline="") as file:
        points = {row["point"]: row for row in csv.DictReader(file)}
    lon, lat = float(points['a"b,ö']["crs_x"]), float(points['a"b,ö']["crs_y"])
    assert (lon, lat) == pytest.approx((LON, LAT), abs=0.01)
    assert lon != LON


@pytest.mark.slow
def test_parquet_is_read_back_with_its_types(block: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert main(["export", "parquet", str(block), "-o", str(tmp_path / "p")]) == 0
    assert main(["export", "csv", str(block), "-o", str(tmp_path / "c")]) == 0
    for path in sorted((tmp_path / "c").iterdir()):
        found = parquet.read_table(tmp_path / "p" / f"{path.stem}.parquet")
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert found.column_names == list(rows[0])
        for name in found.column_names:
            for value, text in zip(found.column(name).to_pylist(), rows, strict=True):
                if value is None:
                    assert text[name] == ""
                elif isinstance(value, bool):
                    assert text[name] == str(int(value))
                elif isinstance(value, float):
                    assert float(text[name]) == value
                else:
                    assert text[name] == str(value)
    points = parquet.read_table(tmp_path / "p" / "points.parquet")
    types = {field.name: str(field.type) for field in points.schema}
    assert (types["point"], types["X"], types["rays"]) == ("string", "double", "int64")
    assert points.schema.field("X").metadata == {b"unit": b"m"}
    rays = parquet.read_table(tmp_path / "p" / "image_points.parquet").schema
    for name in ("vx_um", "vy_um", "mdb_x_um", "mdb_y_um"):
        assert rays.field(name).metadata == {b"unit": b"um"}
    units = {name: points.schema.field(f"crs_{name}").metadata[b"unit"] for name in "xyz"}
    assert units == {"x": b"deg", "y": b"deg", "z": b"m"}
    assert str(rays.field("flagged").type) == "bool"
    assert str(rays.field("model").type) == "string"  # although nothing stands there


def test_without_pyarrow_it_says_what_to_install(
    block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["export", "parquet", str(block), "-o", str(tmp_path / "p")]) == 2
    assert "pip install 'anaplot[parquet]'" in capsys.readouterr().err
    assert not (tmp_path / "p").exists()


def test_what_is_written_only_cannot_come_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x").write_text("{}")
    assert main(["import", "geojson", str(tmp_path / "x"), "-o", str(tmp_path / "b")]) == 2
    assert "is written only" in capsys.readouterr().err
    assert main(["export", "csv", str(tmp_path), "-o", "y", "--ellipses", "2"]) == 2
    assert "--ellipses: csv has no use for it" in capsys.readouterr().err


def test_what_is_known_of_points_holds_what_is_written(block: Path, tmp_path: Path) -> None:
    folder = _local(block, tmp_path / "b")
    rows = [
        ",".join((row.point, *map(repr, row.xyz)))
        for row in read_block(folder).control[1:]
        if "," not in row.point
    ]
    known = [f"{row},.5,.5,.5,prior" for row in rows]
    (folder / "control.csv").write_text("\n".join(("point,X,Y,Z,sX,sY,sZ,use", *known, "")))
    assert len(read_block(folder).priors) >= 3
    assert main(["adjust", str(folder), "--to", str(tmp_path / "adjusted")]) == 0
    assert main(["export", "csv", str(folder), "-o", str(tmp_path / "written")]) == 0
    for name in ("points.csv", "photos.csv"):
        ours, theirs = ((tmp_path / d / name).read_text() for d in ("adjusted", "written"))
        assert theirs.splitlines() == ours.splitlines()
