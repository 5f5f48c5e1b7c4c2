"""`anaplot inner FILE`: what is printed, as text and as JSON, and with which exit code."""

from __future__ import annotations

import argparse
import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from wild import text_of, wild, words

from anaplot.errors import InputError
from anaplot.exchange.camerafile import read_camera
from anaplot.exchange.fiducialfile import read_fiducials
from anaplot.photogrammetry.inner import TRANSFORMATIONS, orient_inner
from anaplot.photogrammetry.platetransformation import Placement, PlateTransformation
from anaplot.report.astext import table_lines
from anaplot.report.innerarguments import INNER_HELP, add_inner_arguments
from anaplot.report.innercommand import orient_photos, run_inner
from anaplot.report.innerdocument import (
    InnerGroup,
    fiducial_table,
    inner_documents,
    photo_document,
)

CAMERA = """\
format = 1
[camera]
id = "rmk"
c = 152.40
format = [230.0, 230.0]
[fiducials]
1 = [-106.003, 106.001]
2 = [106.000, 105.998]
3 = [106.002, -106.000]
4 = [-105.998, -106.003]
5 = [-113.000, 0.012]
6 = [0.003, 113.004]
7 = [113.001, -0.004]
8 = [0.000, -112.998]
[distortion]
table = [[40.0, 2.2], [148.0, 1.0]]
"""
LIE = Placement(120.0, 110.0, 0.01, 1e-4, 0.9995, 1.0003)


def options(*arguments):
    parser = argparse.ArgumentParser("anaplot inner")
    add_inner_arguments(parser)
    return parser.parse_args([str(argument) for argument in arguments])


@pytest.fixture
def make_file(tmp_path: Path):
    """Return a function that writes measured fiducials: {photo: (count, wrong row or None)}."""
    (tmp_path / "rmk.toml").write_text(CAMERA)

    def make(photos: dict[str, tuple[int, int | None]], lie: Placement = LIE) -> Path:
        marks = read_camera(tmp_path / "rmk.toml").fiducials
        rng = np.random.default_rng(2)
        lines = ["format = 1", 'camera = "rmk.toml"']
        for photo, (count, wrong) in photos.items():
            image = np.array([(mark.x, mark.y) for mark in marks[:count]])
            plate = lie.transformation().to_plate(image) + rng.normal(size=image.shape) * 0.003
            if wrong is not None:
                plate[wrong, 1] += 0.15
            lines.append(f'[photo."{photo}"]')
            lines += [
                f"{mark.id} = [{x:.4f}, {y:.4f}]"
                for mark, (x, y) in zip(marks, plate.tolist(), strict=False)
            ]
        path = tmp_path / "fid.toml"
        path.write_text("\n".join(lines) + "\n")
        return path

    return make


def test_a_good_photo(make_file, capsys):
    assert run_inner(options(make_file({"101": (8, None)}), "--fail-on-flag")) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "PHOTO 101  camera rmk" in out
    assert "the bilinear transformation" in out
    assert "redundancy 8" in out
    assert "nothing is flagged" in out
    assert "the distortion is calibrated up to radius 148 mm" in out
    (origin,) = (line.split() for line in out.splitlines() if line.startswith("  origin"))
    assert (float(origin[2]), float(origin[4])) == pytest.approx((120.0, 110.0), abs=0.02)
    assert "film shrinkage x" in out
    rows = [line.split() for line in out.splitlines() if line[2:3].isdigit()]
    assert [(row[0], row[1]) for row in rows] == [(str(k), a) for k in range(1, 9) for a in "xy"]
    assert sum(float(row[2]) for row in rows) == pytest.approx(8.0, abs=0.01)


def test_the_wrong_fiducial_is_marked(make_file, capsys):
    path = make_file({"101": (8, None), "102": (8, 6)})
    assert run_inner(options(path)) == 0
    out = capsys.readouterr().out
    (marked,) = (line for line in out.splitlines() if "<< REMEASURE" in line)
    assert marked.split()[:2] == ["7", "y"]
    assert "remeasure 7 (y): more than 1000 to 1 over" in out
    assert run_inner(options(path, "--fail-on-flag")) == 1


def test_four_fiducials_with_a_wrong_one_fail_without_a_flagged_row(make_file, capsys):
    path = make_file({"101": (4, 2)})
    assert run_inner(options(path, "--fail-on-flag")) == 1
    out = capsys.readouterr().out
    assert "among four fiducials one wrong fiducial cannot be located" in out
    assert "<<" not in out
    assert "not measured: 5, 6, 7, 8" in out


