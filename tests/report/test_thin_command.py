"""`anaplot adjust --thin R`: the page, JSON, what --apply writes and --apply-undo takes back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commandbench import run, written

import anaplot
from anaplot import cli
from anaplot.adjustment.watch import Watch
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.thinning.thinning import thin_block
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.photogrammetry.block import Block
from anaplot.planning.blockplan import BlockPlan, plan_block
from anaplot.report.astext import page_text
from anaplot.report.thinning import thinning_document


def planned() -> Block:
    """A block of 5 x 5 points a photo, with noise."""
    block = plan_block(BlockPlan(3, 4, 0.60, 0.60, 5, control_m=0.05, stereo=False)).block
    off = np.random.default_rng(4).normal(size=(len(block.image_points), 2)) * 0.005
    rows = [
        replace(row, x=row.x + x, y=row.y + y)
        for row, (x, y) in zip(block.image_points, off.tolist(), strict=True)
    ]
    return replace(block, image_points=tuple(rows))


BLOCK = planned()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return written(BLOCK, tmp_path / "block")


def same(one: object, other: object) -> bool:
    """Whether two answers are the same but for rounding."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return one == pytest.approx(other, rel=1e-6, abs=1e-9)
    return one == other


@pytest.mark.slow
@pytest.mark.parametrize("words", [[], ["--errors", "baarda"], ["--datum", "free"]])
def test_all_that_is_told_is_what_the_written_block_says(
    folder: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    if "--errors" in words:
        rows = list(read_block(folder).image_points)
        rows[100] = replace(rows[100], x=rows[100].x + 0.3)
        write_image_points(folder, rows)
    before = read_block(folder).image_points
    thin = run(capsys, folder, *words, "--thin", "0.25", "--apply")
    found = thin["thinning"]
    assert isinstance(found, dict)
    assert thin["applied"] >= found["rays_before"] - found["rays"] > 20
    datum = words if "--datum" in words else []
    anew = run(capsys, folder, *datum)
    for key in ("observations", "unknowns", "redundancy", "sigma0", "photos", "points",
                "indicators", "overlaps", "check"):  # fmt: skip
        assert same(thin[key], anew[key]), key
    taken = [row for row in thin["image_points"] if row["use"] == "xy" and not row.get("rejected")]
    again = {(row["photo"], row["point"]): row for row in anew["image_points"]}
    for row in taken:
        then = again[row["photo"], row["point"]]
        assert all(same(row[key], then[key]) for key in ("vx_um", "vy_um", "rx", "ry", "wx", "wy"))
    gone = set(found["gone"])
    rows_now = read_block(folder).image_points
    assert {row.point for row in rows_now if (row.reason or "").startswith("thin")} == gone
    assert all(row.use == "off" for row in rows_now if row.point in gone)
    # a second time there is nothing more; what was done is taken back whole
    assert run(capsys, folder, *datum, "--thin", "0.25", "--apply")["applied"] == 0
    run(capsys, folder, *datum, "--thin", "0.25", "--apply-undo")
    assert not any((row.reason or "").startswith("thin") for row in read_block(folder).image_points)
    run(capsys, folder, *datum, "--apply-undo")
    assert read_block(folder).image_points == before


def test_what_it_says_of_the_photos_is_what_both_adjustments_say(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = run(capsys, folder)
    thin = run(capsys, folder, "--thin", "0.25")
    found = thin["thinning"]
    assert thin["test"]["kind"] == "baarda"  # standard deviations by the a-priori sigma0
    more = thin["sigma0"] / before["sigma0"]
    for row, first, then in zip(found["photos"], before["photos"], thin["photos"], strict=True):
        assert row["photo"] == first["photo"] == then["photo"]
        for key, of in (("s_before", first), ("s", then)):
            s = np.sqrt(np.mean([of[axis] ** 2 for axis in ("sX", "sY", "sZ")]))
            assert row[key] == pytest.approx(s, rel=1e-9)
        assert row["s_more"] == pytest.approx(row["s"] / row["s_before"] - 1.0)
        for key, of in (("redn_before", before), ("redn", thin)):
            mine = [one for one in of["image_points"] if one["photo"] == row["photo"]]
            r = [one[axis] for one in mine for axis in ("rx", "ry") if one[axis] is not None]
            assert row[key] == pytest.approx(np.mean(r), abs=1e-7)
    s = {row["point"]: row for row in before["points"]}
    both = [
        [np.sqrt(np.mean([of[axis] ** 2 for axis in ("sX", "sY", "sZ")])) for of in pair]
        for pair in ((s[row["point"]], row) for row in thin["points"])
    ]
    first, then = np.mean(both, axis=0)
    accuracy = found["accuracy"]["points"]
    assert accuracy["ratio"] == pytest.approx(then / first, rel=1e-9)
    assert accuracy["ratio_estimated"] == pytest.approx(more * then / first, rel=1e-9)
    assert accuracy["after"] == pytest.approx(then, rel=1e-9)
    assert accuracy["ratio"] > 1.0


def test_the_page_says_what_goes_and_what_it_costs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["adjust", str(folder), "--thin"]) == 0
    out = capsys.readouterr().out
    assert "THINNING: mean redundancy number of every photo and region at least 0.3" in out
    assert "rays of" in out
    assert "points that are left" in out
    found = run(capsys, folder, "--thin")["thinning"]
    fall = max(one["redn_before"] - one["redn"] for one in found["weak"])  # type: ignore[index]
    assert fall > 0.001
    assert f"below 0.3 before, and keep all points, but lose up to {fall:.3f}: in" in " ".join(
        out.split()
    )
    assert cli.main(["adjust", str(folder), "--thin", "0.9999999"]) == 0
    out = capsys.readouterr().out
    assert "  no point can go" in out
    assert "region at least 0.9999999" in out
    assert "below 0.9999999 before, and keep all points: in" in out


def test_a_search_that_was_stopped_at_once_says_only_that() -> None:
    before = adjust_block(BLOCK)
    watch = Watch()
    watch.stop()
    page = page_text(thinning_document(thin_block(before, 0.3, watch=watch)).page)
    assert "ended early: more points could go" in page
    assert "no point can go" not in page


def test_what_is_taken_back_is_not_thinned_again(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, folder, "--thin", "0.25", "--apply")
    answer = run(capsys, folder, "--apply-undo", "--thin")
    assert "thinning" not in answer
    assert len(answer["points"]) == len({row.point for row in BLOCK.image_points})
    assert read_block(folder).image_points == BLOCK.image_points


@pytest.mark.parametrize("value", ["0", "1", "-0.3", "nan", "much", "1e400"])
def test_a_limit_that_is_none(folder: Path, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["adjust", str(folder), f"--thin={value}"]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "--thin" in said
    with pytest.raises(InputError, match="--thin"):
        anaplot.adjust(folder, thin=value)  # type: ignore[arg-type]


def test_points_that_options_name_stay(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gone = run(capsys, folder, "--thin", "0.25")["thinning"]["gone"]  # type: ignore[index]
    a, b, c, d = gone[:4]
    photo = next(row.photo for row in BLOCK.image_points if row.point == d)
    answer = run(
        capsys, folder, "--thin", "0.25", "--function", f"distance {a} {b}", "--test-set",
        f"point:{c}", "--plant", f"{photo}:{d}:x:1", "--covariance", f"points:{a}", "points",
    )  # fmt: skip
    left = answer["thinning"]["gone"]  # type: ignore[index]
    assert left
    assert not {a, b, c, d} & set(left)


def test_programs_have_it_as_objects() -> None:
    found = anaplot.adjust(BLOCK, thin=0.25)
    thinning = found.result.thinning
    assert thinning is not None
    assert found.result.block is thinning.block
    assert found.to_dict()["thinning"]["gone"] == list(thinning.gone)
    columns = found.to_columns("thinning")
    assert columns["rays"].sum() == len(thinning.block.problem.photo)
    assert anaplot.adjust(BLOCK).result.thinning is None
