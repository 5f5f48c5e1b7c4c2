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

from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.photolayout import laid_out, overlap
from anaplot.planning.syntheticblock import synthetic_block
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


def test_photos_are_laid_out_where_they_were_exposed() -> None:
    block = measured(2, 4)
    at = laid_out(block.image_points)
    for strip in block.strips:
        xy = np.array([(at[p].x, at[p].y) for p in strip.photos])
        steps = np.hypot(*np.diff(xy, axis=0).T)
        # relief and tilts: a tenth of the base
        np.testing.assert_allclose(steps, 92.0, atol=14.0)


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
