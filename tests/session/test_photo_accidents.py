"""Photographs under each other's name, turned, or mirrored: told by how they lie."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sessionscene import Scene
from syntheticblocks import synthetic_block

from anaplot.cli import main
from anaplot.errors import NotComputableError
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.photogrammetry.block import Block, ImagePoint, Strip
from anaplot.photogrammetry.photolayout import laid_out, overlap
from anaplot.report import adjustcommand
from anaplot.session.accidents import accidents
from anaplot.session.modelstate import Measured
from anaplot.session.photoaccidents import photo_accidents, with_photos_exchanged
from anaplot.session.transfer import Transfer


@cache
def measured(strips: int, photos: int, seed: int = 1) -> Block:
    """Strips flown to and fro over relief, every ray measured once, noise of 5 um."""
    made = synthetic_block(strips, photos, seed=seed)
    rng = np.random.default_rng(seed)
    rows = tuple(
        ImagePoint(photo, point, *(np.array(at) + rng.normal(0.0, 0.005, 2)).tolist())
        for photo, points in made.truth.items()
        for point, at in points.items()
    )
    return replace(made.block, image_points=rows)


def changed(block: Block, photo: str, how: Callable[[ImagePoint], ImagePoint]) -> Block:
    rows = tuple(how(r) if r.photo == photo else r for r in block.image_points)
    return replace(block, image_points=rows)


@pytest.mark.parametrize(
    ("strips", "photos", "unnamed", "two"), [(2, 3, 2, 0), (2, 4, 0, 4), (1, 6, 0, 0), (3, 5, 0, 6)]
)
@pytest.mark.slow
def test_every_exchange_of_two_photos_is_named(
    strips: int, photos: int, unnamed: int, two: int
) -> None:
    block = measured(strips, photos)
    assert photo_accidents(block) == ()
    alone = or_else = nothing = 0
    pairs = list(combinations([p.id for p in block.photos], 2))
    for pair in pairs:
        found = photo_accidents(with_photos_exchanged(block, *pair))
        if not found:
            nothing += 1
            continue
        (one,) = found
        assert one.kind == "exchanged"
        named = set(one.photos) == set(pair)
        if ", or " in one.text:
            # what is the same but for the strip's direction: the other half of the strip
            or_else += 1
            assert named or f"{pair[0]} and {pair[1]}" in one.text
        else:
            alone += 1
            assert named
    # the ends of a strip of three; 1-5 or 2-4 of five, 1-4 or 2-3 of four; of six it takes three
    assert (nothing, or_else, alone) == (unnamed, two, len(pairs) - unnamed - two)


@pytest.mark.parametrize(
    ("how", "kind", "words"),
    [
        (lambda r: replace(r, x=-r.x, y=-r.y), "turned", "is turned by 180 degrees"),
        (lambda r: replace(r, x=r.y, y=-r.x), "turned", "is turned by 90 degrees"),
        (lambda r: replace(r, x=-r.x), "mirrored", "is mirrored"),
        (lambda r: replace(r, y=-r.y), "mirrored", "is mirrored"),
    ],
)
def test_a_photo_that_is_turned_or_mirrored_is_named(how, kind: str, words: str) -> None:
    block = measured(2, 4)
    for photo in (p.id for p in block.photos):
        (one,) = photo_accidents(changed(block, photo, how))
        assert (one.kind, one.photos) == (kind, (photo,))
        assert one.text.startswith(f"photo {photo} {words}")


def test_a_photo_that_is_another_one_is_named() -> None:
    block = measured(1, 6)
    rows = tuple(
        replace(r, photo="105") if r.photo == "106" else r
        for r in block.image_points
        if r.photo != "105"
    )
    (one,) = photo_accidents(replace(block, image_points=rows))
    assert (one.kind, one.photos) == ("elsewhere", ("105",))
    assert "lies 1.0 bases from where strip 1 has it" in one.text


def test_overlaps_that_vary_and_a_gap_are_no_accident() -> None:
    block = measured(1, 6)
    strip = replace(block.strips[0], photos=("101", "102", "104", "105", "106"))
    rows = tuple(r for r in block.image_points if r.photo != "103")
    assert photo_accidents(replace(block, strips=(strip,), image_points=rows)) == ()
    assert photo_accidents(replace(block, strips=())) == ()
    assert photo_accidents(replace(block, image_points=())) == ()


def renamed(block: Block, names: dict[str, str]) -> Block:
    rows = tuple(replace(r, photo=names.get(r.photo, r.photo)) for r in block.image_points)
    return replace(block, image_points=rows)


@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize(("strips", "photos"), [(1, 6), (1, 8), (2, 5), (2, 6)])
def test_a_photo_that_is_missing_accuses_no_other(strips: int, photos: int, declared: bool) -> None:
    block = measured(strips, photos)
    for missing in block.strips[0].photos:
        rows = tuple(r for r in block.image_points if r.photo != missing)
        order = block.strips
        if not declared:
            order = tuple(
                replace(s, photos=tuple(p for p in s.photos if p != missing)) for s in order
            )
        assert photo_accidents(replace(block, strips=order, image_points=rows)) == ()


def ring(photos: int, tilt: float) -> Block:
    """Photographs around an object of which every one has all points."""
    points = np.random.default_rng(3).normal(0.0, 3.0, (60, 3))
    rows = []
    for k in range(photos):
        along = 2.0 * np.pi * k / photos
        place = 20.0 * np.array([np.cos(along), np.sin(along), np.tan(tilt)])
        back = place / np.linalg.norm(place)
        right = np.array([-np.sin(along), np.cos(along), 0.0])
        x, y, z = np.array([right, np.cross(back, right), back]) @ (points - place).T
        for i, at in enumerate(zip(-150.0 * x / z, -150.0 * y / z, strict=True)):
            rows.append(ImagePoint(f"{101 + k}", f"p{i}", *map(float, at)))
    strip = Strip("1", tuple(f"{101 + k}" for k in range(photos)))
    return replace(measured(1, 4), strips=(strip,), image_points=tuple(rows))


@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("photos", [8, 12, 24])
def test_convergent_photos_are_not_accused(photos: int, tilt: float) -> None:
    assert photo_accidents(ring(photos, tilt)) == ()


def turned_by(block: Block, photos: set[str], angle: float) -> Block:
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    rows = tuple(
        replace(r, x=float(c * r.x - s * r.y), y=float(s * r.x + c * r.y))
        if r.photo in photos
        else r
        for r in block.image_points
    )
    return replace(block, image_points=rows)


def test_cameras_that_are_rolled_on_purpose_are_not_accused() -> None:
    block = measured(1, 8)
    for rolled in ({"102", "104", "106", "108"}, {"101", "105", "106", "107"}):
        assert photo_accidents(turned_by(block, rolled, 90.0)) == ()


def test_what_every_model_is_promised_for_is_not_turned_and_the_angle_is_told() -> None:
    block = measured(1, 6)
    assert photo_accidents(turned_by(block, {"103"}, 50.0)) == ()
    (one,) = photo_accidents(turned_by(block, {"103"}, 74.0))
    said = int(one.text.split(" degrees")[0].split()[-1])
    assert abs(said - 74) < 8  # tilts and relief turn the others, too


@pytest.mark.parametrize(("strips", "photos"), [(1, 8), (2, 8), (1, 12)])
def test_two_exchanges_in_a_strip_are_two_and_not_alternatives(strips: int, photos: int) -> None:
    names = {"102": "103", "103": "102", "106": "107", "107": "106"}
    found = photo_accidents(renamed(measured(strips, photos), names))
    assert [(one.kind, one.photos, one.alternatives) for one in found] == [
        ("exchanged", ("102", "103"), ()),
        ("exchanged", ("106", "107"), ()),
    ]


def test_of_a_strip_alone_both_pairs_are_there_for_programs() -> None:
    (one,) = photo_accidents(with_photos_exchanged(measured(1, 4), "102", "103"))
    assert sorted(one.pairs) == [("101", "104"), ("102", "103")]


@pytest.mark.parametrize(("strips", "photos"), [(1, 6), (2, 5)])
def test_three_names_in_a_circle_give_the_order_of_the_points(strips: int, photos: int) -> None:
    names = {"102": "103", "103": "104", "104": "102"}
    (one,) = photo_accidents(renamed(measured(strips, photos), names))
    assert (one.kind, one.photos, one.strips) == ("order", ("102", "103", "104"), ("1",))
    assert "strip 1 does not run straight on" in one.text
    assert "follow as 101 103 104 102 105" in one.text


def test_an_exchange_keeps_the_models_that_the_strip_has_and_every_row() -> None:
    block = measured(1, 5)
    order = block.strips[0].photos
    rows = tuple(
        replace(r, model=f"{order[k]}/{order[k + 1]}")
        for r in block.image_points
        for k in (order.index(r.photo) - 1, order.index(r.photo))
        if 0 <= k < 4
    )
    block = replace(block, image_points=rows)
    for first, second in combinations(order, 2):
        right = with_photos_exchanged(block, first, second).image_points
        assert len({(r.photo, r.point, r.model) for r in right}) == len(right) == len(rows)
        assert all(r.model is None or r.photo in r.model.split("/") for r in right)
        if (first, second) == ("101", "103"):
            # 101/102 and 102/103 have become each other
            assert sum(r.model == "102/103" for r in right) >= sum(
                r.model == "101/102" for r in rows
            )


places = st.lists(
    st.tuples(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0)), min_size=4, max_size=9
)


@given(places, st.floats(-3.0, 3.0), st.floats(-90.0, 90.0))
def test_a_turn_and_a_shift_leave_nothing(at: list[tuple[float, float]], by: float, dx: float):
    first = np.array(at)
    z = (first @ np.array([1.0, 1.0j])) * np.exp(-1j * by) + dx
    found = overlap(first, np.column_stack([z.real, z.imag]))
    assert found.points == len(at)
    assert found.misfit <= 1e-4
    size = np.abs(first - first.mean(axis=0)).max()
    if not found.mirrored and size > 1.0:
        assert np.cos(found.angle - by) > 1.0 - 1e-6


@pytest.mark.parametrize("mirrored", [False, True])
def test_two_photos_lie_as_their_overlap_has_it(mirrored: bool) -> None:
    rng = np.random.default_rng(3)
    at = rng.uniform(-100.0, 100.0, (9, 2)) + np.array([0.0, 700.0])
    turned = (at - (60.0, 690.0)) @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    other = turned + rng.normal(0.0, 1.0, (9, 2))
    other[:, 1] *= -1.0 if mirrored else 1.0
    rows = [ImagePoint("b", str(k), *here) for k, here in enumerate(at.tolist())]
    rows += [ImagePoint("a", str(k), *here) for k, here in enumerate(other.tolist())]
    # what is off, what only one has, and the second row of a point say nothing
    rows.insert(0, ImagePoint("b", "0", 0.0, 0.0, use="off"))
    rows += [ImagePoint("a", "alone", 0.0, 0.0), ImagePoint("a", "1", 0.0, 0.0, model="a/b")]
    found, laid = overlap(other, at), laid_out(rows)
    assert found.mirrored == mirrored == (laid["a"].mirrored != laid["b"].mirrored)
    assert (laid["a"].angle, laid["b"].angle) == (0.0, pytest.approx(found.angle, abs=1e-12))
    mine = other.mean(axis=0) - (laid["b"].x, laid["b"].y)
    x, y = at.mean(axis=0)
    z = complex(x, -y if mirrored else y) * np.exp(1j * found.angle)
    np.testing.assert_allclose(mine, (z.real, z.imag), atol=1e-10)
    assert laid["b"].spread == pytest.approx(np.hypot(*(at - at.mean(axis=0)).T).mean())


def test_photos_are_laid_out_where_they_were_exposed() -> None:
    block = measured(2, 4)
    at = laid_out(block.image_points)
    for strip in block.strips:
        xy = np.array([(at[p].x, at[p].y) for p in strip.photos])
        steps = np.hypot(*np.diff(xy, axis=0).T)
        # relief and tilts: a tenth of the base
        np.testing.assert_allclose(steps, 92.0, atol=14.0)


@pytest.mark.slow
@pytest.mark.parametrize("common", [None, 0, 1, 3])
def test_photos_with_few_points_in_common_are_not_laid_out(
    common: int | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    block = measured(1, 3)
    shared = [row.point for row in block.image_points if row.photo == "102"]
    shared = [p for p in shared if (p, "101") in {(r.point, r.photo) for r in block.image_points}]
    kept = set(shared[: common or 0])
    rows = tuple(
        row
        for row in block.image_points
        if row.photo == "101" or (common is not None and row.photo == "102" and row.point in kept)
    )
    assert laid_out(rows) == {}
    written(tmp_path / "b", replace(block, image_points=rows))
    assert main(["status", str(tmp_path / "b")]) == 0
    assert "101" in capsys.readouterr().out
    # control makes a photo by itself
    assert main(["adjust", str(tmp_path / "b")]) in (0, 4)


@pytest.mark.slow
def test_the_commands_name_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "b"
    block = with_photos_exchanged(measured(2, 5), "102", "103")
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)
    words = "photos 102 and 103 exchanged? By their points the photos of strip 1 follow as 101 103"
    main(["bridge", str(folder)])
    assert f"{words} 102 104 105: with the two exchanged 4 of 4 models" in capsys.readouterr().out
    for command in ("adjust", "status", "bridge"):
        main([command, str(folder), "--json"])
        (one,) = json.loads(capsys.readouterr().out)["photo_accidents"]
        assert (one["kind"], one["photos"], one["strips"]) == ("exchanged", ["102", "103"], ["1"])
        main([command, str(folder)])
        assert words in capsys.readouterr().out
    # photographs without common points cannot be bridged: the reason is named
    far = with_photos_exchanged(measured(2, 5), "101", "105")
    write_image_points(folder, far.image_points)
    assert main(["bridge", str(folder)]) == 2
    assert "have no common points; photos 101 and 105" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        (lambda x, y: (x, y), ""),
        (lambda x, y: (-x, -y), "photos 102 and 103 are turned against each other by 180 degrees"),
        (lambda x, y: (x, -y), "one of photos 102 and 103 is mirrored"),
        (lambda x, y: (x - 100.0, y), "photos 102 and 103 lie 2."),
    ],
)
def test_a_wrong_photo_in_the_instrument_is_told_while_one_measures(seen, words: str) -> None:
    scene = Scene(3)
    state = scene.chosen(1)
    for planned in state.current.plan:
        event = scene.measurement(state, planned.point)
        xr, yr = seen(event.xr, event.yr)
        model = state.current
        state = replace(
            state,
            current=replace(
                model,
                measured=(
                    *model.measured,
                    Measured(planned.point, event.xl, event.yl, xr, yr, 1),
                ),
            ),
        )
        told = [one.text for one in accidents(state, Transfer()) if not one.point]
        if len(state.current.measured) < 5 or not words:
            assert told == []
    assert [one.startswith(words) for one in told] == ([True] if words else [])


def written(folder: Path, block: Block) -> None:
    write_new_block(folder, block)
    write_image_points(folder, block.image_points)
    write_control(folder, block.control)


@pytest.mark.slow
def test_bridge_says_what_every_pair_would_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "one", with_photos_exchanged(measured(1, 4), "102", "103"))
    main(["bridge", str(tmp_path / "one"), "--json"])
    (one,) = json.loads(capsys.readouterr().out)["photo_accidents"]
    (other,) = one["alternatives"]
    assert {*one["photos"], *other["photos"]} == {"101", "102", "103", "104"}
    for pair in (one, other):
        assert (pair["exchanged"]["models"], pair["exchanged"]["of"]) == (3, 3)
        assert 2.0 < pair["exchanged"]["sigma0_um"] < 10.0  # of 5 um
    main(["bridge", str(tmp_path / "one")])
    said = capsys.readouterr().out
    assert "with 101 and 104 exchanged 3 of 3" in said
    assert "with 102 and 103 exchanged 3 of 3" in said
    # what cannot be begun has the cure in its error
    written(tmp_path / "far", with_photos_exchanged(measured(2, 5), "101", "105"))
    assert main(["bridge", str(tmp_path / "far")]) == 2
    assert "with 101 and 105 exchanged 4 of 4 models are computed" in capsys.readouterr().err
    # and one that is sound says so
    written(tmp_path / "sound", measured(2, 4))
    for command in ("bridge", "status", "adjust"):
        main([command, str(tmp_path / "sound"), "--json"])
        assert json.loads(capsys.readouterr().out)["photo_accidents"] == []


def test_adjust_names_what_keeps_it_from_a_solution_and_no_turned_photo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    block = measured(2, 4)
    written(tmp_path / "turned", turned_by(block, {"203"}, 180.0))
    assert main(["adjust", str(tmp_path / "turned"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["photo_accidents"] == []

    def unsolved(*_: object, **__: object) -> None:
        raise NotComputableError("no minimum")  # which takes a minute to find out

    monkeypatch.setattr(adjustcommand, "adjust_block", unsolved)
    written(tmp_path / "mirrored", changed(block, "203", lambda r: replace(r, x=-r.x)))
    assert main(["adjust", str(tmp_path / "mirrored")]) == 4
    said = capsys.readouterr().err
    assert "no minimum; photo 203 is mirrored against the others of strip 2" in said
    assert main(["adjust", str(tmp_path / "turned")]) == 4
    assert capsys.readouterr().err.strip().endswith("no minimum")


def test_status_goes_to_the_photos_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "b", with_photos_exchanged(measured(2, 5), "203", "204"))
    main(["status", str(tmp_path / "b"), "--json"])
    step = json.loads(capsys.readouterr().out)["next"]
    assert (step["do"], step["model"], step["photo"]) == ("return", "202/203", "203")
    main(["status", str(tmp_path / "b")])
    assert "NEXT: return to model 202/203, photo 203: anaplot open " in capsys.readouterr().out