def test_json_says_the_same(make_file, capsys):
    path = make_file({"101": (8, 1), "102": (4, None)})
    assert run_inner(options(path, "--json")) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["camera"] == "rmk"
    first, second = answer["photos"]
    file = read_fiducials(path)
    for told, photo in zip((first, second), file.photos, strict=True):
        inner = orient_inner(file.camera, {f: (x, y) for f, x, y in photo.measured})
        assert told["photo"] == photo.photo
        assert told["sigma0_um"] == inner.sigma0_um
        assert [tuple(row.values()) for row in told["table"]] == [
            (r.point, r.axis, r.r, r.residual, r.expected, r.size, r.flagged, r.mdb, r.probability)
            for r in inner.rows
        ]
        assert list(told["table"][0]) == [
            "fiducial", "axis", "redn", "residual_um", "expd_um", "sigf", "flagged", "mdb_um",
            "probability",
        ]  # fmt: skip
        numbers = told["plate_to_image"]
        again = PlateTransformation(
            told["transformation"],
            tuple(tuple(row) for row in numbers["frame"]),
            tuple(tuple(row) for row in numbers["numerator"]),
            tuple(numbers["denominator"]),
        )
        assert again == inner.transformation
        place = told["placement"]
        assert (place["x"], place["rotation"]) == (inner.placement.x, inner.placement.rotation)
        assert place["shrinkage_x_ppm"] == pytest.approx((1 - place["scale_x"]) * 1e6)
    assert (first["transformation"], first["locatable"], first["refused"]) == (
        "bilinear",
        True,
        True,
    )
    assert (second["transformation"], second["locatable"]) == ("affine", False)
    assert len(second["partners"]) == 12


def test_the_power_is_a_number_whatever_is_asked_for(make_file, capsys):
    path = make_file({"101": (8, None)})
    path.write_text(path.read_text().replace("[photo", "[test]\npower = 0.995\n[photo", 1))
    assert run_inner(options(path, "--transformation", "helmert", "--json")) == 0
    photo = json.loads(capsys.readouterr().out)["photos"][0]
    assert photo["redundancy"] == 12
    assert photo["test"]["power"] == pytest.approx(0.867304, abs=1e-6)


def test_a_photo_that_cannot_be_oriented_does_not_stop_the_others(make_file, capsys):
    path = make_file({"101": (2, None), "102": (8, None)})
    assert run_inner(options(path)) == 4
    out, err = capsys.readouterr()
    assert err == "anaplot: photo 101: inner orientation needs 3 fiducials, 2 measured (1, 2)\n"
    assert "PHOTO 102" in out
    assert run_inner(options(path, "--json")) == 4
    answer = json.loads(capsys.readouterr().out)
    assert answer["photos"][0] == {
        "photo": "101",
        "error": "inner orientation needs 3 fiducials, 2 measured (1, 2)",
    }
    assert answer["photos"][1]["redundancy"] == 8


@pytest.mark.parametrize("kind", ["helmert", "affine", "bilinear", "projective"])
def test_the_transformation_on_request(make_file, capsys, kind):
    path = make_file({"101": (8, None)})
    assert run_inner(options(path, "--json", "--transformation", kind)) == 0
    assert json.loads(capsys.readouterr().out)["photos"][0]["transformation"] == kind


def test_an_unknown_transformation_is_named_with_the_nearest(make_file):
    with pytest.raises(InputError, match=r"'afine' \(did you mean 'affine'\?\)"):
        run_inner(options(make_file({"101": (8, None)}), "--transformation", "afine"))
    with pytest.raises(InputError, match="file not found"):
        run_inner(options("none.toml"))


def test_no_redundancy_prints_dashes_and_null(make_file, capsys):
    path = make_file({"101": (4, None)})
    assert run_inner(options(path, "--transformation", "projective")) == 0
    out = capsys.readouterr().out
    assert "sigma0    none" in out
    assert "four fiducials and the projective transformation: no check at all" in out
    assert out.count("not testable") == 8
    assert run_inner(options(path, "--transformation", "projective", "--json")) == 0
    (photo,) = json.loads(capsys.readouterr().out)["photos"]
    assert photo["sigma0_um"] is None
    assert photo["test"]["critical"] is None
    assert {row["sigf"] for row in photo["table"]} == {None}


