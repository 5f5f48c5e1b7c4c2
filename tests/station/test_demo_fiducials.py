"""The demonstration with inner orientations: the missed fiducial found, the strip as without."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_demo_seeds import run, standardized

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.photogrammetry.block import ImagePoint
from anaplot.planning.synthetic import SyntheticStrip
from anaplot.plotter.device.hand import Offsets, fiducial_name
from anaplot.report.astext import page_text
from anaplot.report.democommand import demo_document, model_story
from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.demo import Demo, Outcome
from anaplot.simulation.mistakes import SMALLEST
from anaplot.simulation.opening import open_station
from anaplot.simulation.wrongfiducial import plant_wrong_fiducial
from anaplot.station.replay import replay_session

MODELS = 3


def wrong_of(demo: Demo):
    (wrong,) = [p for p in demo.plot.planted if p.kind == "wrong fiducial"]
    return wrong


def test_all_else_is_as_without_fiducials() -> None:
    for seed in (1, 2):
        plain, demo = Demo.make(MODELS, seed), Demo.make(MODELS, seed, fiducials=True)
        wrong = wrong_of(demo)
        assert tuple(p for p in demo.plot.planted if p != wrong) == plain.plot.planted
        assert demo.strip.truth == plain.strip.truth
        assert demo.candidates == plain.candidates
        assert plain.placements == {}
        assert len(demo.placements) == 2 * (MODELS + 1)
        assert len(demo.plot.offsets) == len(plain.plot.offsets) + 1
        again = Demo.make(MODELS, seed, fiducials=True)
        assert (again.plot, again.placements) == (demo.plot, demo.placements)


def assert_found_and_repaired(demo: Demo, plain: Demo, outcome: Outcome) -> None:
    wrong = wrong_of(demo)
    assert wrong in outcome.planted
    assert wrong in outcome.found
    assert wrong in outcome.repaired
    # the strip's mistakes are found as well as without plates
    assert min(standardized(replace(demo, plot=plain.plot)).values()) >= SMALLEST
    assert outcome.missed == ()
    for record in outcome.models:
        name = f"{record.left}/{record.right}"
        assert [(i.photo, i.side) for i in record.inners] == [
            (record.left, "left"),
            (record.right, "right"),
        ]
        for inner in record.inners:
            assert inner.after is not None
            assert not inner.after.flagged
            assert (inner.after.kind, inner.after.redundancy) == ("bilinear", 8)
            assert inner.before is not None
            if (name, inner.photo) == (wrong.model, wrong.photo):
                assert inner.before.flagged[0].key == (wrong.point, wrong.axis)


@pytest.mark.usefixtures("without_block")
@pytest.mark.parametrize("seed", [1, 2])
def test_the_missed_fiducial_is_found_and_repaired(tmp_path: Path, seed: int) -> None:
    demo, plain = Demo.make(MODELS, seed, fiducials=True), Demo.make(MODELS, seed)
    assert_found_and_repaired(demo, plain, run(demo, tmp_path / "demo"))


@pytest.mark.long
@pytest.mark.usefixtures("without_block")
def test_so_it_is_and_strip_tables_are_like_those_without_plates(tmp_path: Path) -> None:
    gaps, sigmas, scatter = [], [], []
    for seed in range(21, 27):
        demo, plain = (Demo.make(MODELS, seed, fiducials=with_them) for with_them in (True, False))
        outcome, other = run(demo, tmp_path / str(seed)), run(plain, tmp_path / f"plain{seed}")
        assert_found_and_repaired(demo, plain, outcome)
        truth = demo.strip.truth
        mistaken = {(p.model, p.point) for p in demo.plot.planted}
        gaps += [
            (row.x - truth[row.photo][row.point][0], row.y - truth[row.photo][row.point][1])
            for row in read_block(tmp_path / str(seed)).image_points
            if (row.model, row.point) not in mistaken
        ]
        for record, same in zip(outcome.models, other.models, strict=True):
            assert record.after is not None
            assert same.after is not None
            sigmas.append((record.after.sigma0_um, same.after.sigma0_um))
            redn = {row.key: row.r for row in same.after.table}
            if redn.keys() == {row.key for row in record.after.table}:
                scatter += [abs(row.r - redn[row.key]) for row in record.after.table]
    # 5 um of the pointing, and what eight fiducials leave of another 5 um
    assert 0.0050 < np.sqrt(np.mean(np.square(gaps))) < 0.0075
    with_plates, without = np.sqrt(np.mean(np.square(sigmas), axis=0))
    assert 0.9 < with_plates / without < 1.25
    # the same geometry: the same redundancy numbers
    assert len(scatter) > 100
    assert max(scatter) < 0.02


def test_the_session_replays_to_the_last_digit(tmp_path: Path) -> None:
    demo = Demo.make(MODELS, 4, fiducials=True)
    run(demo, tmp_path / "demo")
    replayed = replay_session(tmp_path / "demo")
    assert replayed.differences == ()
    assert replayed.measurements >= MODELS * (16 + 13) + 1
    assert replayed.block == replace(read_block(tmp_path / "demo"), image_points=())


def test_the_same_seed_tells_the_same_whatever_the_speed(tmp_path: Path) -> None:
    texts, files = [], set()
    for k, scale in enumerate((500.0, 20000.0)):
        outcome = run(Demo.make(2, 6, fiducials=True), tmp_path / str(k), scale)
        texts.append(json.dumps(demo_document(6, outcome).to_dict(), allow_nan=False))
        files.add((tmp_path / str(k) / "image_points.csv").read_bytes())
    assert texts[0] == texts[1]
    assert len(files) == 1
    answer = json.loads(texts[0])
    for model in answer["models"]:
        assert [i["side"] for i in model["inner"]] == ["left", "right"]
        for inner in model["inner"]:
            assert len(inner["after"]["table"]) == 16
    handled = [h for m in answer["models"] for i in m["inner"] for h in i["handled"]]
    assert {h["action"] for h in handled} == {"measured again"}


def test_it_is_told(tmp_path: Path) -> None:
    demo = Demo.make(1, 1, fiducials=True)
    outcome = run(demo, tmp_path / "demo")
    wrong = wrong_of(demo)
    document = demo_document(1, outcome)
    story = page_text(model_story(outcome.models[0]))
    assert f"fiducial {wrong.point} ({wrong.axis}) measured again" in story
    assert story.count("the bilinear transformation accepted") == 2
    assert "RESID" in story
    assert page_text(document.page).startswith(story)
    assert f"wrong fiducial of photo {wrong.photo}" in page_text(document.page)


def test_a_fiducial_missed_again_and_again_is_switched_off_and_reported(tmp_path: Path) -> None:
    demo = Demo.make(1, 1, fiducials=True)
    key = ("101", "102", fiducial_name("right", "6"))
    offsets = {key: Offsets(dxr=0.3, count=9)}
    demo = replace(demo, plot=replace(demo.plot, planted=(), offsets=offsets))
    demo.write(tmp_path / "demo")
    with demo.open(tmp_path / "demo", 5000.0) as station:
        operator = AutomaticOperator(station)
        operator.run()
        (record,) = operator.records
        state = station.state
    actions = [(h.photo, h.point, h.axis, h.action) for h in record.handled]
    assert actions == [
        ("102", "6", "x", "measured again"),
        ("102", "6", "x", "measured again"),
        ("102", "6", "x", "switched off"),
    ]
    inner = state.models[0].inner_of("right")
    assert inner is not None
    assert inner.off == {("6", "x")}
    assert inner.accepted is not None


def test_among_four_fiducials_all_are_measured_again(tmp_path: Path) -> None:
    demo = Demo.make(1, 1, fiducials=True)
    camera = demo.strip.block.cameras[0]
    assert camera.calibration is not None
    calibration = replace(camera.calibration, fiducials=camera.calibration.fiducials[:4])
    block = replace(demo.strip.block, cameras=(replace(camera, calibration=calibration),))
    strip = SyntheticStrip(block, demo.strip.truth, demo.strip.centres, demo.strip.rotations)
    for count, last in ((1, "measured again"), (99, "accepted as it is")):
        key = ("101", "102", fiducial_name("left", "3"))
        offsets = {key: Offsets(dyl=0.3, count=count)}
        made = replace(demo, strip=strip, plot=replace(demo.plot, planted=(), offsets=offsets))
        made.write(tmp_path / str(count))
        with made.open(tmp_path / str(count), 5000.0) as station:
            operator = AutomaticOperator(station)
            operator.run()
            (record,) = operator.records
        handled = [h for h in record.handled if h.photo == "101"]
        assert {h.point for h in handled} >= set("123")
        assert handled[-1].action == last
        assert not any(h.action == "switched off" for h in handled)


def test_a_camera_without_coordinates_cannot_have_a_missed_fiducial() -> None:
    with pytest.raises(InputError, match="no fiducials with coordinates"):
        plant_wrong_fiducial(Demo.make(1, 1).strip.block, 1)


def test_an_opened_simulation_lays_the_plates_too(tmp_path: Path) -> None:
    demo = Demo.make(1, 2, fiducials=True)
    demo.write(tmp_path / "truth")
    rows = tuple(
        ImagePoint(photo, point, x, y)
        for photo, points in demo.strip.truth.items()
        for point, (x, y) in points.items()
    )
    write_image_points(tmp_path / "truth", rows)
    demo.write(tmp_path / "block")
    for truth in (None, tmp_path / "truth"):
        with open_station(
            tmp_path / "block", simulate=True, truth=truth, time_scale=5000.0
        ) as station:
            assert station.instrument is not None
            simulator = station.instrument.simulator
            assert simulator is not None
            left, right = (simulator.points_of("101", side) for side in ("left", "right"))  # type: ignore[arg-type]
            assert any(name.startswith(" left ") for name in left)
            point = next(name for name in left if not name.startswith(" "))
            assert left[point] != right[point]
