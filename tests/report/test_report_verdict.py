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
from anaplot.report.astext import line_text
from anaplot.report.html.sections.verdict import verdict_lines
from anaplot.report.statuscommand import adjusted_status


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Block:
    """Two strips of four photos, error-free coordinates, each point in four photos and more."""
    folder = tmp_path_factory.mktemp("verdict") / "block"
    options = ("--strips", "2", "--photos", "4", "--sidelap", "60", "--to", str(folder))
    assert main(["plan", "block", *options]) == 0
    return anaplot.read_block(folder)


def noisy(block: Block, um: float = 5.0, **wrong: float) -> Block:
    """Return a block with noise, and errors [mm] in y of rays PHOTO_POINT."""
    rng = np.random.default_rng(4)
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


def test_a_good_block_is_sound_and_lacks_check_points(planned: Block) -> None:
    sound, wrong, unchecked, accuracy, following = said(noisy(planned))
    assert sound.startswith("Sound: Yes: no observation of ")
    assert "is not significantly larger than the 5 um a priori" in sound
    assert wrong == "Wrong: Nothing shows in what is checked"
    assert "there is no check point" in unchecked
    assert "m in X" in accuracy
    assert following.startswith("Next: Nothing has to be measured again")


def test_a_gross_error_is_named_and_what_to_do(planned: Block) -> None:
    block = noisy(planned, p102_03_02=0.2)
    sound, wrong, _, _, following = said(block)
    assert sound.startswith("Sound: No: ")
    assert "03-02 in photo 102" in wrong
    assert "03-02" in following
    sound, wrong, _, _, following = said(block, errors="baarda")
    assert not sound.startswith("Sound: No")
    assert re.search(r", without \d rejected observations?", sound)
    assert re.match(r"Wrong: \d gross observations? (was|were) rejected, with the evidence", wrong)
    assert following.endswith("adjust --errors baarda --apply")


def test_images_worse_than_stated_are_a_doubt(planned: Block) -> None:
    tau = replace(planned, test=replace(planned.test, kind="tau"))
    sound, wrong, _, _, following = said(noisy(tau, um=15.0))
    assert sound.startswith("Sound: With doubts: ")
    assert "um is larger than the 5 um a priori" in wrong
    assert "image_um" in following


def test_check_points_that_differ_are_a_doubt(planned: Block) -> None:
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
    assert "given points that are rejected" in following


def test_a_block_that_nothing_ties_to_the_ground_says_so(planned: Block) -> None:
    _, _, unchecked, _, _ = said(noisy(replace(planned, control=())), datum="free")
    assert "where it lies: its datum is inner constraints over the points" in unchecked


def test_without_redundancy_nobody_can_tell(planned: Block) -> None:
    names = ("01-01", "01-02", "02-01", "02-02", "03-01")
    model = [row for row in planned.image_points if row.model == "101/102"]
    rows = tuple(row for row in model if row.point in names)
    few = replace(planned, image_points=rows, control=(), strips=(), photos=planned.photos[:2])
    sound, *_ = said(few, datum="free")
    assert sound == "Sound: Nobody can tell: redundancy 0, no test is possible"


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