def test_distances_only(tmp_path, capsys):
    (tmp_path / "old.toml").write_text(
        'format = 1\n[camera]\nid = "old"\nc = 210.0\n[distances]\n'
        'mm = [["1", "3", 226.0], ["4", "2", 226.0]]\n'
    )
    path = tmp_path / "fid.toml"
    path.write_text(
        'format = 1\ncamera = "old.toml"\n[photo.1]\n'
        "1 = [7.0, 120.0]\n2 = [120.0, 233.0]\n3 = [233.01, 120.0]\n4 = [120.0, 7.0]\n"
    )
    assert run_inner(options(path)) == 0
    out = capsys.readouterr().out
    assert "the two-parameter similarity" in out
    assert "only distances are known: x runs from 1 to 3" in out
    assert "film shrinkage -22 ppm" in out
    # 10 um too long, half of it taken by the scale
    _, distances = out.split("DISTANCES")
    assert [line.split()[-1] for line in distances.splitlines() if " - " in line] == ["5.0", "-5.0"]
    assert run_inner(options(path, "--json")) == 0
    (photo,) = json.loads(capsys.readouterr().out)["photos"]
    assert [d["first"] for d in photo["distances"]] == ["1", "4"]
    assert photo["distances"][0]["difference_um"] == pytest.approx(5.0, abs=0.01)


def test_a_mirrored_plate_is_said_to_be_one(make_file, capsys):
    assert run_inner(options(make_file({"101": (8, None)}, LIE._replace(mirrored=True)))) == 0
    assert "seen from behind" in capsys.readouterr().out


def test_names_never_reach_the_terminal_as_commands(make_file):
    file = read_fiducials(make_file({"101": (8, None)}))
    ((_, inner),) = orient_photos(file)
    text = text_of(photo_document("1\x1b[2J01", inner))
    assert all(line.isprintable() for line in text.split("\n"))
    assert r"1\x1b[2J01" in text


def test_columns_never_touch(make_file):
    ((_, inner),) = orient_photos(read_fiducials(make_file({"101": (8, None)})))
    usual, large = (fiducial_table(one) for one in (inner, wild(inner)))
    assert words("\n".join(table_lines(usual))) == words("\n".join(table_lines(large)))


def test_what_the_camera_leaves_open(make_file):
    camera = read_fiducials(make_file({"101": (8, None)})).camera
    text = text_of(inner_documents([InnerGroup(camera, [])]))
    assert text.endswith("up to radius 148 mm; beyond it, its last value is held")
    assert inner_documents([InnerGroup(replace(camera, radial=None), [])]).page == ()
    assert inner_documents([InnerGroup(replace(camera, format=(200.0, 200.0)), [])]).page == ()
    assert inner_documents([InnerGroup(camera, [])]).to_dict() == {"camera": "rmk", "photos": []}


def test_one_file_holds_the_fiducials_of_all_photos(make_file, capsys, tmp_path):
    path, written = (
        make_file({"101": (8, 1), "102": (2, None), "103": (4, None)}),
        tmp_path / "f.csv",
    )
    assert run_inner(options(path, "--json", "--csv", written, "--to", tmp_path / "all")) == 4
    photos = json.loads(capsys.readouterr().out)["photos"]
    with written.open(newline="") as file:
        rows = list(csv.DictReader(file))
    told = [{"photo": p["photo"], **row} for p in photos for row in p.get("table", ())]
    assert len(rows) == len(told) == 2 * (8 + 4)
    for row, same in zip(rows, told, strict=True):
        assert list(row) == list(same)
        assert row["photo"] == same["photo"]
        assert row["flagged"] == str(int(same["flagged"]))
        assert float(row["redn"]) == same["redn"]
    names = ["distances.csv", "fiducials.csv", "summary.json"]
    assert sorted(one.name for one in (tmp_path / "all").iterdir()) == names
    assert (tmp_path / "all" / "fiducials.csv").read_bytes() == written.read_bytes()
    for read in (path, tmp_path / "rmk.toml"):
        with pytest.raises(InputError, match="it is read"):
            run_inner(options(path, "--csv", read))


def test_the_help_names_every_transformation_and_is_true(tmp_path):
    for name in TRANSFORMATIONS:
        assert name in INNER_HELP
    # the example in the help is a file that is read
    lines = INNER_HELP.splitlines()
    start = lines.index("  format = 1")
    end = next(k for k in range(start, len(lines)) if not lines[k].strip())
    text = "\n".join(line.split("   ")[0] for line in (x.strip() for x in lines[start:end]))
    text = "\n".join(line.split("as in")[0].split("beside")[0] for line in text.splitlines())
    (tmp_path / "rmk.toml").write_text(CAMERA)
    (tmp_path / "fid.toml").write_text(text)
    assert [photo.photo for photo in read_fiducials(tmp_path / "fid.toml").photos] == ["101"]
