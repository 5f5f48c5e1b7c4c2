"""`adjust --calibrate`: cameras' own values, free, weighted or held, and camera files of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calibrationblocks import SIZE, TRUTH, make_block, stated

import anaplot
from anaplot.bundle.solve.cameracalibration import CalibratedCamera
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_block
from anaplot.exchange.camerafile import read_camera
from anaplot.photogrammetry.block import Block, Camera, in_pixels
from anaplot.photogrammetry.camera import BrownLens, CameraCalibration, RadialPolynomial
from anaplot.photogrammetry.lens import LENS_PARAMETERS
from anaplot.photogrammetry.refinement import Refinement
from anaplot.report.calibration import calibration_asked
from anaplot.report.camerafiles import calibration_file, camera_files_asked


def values(found) -> dict[tuple[str, str], dict]:
    cameras = found.to_dict()["calibration"]["cameras"]
    return {(one["camera"], row["name"]): row for one in cameras for row in one["parameters"]}


ALL = ",".join(LENS_PARAMETERS)


@pytest.mark.slow
def test_every_camera_finds_its_own_lens_within_its_deviations() -> None:
    found = anaplot.adjust(make_block(), calibrate="c,x0,y0,k1,k2,p1,p2,b1,b2")
    block = found.result.block
    assert abs(block.sigma0 - 1.0) < 3.0 / np.sqrt(2.0 * block.redundancy)
    rows = values(found)
    assert len(rows) == 27
    for (camera, name), row in rows.items():
        truth = TRUTH[camera][LENS_PARAMETERS.index(name)]
        assert abs(row["value"] - truth) < 4.0 * row["s"], (camera, name)
        assert row["value"] == pytest.approx(row["stated"] + row["correction"], abs=1e-12)
    c = rows["drone", "c"]
    assert c["value_px"] == pytest.approx(c["value"] / 0.006)
    assert c["s_px"] == pytest.approx(c["s"] / 0.006)
    # down is positive in pixels
    assert rows["drone", "y0"]["value_px"] == pytest.approx(1990.0 - c_px(rows["drone", "y0"]))
    assert rows["drone", "x0"]["value_px"] == pytest.approx(3010.0 + c_px(rows["drone", "x0"]))
    assert (c["unit"], rows["drone", "k1"]["unit"]) == ("mm", None)
    text = found.text()
    assert "CALIBRATION" in text
    tests = found.to_dict()["hypotheses"]["additional"]["parameters"]
    assert len(tests) == 27


def c_px(row: dict) -> float:
    return row["value"] / 0.006


@pytest.mark.slow
def test_all_of_a_camera_are_the_physical_set_of_a_camera() -> None:
    block = make_block()
    mine = anaplot.adjust(block, calibrate=ALL)
    theirs = anaplot.adjust(block, additional="physical:camera")
    assert mine.result.block.sigma0 == theirs.result.block.sigma0
    assert values(mine) == values(theirs)


@pytest.mark.slow
def test_cameras_have_what_is_freed_of_each_and_the_others_stay() -> None:
    block = make_block()
    freed = anaplot.adjust(block, calibrate=["drone:c,x0,y0,k1,k2,p1,p2", "phone/7:c,k1"])
    problem = freed.result.block.problem
    rows = values(freed)
    assert set(rows) == {
        *(("drone", name) for name in ("c", "x0", "y0", "k1", "k2", "p1", "p2")),
        ("phone/7", "c"), ("phone/7", "k1"),
    }  # fmt: skip
    everything = problem.additional_unknowns
    assert everything == 9
    assert problem.unknowns == 6 * 12 + 3 * len(problem.points) + 9
    # the same by weights that leave nothing
    tight = [f"{c}:{name}=1e-9" for c in ("metric",) for name in ("c", "k1", "k2", "p1", "p2")]
    tight += ["metric:x0=1e-7,y0=1e-7", "phone/7:x0=1e-7,y0=1e-7,k2=1e-9,p1=1e-9,p2=1e-9"]
    held = anaplot.adjust(block, calibrate="c,x0,y0,k1,k2,p1,p2", calibrate_sigma=tight)
    for key, row in rows.items():
        other = values(held)[key]
        assert other["value"] == pytest.approx(row["value"], abs=1e-3 * row["s"])
        s0 = freed.result.block.sigma0 / held.result.block.sigma0
        assert other["s"] * s0 == pytest.approx(row["s"], rel=1e-4)
    np.testing.assert_allclose(
        held.result.block.cofactors.r, freed.result.block.cofactors.r, atol=1e-5
    )
    np.testing.assert_allclose(held.result.block.v, freed.result.block.v, atol=1e-2)


@pytest.mark.slow
def test_weights_pull_towards_the_cameras_own_values_or_those_that_are_given() -> None:
    block = make_block(("drone",))
    free = values(anaplot.adjust(block, calibrate="c,k1,k2,x0,y0,p1,p2"))["drone", "k1"]
    loose = anaplot.adjust(block, calibrate="c,k1,k2,x0,y0,p1,p2", calibrate_sigma="k1=1000")
    assert values(loose)["drone", "k1"]["value"] == pytest.approx(free["value"], abs=1e-6)
    assert values(loose)["drone", "k1"]["freedom"] == "weighted"
    # half way between, by the weight of the free one's own variance (a-priori sigmas)
    own = free["s"] / anaplot.adjust(
        block, calibrate="c,k1,k2,x0,y0,p1,p2"
    ).result.block.sigma0  # fmt: skip
    mean = anaplot.adjust(
        block, calibrate="c,k1=-0.1,k2,x0,y0,p1,p2", calibrate_sigma=f"k1={own!r}"
    )
    found = values(mean)["drone", "k1"]["value"]
    assert found == pytest.approx(0.5 * (free["value"] - 0.1), abs=2e-4)
    assert any(row["unknown"] == "k1" for row in mean.to_dict()["priors"])


@pytest.mark.slow
def test_pixels_are_a_unit_of_lengths() -> None:
    block = make_block(("drone",))
    kept = anaplot.adjust(
        block, calibrate="c=5840px,x0=3015px,y0=1998px,k1,k2,p1,p2",
        calibrate_sigma="c=0px,x0=0,y0=0",
    )  # fmt: skip
    rows = values(kept)
    assert rows["drone", "c"]["value"] == pytest.approx(35.04)
    assert rows["drone", "x0"]["value"] == pytest.approx(0.03)
    assert rows["drone", "y0"]["value"] == pytest.approx(-0.048)
    assert {rows["drone", n]["freedom"] for n in ("c", "x0", "y0")} == {"held"}
    assert rows["drone", "c"]["s"] is None


@pytest.mark.slow
def test_a_written_camera_gives_the_adjustment_with_its_parameters_held(tmp_path: Path) -> None:
    write_block(tmp_path / "block", make_block(("drone", "phone/7")))
    free = anaplot.adjust(
        tmp_path / "block",
        calibrate=["drone:c,x0,y0,k1,k2,p1,p2", "phone/7:c,x0,y0,k1,k2,p2,b1,b2"],
        write_camera=[f"drone={tmp_path / 'd.toml'}", f"phone/7={tmp_path / 'p.toml'}"],
    )
    assert read_camera(tmp_path / "p.toml").lens.b1 == pytest.approx(1e-3, abs=3e-4)
    # the block with these cameras instead, nothing unknown in them
    (tmp_path / "next").mkdir()
    text = (tmp_path / "block" / "block.toml").read_text()
    head, *cameras = text.split("[[camera]]")
    rest = "[[photo]]" + cameras[-1].split("[[photo]]", 1)[1]
    files = [f'[[camera]]\nid = "{name}"\nfile = "{tmp_path / file}"\n\n'
             for name, file in (("drone", "d.toml"), ("phone/7", "p.toml"))]  # fmt: skip
    (tmp_path / "next" / "block.toml").write_text(head + "".join(files) + rest)
    for name in ("image_points.csv", "control.csv"):
        (tmp_path / "next" / name).write_bytes((tmp_path / "block" / name).read_bytes())
    again = anaplot.adjust(tmp_path / "next")
    one, other = free.result.block, again.result.block
    assert other.vtpv == pytest.approx(one.vtpv, rel=1e-9)
    np.testing.assert_allclose(other.v, one.v, atol=1e-8)
    rows = values(free)
    held = ["drone:", "phone/7:"]
    sigma = list(held)
    for k, camera in enumerate(("drone", "phone/7")):
        mine = {n: row["value"] for (c, n), row in rows.items() if c == camera}
        held[k] += ",".join(f"{name}={value!r}" for name, value in mine.items())
        sigma[k] += ",".join(f"{name}=0" for name in mine)
    kept = anaplot.adjust(tmp_path / "block", calibrate=held, calibrate_sigma=sigma)
    assert kept.result.block.problem.additional_unknowns == 0
    assert kept.result.block.sigma0 == pytest.approx(other.sigma0, rel=1e-9)
    np.testing.assert_allclose(kept.result.block.v, other.v, atol=1e-8)
    np.testing.assert_allclose(kept.result.block.cofactors.r, other.cofactors.r, atol=1e-9)
    with pytest.raises(InputError, match="exists already"):
        anaplot.adjust(tmp_path / "next", calibrate="drone:c", write_camera=f"drone={tmp_path}")
    assert read_block(tmp_path / "next").cameras[0].principal_px is not None


@pytest.mark.slow
def test_a_gross_error_is_found_while_cameras_are_calibrated() -> None:
    block = make_block(("drone", "metric"))
    rows = list(block.image_points)
    rows[20] = replace(rows[20], x=rows[20].x + 0.05)
    wrong = replace(block, image_points=tuple(rows))
    found = anaplot.find_gross_errors(wrong, "baarda", calibrate="drone:c,x0,y0,k1,k2,p1,p2")
    first = found.result.rejected[0].name
    assert first[:3] == ("image", rows[20].photo, rows[20].point)


@pytest.mark.parametrize(
    ("calibrate", "sigma", "said"),
    [
        ("k9", None, "no parameter 'k9'"),
        ("drone2:c", None, "no camera 'drone2'"),
        ("", "k1=1", "goes with --calibrate"),
        ("k1=x", None, "'x' is no number"),
        ("k1=1e999", None, "is no number"),
        ("k1=3px", None, "it has no unit"),
        ("c=-3", None, "no camera constant"),
        ("c", "k1=0.1", "not calibrated"),
        ("c", "c", "a sigma is written as"),
        ("c", "c=-1", "a sigma is written as"),
        ("drone:c", "metric:c=1", "of camera 'metric'"),
        ("c", "c=1e-300", "sigma"),
        ("b1=-1", None, "b1: must be greater than -1"),
        ("k1,k1=0.3", None, "--calibrate k1: stands twice"),
        (["drone:c", "drone:k1,c"], None, "c of camera 'drone': stands twice"),
        ("c", ["c=1", "c=2"], "--calibrate-sigma c: stands twice"),
    ],
)
def test_what_cannot_be_meant_is_said_in_one_line(calibrate, sigma, said) -> None:
    block = make_block(("drone", "metric"))
    with pytest.raises(InputError, match=said) as error:
        anaplot.adjust(block, calibrate=calibrate or None, calibrate_sigma=sigma)
    assert "\n" not in str(error.value)


def test_what_is_said_of_one_camera_counts_wherever_it_stands() -> None:
    block = make_block(("drone", "metric"))
    one, all_of_them = ["drone:k1=0.1", "k1=0.2,c"], ["drone:k1=0.01", "k1=0.02"]
    first = calibration_asked(block, one, all_of_them, None)
    assert first == calibration_asked(block, one[::-1], all_of_them[::-1], None)
    known = {p.group: (p.value, p.sigma) for p in first.priors if p.parameter == "k1"}
    assert known == {"drone": (0.1, 0.01), "metric": (0.2, 0.02)}


def test_two_sets_of_parameters_are_refused_and_files_without_calibration() -> None:
    block = make_block(("drone",), pixels=False)
    with pytest.raises(InputError, match="two sets"):
        anaplot.adjust(block, calibrate="c", additional="ebner")
    with pytest.raises(InputError, match="goes with --calibrate"):
        anaplot.adjust(block, write_camera="x.toml")
    with pytest.raises(InputError, match="has no pixels"):
        anaplot.adjust(block, calibrate="c=5000px")
    two = make_block(("drone", "metric"))
    with pytest.raises(InputError, match="of which camera"):
        anaplot.adjust(two, calibrate="c", write_camera="x.toml")
    with pytest.raises(InputError, match="stands twice"):
        anaplot.adjust(two, calibrate="c", write_camera=["drone=x", "drone=y"])


@pytest.mark.slow
def test_a_principal_point_in_mm_goes_into_the_file_for_the_next_inner_orientation(
    tmp_path: Path,
) -> None:
    block = make_block(("drone",), pixels=False)
    file = tmp_path / "d.toml"
    found = anaplot.adjust(block, calibrate="c,x0,y0,k1,k2,p1,p2", write_camera=str(file))
    rows, written = values(found), read_camera(file)
    assert written.principal_point == (
        rows["drone", "x0"]["value"],
        rows["drone", "y0"]["value"],
    )
    assert (written.c, written.lens.k1) == (
        rows["drone", "c"]["value"],
        rows["drone", "k1"]["value"],
    )
    assert rows["drone", "c"]["value_px"] is None
    x, y = written.principal_point
    note = f"old principal point: {x:+.4f}, {y:+.4f} mm go into the file alone"
    assert note in " ".join(found.text().split())
    told = found.to_dict()["principal_points_in_file_alone"]
    assert told == [{"camera": "drone", "offset": [x, y]}]


def test_a_file_that_corrects_by_a_table_of_distortion_holds_no_lens_beside_it() -> None:
    camera = stated("drone")
    table = CameraCalibration("drone", 35.0, radial=RadialPolynomial((0.0, 1e-6, 0.0, 0.0)))
    own = replace(camera, calibration=table, file="d.toml")
    found = CalibratedCamera(own, (), replace(own, lens=BrownLens(k1=0.1)), (0.0, 0.0))
    with pytest.raises(InputError, match=r"\[distortion\] of 'd.toml'"):
        calibration_file(found)
    kept = calibration_file(found._replace(camera=replace(own, c=35.1)))
    assert (kept.c, kept.radial, kept.symmetry_point) == (35.1, table.radial, None)
    # known before anything is adjusted
    block = replace(make_block(("drone",)), cameras=(own,))
    with pytest.raises(InputError, match=r"\[distortion\] of 'd.toml'"):
        asked(block, "c,k1", "x.toml")
    assert asked(block, "c,x0", "x.toml") == {"drone": Path("x.toml")}


@pytest.mark.parametrize("pixels", [False, True])
def test_distortion_stays_where_it_is_when_the_principal_point_moves(pixels: bool) -> None:
    camera = stated("drone") if pixels else Camera("drone", 35.0)
    table = CameraCalibration(
        "drone", 35.0, (0.01, -0.02), radial=RadialPolynomial((0.0, 3e-5, 0.0, 0.0))
    )
    own = replace(camera, calibration=table, file="d.toml")
    written = calibration_file(CalibratedCamera(own, (), own, (0.3, -0.4)))
    # in pixels the plate counts from the principal point, which has moved itself
    moved = np.array((0.3, -0.4))
    at = np.array([[9.0, 7.0], [-12.0, 3.0]])
    before = Refinement.of(table).refine(at) - (at - table.principal_point)
    shift = moved if pixels else np.zeros(2)
    after = Refinement.of(written).refine(at - shift) - (at - shift - written.principal_point)
    np.testing.assert_allclose(after, before, atol=1e-12)
    assert np.abs(before).max() > 1e-3


def asked(block: Block, calibrate, *files: str) -> dict[str, Path]:
    chosen = calibration_asked(block, calibrate, None, None)
    return camera_files_asked(block, list(files), chosen)


def test_what_a_camera_file_cannot_be_is_told_before_the_adjustment(tmp_path: Path) -> None:
    two = make_block(("drone", "phone/7"))
    with pytest.raises(InputError, match="nothing of camera 'phone/7' is calibrated"):
        asked(two, "drone:c,k1", "phone/7=zz.toml")
    with pytest.raises(InputError, match="there is no such folder"):
        asked(two, "c", f"drone={tmp_path / 'none' / 'd.toml'}")
    one = make_block(("drone",))
    with pytest.raises(InputError, match=r"of which camera.*did you mean 'drone'"):
        asked(one, "c", "dron=foo.toml")
    # names with = in them
    odd = replace(one, cameras=(replace(one.cameras[0], id="a=b"),))
    odd = replace(odd, photos=tuple(replace(photo, camera="a=b") for photo in odd.photos))
    assert asked(odd, "c", "a=b=c.toml") == {"a=b": Path("c.toml")}
    file = tmp_path / "none" / "a.npz"
    for option in ({"posterior": file}, {"covariance": "photos:p00", "covariance_to": file}):
        with pytest.raises(InputError, match="there is no such folder"):
            anaplot.adjust(one, **option)


@pytest.mark.slow
def test_no_file_is_left_where_one_cannot_be_written(tmp_path: Path, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise InputError("no space left")

    monkeypatch.setattr("anaplot.report.covariance.write_covariance", full)
    with pytest.raises(InputError, match="no space left"):
        anaplot.adjust(
            make_block(("drone",)),
            calibrate="c",
            write_camera=tmp_path / "d.toml",
            covariance="photos:p00",
            covariance_to=tmp_path / "a.npz",
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_covariance_of_parameters_says_that_they_are_corrections() -> None:
    found = anaplot.adjust(make_block(("drone",)), calibrate="c,k1", covariance="parameters")
    c = values(found)["drone", "c"]
    assert found.to_dict()["covariance"]["values"][0] == pytest.approx(c["correction"])
    line = "values of parameters are corrections of what the cameras state"
    assert found.text().count(line) == 1
    other = anaplot.adjust(make_block(("drone",)), calibrate="c,k1", covariance="photos:p00")
    assert line not in other.text()


@pytest.mark.slow
def test_a_parameter_that_is_held_where_it_was_stated_is_told() -> None:
    block = make_block(("drone",))
    for calibrate in ("c=35,k1", "c,k1"):
        rows = values(anaplot.adjust(block, calibrate=calibrate, calibrate_sigma="c=0"))
        assert (rows["drone", "c"]["freedom"], rows["drone", "c"]["value"]) == ("held", 35.0)
        assert rows["drone", "k1"]["freedom"] == "free"


@pytest.mark.slow
def test_lengths_are_shown_in_pixels_where_a_pixel_has_no_size() -> None:
    block = make_block(("drone",))
    [camera] = block.cameras
    bare = in_pixels(replace(camera, c=35.0 / 6.0), SIZE, None, camera.principal_px)
    rows = tuple(replace(row, x=row.x / 6.0, y=row.y / 6.0) for row in block.image_points)
    bare_block = replace(
        block, cameras=(bare,), image_points=rows, precision=replace(block.precision, image_um=0.35)
    )
    found = anaplot.adjust(bare_block, calibrate="c,k1")
    known = values(found)["drone", "c"]
    assert known["value_px"] == pytest.approx(1e3 * known["value"])
    text = found.text()
    table = text[text.index("CALIBRATION") :].splitlines()
    cells = next(line.split() for line in table if line.split()[:2] == ["drone", "c"])
    assert cells[4] == "px"
    assert float(cells[2]) == pytest.approx(known["value_px"], abs=1e-6)
