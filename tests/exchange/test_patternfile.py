"""A point pattern as a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.exchange.patternfile import format_pattern, is_pattern_file, read_pattern
from anaplot.photogrammetry.block import PatternPoint

LABELS = st.text(st.characters(codec="utf-8", categories=["L", "N", "P"]), min_size=1, max_size=9)
PLACES = st.floats(-900.0, 900.0)
POINTS = st.lists(
    st.builds(PatternPoint, LABELS, PLACES, PLACES, st.booleans()),
    min_size=1,
    max_size=9,
    unique_by=lambda point: point.label,
).map(tuple)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("patterns")


@pytest.mark.parametrize("suffix", [".csv", ".toml"])
@given(points=POINTS)
def test_what_is_written_is_read_back(
    folder: Path, suffix: str, points: tuple[PatternPoint, ...]
) -> None:
    path = folder / f"pattern{suffix}"
    path.write_text(format_pattern(points, suffix), encoding="utf-8")
    read = read_pattern(path)
    assert read.points == points
    assert read.places == tuple(point[:3] for point in points)
    assert read.ties == tuple(point.label for point in points if point.tie)


def test_a_fault_names_the_line_of_a_point(tmp_path: Path) -> None:
    csv, toml = tmp_path / "a.csv", tmp_path / "a.toml"
    csv.write_text("label,x,y\n\n1,0,0\n2,5,5\n")
    toml.write_text(format_pattern(read_pattern(csv).points, ".toml"))
    assert str(read_pattern(csv).fault("2", "is far")) == f"{csv} line 4: is far"
    assert str(read_pattern(toml).fault("2", "is far")) == f"{toml} line 10: is far"
    assert str(read_pattern(csv).fault(None, "is small")) == f"{csv}: is small"


def test_a_name_is_no_file() -> None:
    assert [is_pattern_file(name) for name in ("13/5", "a.CSV", "b.toml", "c.txt")] == [
        False,
        True,
        True,
        False,
    ]
