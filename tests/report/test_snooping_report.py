"""`anaplot adjust --snooping` and `--correlations`: text, JSON, options, an interrupt."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import pty
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandbench import run_adjust
from processes import running
from wild import text_of, wild, words

from anaplot.adjustment.reliability import SPUR
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.papermodels import PaperModel, paper_models
from anaplot.bundle.errors.snooping import ObservationClass, classify
from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_new_block
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.report.correlations import correlated_rays, correlations_document
from anaplot.report.snooping import snoop_block, snooping_document
from anaplot.report.snoopingmodels import snooping_models

WAIT = 120.0
BASE, HEIGHT, C = 600.0, 1000.0, 150.0


def flown(strips: int, length: int, *, errors: int = 0, relief: float = 30.0) -> Block:
    """A 60/60 block with noise of 5 um, control at its corners, and errors of 60 um in y."""
    rng = np.random.default_rng(5)
    points = {
        f"p{i}-{j}": np.array([i * BASE / 2.0, j * BASE / 2.0, rng.uniform(-1.0, 1.0) * relief])
        for j in range(-1, 2 * strips)
        for i in range(2 * length - 1)
    }
    names, at = list(points), np.array(list(points.values()))
    rows, lines = [], []
    for j in range(strips):
        ids = tuple(f"{j + 1}{i + 1:02d}" for i in range(length))
        lines.append(Strip(f"s{j + 1}", ids))
        for i, photo in enumerate(ids):
            centre = np.array([i * BASE, j * BASE, HEIGHT])
            rotation = rotation_matrix(*(rng.normal(size=3) * 0.02))
            n = len(names)
            seen = project(
                np.broadcast_to(centre, (n, 3)),
                np.broadcast_to(rotation, (n, 3, 3)),
                np.full(n, C),
                at,
            )
            near = np.abs(at[:, :2] - centre[:2]).max(axis=1) < 1.01 * BASE
            for k in np.nonzero(near)[0].tolist():
                x, y = (seen.xy[k] + rng.normal(size=2) * 0.005).tolist()
                rows.append(ImagePoint(photo, names[k], x, y))
    for k in rng.choice(len(rows), errors, replace=False).tolist():
        rows[k] = replace(rows[k], y=rows[k].y + 0.06)
    corners = [
        f"p{i}-{j}" for i in (0, length - 1, 2 * length - 2) for j in (-1, strips, 2 * strips - 1)
    ]
    control = tuple(
        ControlPoint(name, tuple(points[name].tolist()), (0.0, 0.0, 0.0)) for name in corners
    )
    return Block(
        name="flown",
        precision=Precision(image_um=5.0),
        test=TestSettings(kind="baarda"),
        cameras=(Camera("rmk", C),),
        photos=tuple(Photo(photo, "rmk") for strip in lines for photo in strip.photos),
        strips=tuple(lines),
        image_points=tuple(rows),
        control=control,
    )


def written(folder: Path, block: Block) -> Path:
    write_new_block(folder, replace(block, image_points=(), control=()))
    rows = ["photo,point,x,y"]
    rows += [f"{r.photo},{r.point},{r.x!r},{r.y!r}" for r in block.image_points]
    (folder / "image_points.csv").write_text("\n".join(rows) + "\n")
    control = ["point,X,Y,Z,sX,sY,sZ,use"]
    control += [",".join([c.point, *map(repr, c.xyz), "0,0,0", c.use]) for c in block.control]
    (folder / "control.csv").write_text("\n".join(control) + "\n")
    return folder


def test_both_tests_side_by_side() -> None:
    adjusted = adjust_block(flown(3, 5, errors=6))
    for tolerance in (0.05, 0.25):
        found = snoop_block(adjusted, tolerance=tolerance)
        assert found is not None
        assert found.observations == adjusted.v.size
        told = [(r.accepted, r.rejected, r.undecided, r.untestable) for r in found.classes]
        assert np.sum(told) == adjusted.v.size
        # what is decided exactly is what the model values left open, and agrees with the exact test
        assert len(found.undecided) == sum(row.undecided for row in found.classes)
        assert all(row.rejected == row.exact for row in found.undecided)
        # the differences are counted
        rejected = {row[:4] for row in found.rejected}
        exact = {
            (p.photo, p.point, p.model, "xy"[axis])
            for ray, axis in np.argwhere(adjusted.flagged).tolist()
            for p in [adjusted.problem.block.image_points[adjusted.problem.source[ray]]]
        }
        assert exact
        assert {row[:4] for row in found.wrongly_rejected} == rejected - exact
        assert {row[:4] for row in found.wrongly_accepted} == exact - rejected
        # the largest first; of two that differ by rounding alone the first in the block
        sizes = np.array([abs(row.w) for row in found.rejected if row.w is not None])
        assert (np.diff(sizes) < 1e-6).all()
        for row in found.classes:
            assert row.smallest <= row.largest
            assert (
                (row.beyond == 0)
                or row.smallest < row.model * (1.0 - tolerance)
                or (row.largest > row.model * (1.0 + tolerance))
            )
    # a wider tolerance leaves more undecided
    narrow = snoop_block(adjusted, tolerance=0.05)
    wide = snoop_block(adjusted, tolerance=0.25)
    assert narrow is not None
    assert wide is not None
    assert len(narrow.undecided) < len(wide.undecided)


@pytest.mark.parametrize("values", ["3x3", "3x3-twin", "5x5", "5x5-twin"])
def test_the_papers_model_values_serve_regular_blocks(values: str) -> None:
    adjusted = adjust_block(flown(3, 5, errors=6))
    found = snoop_block(adjusted, model=values)
    assert found is not None
    printed = paper_models(PaperModel(int(values[0]), values.endswith("twin")))
    for row in found.classes:
        assert row.model == printed.get(row.kind)
        if row.model is None:
            assert row.undecided == row.observations
    assert f"with {values[0]} x {values[0]} points" in text_of(snooping_document(found))
    assert ("in pairs" in text_of(snooping_document(found))) == values.endswith("twin")
    exact = {row[:4] for row in found.undecided if row.exact}
    assert exact <= {row[:4] for row in found.rejected}


def test_the_paper_s_block_that_is_most_like_one_is_chosen() -> None:
    for plan, source in (
        (BlockPlan(4, 4, 0.60, 0.60, 3), "3x3"),
        (BlockPlan(4, 4, 0.60, 0.60, 3, twin=True), "3x3-twin"),
        (BlockPlan(4, 4, 0.60, 0.60, 5), "5x5"),
        (BlockPlan(4, 4, 0.60, 0.60, 5, twin=True), "5x5-twin"),
    ):
        planned = plan_block(plan).evaluated()
        assert snooping_models(planned, "paper").source == source
        on_curves = snooping_models(planned, "paper", 2.0).roots
        other = [
            kind for kind, root in snooping_models(planned, "paper").roots.items()
            if on_curves[kind] != root
        ]  # fmt: skip
        assert {(kind.control, kind.rays) for kind in other} == {(True, 4)}
        assert {kind.inner for kind in other} == {False, True}
    single = snooping_models(plan_block(BlockPlan(4, 4, 0.60, 0.60, 3)).evaluated(), "3x3", 2.0)
    assert single.roots[ObservationClass(4, False, True, "y")] == pytest.approx(0.735 - 0.036)
    assert single.roots[ObservationClass(4, True, True, "x")] == pytest.approx(0.885 - 0.008)


def test_without_tolerance_model_values_alone_decide() -> None:
    adjusted = adjust_block(flown(3, 5, errors=6))
    found = snoop_block(adjusted, tolerance=0.0, model="3x3")
    assert found is not None
    for row in found.classes:
        assert row.undecided == (row.observations if row.model is None else 0)
    assert found.wrongly_accepted or found.wrongly_rejected


def test_model_values_come_from_a_planned_block(tmp_path: Path, capsys) -> None:
    file = tmp_path / "values.csv"
    planned = ["plan", "block", "--strips", "3", "--photos", "5", "--sidelap", "60", "--bridging"]
    assert main([*planned, "4", "--csv", str(file)]) == 0
    folder = written(tmp_path / "b", flown(3, 5, errors=6))
    capsys.readouterr()
    assert main(["adjust", str(folder), "--snooping", "--snooping-model", str(file), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["snooping"]
    assert told["model_values"] == "file"
    values = {
        (row["rays"], row["ray"] == "inner", row["point"] == "control", row["axis"]): row
        for row in csv.DictReader(file.read_text().splitlines())
    }
    with_value = 0
    for row in told["classes"]:
        of = values.get((str(row["rays"]), row["inner"], row["control"], row["axis"]))
        assert row["root_qvv"] == (None if of is None else float(of["mean_root"]))
        with_value += of is not None
    assert with_value > 4
    text = run(folder, snooping=True, snooping_model=file)
    assert "model values of sqrt(q_vv) of values.csv" in text


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("rays,ray,point,axis,mean_root\n5,outer,new,x,0.5\n", "v.csv line 2: rays: must be"),
        ("rays,ray,point,axis,mean_root\n4,outer,new,x,1.5\n", "v.csv line 2: mean_root: must lie"),
        ("rays,ray,point,axis\n4,outer,new,x\n", "v.csv line 1: no column 'mean_root'"),
        ("rays,ray,point,axis,mean_root\n", "v.csv: no rows"),
        (
            "rays,ray,point,axis,mean_root\n4,outer,new,x,0.5\n4,outer,new,x,0.6\n",
            "v.csv line 3: rays '4' twice in ray 'outer' in point 'new'",
        ),
    ],
)
def test_a_bad_file_of_model_values_is_named(tmp_path: Path, capsys, rows: str, said: str) -> None:
    folder = written(tmp_path / "b", flown(2, 4))
    (tmp_path / "v.csv").write_text(rows)
    values = str(tmp_path / "v.csv")
    assert main(["adjust", str(folder), "--snooping", "--snooping-model", values]) == 2
    out, error = capsys.readouterr()
    assert said in error
    assert not out


def test_a_bridging_distance_goes_with_the_paper_s_values(tmp_path: Path, capsys) -> None:
    folder = written(tmp_path / "b", flown(2, 4))
    assert main(["adjust", str(folder), "--snooping", "--snooping-bridging", "2"]) == 2
    assert "--snooping-bridging goes with" in capsys.readouterr().err


def run(folder: Path, **options: object) -> str:
    code, text, _ = run_adjust(folder, **options)
    assert code == 0
    return text


def test_the_report_follows_the_block(tmp_path: Path) -> None:
    folder = written(tmp_path / "b", flown(2, 4, errors=3))
    plain = run(folder)
    text = run(folder, snooping=True, correlations=0.9)
    assert text.startswith(plain.rstrip("\n"))
    assert "MODIFIED DATA SNOOPING (Gruen 1980) BESIDE THE EXACT TEST" in text
    assert "k_q 25 %" in text
    assert "CORRELATED RESIDUALS of a point's rays, 0.9 or more" in text
    found = re.search(
        r"of (\d+) image coordinates the model values accept (\d+) and reject (\d+); (\d+) "
        r"undecided are decided exactly",
        text,
    )
    assert found is not None
    total, accepted, rejected, undecided = map(int, found.groups())
    assert total == accepted + rejected + undecided == 2 * len(read_block(folder).image_points)
    assert rejected > 0


def test_the_keys_are_additive(tmp_path: Path) -> None:
    folder = written(tmp_path / "b", flown(2, 4, errors=3))
    plain = json.loads(run(folder, as_json=True))
    got = json.loads(
        run(folder, as_json=True, snooping=True, snooping_tolerance=10.0, correlations=1.0)
    )
    snooping, correlations = got.pop("snooping"), got.pop("correlations")
    assert got == plain
    assert snooping["tolerance"] == 0.1
    assert snooping["differences"] == len(snooping["wrongly_accepted"]) + len(
        snooping["wrongly_rejected"]
    )
    assert set(snooping["rejected"][0]) == {
        "photo", "point", "model", "axis", "w", "rejected", "exact",
    }  # fmt: skip
    assert {row["axis"] for row in snooping["classes"]} == {"x", "y"}
    assert sum(row["observations"] for row in snooping["classes"]) == snooping["observations"]
    # the two y of a point in two photos check each other and nothing else does
    assert correlations
    assert {"point", "first", "second", "correlation"} == set(correlations[0])
    assert all(abs(pair["correlation"]) <= 1.0 for pair in correlations)


def test_correlations_are_those_of_the_library() -> None:
    adjusted = adjust_block(flown(2, 4))
    limit = 0.6
    pairs = correlated_rays(adjusted, limit)
    assert pairs
    listed = {(p.point, p.first, p.second): p.correlation for p in pairs}
    for point in adjusted.problem.points:
        labels, rho = adjusted.point_correlations(point)
        for i in range(len(labels)):
            for j in range(i + 1, len(labels)):
                name = (point, labels[i], labels[j])
                above = np.isfinite(rho[i, j]) and abs(rho[i, j]) >= limit
                assert (name in listed) == above
                if above:
                    assert listed[name] == pytest.approx(rho[i, j])
    assert correlated_rays(adjusted, 1.0) == tuple(
        p for p in correlated_rays(adjusted, 0.9) if abs(p.correlation) > 1.0 - 1e-9
    )


def test_without_redundancy_there_is_nothing_to_snoop() -> None:
    block = flown(1, 2)
    points = ("p0--1", "p2--1", "p1-0", "p0-1", "p2-1")
    rows = tuple(r for r in block.image_points if r.point in points)
    adjusted = adjust_block(replace(block, image_points=rows, control=()), datum="free")
    assert adjusted.redundancy == 0
    found = snoop_block(adjusted)
    assert found is None
    assert snooping_document(found).to_dict() is None
    assert "no test" in text_of(snooping_document(found))


def test_what_nothing_checks_is_not_accepted() -> None:
    adjusted = adjust_block(flown(3, 5))
    found = snoop_block(adjusted)
    kind = ObservationClass(2, False, False, "x")
    [row] = [row for row in found.classes if row.kind == kind]
    assert 0.0 < row.model < 0.01
    assert (row.accepted, row.rejected, row.undecided) == (0, 0, 0)
    # what is next to nothing as well is no farther from it than the tolerance
    rays, axis = classify(adjusted.problem)[kind]
    assert row.beyond == (adjusted.cofactors.r[rays, axis] >= SPUR).sum() < 16
    assert row.untestable == row.observations == found.untestable == 16
    assert found.observations == adjusted.v.size
    text = text_of(snooping_document(found))
    assert [line.split()[:2] for line in text.splitlines() if line.endswith("  not testable")] == [
        ["2", "rays,"]
    ]
    assert "undecided are decided exactly, 16 cannot be tested" in text
    assert f"accept {found.observations - 16 - len(found.undecided)} and reject 0" in text
    told = snooping_document(found).to_dict()
    assert told["untestable"] == sum(one["untestable"] for one in told["classes"]) == 16


def test_columns_never_touch() -> None:
    found = snoop_block(adjust_block(flown(2, 4, errors=3)))
    many = [row._replace(accepted=12345678, beyond=10**12) for row in found.classes]
    usual, large = (
        text_of(snooping_document(one)) for one in (found, wild(replace(found, classes=many)))
    )
    rows = slice(3, 3 + len(found.classes))
    assert words(usual)[rows] == words(large)[rows]


def test_names_cannot_control_the_terminal() -> None:
    block = flown(2, 4, errors=3)
    rows = tuple(replace(r, point=f"{r.point}\x1b[31m") for r in block.image_points)
    control = tuple(replace(c, point=f"{c.point}\x1b[31m") for c in block.control)
    adjusted = adjust_block(replace(block, image_points=rows, control=control))
    text = text_of(snooping_document(snoop_block(adjusted)))
    text += text_of(correlations_document(correlated_rays(adjusted, 0.9), 0.9))
    assert "\\x1b[31m" in text
    assert "\x1b" not in text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--snooping-tolerance", "100"], "must lie below 100"),
        (["--snooping-tolerance", "-3"], "is no positive number"),
        (["--correlations", "1.5"], "is no correlation"),
        (["--correlations", "0"], "is no positive number"),
        (["--correlations", "nan"], "is no positive number"),
    ],
)
def test_options_that_make_no_sense(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["adjust", str(tmp_path), *options]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_the_command_line_prints_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = written(tmp_path / "b", flown(2, 4, errors=3))
    options = ["--snooping", "--snooping-tolerance", "10", "--correlations", "0.95"]
    assert main(["adjust", str(folder), *options]) == 0
    out = capsys.readouterr().out
    assert "k_q 10 %" in out
    assert "0.95 or more" in out


INTERRUPTED = """
import sys, time
from anaplot.cli import main
from anaplot.report import progress

