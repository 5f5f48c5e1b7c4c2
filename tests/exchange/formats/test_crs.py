"""Ground coordinates between a person's system and a block's frame: there and back."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import format_block_toml, parse_block_toml
from anaplot.exchange.formats.crs import CoordinateSystem, GroundFrame, crs_text, local_system
from anaplot.photogrammetry.block import Block, Camera, Photo, Precision, TestSettings
from anaplot.photogrammetry.ellipsoid import WGS84, Ellipsoid, LocalFrame, geocentric, geodetic
from anaplot.photogrammetry.groundsystem import GroundSystem

# a place of each system in degrees; a north and a south, grads and feet, an oblique map, a pole
PLACES = {
    "EPSG:4326": (11.6, 48.1, 520.0),
    "EPSG:25832": (11.6, 48.1, 520.0),
    "EPSG:31467": (9.2, 48.8, 300.0),
    "EPSG:2056": (8.5, 47.4, 400.0),
    "EPSG:27700": (-1.5, 53.0, 80.0),
    "EPSG:2193": (174.8, -41.3, 20.0),
    "EPSG:27572": (2.3, 48.85, 60.0),
    "EPSG:2263": (-74.0, 40.7, 10.0),
    "EPSG:3031": (30.0, -80.0, 2500.0),
    "EPSG:5514": (14.4, 50.1, 200.0),
    "EPSG:4978": (100.0, 15.0, 0.0),
    "EPSG:25832+7837": (11.6, 48.1, 520.0),
    "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs": (11.6, 48.1, 520.0),
}


@pytest.mark.parametrize("crs", PLACES)
def test_there_and_back_is_exact(crs: str) -> None:
    if crs != "EPSG:4326":
        pytest.importorskip("pyproj")
    frame = GroundFrame.of(local_system(crs, PLACES[crs]))
    rng = np.random.default_rng(7)
    local = rng.uniform(-3000.0, 3000.0, (40, 3))
    theirs = frame.out_of_block(local)
    assert np.abs(frame.into_block(theirs) - local).max() < 1e-6
    assert np.abs(frame.out_of_block(frame.into_block(theirs)) - theirs).max() < 1e-6
    # near the origin, and as far from it as said; a datum moves the origin, not the frame
    degrees = frame.degrees(np.zeros((1, 3)))[0]
    assert np.abs(degrees[:2] - PLACES[crs][:2]).max() < 1e-6


def test_up_is_up_and_distances_stay() -> None:
    local = LocalFrame.at(11.6, 48.1, 520.0, WGS84)
    assert np.allclose(local.axes @ local.axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(local.axes) == pytest.approx(1.0)
    rng = np.random.default_rng(3)
    places = rng.uniform(-2000.0, 2000.0, (20, 3))
    there = local.geocentric(places)
    assert np.allclose(np.linalg.norm(np.diff(there, axis=0), axis=1),
                       np.linalg.norm(np.diff(places, axis=0), axis=1), atol=1e-8)  # fmt: skip
    # one metre up is one metre more height; a place on the plane lies above the ellipsoid
    lon, lat, height = geodetic(local.geocentric(np.array([[0.0, 0.0, 1.0]])), WGS84)[0]
    assert np.degrees((lon, lat)) == pytest.approx((11.6, 48.1), abs=1e-12)
    assert height == pytest.approx(521.0, abs=1e-8)
    above = geodetic(local.geocentric(np.array([[1000.0, 0.0, 0.0]])), WGS84)[0, 2]
    assert above - 520.0 == pytest.approx(1000.0**2 / 2 / 6.39e6, rel=0.01)


@pytest.mark.parametrize("ellipsoid", [WGS84, Ellipsoid(6378137.0, 0.0)])
def test_geodetic_undoes_geocentric_also_at_the_poles(ellipsoid: Ellipsoid) -> None:
    lon, lat, height = np.meshgrid(
        np.radians([-179.9, -20.0, 0.0, 100.0]),
        np.radians([-90.0, -89.9999, -45.0, 0.0, 1e-9, 60.0, 90.0]),
        [-100.0, 0.0, 9000.0],
    )
    places = np.stack((lon.ravel(), lat.ravel(), height.ravel()), axis=1)
    xyz = geocentric(places, ellipsoid)
    assert np.abs(geocentric(geodetic(xyz, ellipsoid), ellipsoid) - xyz).max() < 3e-9


def test_agrees_with_pyprojs_own_topocentric_system() -> None:
    pyproj = pytest.importorskip("pyproj")
    turn = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=GRS80 "
        "+step +proj=topocentric +ellps=GRS80 +lon_0=9.1 +lat_0=48.2 +h_0=300"
    )
    system = GroundSystem("EPSG:25832", "local", (9.1, 48.2, 300.0))
    utm = pyproj.Transformer.from_crs(4258, 25832, always_xy=True)
    lon, lat, h = np.array([9.11, 9.05]), np.array([48.21, 48.19]), np.array([250.0, 900.0])
    e, n = utm.transform(lon, lat)
    found = GroundFrame.of(system).into_block(np.stack((e, n, h), axis=1))
    assert np.abs(found - np.stack(turn.transform(lon, lat, h), axis=1)).max() < 1e-6


def test_an_offset_needs_a_map_in_metres() -> None:
    pytest.importorskip("pyproj")
    frame = GroundFrame.of(GroundSystem("EPSG:25832", "offset", (500000.0, 5300000.0, 100.0)))
    xyz = np.array([[500123.25, 5300010.5, 130.0]])
    assert frame.into_block(xyz).tolist() == [[123.25, 10.5, 30.0]]
    assert frame.out_of_block(frame.into_block(xyz)).tolist() == xyz.tolist()
    lon, lat, h = frame.degrees(np.array([[0.0, 0.0, 0.0]]))[0]
    assert (lon, h) == pytest.approx((9.0, 100.0))
    assert 47.0 < lat < 48.5
    for crs in ("EPSG:4326", "EPSG:2263", "EPSG:5513"):
        with pytest.raises(InputError, match="frame must be local"):
            GroundFrame.of(GroundSystem(crs, "offset", (0.0, 0.0, 0.0)))


def test_names_of_systems() -> None:
    pytest.importorskip("pyproj")
    assert crs_text("WGS84 UTM 32N") == "EPSG:32632"
    assert crs_text(" wgs84  utm 7 s ") == "EPSG:32707"
    assert crs_text("WGS84") == "EPSG:4326"
    assert CoordinateSystem.of("EPSG:4326").units() == ("deg", "m")
    assert CoordinateSystem.of("EPSG:25832+7837").units() == ("m", "m")
    assert CoordinateSystem.of("EPSG:2263+6360").units() == ("us-ft", "us-ft")
    assert crs_text("epsg:25832") == "EPSG:25832"
    assert crs_text("EPSG 32632") == crs_text("EPSG: 32632") == "EPSG:32632"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("WGS84 UTM 61N", "zones 1 to 60"),
        ("+proj=utm +nadgrids=own.gsb", "nadgrids is not read"),
        ("+proj=utm +nadgrids=/etc/passwd", "no coordinate system"),
        ("+proj=utm +init=epsg:1", "no coordinate system"),
        ("+proj=pipeline +step +proj=utm", "step is not read"),
        ("/etc/passwd", "no coordinate system"),
        ("https://epsg.io/25832", "no coordinate system"),
        ("urn:ogc:def:crs:EPSG::4326", "no coordinate system"),
        ("", "no coordinate system"),
        ("+proj=utm \x1b[2J", "no coordinate system"),
        ("+" + "a" * 10**6, "more than 255"),
    ],
)
def test_what_is_no_system_is_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        crs_text(text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("text", ["EPSG:999999", "EPSG:5783", "+proj=nonsense"])
def test_what_pyproj_does_not_know_is_one_line(text: str) -> None:
    pytest.importorskip("pyproj")
    with pytest.raises(InputError) as caught:
        CoordinateSystem.of(text)
    assert str(caught.value).isprintable()


def test_places_outside_of_a_map_are_refused() -> None:
    pytest.importorskip("pyproj")
    with pytest.raises(InputError, match="is no place in"):
        CoordinateSystem.of("EPSG:25832").geocentric(np.array([[1e30, 1e30, 0.0]]))
    with pytest.raises(InputError, match="is no place in"):
        CoordinateSystem.of("EPSG:4326").geocentric(np.array([[48.0, 91.0, 0.0]]))


def test_without_pyproj_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(InputError, match=r"pip install 'anaplot\[crs\]'"):
        CoordinateSystem.of("EPSG:25833")
    # degrees need none
    assert local_system("WGS84", (1.0, 2.0, 3.0)).origin == (1.0, 2.0, 3.0)


def test_no_network_is_asked() -> None:
    network = pytest.importorskip("pyproj.network")
    CoordinateSystem.of("EPSG:25832")
    assert not network.is_network_enabled()


def test_block_toml_holds_it() -> None:
    block = Block(
        "b", Precision(), TestSettings(), (Camera("c", 1.0),), (Photo("1", "c"),), (),
        ground=GroundSystem("EPSG:25832", "local", (11.600000000000001, 48.1, 520.25)),
    )  # fmt: skip
    text = format_block_toml(block)
    assert parse_block_toml(text, Path("block.toml")) == block
    assert "[ground]" not in format_block_toml(replace(block, ground=None))
    for old, new, message in (
        ('frame = "local"', 'frame = "here"', 'must be "local" or "offset"'),
        ("48.1", "98.1", "is a latitude"),
        ('crs = "EPSG:25832"\n', "", "crs"),
        ("520.25]", "520.25, 1.0]", "origin"),
    ):
        with pytest.raises(InputError, match=message):
            parse_block_toml(text.replace(old, new), Path("block.toml"))
