"""Planned networks: the cube of 1978, networks from files, what is refused."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.bundle.adjust import adjust_block
from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block
from anaplot.photogrammetry.block import Camera
from anaplot.planning.idealblock import ExposureStation
from anaplot.planning.networkplan import (
    CUBE_VERSIONS,
    Network,
    cube,
    looking_at,
    plan_network,
)
from anaplot.planning.plannedreliability import photo_reliability, point_reliability

# n, u, r, AI X Y Z all [mm] for 1 um, RI x' y' (1978, Table 2, as worked out)
TABLE_2 = {
    "A": (108, 69, 39, (0.257, 1.286, 0.258, 0.600), (0.19, 0.53)),
    "B": (108, 69, 39, (0.098, 0.287, 0.104, 0.163), (0.20, 0.52)),
    "C": (162, 75, 87, (0.085, 0.282, 0.090, 0.153), (0.43, 0.646)),
    "D": (216, 81, 135, (0.182, 0.907, 0.182, 0.423), (0.62, 0.62)),
    "E": (216, 81, 135, (0.071, 0.200, 0.071, 0.114), (0.62, 0.62)),
}


@pytest.mark.parametrize("version", CUBE_VERSIONS)
def test_table_2_of_1978_by_the_command(version: str, capsys) -> None:
    call = ["plan", "network", "cube", "--case", version, "--image-um", "1", "--json"]
    assert main(call) == 0
    answer = json.loads(capsys.readouterr().out)
    n, u, r, ai, ri = TABLE_2[version]
    assert [answer[key] for key in ("observations", "unknowns", "redundancy")] == [n, u, r]
    got = answer["indicators"]
    found = [1e3 * got[f"ai{axis}"] for axis in ("_x", "_y", "_z", "")]
    np.testing.assert_allclose(found, ai, atol=0.00051)
    np.testing.assert_allclose([got["ri_x"], got["ri_y"]], ri, atol=0.01)
    assert set(answer["rays"].values()) == {len(CUBE_VERSIONS[version])}


def test_correlations_and_detectable_errors_of_a_point(capsys) -> None:
    assert main(["plan", "network", "cube", "--case", "C", "--point", "2", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    at = {(c["photo"], c["axis"]): k for k, c in enumerate(answer["point"]["coordinates"])}
    rho = answer["point"]["correlations"]
    three, zero, four = at["3", "x"], at["0", "x"], at["4", "x"]
    assert rho[three][zero] == pytest.approx(-0.960, abs=5e-4)
    assert rho[three][four] == pytest.approx(0.956, abs=5e-4)
    assert any(c["point"] == "2" for c in answer["correlations"])
    # Table 3, C: 48.5 um for x of point 2 (sqrt(lambda0) rounded up to 4.14)
    block = plan_network(cube("C")).evaluated()
    row = next(row for row in block.ray_rows() if (row.photo, row.point) == ("3", "2"))
    assert row.xy[0].mdb * 4.14 / block.test.delta0 == pytest.approx(48.5, abs=0.1)


def test_spurs_of_two_parallel_photos_are_named(capsys) -> None:
    assert main(["plan", "network", "cube", "--case", "A"]) == 0
    out = capsys.readouterr().out
    assert "SPUR OBSERVATIONS: next to nothing checks these 38" in out
    # the corners are control
    assert "  2 photos: 2, 4, 5, 6, 8, 10" in out
    assert max(len(line) for line in out.splitlines()) <= 80


def test_reports_keep_to_a_page(tmp_path: Path, capsys) -> None:
    path = tmp_path / "pier.toml"
    text = network(9).replace('"s1"', '"a-rather-long-name-of-a-station-1"')
    path.write_text(text.replace('"p2"', '"a-rather-long-name-of-a-point-2"'))
    for call in (
        ["cube", "--case", "E", "--point", "2"],
        ["cube", "--image-um", "1e6"],
        [str(path), "--correlations", "0.99", "--point", "a-rather-long-name-of-a-point-2"],
    ):
        assert main(["plan", "network", *call]) == 0
        lines = capsys.readouterr().out.splitlines()
        correlated = next(k for k, line in enumerate(lines) if line.startswith("CORRELATED"))
        assert max(map(len, lines[:correlated])) <= 80
    assert any("a-ra...t-2" in line for line in lines)
    assert any("a-ra...n-1" in line for line in lines)


def test_the_correlations_of_a_point_in_many_photos_are_all_there(tmp_path: Path, capsys) -> None:
    path = tmp_path / "pier.toml"
    path.write_text(network(9).replace("normal", "# normal"))
    assert main(["plan", "network", str(path), "--point", "p2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    table = lines[next(k for k, line in enumerate(lines) if line.startswith("POINT p2:")) + 1 :]
    assert max(map(len, table)) <= 80
    rows: dict[str, list[str]] = {}
    for line in table:
        photo, axis, *values = line.split()
        if values[0][-1].isdigit() and "." in values[0]:
            rows.setdefault(f"{photo} {axis}", []).extend(values)
    assert len(rows) == 18
    # 18 correlations and the smallest detectable error
    assert {len(values) for values in rows.values()} == {19}
    assert [values[k] for k, values in enumerate(rows.values())] == ["1.000"] * 18


OPEN = """[[station]]
id = "away"
camera = "cam"
position = [12.0, 1.0, 2.0]
look_at = [30.0, 0.0, 3.0]
[[point]]
id = "lone"
position = [-40.0, 2.0, 900.0]
normal = [0.0, 0.0, 1.0]
[[point]]
id = "hidden"
position = [900.0, 0.0, 0.0]
control = 0.01
"""


def test_what_is_left_open_is_said(tmp_path: Path, capsys) -> None:
    path = tmp_path / "pier.toml"
    path.write_text(network() + OPEN)
    assert main(["plan", "network", str(path)]) == 0
    out = capsys.readouterr().out
    assert "lone (no photos)" in out[out.index("NOT DETERMINED: ") : out.index("STATIONS WITH")]
    assert "STATIONS WITHOUT USABLE RAYS: away" in out
    assert "CONTROL WITHOUT USABLE RAYS: hidden" in out
    assert main(["plan", "network", str(path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    left_open = set(answer["new_points"]["not_determined"])
    assert "lone" in left_open
    assert all(answer["rays"][name] < 2 for name in left_open)
    assert not left_open & {p["name"] for p in answer["points"]}
    assert answer["unused_photos"] == ["away"]
    assert answer["unused_control"] == ["hidden"]
    new = [p for p in answer["points"] if p["name"] not in ("p1", "p3", "p5", "p7", "p25", "p27",
                                                            "p29", "p31")]  # fmt: skip
    assert answer["new_points"]["determined"] == len(new)
    mean = np.mean([p["s_m"] for p in new], axis=0)
    np.testing.assert_allclose(answer["new_points"]["mean_s_m"], [*mean, mean.mean()])


def test_a_point_without_photos_is_not_among_those_seen_often(tmp_path: Path, capsys) -> None:
    path = tmp_path / "pier.toml"
    text = network(12).replace("normal", "# normal")
    every = "every new point is seen in 3 photos or more"
    for lone, said in (("", every), (OPEN, every.replace("every", "every other"))):
        path.write_text(text + lone)
        assert main(["plan", "network", str(path)]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert [line for line in lines if "new point is seen" in line] == [said]
        assert any("NOT DETERMINED: 1 new point" in line for line in lines) == bool(lone)


def test_without_a_new_point_the_accuracy_is_that_of_control(tmp_path: Path, capsys) -> None:
    one, _, points = network(1).partition("[[point]]")
    points = ("[[point]]" + points).replace("control = 0.0005\n", "")
    free = [part for part in points.split("[[point]]") if part]
    text = one + "".join(
        "[[point]]" + part + ("" if k == 20 else "control = 0.0\n") for k, part in enumerate(free)
    ).replace("normal", "# normal")
    path = tmp_path / "single.toml"
    path.write_text(text)
    assert main(["plan", "network", str(path)]) == 0
    out = capsys.readouterr().out
    zero = "X 0.000   Y 0.000   Z 0.000   all 0.000 mm"
    assert f"AI (mean deviation)  {zero}\n  new points (0)     -\n" in out
    assert "NOT DETERMINED: 1 new point\n  p21 (1 photo)" in out
    assert "SEEN IN FEWER" not in out
    assert main(["plan", "network", str(path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["indicators"]["ai"] == 0.0
    assert answer["indicators"]["ri"] > 0.0
    assert answer["new_points"]["mean_s_m"] is None
    assert main(["plan", "network", str(path), "--point", "p21"]) == 2
    assert "point 'p21' is not determined in this network" in capsys.readouterr().err


def test_the_accuracy_of_control_free_of_error_is_that_of_the_written_block(
    tmp_path: Path, capsys
) -> None:
    path, folder = tmp_path / "control.toml", tmp_path / "folder"
    text = network(3).replace("control = 0.0005\n", "")
    text = re.sub(r"normal = .*\n", "control = 0.0\n", text)
    path.write_text(text)
    assert main(["plan", "network", str(path), "--json", "--to", str(folder)]) == 0
    planned = json.loads(capsys.readouterr().out)["indicators"]
    assert main(["adjust", str(folder), "--json"]) == 0
    adjusted = json.loads(capsys.readouterr().out)["indicators"]
    for name in ("AI_X", "AI_Y", "AI_Z", "AI"):
        assert planned[name.lower()] == adjusted[name] == 0.0


def test_worth_is_sorted_and_true() -> None:
    block = plan_network(cube("B")).evaluated()
    r = {(row.photo, row.point): [one.r for one in row.xy] for row in block.ray_rows()}
    points, photos = point_reliability(block), photo_reliability(block)
    for found in (points, photos):
        assert np.all(np.diff([worth.low_r for worth in found]) > -1e-8)
    for worth in points:
        mine = [values for (_, point), values in r.items() if point == worth.name]
        assert worth.low_r == pytest.approx(max(min(map(min, mine)), 0.0), abs=1e-12)
        assert worth.mean_r == pytest.approx(np.mean(mine))
        at = r[worth.weakest, worth.name]["xy".index(worth.axis)]
        assert worth.low_r == pytest.approx(max(at, 0.0), abs=1e-12)
    assert {worth.name for worth in photos} == set(CUBE_VERSIONS["B"])


@given(
    st.tuples(*[st.floats(-50, 50)] * 3),
    st.tuples(*[st.floats(-50, 50)] * 3),
    st.floats(-3, 3),
)
def test_a_camera_looks_at_its_target(centre, target, roll) -> None:
    off = np.subtract(target, centre)
    if np.linalg.norm(off) < 1e-3:
        return
    rotation = looking_at(centre, target, roll)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(-rotation[:, 2], off / np.linalg.norm(off), atol=1e-9)
    level = looking_at(centre, target)
    # straight up and down y' decides, and x' is level only as nearly as the axis is plumb
    plumb = abs(level[2, 2]) >= 1.0 - 1e-9
    assert level[2, 0] == pytest.approx(0.0, abs=5e-5 if plumb else 1e-9)


NETWORK = """format = 1
name = "pier"
image_um = 3.0
[[camera]]
id = "cam"
c = 50.0
format = [60.0, 60.0]
"""


def network(stations: int = 5) -> str:
    lines = [NETWORK]
    for k in range(stations):
        angle = 2.0 * np.pi * k / stations
        x, y = 12.0 * np.cos(angle), 12.0 * np.sin(angle)
        lines.append(
            f'[[station]]\nid = "s{k}"\ncamera = "cam"\nposition = [{x:.4f}, {y:.4f}, '
            f"{6.0 if k % 2 else 2.0}]\nlook_at = [0.0, 0.0, 3.0]\n"
            + ("roll = 90.0\n" if k == 1 else "")
        )
    number = 0
    for z in (0.0, 2.0, 4.0, 6.0):
        for k in range(8):
            angle = 2.0 * np.pi * (k + z / 20.0) / 8.0
            number += 1
            x, y = 2.0 * np.cos(angle), 2.0 * np.sin(angle)
            control = "control = 0.0005\n" if z in (0.0, 6.0) and k % 2 == 0 else ""
            lines.append(
                f'[[point]]\nid = "p{number}"\nposition = [{x:.4f}, {y:.4f}, {z}]\n'
                f"normal = [{x:.4f}, {y:.4f}, 0.0]\n{control}"
            )
    return "".join(lines)


def test_a_network_from_a_file(tmp_path: Path, capsys) -> None:
    path, folder, table = tmp_path / "pier.toml", tmp_path / "block", tmp_path / "worth.csv"
    path.write_text(network())
    call = ["plan", "network", str(path), "--json", "--to", str(folder), "--csv", str(table)]
    assert main(call) == 0
    answer = json.loads(capsys.readouterr().out)
    # nobody sees through the pier
    assert 0 < max(answer["rays"].values()) < 5
    assert answer["name"] == "pier"
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["kind"] for row in rows} == {"point", "photo"}
    block = adjust_block(read_block(folder))
    assert block.redundancy == answer["redundancy"]
    assert block.indicators().ai == pytest.approx(answer["indicators"]["ai"], rel=1e-6)
    # more stations see more and determine better
    path.write_text(network(9))
    assert main(["plan", "network", str(path), "--json"]) == 0
    better = json.loads(capsys.readouterr().out)
    assert better["indicators"]["ai"] < answer["indicators"]["ai"]
    assert better["indicators"]["ri"] > answer["indicators"]["ri"]


def test_a_point_is_seen_along_the_shortest_ray() -> None:
    corner = np.zeros(3)
    near = {"near": np.array([0.0, 0.0, -1e-200]), "behind": np.array([0.0, 0.0, -2e-200])}
    normals = {"near": np.array([0.0, 0.0, 1.0]), "behind": np.array([0.0, 0.0, -1.0])}
    stations = {"s": ExposureStation(corner, np.eye(3), "cam")}
    made = plan_network(Network("n", (Camera("cam", 50.0),), stations, near, normals=normals))
    assert [row.point for row in made.block.image_points] == ["near"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("look_at = [0.0, 0.0, 3.0]\n", "", "a station has either rotation or look_at"),
        ('camera = "cam"', 'camera = "can"', "[[station]] camera: unknown camera 'can'"),
        ('id = "p2"', 'id = "p1"', "point 'p1' twice"),
        ('id = "s1"', 'id = "s0"', "station 's0' twice"),
        ("normal = [2.0000, 0.0000, 0.0]", "normal = [0.0, 0.0, 0.0]", "normal: no direction"),
        (
            "image_um = 3.0",
            "image_um = 3.0\nincidence = 95.0",
            "must lie between 0.001 and 90, not 95",
        ),
        ("look_at = [0.0, 0.0, 3.0]", "look_at = [12.0, 0.0, 2.0]", "is the station itself"),
        ("position = [2.0000,", "position = [2e9,", "position: must lie between"),
        ('name = "pier"', 'name = "pier"\ncolour = 1', "colour"),
    ],
)
def test_a_wrong_file_is_refused_by_its_line(tmp_path: Path, capsys, old, new, said) -> None:
    path = tmp_path / "pier.toml"
    text = network()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    assert main(["plan", "network", str(path)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "pier.toml line " in error


def test_other_refusals(tmp_path: Path, capsys) -> None:
    for call, said in (
        (["ball"], "no network is called 'ball'"),
        (["cube", "--point", "99"], "no point '99' is seen"),
        ([str(tmp_path / "none.toml")], "none.toml"),
    ):
        assert main(["plan", "network", *call]) == 2
        assert said in capsys.readouterr().err
    folder, table = tmp_path / "np", tmp_path / "np.csv"
    call = ["plan", "network", "cube", "--point", "99", "--to", str(folder), "--csv", str(table)]
    assert main(call) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "no point '99' is seen in this network" in said.err
    assert not folder.exists()
    assert not table.exists()
    path = tmp_path / "pier.toml"
    path.write_text(network(1))
    assert main(["plan", "network", str(path)]) == 4
    path.write_text(network().replace("format = [60.0, 60.0]", "format = [0.01, 0.01]"))
    assert main(["plan", "network", str(path)]) == 4
    assert "no station sees any point" in capsys.readouterr().err
    path.write_text(network())
    for option in (["--case", "A"], ["--image-um", "2"]):
        assert main(["plan", "network", str(path), *option]) == 2
