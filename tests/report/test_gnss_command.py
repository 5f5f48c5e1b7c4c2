"""`anaplot adjust` with positions and angles measured in flight: files, options, what is told."""

from __future__ import annotations

import json
from dataclasses import replace
from math import radians

import numpy as np
import pytest

import anaplot
from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_block

SHIFT = np.array([0.3, -0.2, 0.5])
DRIFT = np.array([0.008, 0.012, -0.008])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A planned block, measured with 5 um, whose first strip has a shift and a drift."""
    planned = tmp_path_factory.mktemp("gnss") / "planned"
    folder = planned.parent / "block"
    assert main(["plan", "block", "--strips", "2", "--photos", "4", "--to", str(planned)]) == 0
    block = read_block(planned)
    rng = np.random.default_rng(1)
    rows = []
    for row in block.image_points:
        x, y = rng.normal(size=2) * 0.005
        rows.append(replace(row, x=row.x + x, y=row.y + y))
    truth = {row.photo: row for row in anaplot.adjust(block).result.block.photo_rows()}
    photos = []
    for k, photo in enumerate(block.photos):
        row = truth[photo.id]
        at = np.array(row.position) + rng.normal(size=3) * 0.05
        if photo.id in block.strips[0].photos:
            at += SHIFT + DRIFT * (block.strips[0].photos.index(photo.id) - 1.5) * 10.0
        angles = np.array(row.angles) + rng.normal(size=3) * 1e-4 + [0.0, radians(0.05), 0.0]
        photos.append(
            replace(
                photo,
                position=tuple(at.tolist()),
                position_sigma=(0.05,) * 3,
                rotation=tuple(angles.tolist()),
                rotation_sigma=(1e-4,) * 3,
                time=100.0 + 10.0 * k,
            )
        )
    write_block(folder, replace(block, photos=tuple(photos), image_points=tuple(rows)))
    return folder


def answer(capsys, *arguments: str) -> dict:
    assert main(["adjust", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_options_and_block_toml_say_the_same(folder, tmp_path, capsys) -> None:
    options = ["--gnss-shift", "strip", "--gnss-drift", "strip", "--imu-boresight", "camera"]
    got = answer(capsys, str(folder), *options)
    found = got["offsets"]
    assert (found["shift"], found["drift"], found["boresight"]) == ("strip", "strip", "camera")
    rows = {(row["kind"], row["group"], row["axis"]): row for row in found["unknowns"]}
    assert len(rows) == 2 * 3 + 2 * 3 + 3
    for k, axis in enumerate("XYZ"):
        for kind, value, unit in (("shift", SHIFT[k], "m"), ("drift", DRIFT[k], "m/s")):
            row = rows[kind, "1", axis]
            assert abs(row["value"] - value) < 4.0 * row["s"]  # one of 16 000
            assert row["unit"] == unit
            assert row["detectable"] > 3.0 * row["s"] > 0.0
    assert rows["drift", "1", "X"]["since"] == 115.0
    assert rows["shift", "1", "X"]["since"] is None
    [turn] = [row for row in found["unknowns"] if row["axis"] == "phi"]
    assert turn["value"] == pytest.approx(radians(0.05), abs=2e-4)
    assert turn["group"] == read_block(folder).cameras[0].id
    judged = {(row["kind"], row["group"]): row["verdict"]["rejected"] for row in found["groups"]}
    assert judged["shift", "1"]
    assert not judged["shift", "2"]
    # the same, said in the file
    block = read_block(folder)
    said = tmp_path / "said"
    said.mkdir()
    offsets = anaplot.adjust(block, gnss_shift="strip").result.block.problem.block.offsets
    assert offsets is not None
    write_block(said, replace(block, offsets=replace(offsets, drift="strip", boresight="camera")))
    assert answer(capsys, str(said)) == got
    # and taken back for once
    none = ["--gnss-shift", "none", "--gnss-drift", "none", "--imu-boresight", "none"]
    plain = answer(capsys, str(said), *none)
    assert "offsets" not in plain
    assert plain == answer(capsys, str(folder))
    # which is what it would have
    advised = {one["kind"]: one for one in plain["offsets_advised"]}
    assert advised["shift"]["option"] == "--gnss-shift strip"
    assert advised["boresight"]["option"] == "--imu-boresight block"
    assert advised["shift"]["probability"] < 1e-3
    assert plain["redundancy"] - advised["shift"]["unknowns"] - 3 == got["redundancy"] + 6
    assert "offsets_advised" not in got
    assert main(["adjust", str(folder)]) == 0
    last = capsys.readouterr().out.splitlines()[-2:]
    assert [line.split(": with ")[0] for line in last] == [
        "note: stated positions are off by the same, or control is",
        "note: stated angles are off by the same",
    ]  # fmt: skip
    assert plain["sigma0"] > 2.0 > got["sigma0"]
    assert plain["redundancy"] == got["redundancy"] + 15


def test_what_is_weighted_is_an_observation_among_the_priors(folder, capsys, tmp_path) -> None:
    weighted = ["--gnss-shift", "strip", "--gnss-shift-sigma", "2"]
    weighted += ["--imu-boresight", "block", "--imu-boresight-sigma", "1"]
    got = answer(capsys, str(folder), *weighted)
    priors = [row for row in got["priors"] if " " in row["unknown"]]
    assert [(row["owner"], row["unknown"]) for row in priors] == [
        *(("1", f"shift {axis}") for axis in "XYZ"),
        *(("2", f"shift {axis}") for axis in "XYZ"),
        *(("block", f"boresight {axis}") for axis in ("omega", "phi", "kappa")),
    ]
    at = got["offsets"]["unknowns"]
    assert [row["v"] for row in priors] == pytest.approx([row["value"] for row in at])
    r = sum(row["rx"] + row["ry"] for row in got["image_points"])
    r += sum(row["r"] for row in (*got["control"], *got["priors"]))
    assert r == pytest.approx(got["redundancy"], abs=1e-6)
    search = anaplot.find_gross_errors(folder, gnss_shift="strip", gnss_shift_sigma=2.0)
    rows = search.result.block.prior_rows()
    assert any(row.key == ("prior", "2", "shift Y") for row in rows)
    offsets = search.result.block.problem.block.offsets
    assert offsets is not None
    block = read_block(folder)
    said = tmp_path / "said"
    said.mkdir()
    write_block(said, replace(block, offsets=offsets))
    assert main(["adjust", str(said)]) == 0
    assert "  the shift is weighted: a priori 2, 2, 2 m\n" in capsys.readouterr().out
    assert main(["adjust", str(said), "--gnss-shift-sigma", "none"]) == 0
    assert "  the shift is free\n" in capsys.readouterr().out
    free = answer(capsys, str(folder), "--gnss-shift", "strip", "--imu-boresight", "block")
    assert free["redundancy"] == got["redundancy"] - 9
    assert free["sigma0"] == pytest.approx(got["sigma0"], rel=0.1)


def test_a_person_reads_values_and_tests(folder, capsys) -> None:
    assert main(["adjust", str(folder), "--gnss-shift", "strip", "--imu-boresight", "block"]) == 0
    page = capsys.readouterr().out
    assert page.count("OFFSETS of what photos state") == page.count("HYPOTHESES") == 1
    lines = [line for line in page.splitlines() if line.startswith("  shift")]
    assert len(lines) == 6
    assert "<< not zero" in lines[0]
    assert "<< not zero" not in lines[3]
    assert any("the shift of 1 " in line and "<<" in line for line in page.splitlines())
    assert any(line.startswith("  boresight block phi") and " deg" in line
               for line in page.splitlines())  # fmt: skip


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--gnss-shift", "strip", "--datum", "free"], "--gnss-shift goes with the datum"),
        (["--gnss-drift-sigma", "1"], "--gnss-drift-sigma goes with --gnss-drift"),
        (["--imu-boresight", "none", "--imu-boresight-sigma", "1"], "goes with --imu-boresight"),
    ],
)
def test_what_does_not_go_together(folder, capsys, options, words) -> None:
    assert main(["adjust", str(folder), *options]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_without_control_a_free_shift_ends_with_4(folder, tmp_path, capsys) -> None:
    block = read_block(folder)
    bare = tmp_path / "bare"
    bare.mkdir()
    control = tuple(replace(row, use="check") for row in block.control)
    write_block(bare, replace(block, control=control))
    assert main(["adjust", str(bare), "--gnss-shift", "strip"]) == 4
    error = capsys.readouterr().err
    assert "not determined: the shift in X, the shift in Y, the shift in Z" in error
    assert "but for the unknown shift" in error
    assert error.count("\n") == 1
    assert main(["adjust", str(bare)]) == 0  # the positions alone


def test_a_rejected_position_says_how_it_is_taken_out(folder, capsys, tmp_path) -> None:
    block = read_block(folder)
    first = block.photos[0]
    assert first.position is not None
    x, y, z = first.position
    wrong = replace(first, position=(x + 40.0, y, z))
    write_block(tmp_path, replace(block, photos=(wrong, *block.photos[1:])))
    options = ["--gnss-shift", "strip", "--imu-boresight", "block", "--errors", "baarda", "--apply"]
    assert main(["adjust", str(tmp_path), *options]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "nothing is written of them; take" in said
    assert f"position_sigma of photo '{first.id}'" in said
    assert "out of block.toml" in said
    assert "use = off" not in said
