"""image_points.csv of a session: read once, and anew when somebody else has written it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from journaltools import append_event
from sessionscene import Scene
from test_mono_fold import SCENE
from test_mono_fold import chosen as mono_chosen
from test_mono_fold import laid as mono_laid
from test_mono_fold import seen as mono_seen
from test_mono_fold import whole as mono_whole

from anaplot.exchange import blockfolder
from anaplot.exchange.blockfolder import (
    image_points_digest,
    read_block,
    write_image_points,
    write_new_block,
)
from anaplot.exchange.journal import Journal
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.session.events import (
    Event,
    ModelAccepted,
    ModelReopened,
    MonoMeasured,
    PhotoLaid,
    PointRenamed,
    Undone,
)
from anaplot.session.state import SessionState, apply, fold
from anaplot.station.imagepoints import rows_of
from anaplot.station.pointsfile import BlockRead, PointsFile
from anaplot.station.takenup import TakenUp

ELSEWHERE = ImagePoint("103", "hut", 10.0, 20.0)


def accepted(scene: Scene) -> SessionState:
    state = fold(scene.start, [scene.choice(scene.start, 0)])
    return fold(state, [*scene.measurements(state), ModelAccepted("101", "102")])


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders of which the image points were read."""
    folders: list[Path] = []
    real = blockfolder.with_image_points

    def read(folder: Path, block: Block) -> Block:
        folders.append(folder)
        return real(folder, block)

    monkeypatch.setattr(blockfolder, "with_image_points", read)
    return folders


def test_what_nobody_else_has_written_is_read_once(tmp_path: Path, reads: list[Path]) -> None:
    scene = Scene(3)
    folder = tmp_path / "b"
    write_new_block(folder, scene.block)
    assert image_points_digest(folder) is None
    assert write_image_points(folder, [ELSEWHERE]) == image_points_digest(folder)
    state = accepted(scene)
    points = PointsFile(folder, BlockRead.of(folder), ["101/102"])
    points.write(state)
    points.write(scene.start)
    points.write(state)
    assert len(reads) == 1
    rows = (ELSEWHERE, *rows_of(state.models))
    assert points.block.image_points == read_block(folder).image_points == rows


def test_what_came_from_elsewhere_meanwhile_stays(tmp_path: Path, reads: list[Path]) -> None:
    scene = Scene(3)
    folder = tmp_path / "b"
    write_new_block(folder, scene.block)
    state = accepted(scene)
    points = PointsFile(folder, BlockRead.of(folder), ["101/102"])
    for first, second in (((ELSEWHERE,), state), ((), scene.start)):
        # behind its back, before and after it has written the file itself
        write_image_points(folder, (*first, *rows_of(state.models)[:3]))
        points.write(second)
        assert read_block(folder).image_points == (*first, *rows_of(second.models))
        assert points.block.image_points == read_block(folder).image_points


def two_mono_models() -> SessionState:
    state = apply(mono_whole(mono_chosen(SCENE.start)), ModelAccepted("101", "102"))
    return apply(mono_whole(mono_chosen(state, 1)), ModelAccepted("102", "103"))


def changed_ties(state: SessionState) -> list[list[Event]]:
    """Ways in which ties that were measured once, for two models, are changed in the first."""
    ties = [row.point for row in rows_of(state.models) if row.model is None]
    first, second = ties[:2]
    reopened, accepted = ModelReopened("101", "102"), ModelAccepted("101", "102")
    back = apply(state, reopened)
    measured = mono_seen(mono_laid(back, "right"), first, "right", dy=0.004)
    return [
        [reopened, PointRenamed("101", "102", first, second), accepted],
        [reopened, PointRenamed("101", "102", first, second, "right"), accepted],
        [reopened, PointRenamed("101", "102", first, "7"), accepted],
        [reopened, PhotoLaid("102"), measured, accepted],
    ]


@pytest.mark.parametrize("way", range(4))
def test_what_two_models_of_a_mono_comparator_share_follows_them(way: int, tmp_path: Path) -> None:
    folder = tmp_path / "b"
    write_new_block(folder, SCENE.block)
    elsewhere = ImagePoint("102", "hut", 10.0, 20.0)
    write_image_points(folder, [elsewhere])
    before = two_mono_models()
    after = fold(before, changed_ties(before)[way])
    stale = set(rows_of(before.models)) - set(rows_of(after.models))
    assert any(row.model is None for row in stale)
    points = PointsFile(folder, BlockRead.of(folder), ["101/102", "102/103"])
    for state in (before, after, apply(after, Undone()), after):
        points.write(state)
        assert read_block(folder).image_points == (elsewhere, *rows_of(state.models))
        assert points.known_points(state.models) == {"102": {"hut": (10.0, 20.0)}}


def test_a_file_that_lags_behind_the_journal_of_a_mono_comparator_is_brought_up_to_it(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "b"
    write_new_block(folder, SCENE.block)
    before = two_mono_models()
    state = SCENE.start
    with Journal.open(folder, {})[0] as journal:

        def happen(event: Event) -> None:
            nonlocal state
            append_event(journal, event)
            state = apply(state, event)

        for k, model in enumerate(before.models):
            happen(replace(SCENE.choice(state, k), mono=True))
            for side, photo in zip(("left", "right"), model.photos, strict=True):
                happen(PhotoLaid(photo))
                for s in model.seen:
                    if s.side == side:
                        happen(MonoMeasured(*model.photos, side, s.point, s.x, s.y, "key"))
            happen(ModelAccepted(*model.photos))
        assert rows_of(state.models) == rows_of(before.models)
        for event in changed_ties(state)[0]:
            happen(event)
    # the disk was full since; a row from elsewhere is nobody's measurement here
    elsewhere = ImagePoint("102", "hut", 10.0, 20.0)
    write_image_points(folder, (elsewhere, *rows_of(before.models)))
    taken_up = TakenUp(folder, BlockRead.of(folder))
    with taken_up.open({})[0]:
        assert taken_up.past.state == state
        taken_up.points.write(state)
    assert read_block(folder).image_points == (elsewhere, *rows_of(state.models))