progress._FIRST = progress._EVERY = 0.0
show = progress.ProgressLine.__call__

def shown(self, what, fraction):
    show(self, what, fraction)
    # in the middle of the work, until the interrupt comes; one long wait would not do, as
    # an interrupt that comes just before it is only looked at after it
    while what == "factor":
        time.sleep(0.01)

progress.ProgressLine.__call__ = shown
sys.exit(main(["adjust", sys.argv[1], "--snooping"]))
"""


def test_an_interrupt_in_the_middle_leaves_one_line(tmp_path: Path) -> None:
    folder = written(tmp_path / "b", flown(2, 4))
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    master, slave = pty.openpty()
    try:
        with (
            (tmp_path / "out").open("wb") as out,
            running(
                [sys.executable, "-c", INTERRUPTED, folder],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=slave,
            ) as process,
        ):
            os.close(slave)
            told = b""
            while b"factor" not in told:
                told += os.read(master, 4096)
            process.send_signal(signal.SIGINT)
            code = process.wait(WAIT)
        with contextlib.suppress(OSError):  # so ends a terminal that nobody holds any more
            while more := os.read(master, 4096):
                told += more
    finally:
        os.close(master)
    text = told.decode()
    assert code == 130, text
    assert (tmp_path / "out").read_bytes() == b""
    # the progress line is gone, and one line says what happened
    assert re.search(r"\r +\ranaplot: interrupted: factor( \d+ %)?, after [\d.]+ s\r\n$", text)
    assert text.count("\n") == 1
    assert "Traceback" not in text
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
