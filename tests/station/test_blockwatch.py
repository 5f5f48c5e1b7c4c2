"""The block in the background of a station: whom it accuses, and that nobody waits for it."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from stationbench import WAIT, Bench, Watch, measure, measure_all

import anaplot
from anaplot.bundle.live import LiveAnswer, LiveBlock
from anaplot.errors import NotComputableError
from anaplot.exchange.blockfolder import read_block, write_image_points
from anaplot.photogrammetry.block import ImagePoint
from anaplot.planning.synthetic import synthetic_strip
from anaplot.plotter.device.hand import Offsets
from anaplot.session.desk import Desk
from anaplot.session.state import start
from anaplot.session.workflow import outlook
from anaplot.station.blockview import BlockView
from anaplot.station.blockwatch import BlockWatch
from anaplot.station.modeltables import ModelTables, TableKeeper
from anaplot.station.station import Station

# an x error at a point that is no tie in the first model: no table of that model shows it
HIDDEN = {("101", "102", "102-2"): Offsets(dxr=0.1)}


def seen(watch: Watch, after: str, **wanted: object) -> BlockView:
    """Wait until the block has been adjusted with everything up to a model."""

    def true(view: BlockView | None) -> bool:
        return (
            view is not None
            and not view.busy
            and view.after == after
            and all(getattr(view, name) == value for name, value in wanted.items())
        )

    view = watch.until(lambda p: true(p.block_view)).block_view
    assert view is not None
    return view


def block_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "block"]


def test_the_block_accuses_a_point_of_the_first_model(bench: Bench) -> None:
    station, watch = bench.open(mistakes=HIDDEN)
    station.next_model()
    assert station.snapshot().block_view is None
    assert block_threads() == []
    measure_all(station, watch)
    # the pattern is complete and nothing is flagged: the model takes part before it is accepted
    view = seen(watch, "101/102", provisional=True)
    assert (view.photos, view.points, view.rays, view.redundancy) == (2, 13, 26, 8)
    assert view.datum == "free"
    assert view.suspects == ()
    station.accept()
    assert seen(watch, "101/102", provisional=False).suspects == ()
    station.next_model()
    measure_all(station, watch)
    # x rows of ties are flagged now, and only the block can say which of the two models is wrong
    view = seen(watch, "102/103", provisional=True)
    solution = station.snapshot().solution
    assert solution is not None
    assert {row.axis for row in solution.flagged} == {"x"}
    worst = view.suspects[0]
    assert worst.point == "102-2"
    assert (worst.accused.photo, worst.accused.model) == ("102", "101/102")
    assert worst.accused.probability > 0.99
    assert sum(ray.probability for ray in worst.rays) == pytest.approx(1.0)
    assert (worst.newly, worst.since) == (True, "102/103")
    first = worst.flagged[0]
    assert (first.photo, first.model, first.axis) == ("102", "101/102", "x")
    assert abs(first.w) > view.critical  # type: ignore[operator]
    assert 0.0 < first.r < 1.0
    assert view.of_earlier_models("102/103")[0] is worst
    assert worst not in view.of_earlier_models("101/102")
    station.accept()
    station.next_model()
    measure_all(station, watch)
    # what stays flagged is not new any more
    worst = seen(watch, "103/104").suspects[0]
    assert (worst.point, worst.newly, worst.since) == ("102-2", False, "102/103")


def test_undo_takes_models_out_of_the_block(bench: Bench) -> None:
    station, watch = bench.open(mistakes=HIDDEN)
    for _ in range(2):
        station.next_model()
        measure_all(station, watch)
        station.accept()
    assert seen(watch, "102/103", provisional=False).suspects
    station.undo()
    assert seen(watch, "102/103", provisional=True).suspects
    station.undo()  # the last point of the pattern is open again
    view = seen(watch, "101/102", provisional=False)
    assert (view.models, view.photos, view.rays) == (1, 2, 26)
    assert view.suspects == ()
    while station.state.models or station.state.current is not None:
        station.undo()
    watch.until(lambda p: p.block_view is None)


def test_a_remeasured_point_is_judged_anew(bench: Bench) -> None:
    station, watch = bench.open(mistakes={("102", "103", "102-2"): Offsets(dxr=0.1)})
    station.next_model()
    measure_all(station, watch)
    station.accept()
    station.next_model()
    measure_all(station, watch)
    worst = seen(watch, "102/103").suspects[0]
    assert (worst.point, worst.accused.photo, worst.accused.model) == ("102-2", "103", "102/103")
    # the simulated operator makes his mistake once
    measure(station, watch, "102-2")
    view = seen(watch, "102/103", suspects=())
    assert view.provisional


def test_a_model_with_a_flagged_y_waits(bench: Bench) -> None:
    station, watch = bench.open(mistakes={("102", "103", "103-2"): Offsets(dyr=0.2)})
    station.next_model()
    measure_all(station, watch)
    station.accept()
    seen(watch, "101/102", provisional=False)
    station.next_model()
    measure_all(station, watch)
    assert station.snapshot().solution is not None
    assert any(row.axis == "y" for row in station.snapshot().solution.flagged)  # type: ignore[union-attr]
    view = station.snapshot().block_view
    assert view is not None
    assert (view.after, view.busy) == ("101/102", False)
    measure(station, watch, "103-2")
    assert seen(watch, "102/103", provisional=True).suspects == ()


def test_rows_from_elsewhere_check_what_no_model_can(bench: Bench) -> None:
    # nobody means to measure 102-2 again in the second model, but a workstation did before
    truth, point = bench.made.truth, "102-2"
    bench.candidates = {
        photo: {name: at for name, at in points.items() if (photo, name) != ("103", point)}
        for photo, points in bench.candidates.items()
    }
    elsewhere = tuple(ImagePoint(photo, point, *truth[photo][point]) for photo in ("102", "103"))
    write_image_points(bench.folder, elsewhere)
    station, watch = bench.open(mistakes=HIDDEN)
    for after in ("101/102", "102/103"):
        station.next_model()
        measure_all(station, watch)
        solution = station.snapshot().solution
        assert solution is not None
        assert not solution.flagged
        view = seen(watch, after, provisional=True)
        station.accept()
    assert point not in {p.point for p in solution.points}
    worst = view.suspects[0]
    assert (worst.point, worst.accused.photo, worst.accused.model) == (point, "102", "101/102")
    assert worst.accused.probability > 0.99
    assert {(ray.photo, ray.model) for ray in worst.rays} == {
        ("101", "101/102"),
        ("102", "101/102"),
        ("102", None),
        ("103", None),
    }


def test_control_from_the_folder_fixes_the_datum(bench: Bench) -> None:
    made = bench.made
    rows = ["point,X,Y,Z,sX,sY,sZ,use"]
    # where the rays of the first two photos meet, in the strip system
    for name in sorted(made.truth["101"].keys() & made.truth["102"].keys())[:8]:
        rays = []
        for k, photo in enumerate(("101", "102")):
            x, y = made.truth[photo][name]
            rays.append(made.rotations[k] @ np.array([x, y, -made.block.cameras[0].c]))
        base = made.centres[1] - made.centres[0]
        a = np.stack([rays[0], -rays[1]], axis=1)
        scale = np.linalg.lstsq(a, base, rcond=None)[0]
        at = made.centres[0] + scale[0] * rays[0]
        rows.append(",".join([name, *(repr(float(v)) for v in at), "0.01,0.01,0.01", "control"]))
    (bench.folder / "control.csv").write_text("\n".join(rows) + "\n")
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    assert seen(watch, "101/102").datum == "control"


def test_a_reopened_block_is_adjusted_by_itself(bench: Bench) -> None:
    station, watch = bench.open(mistakes=HIDDEN)
    for _ in range(2):
        station.next_model()
        measure_all(station, watch)
        station.accept()
    before = seen(watch, "102/103", provisional=False)
    station.close()
    again = Station(bench.folder, candidates=bench.candidates)
    bench.stack.callback(again.close)
    after = seen(Watch(again), "102/103", provisional=False)
    assert after.sigma0 == pytest.approx(before.sigma0, rel=1e-6)
    assert [p.point for p in after.suspects] == [p.point for p in before.suspects]
    # there is no answer before this one: nothing is news
    assert not any(p.newly for p in after.suspects)


def test_why_there_is_no_solution(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    failures: list[Exception] = [
        NotComputableError("photo 102 is not determined"),
        ZeroDivisionError("odd"),
    ]
    update = LiveBlock.update

    def fails(self: LiveBlock, *arguments: object, **options: object) -> LiveAnswer:
        if failures:
            raise failures.pop(0)
        return update(self, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(LiveBlock, "update", fails)
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    view = seen(watch, "101/102", provisional=True)
    assert (view.remark, view.solved, view.sigma0) == ("photo 102 is not determined", False, None)
    station.accept()
    view = seen(watch, "101/102", provisional=False)
    assert view.remark == "the block could not be adjusted: ZeroDivisionError: odd"
    station.next_model()
    measure_all(station, watch)
    assert seen(watch, "102/103").solved


def test_tables_that_cannot_be_formed_are_told_and_the_work_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = synthetic_strip(2, seed=1)
    rows = [
        ImagePoint(photo, name, *at)
        for photo, seen in made.truth.items()
        for name, at in seen.items()
    ]
    block = replace(made.block, image_points=tuple(rows))
    failures: list[Exception] = [ZeroDivisionError("odd")]
    update = TableKeeper.update

    def fails(self: TableKeeper, *arguments: object) -> ModelTables:
        if failures:
            raise failures.pop()
        return update(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(TableKeeper, "update", fails)
    monkeypatch.setattr("anaplot.station.blockwatch._FIRST_SCREEN", 0.0)
    state = start(block)
    heard: queue.SimpleQueue[BlockView | None] = queue.SimpleQueue()
    watch = BlockWatch(lambda: heard.put(watch.view))
    try:
        watch.tell(block, state, outlook(state), set())
        view = heard.get(timeout=WAIT)
        assert view is not None
        assert not view.busy
        assert view.remark == "the block could not be adjusted: ZeroDivisionError: odd"
        watch.tell(replace(block, name="again"), state, outlook(state), set())
        while (view := heard.get(timeout=WAIT)) is None or view.busy:
            pass  # the tables come first
        assert view.solved
        assert set(watch.tables) == {("101", "102")}
    finally:
        watch.close()


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> tuple[threading.Event, threading.Event]:
    """An adjustment that lasts until it is let go: (begun, let go)."""
    begun, go = threading.Event(), threading.Event()
    update = LiveBlock.update

    def slow(self: LiveBlock, *arguments: object, **options: object) -> LiveAnswer:
        begun.set()
        assert go.wait(WAIT)
        return update(self, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(LiveBlock, "update", slow)
    return begun, go


def test_nobody_waits_for_a_slow_adjustment(
    bench: Bench, held: tuple[threading.Event, threading.Event]
) -> None:
    begun, go = held
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    assert begun.wait(WAIT)
    # tables, acceptance and the next model go on while it stands
    assert station.snapshot().solution is not None
    station.accept()
    station.next_model()
    measure_all(station, watch)
    picture = station.snapshot()
    assert picture.solution is not None
    assert picture.block_view is not None
    assert picture.block_view.busy
    assert not picture.block_view.solved
    go.set()
    # of what came meanwhile only the newest is adjusted
    seen(watch, "102/103", provisional=True)
    shown = {p.block_view.after for p in watch.pictures if p.block_view and p.block_view.solved}
    assert shown == {"102/103"}


def test_closing_waits_for_no_more_than_the_adjustment(
    bench: Bench, held: tuple[threading.Event, threading.Event]
) -> None:
    begun, go = held
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    assert begun.wait(WAIT)
    closing = threading.Thread(target=station.close)
    closing.start()
    go.set()
    closing.join(WAIT)
    assert not closing.is_alive()
    assert block_threads() == []


def test_closing_gives_up_an_endless_adjustment(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = threading.Event()

    def endless(
        self: LiveBlock, block: object, *, progress: Callable[[str, float], None]
    ) -> LiveAnswer:
        begun.set()
        while True:
            progress("factor", 0.5)

    monkeypatch.setattr(LiveBlock, "update", endless)
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    assert begun.wait(WAIT)
    station.close()
    assert block_threads() == []


def test_the_block_leaves_the_files_alone(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    seen(watch, "101/102", provisional=True)
    assert bench.csv() == ""
    station.accept()
    seen(watch, "101/102", provisional=False)
    assert len(read_block(bench.folder).image_points) == 26
    assert not any("block" in kind for kind in bench.kinds())


def test_pictures_without_news_of_the_block_keep_its_view(bench: Bench) -> None:
    station, watch = bench.open()
    station.next_model()
    measure_all(station, watch)
    station.accept()
    view = seen(watch, "101/102", provisional=False)
    station.suspend()
    station.resume()
    assert station.snapshot().block_view == replace(view)


def test_nothing_of_the_bundle_is_loaded_for_the_first_screen() -> None:
    code = """
import sys, anaplot.simulation.opening, anaplot.console.app
print(sum(name.startswith("anaplot.bundle") for name in sys.modules))
"""
    found = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(anaplot.__path__[0]).parent,
        capture_output=True,
        text=True,
        timeout=WAIT,
        check=True,
    )
    assert found.stdout.strip() == "0"


def test_an_adjustment_that_waits_begins_with_newer_news_and_ends_at_once() -> None:
    strip = synthetic_strip(4, seed=11)
    points = tuple(
        ImagePoint(photo, point, x, y)
        for photo, points in strip.truth.items()
        for point, (x, y) in points.items()
    )
    desk = Desk.at(start(strip.block))
    ready = threading.Event()
    watch = BlockWatch(ready.set)

    def told(count: int, pause: float) -> None:
        block = replace(strip.block, image_points=points[:count])
        watch.tell(block, desk.state, desk.outlook, frozenset(), pause=pause)

    told(len(points), 100.0 * WAIT)
    assert watch.view is not None
    assert watch.view.busy
    told(len(points) - 1, 0.0)
    assert ready.wait(WAIT)
    told(len(points), 100.0 * WAIT)
    watch.close()
    assert block_threads() == []
