"""`anaplot status` of a block without strips, and pages in px where pixels have no size."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anaplot.cli import main
from anaplot.exchange.blockfolder import read_block, write_block, write_control
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    Photo,
    Precision,
    TestSettings,
    in_pixels,
)
from anaplot.report.astext import page_text
from anaplot.report.document import (
    Column,
    Document,
    Line,
    Listed,
    Value,
    name,
    named,
    number,
    say,
    table,
)
from anaplot.report.lengthunits import with_lengths_of, without_pixel_size
from tests.exchange.formats.colmapsamples import sample


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block of 6 photos of three cameras, without control, brought in from COLMAP."""
    at = tmp_path_factory.mktemp("imported")
    sample().write(at / "in")
    assert main(["import", str(at / "in"), "-o", str(at / "b")]) == 0
    return at / "b"


def test_it_says_at_once_what_it_is(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = read_block(folder).image_points
    counting = [row for row in rows if row.use == "xy"]
    points = {row.point for row in counting}
    assert main(["status", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    there = found["contents"]
    assert (there["photos"], there["oriented"], there["rays"]) == (6, 6, len(rows))
    assert there["off"] == len(rows) - len(counting) > 0
    assert there["points"] == len(points)
    assert there["mean_rays"] == len(counting) / len(points)
    assert (there["control"], there["check"], there["in_pixels"]) == (0, 0, True)
    assert [camera["photos"] for camera in there["cameras"]] == [2, 2, 2]
    assert there["cameras"][1]["lens"] == ["k1", "k2", "p1", "p2", "b1"]
    assert found["next"]["do"] == "adjust"
    assert found["next"]["command"] == f"anaplot adjust {folder} --datum free"
    assert main(["status", str(folder)]) == 0
    page = capsys.readouterr().out
    assert f"6 photos, {len(rows)} rays, {len(points)} points with " in page
    assert f"{there['off']} rays do not count" in page
    assert "no control" in page
    assert "measured in pixels; approximate orientations of all photos" in page
    assert "cameras: 3, 2 photos, c 1500.0 px, 2000 x 1500 px, lens k1 k2; 7, " in page
    assert f"NEXT: adjust the block: anaplot adjust {folder} --datum free" in page
    assert " px" in next(line for line in page.splitlines() if "sigma0" in line)


def test_without_control_adjust_proposes_a_free_datum(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["adjust", str(folder)]) == 4
    assert "adjust --datum free needs none" in capsys.readouterr().err
    assert main(["adjust", str(folder), "--datum", "free"]) == 0
    page = capsys.readouterr().out
    assert "a priori 1 (1 px)" in page
    assert "[um]" not in page.replace("v [px]", "")


def test_with_control_the_datum_is_no_longer_free(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = read_block(folder)
    made = sample()
    held = list(made.points.items())[:4]
    write_block(tmp_path / "b", block)
    write_control(
        tmp_path / "b", [ControlPoint(str(n), (x, y, z), (0.01,) * 3) for n, (x, y, z) in held]
    )
    assert main(["status", str(tmp_path / "b"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["contents"]["control"] == 4
    assert found["next"]["command"] == f"anaplot adjust {tmp_path / 'b'}"


def test_wrong_control_stands_before_the_rays_that_it_bends(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_block(tmp_path / "b", read_block(folder))
    places = {str(n): np.array(at) for n, at in list(sample().points.items())[:8]}
    places["3"] = places["3"] + [0.5, 0.0, 0.0]
    sigma = (0.001,) * 3
    write_control(
        tmp_path / "b", [ControlPoint(n, tuple(at.tolist()), sigma) for n, at in places.items()]
    )
    capsys.readouterr()
    assert main(["status", str(tmp_path / "b"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["block"]
    first = found["flagged_others"][0]
    assert (first["kind"], first["what"]) == ("control", "X of control point 3")
    assert main(["status", str(tmp_path / "b")]) == 0
    page = capsys.readouterr().out
    looks = [line for line in page.splitlines() if line.startswith("  look: ")]
    assert looks[0] == f"  look: X of control point 3: w {first['w']:.2f}"
    assert f"flagged and {len(found['flagged_others'])} other observation" in page
    assert main(["adjust", str(tmp_path / "b")]) == 0
    page = capsys.readouterr().out
    assert f"flagged; look at X of control point 3 (w {first['w']:.2f}) first, then at" in " ".join(
        page.split()
    )


def test_positions_that_are_priors_are_told(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All lie 5 m east of where they are: they are off by the same."""
    block = read_block(folder)
    photos = [
        replace(photo, position=(photo.position[0] + 5.0, *photo.position[1:]),
                position_sigma=(0.01,) * 3)
        for photo in block.photos
    ]  # fmt: skip
    write_block(tmp_path / "b", replace(block, photos=tuple(photos)))
    assert main(["status", str(tmp_path / "b"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["contents"]["position_priors"] == 6
    assert main(["status", str(tmp_path / "b")]) == 0
    assert "no control, priors of 6 positions\n" in capsys.readouterr().out
    held = [ControlPoint(str(n), at, (0.01,) * 3) for n, at in list(sample().points.items())[:8]]
    write_control(tmp_path / "b", held)
    assert main(["status", str(tmp_path / "b"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["block"]["offsets_advised"][0]["kind"] == "shift"
    assert main(["status", str(tmp_path / "b")]) == 0
    assert "with --gnss-shift block" in capsys.readouterr().out


def test_a_block_that_cannot_be_adjusted_is_free_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two photos without a common point: no adjustment says that the datum is free."""
    made = sample(photos=2)
    for image, kept in zip(made.images, (0, 1), strict=True):
        image.features = [f for f in image.features if f[2] is not None and f[2] % 2 == kept]
    made.write(tmp_path / "in")
    assert main(["import", str(tmp_path / "in"), "-o", str(tmp_path / "b")]) == 0
    capsys.readouterr()
    assert main(["status", str(tmp_path / "b"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["block"] is None
    assert found["contents"]["points_of_one_ray"] == found["contents"]["points"]
    assert found["next"]["command"].endswith("--datum free")


def page(block: Block) -> str:
    """Return a page of every kind of part for a block."""
    columns = (name("photo", "PHOTO"), number("", "v [um]", 1, 8, unit="um"))
    parts = (
        say("sigma0 {:.1f|um}, a priori ({} um)", 3.0, 2),
        say("{}", named([say("{:.1f|um}", 1.0), Line((Value("gum um"),))])),
        Listed((say("1 um"), say("2 um")), 1, "and {} more um"),
        table("t", columns, [("um", 4.0)], shown=("photo", "v [um]"), units=">"),
        table(
            "d", (number("mdb", "detectable", 1, 12, unit="mm", scale=1e3),), [(0.009,)], units=">"
        ),
        table(
            "s",
            (Column("", "a priori", 12, form=lambda v: f"{v[0]:.2f} {v[1]}"),),
            [((7.0, "um"),)],
        ),
    )
    return page_text(with_lengths_of(block, Document({}, parts)).page)


def test_lengths_are_in_px_where_pixels_have_no_size() -> None:
    """Words of files, and words that only end in um, stay as they are."""
    mm = Camera("c", 3.0)
    px, sized = in_pixels(mm, (4000, 3000)), in_pixels(mm, (4000, 3000), 4.5)
    block = Block("b", Precision(), TestSettings(), (px, replace(sized, id="unused")), (), ())
    of = {
        camera: replace(block, cameras=(camera, *block.cameras[1:]), photos=(Photo("1", "c"),))
        for camera in (px, sized, mm)
    }
    assert [without_pixel_size(one) for one in of.values()] == [True, False, False]
    assert not without_pixel_size(block)
    shown = page(of[px])
    assert "sigma0 3.0 px, a priori (2 px)" in shown
    assert "1.0 px, gum um" in shown
    assert "1 px" in shown
    assert "more px" in shown
    assert "v [px]" in shown
    assert "7.00 px" in shown
    assert [line.split() for line in shown.splitlines()[-5:-2]] == [["detectable"], ["px"], ["9.0"]]
    assert page(of[sized]) == page(of[mm]) == shown.replace("px", "um")
