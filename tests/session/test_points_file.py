"""image_points.csv of a session: read once, and anew when somebody else has written it."""

from __future__ import annotations

from pathlib import Path

import pytest
from sessionscene import Scene

from anaplot.exchange import blockfolder
from anaplot.exchange.blockfolder import (
    image_points_digest,
    read_block,
    write_image_points,
    write_new_block,
)
from anaplot.photogrammetry.block import ImagePoint
from anaplot.session.events import ModelAccepted
from anaplot.session.state import SessionState, fold
from anaplot.station.imagepoints import rows_of
from anaplot.station.pointsfile import BlockRead, PointsFile

ELSEWHERE = ImagePoint("103", "hut", 10.0, 20.0)


def accepted(scene: Scene) -> SessionState:
    state = fold(scene.start, [scene.choice(scene.start, 0)])
    return fold(state, [*scene.measurements(state), ModelAccepted("101", "102")])


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files of image points that were read."""
    paths: list[Path] = []
    real = blockfolder.parse_image_points

    def parse(path: Path, block: object) -> tuple[ImagePoint, ...]:
        paths.append(path)
        return real(path, block)

    monkeypatch.setattr(blockfolder, "parse_image_points", parse)
    return paths


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
