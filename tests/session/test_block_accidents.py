"""One id in two places, two ids in one place: from the files as while one measures."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from test_stated_orientation import orientations
from transferscene import BlockBench, flown, marked

from anaplot.cli import main
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.session import blockaccidents
from anaplot.session.blockaccidents import block_accidents
from anaplot.session.commands import NextModel
from anaplot.session.filedaccidents import BlockAccidents
from anaplot.session.filedmodels import filed_models
from anaplot.session.tiecheck import GROUND, Known
from anaplot.session.transfer import transfer_of_strip
from anaplot.station.imagepoints import rows_of

SEED = 4


@cache
def block(seed: int = SEED) -> Block:
    """Two strips of four photos with their control, every point measured once a photo."""
    made = flown(seed)
    rng = np.random.default_rng(seed)
    rows = tuple(
        ImagePoint(photo, point, *(np.array(at) + rng.normal(0.0, 0.004, 2)).tolist())
        for photo, points in made.truth.items()
        for point, at in points.items()
    )
    return replace(made.block, image_points=rows)


def lateral(of: Block) -> list[str]:
    """Points of both strips that are no control, those in most photos first."""
    control = {c.point for c in of.control}
    photos = Counter(r.point for r in of.image_points)
    strips = {(r.point, r.photo[0]) for r in of.image_points}
    both = [p for p in photos if {(p, "1"), (p, "2")} <= strips and p not in control]
    return sorted(both, key=lambda p: -photos[p])


def changed(of: Block, name: str, /, **by: object) -> Block:
    """The block with something else of a point in the photos of the second strip."""
    rows = tuple(
        replace(r, **by) if r.point == name and r.photo.startswith("2") else r
        for r in of.image_points
    )
    return replace(of, image_points=rows)


def moved(of: Block, point: str, dx: float, dy: float) -> Block:
    rows = tuple(
        replace(r, x=r.x + dx, y=r.y + dy) if r.point == point and r.photo[0] == "2" else r
        for r in of.image_points
    )
    return replace(of, image_points=rows)


def told(found: BlockAccidents) -> dict[str, str]:
    return {one.accident.point: one.accident.text for one in found.found if one.accident.certain}


@pytest.mark.slow
def test_nothing_is_accused_where_nothing_is_wrong() -> None:
    for seed in (1, 4, 5):
        assert told(block_accidents(block(seed))) == {}


@pytest.mark.slow
def test_the_console_and_the_files_say_the_same() -> None:
    bench = BlockBench.over(flown(SEED), marked(flown(SEED)), SEED).block(4)
    bench.give(NextModel())
    while pending := bench.desk.mode.pending:
        bench.point_at(pending[0])
    wrong = next(o.planned.point for o in bench.offers if o.mark == "lateral")
    bench.off = {(bench.desk.state.current.left, wrong): (2.5, 1.5)}
    bench.point_at(wrong)
    state = bench.desk.state
    rows = rows_of((*state.models, state.current))
    given = replace(bench.made.block, image_points=rows)
    (one,) = (a for a in block_accidents(given).found if a.accident.certain)
    assert one.accident in bench.desk.accidents
    assert (one.strip, one.model) == ("2", state.current.name)
    models = filed_models(given)
    assert [(m.name, {p.point: p.role for p in m.plan if p.role == "tie"}) for m in models] == [
        (m.name, {p.point: "tie" for p in m.plan if p.role == "tie" and m.measurement(p.point)})
        for m in (*state.models, state.current)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("known_orientations", [False, True])
def test_places_far_from_what_is_measured_are_not_told_and_the_others_are_the_same(
    known_orientations: bool,
) -> None:
    of = block()
    for name in lateral(of)[1::2]:
        of = changed(of, name, point=f"{name}'")
    if known_orientations:
        # near another point by these and the control, and far from it by the other strip
        of = changed(of, "C5", point="C5'")
        of = replace(
            of,
            image_points=tuple(
                replace(r, x=r.x + 2.0) if r.point == "C5" else r for r in of.image_points
            ),
        )
        photos = orientations(SEED)
        true = tuple(
            replace(p, position=tuple(photos[p.id][0]), rotation=tuple(photos[p.id][1]))
            for p in of.photos
        )
        of = replace(of, photos=true)
    models = filed_models(of)
    before, own = (tuple(m for m in models if m.strip == strip) for strip in ("1", "2"))
    counts = []
    alone = tuple(c for c in of.control if c.point == "C5")
    for control in (of.control, (), alone):
        known = Known.of(control, None)
        whole = transfer_of_strip(of, before, own, known, len(own), np.inf)
        for reach in (0.015, 0.05, 0.4, 20.0):
            told = transfer_of_strip(of, before, own, known, len(own), reach)
            counts.append(sum(len(one.places) for one in told))
            for model, one, all_of in zip(own, told, whole, strict=True):
                there = np.array([(m.xl, m.yl, m.xr, m.yr) for m in model.used])
                close = {
                    name: (*at, sigma)
                    for name, (at, sigma) in all_of.places.items()
                    if (np.abs(there - at).max(axis=1) < reach).any()
                }
                assert list(one.places) == list(close)
                for name, (at, sigma) in one.places.items():
                    assert (*at, sigma) == pytest.approx(close[name], rel=1e-9, abs=1e-9)
    assert 0 < counts[0] < counts[1]


@pytest.mark.slow
def test_a_wrong_tie_interchanged_names_and_a_second_name() -> None:
    of = block()
    one, two, *_ = lateral(of)
    words = told(block_accidents(moved(of, one, 2.5, 1.5)))
    # a tie that is wrong in all photos bends its strip: others follow
    assert next(iter(words)) == one
    assert "from where strip 1 has it: another point?" in words[one]
    swapped = changed(changed(changed(of, one, point="-"), two, point=one), "-", point=two)
    words = told(block_accidents(swapped))
    assert {one, two} <= set(words)
    assert f"{one} and {two} interchanged?" in " ".join(words.values())
    # one place under two names, in one model and across strips
    second = changed(of, one, point="9001")
    texts = [a.accident.text for a in block_accidents(second).found]
    assert f"9001 lies where {one} lies: the same point under two names?" in texts
    twice = tuple(replace(r, point="9002") for r in of.image_points if r.point == two)
    both = replace(of, image_points=(*of.image_points, *twice))
    texts = [a.accident.text for a in block_accidents(both).found]
    assert any("the same point under two names?" in t and "9002" in t and two in t for t in texts)


@pytest.mark.slow
def test_wrong_control_and_what_is_switched_off() -> None:
    of = block()
    name = max(
        (c.point for c in of.control),
        key=lambda p: sum(r.point == p for r in of.image_points),
    )
    control = tuple(
        replace(c, xyz=(c.xyz[0] + 300.0, c.xyz[1] - 200.0, c.xyz[2])) if c.point == name else c
        for c in of.control
    )
    (found, *_) = block_accidents(replace(of, control=control)).found
    assert (found.accident.point, found.accident.against) == (name, GROUND)
    assert "from where the control list has it" in found.accident.text
    # a point that is off says nothing
    one = lateral(of)[0]
    off = changed(moved(of, one, 2.5, 1.5), one, use="off")
    assert told(block_accidents(off)) == {}


def test_a_strip_with_too_much_is_named_and_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blockaccidents, "MOST_MEASUREMENTS", 10)
    assert block_accidents(block()) == BlockAccidents((), ("1", "2"))


@pytest.mark.slow
def test_bridge_and_status_tell_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    of = block()
    one = lateral(of)[0]
    wrong = moved(of, one, 2.5, 1.5)
    folder = tmp_path / "b"
    write_new_block(folder, replace(wrong, image_points=(), control=()))
    write_control(folder, wrong.control)
    write_image_points(folder, wrong.image_points)

    def said(command: str, *more: str) -> str:
        assert main([command, str(folder), *more]) == 0
        return capsys.readouterr().out

    found = next(a for a in json.loads(said("bridge", "--json"))["accidents"] if a["certain"])
    assert list(found) == ["strip", "model", "point", "text", "certain", "against"]
    assert (found["strip"], found["point"], found["against"]) == ("2", one, "1")
    line = f"model {found['model']}: {found['text']}"
    assert line in said("bridge").splitlines()
    status = json.loads(said("status", "--json"))
    assert found in status["accidents"]
    assert (status["next"]["do"], status["next"]["model"], status["next"]["point"]) == (
        "return",
        found["model"],
        one,
    )
    assert f"  look: {line}" in said("status").splitlines()
