"""The five lines of a block's report: each says what it should of a block of its kind."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import anaplot
from anaplot.cli import main
from anaplot.orientation.strip import bridge, orient
from anaplot.photogrammetry.block import Block
from anaplot.report.astext import line_text, page_text
from anaplot.report.html.judgement import mean_deviations, points_of_two_photos
from anaplot.report.html.sections.verdict import verdict_lines
from anaplot.report.statuscommand import adjusted_status


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Block:
    """Two strips of four photos, error-free coordinates, each point in four photos and more."""
    folder = tmp_path_factory.mktemp("verdict") / "block"
    options = ("--strips", "2", "--photos", "4", "--sidelap", "60", "--to", str(folder))
    assert main(["plan", "block", *options]) == 0
    return anaplot.read_block(folder)


def noisy(block: Block, um: float = 5.0, seed: int = 4, **wrong: float) -> Block:
    """Return a block with noise, and errors [mm] in y of rays PHOTO_POINT."""
    rng = np.random.default_rng(seed)
    rows = []
    for row in block.image_points:
        x, y = rng.normal(size=2) * um / 1e3
        y += wrong.get(f"p{row.photo}_{row.point}".replace("-", "_"), 0.0)
        rows.append(replace(row, x=row.x + x, y=row.y + y))
    return replace(block, image_points=tuple(rows))


def said(block: Block, **options: Any) -> list[str]:
    found = anaplot.adjust(block, **options).result
    status, _ = adjusted_status(None, block, found.block)
    lines = verdict_lines(found, status)
    assert len(lines) == 5
    assert [line_text(line).split(":")[0] for line in lines] == [
        "Sound",
        "Wrong",
        "Unchecked",
        "Accuracy",
        "Next",
    ]
    return [line_text(line) for line in lines]


def wrong_control(block: Block, point: str, metres: float, *, use: str = "control") -> Block:
    """Return a block with X and Z of a given point wrong."""
    control = tuple(
        replace(row, use=use, xyz=(row.xyz[0] + metres, row.xyz[1], row.xyz[2]))
        if row.point == point
        else row
        for row in block.control
    )
    assert control != block.control
    return replace(block, control=control)


def one_model(block: Block, *points: str) -> Block:
    """Return a stereo pair, of these points."""
    rows = tuple(
        row for row in block.image_points if row.model == "101/102" and row.point in points
    )
    return replace(block, image_points=rows, control=(), strips=(), photos=block.photos[:2])


def of_kind(block: Block, kind: str) -> Block:
    return replace(block, test=replace(block.test, kind=kind))


FIVE = ("01-01", "01-02", "02-01", "02-02", "03-01")
SOUND = r"Sound: Yes: no observation of the \d+ that can be tested is flagged"
ROW = "y of point 03-03 in photo 104"
GIVEN = "plan of control point 03-01 differs by"
LARGER = r"sigma0 .* um is larger than the 5 um a priori"
CASES: dict[str, tuple[Any, dict[str, Any], str, str, str]] = {
    "clean": (
        noisy,
        {},
        SOUND + r".*; sigma0 .* is not significantly larger than the 5 um a priori",
        "Nothing shows in what is checked$",
        "Nothing has to be measured again; check points would prove the coordinates$",
    ),
    "one gross ray": (
        lambda block: noisy(block, p104_03_03=0.12),
        {},
        r"Sound: No: \d+ of \d+ observations flagged",
        ROW + r" \(model 103/104\) \(w [\d.]+\); \d+ others are flagged, which it may explain",
        r"Measure point 03-03 in photo 104 again \(y first\)",
    ),
    "the same without it": (
        lambda block: noisy(block, p104_03_03=0.12),
        {"errors": "search"},
        SOUND + r".*, without 1 rejected observation; ",
        f"1 gross observation was rejected: {ROW}$",
        "Measure again what was rejected, or .* adjust --errors search --apply$",
    ),
    "wrong control": (
        lambda block: noisy(wrong_control(block, "03-01", 2.0)),
        {},
        "Sound: No: ",
        GIVEN + r" .* m \(s .* m\); \d+ others are flagged, which it may explain",
        "Look at control point 03-01: its given plan",
    ),
    "nothing redundant": (
        lambda block: noisy(one_model(block, *FIVE)),
        {"datum": "free"},
        "Sound: Nobody can tell: redundancy 0, no test is possible$",
        "Nothing shows in what is checked$",
        "Measure more points, or in more photos: nothing is redundant$",
    ),
    "almost nothing tested": (
        lambda block: one_model(block, *FIVE, "03-02"),
        {"datum": "free"},
        r"Sound: With doubts: no observation of the \d+ that can be tested is flagged \(of 24\); "
        r"but .*\d+ of the observations nothing checks",
        "",
        "",
    ),
    "noise far below": (
        lambda block: noisy(block, um=1.0),
        {},
        "Sound: With doubts: .*but sigma0 .* um is smaller than the 5 um a priori .* see less",
        "the images are measured better than image_um states, or it is too large$",
        r"Find out how well the images are measured, and state it \(\[precision\] image_um\)$",
    ),
    "noise far above": (
        lambda block: noisy(block, um=15.0),
        {},
        "Sound: No: .*" + LARGER,
        LARGER + r" \(test at 5 %\), and none of the \d+ flagged stands out$",
        r"Find out why the images are measured worse than stated, or state it \(\[precision\]",
    ),
    "noise above, sigma0 unknown": (
        lambda block: noisy(of_kind(block, "tau"), um=15.0),
        {},
        "Sound: With doubts: .*but " + LARGER,
        LARGER + ".*no single observation stands out$",
        "Find out why the images are measured worse",
    ),
    "wrong check point": (
        lambda block: noisy(wrong_control(block, "03-01", 2.0, use="check")),
        {},
        "Sound: With doubts: .*but tests reject given coordinates$",
        r"plan of check point 03-01 differs by 2\..* m \(s 0\..* m\)$",
        "Look at check point 03-01: its given plan",
    ),
    "free datum": (
        noisy,
        {"datum": "free"},
        SOUND,
        "Nothing shows in what is checked$",
        "Nothing has to be measured again$",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_verdict_is_that_of_the_block(planned: Block, case: str) -> None:
    made, options, *expected = CASES[case]
    sound, wrong, _, _, following = said(made(planned), **options)
    for line, pattern in zip((sound, wrong[7:], following[6:]), expected, strict=True):
        assert re.match(pattern, line), line


def test_nobody_but_the_wrong_ray_and_its_control_is_accused(planned: Block) -> None:
    for block, accused in (
        (noisy(planned, p104_03_03=0.12), "03-03"),
        (noisy(wrong_control(planned, "03-01", 2.0)), "03-01"),
    ):
        _, wrong, _, _, following = said(block)
        named = {row.point for row in block.image_points if row.point in wrong + following}
        assert named == {accused}


def test_the_accuracy_is_that_of_new_points_with_the_sigma_of_the_tests(planned: Block) -> None:
    for kind in ("tau", "baarda"):
        found = anaplot.adjust(noisy(of_kind(planned, kind), um=15.0)).result.block
        assert found.sigma is not None
        given = {row.point for row in planned.control}
        new = [row.s_xyz for row in found.point_rows() if row.point not in given]
        mean = np.mean(np.array(new, dtype=float), axis=0)
        assert mean_deviations(found) == pytest.approx(tuple(mean))
    tau, baarda = (said(noisy(of_kind(planned, kind), um=15.0))[3] for kind in ("tau", "baarda"))
    assert tau.endswith("on average, by the estimated sigma0")
    assert re.search(r"by the a-priori sigma0 \((2|3)\.\d+ times that by the estimated", baarda)


def test_photos_of_a_point_are_counted_once_and_without_what_is_rejected(planned: Block) -> None:
    # each point of a pair of models is measured in a photograph once for each
    photos: dict[str, set[str]] = {}
    for row in planned.image_points:
        photos.setdefault(row.point, set()).add(row.photo)
    two = sum(len(of) < 3 for of in photos.values())
    assert points_of_two_photos(anaplot.adjust(noisy(planned)).result.block) == two > 0
    point = next(name for name, of in photos.items() if len(of) == 3)
    last = max(photos[point])
    off = tuple(
        replace(row, use="off", reason="blurred")
        if (row.photo, row.point) == (last, point)
        else row
        for row in noisy(planned).image_points
    )
    found = anaplot.adjust(replace(planned, image_points=off)).result.block
    assert points_of_two_photos(found) == two + 1


def test_a_good_close_range_block_is_sound(tmp_path: Path) -> None:
    options = ("network", "cube", "--case", "D", "--to", str(tmp_path / "block"))
    assert main(["plan", *options]) == 0
    block = anaplot.read_block(tmp_path / "block")
    sound, wrong, _, accuracy, _ = said(noisy(block, seed=1))
    assert re.match(SOUND, sound)
    assert wrong == "Wrong: Nothing shows in what is checked"
    assert re.search(r"of 1\.3 mm in X, 6\.4 mm in Y and 1\.3 mm in Z", accuracy)
    # at .001 one of its 216 observations is flagged in a fifth of such blocks
    sound, wrong, *_ = said(noisy(block, seed=4))
    assert sound.startswith("Sound: With doubts: 1 of 216 observations flagged (0.2 of good ones")
    assert "by chance, so that it may be); sigma0" in sound


def test_deviations_of_tenths_of_millimetres_have_two_digits(tmp_path: Path) -> None:
    options = ("network", "cube", "--case", "C", "--to", str(tmp_path / "block"))
    assert main(["plan", *options]) == 0
    found = anaplot.adjust(noisy(anaplot.read_block(tmp_path / "block")))
    ai = found.result.block.indicators()
    assert 5e-4 < ai.ai < 1e-3
    page = page_text(found.document.page)
    assert f"AI X {ai.ai_x:.6f}  Y {ai.ai_y:.6f}" in page


def test_of_a_free_datum_its_scale_is_open_and_given_points_are_compared(planned: Block) -> None:
    _, _, unchecked, accuracy, _ = said(noisy(planned), datum="free")
    words = "where it lies, and its scale: its datum is inner constraints over the points"
    assert words in unchecked
    assert re.search(
        r"; off are \d+ given coordinates in plan by .*mm \(rms\), \d+ given", accuracy
    )


def test_control_that_only_holds_the_block_is_told_as_unchecked(planned: Block) -> None:
    first, *_, last = planned.control
    other = next(row for row in planned.control if row.xyz[0] == first.xyz[0] and row != first)
    height = replace(other, xyz=(None, None, other.xyz[2]), sigma=(None, None, 0.05))
    whole = [replace(row, sigma=(0.05,) * 3) for row in (first, last)]
    block = noisy(replace(planned, control=(*whole, height)))
    _, _, unchecked, _, _ = said(block)
    names = [row.point for row in (*whole, height)]
    assert f"given coordinates of 3 points ({', '.join(names)})" in unchecked
    found = anaplot.adjust(block)
    told = found.document.answer["unchecked"]
    assert [one["what"] for one in told] == [
        f"{axis} of control point {point}"
        for point, axes in zip(names, ("XYZ", "XYZ", "Z"), strict=True)
        for axis in axes
    ]
    assert {one["mdb"] for one in told} == {None}
    assert "7 given values are checked by next to nothing" in page_text(found.document.page)


def test_check_points_are_told_beside_the_accuracy(planned: Block) -> None:
    control = tuple(
        replace(row, use="check", xyz=(*row.xyz[:2], 3.0), sigma=(0.05, 0.05, 0.05))
        if row.point == "03-01"
        else row
        for row in planned.control
    )
    sound, wrong, unchecked, accuracy, following = said(noisy(replace(planned, control=control)))
    assert sound.startswith("Sound: With doubts: ")
    assert "height of check point 03-01 differs by" in wrong
    assert "no check point" not in unchecked
    assert "1 check coordinate in height by" in accuracy
    assert following.startswith("Next: Look at check point 03-01: its given height")


def test_in_pixels_of_no_size_the_verdict_has_px(planned: Block) -> None:
    cameras = tuple(replace(one, pixels=(4000, 4000), pixel_um=None) for one in planned.cameras)
    block = noisy(replace(planned, cameras=cameras), p104_03_03=0.12)
    every: tuple[dict[str, Any], ...] = ({}, {"errors": "search"})
    for options in every:
        verdict = anaplot.block_report(anaplot.adjust(block, **options)).verdict
        told = " ".join(map(line_text, verdict))
        assert " px is " in told
        assert not re.search(r"\d [uµ]m\b", told)


def test_names_of_files_stand_in_the_page_of_a_folder(planned: Block, tmp_path: Path) -> None:
    report = anaplot.block_report(anaplot.adjust(noisy(planned)))
    written = anaplot.write_report(report, tmp_path / "r.html", tmp_path / "figures")
    assert written.size == (tmp_path / "r.html").stat().st_size
    assert {path.suffix for path in written.figures} == {".svg"}
    assert (tmp_path / "figures" / "block-map.svg") in written.figures


def test_every_strip_is_bridged_once_for_a_report(
    planned: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    formed: list[str] = []

    def counting(pair: Any, *settings: Any) -> Any:
        formed.append(f"{pair.left}/{pair.right}")
        return orient(pair, *settings)

    found = anaplot.adjust(noisy(planned))
    monkeypatch.setattr("anaplot.orientation.strip.orient", counting)
    alone = bridge(noisy(planned))
    of_bridge, formed[:] = list(formed), []
    report = anaplot.block_report(found, tmp_path)
    assert len(alone) == 2
    assert formed == of_bridge
    assert "models" in {one.key for one in report.sections}


@pytest.mark.parametrize(("um", "beyond"), [(5.0, False), (12.0, True)])
def test_the_global_test_is_no_alarm_unless_the_limit_of_one_in_twenty_is_exceeded(
    planned: Block, um: float, beyond: bool
) -> None:
    page = page_text(anaplot.adjust(noisy(planned, um)).document.page)
    said = " ".join(page.split("  global test consistent")[1].split("reliability")[0].split())
    assert ("(no alarm: " in said) != beyond
    assert said.endswith(", and this is beyond it)") == beyond


@pytest.mark.parametrize("um", [5.0, 12.0])
def test_what_is_said_above_the_tables_fits_into_80_columns(planned: Block, um: float) -> None:
    for datum in ("control", "free"):
        page = page_text(anaplot.adjust(noisy(planned, um), datum=datum).document.page)
        said = page.split("\n\n")[0]
        assert "global test" in said
        assert max(map(len, said.splitlines())) <= 80
