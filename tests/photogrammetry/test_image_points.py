"""Image points as rows and by columns: the same, whichever they were given as."""

from __future__ import annotations

import math
import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.photogrammetry.block import Block, Camera, ImagePoint, Photo, Precision, TestSettings
from anaplot.photogrammetry.imagepoints import ImagePoints, columns_of
from anaplot.photogrammetry.pointcolumns import Coded, PointColumns, samples, stand_again

NAMES = st.sampled_from(["1", "a", "~2", "b/c", "\u00e4", "10", "1.0"])
NUMBERS = st.floats(allow_nan=False, width=64)
ROWS = st.lists(
    st.builds(
        ImagePoint,
        photo=NAMES,
        point=NAMES,
        x=NUMBERS,
        y=NUMBERS,
        sigma_um=st.none()
        | st.sampled_from([5.0, 0.0, math.inf])
        | NUMBERS.filter(lambda s: s > 0),
        model=st.none() | st.sampled_from(["1/a", "a/1"]),
        use=st.sampled_from(["xy", "x", "y", "off"]),
        reason=st.none() | st.sampled_from(["torn", "l1"]),
        measured=st.none() | st.tuples(NUMBERS, NUMBERS),
    ),
    max_size=12,
)


def by_columns(rows: list[ImagePoint]) -> ImagePoints:
    return ImagePoints(columns=PointColumns.of_rows(rows))


@given(ROWS)
def test_rows_come_back_from_columns(rows: list[ImagePoint]) -> None:
    points = by_columns(rows)
    assert [points[k] for k in range(len(rows))] == rows  # one by one, before all are made
    assert list(points) == rows
    assert [row.measured for row in points] == [row.measured for row in rows]
    assert [points[k].measured for k in range(-len(rows), 0)] == [row.measured for row in rows]
    assert points[1:3] == tuple(rows[1:3])
    assert points == tuple(rows) == points
    assert points == ImagePoints(rows)
    assert hash(points) == hash(tuple(rows))
    assert repr(points) == repr(tuple(rows))
    assert bool(points) == bool(rows)
    assert points + tuple(rows[:1]) == (*rows, *rows[:1])
    assert tuple(rows[:1]) + points == (*rows[:1], *rows)
    longer = rows[:1]
    longer += points
    assert longer == [*rows[:1], *rows]


@given(ROWS)
def test_copies_are_equal_however_they_are_kept(rows: list[ImagePoint]) -> None:
    for points in (ImagePoints(rows), by_columns(rows)):
        copies = [pickle.loads(pickle.dumps(points, k)) for k in range(6)]
        for copy in (*copies, deepcopy(points)):
            assert copy == points
            assert not columns_of(copy).xy.flags.writeable
            assert [row.measured for row in copy] == [row.measured for row in rows]


@given(ROWS, st.data())
def test_some_rows_of_columns_are_the_columns_of_some_rows(
    rows: list[ImagePoint], data: st.DataObject
) -> None:
    chosen = data.draw(st.lists(st.integers(0, len(rows) - 1), unique=True)) if rows else []
    columns = PointColumns.of_rows(rows)
    part = columns.of(np.array(chosen, dtype=np.intp))
    whole = PointColumns.of_rows([rows[k] for k in chosen])
    assert part.rows() == whole.rows()
    for one, other in ((part.photo, whole.photo), (part.point, whole.point)):
        assert one.values == other.values  # none that stands nowhere, in the same order
    uses = ("x", "off")
    found = columns.with_use(*uses)  # type: ignore[arg-type]
    assert found.tolist() == [k for k, row in enumerate(rows) if row.use in uses]


@given(st.lists(st.tuples(NAMES, NAMES, NAMES), max_size=12))
def test_what_stands_again_is_what_was_there_before_or_after(keys: list[tuple[str, ...]]) -> None:
    columns = [Coded.of([key[k] for key in keys]) for k in range(3)]
    assert stand_again(*columns).tolist() == [keys.count(key) > 1 for key in keys]


@pytest.mark.slow
def test_keys_larger_than_a_number_of_the_machine_are_told_apart() -> None:
    # three columns of so many values: their product is beyond 2^63
    many = tuple(map(str, range(2**22)))
    index = np.array([0, 1, 2**22 - 1, 1, 0], dtype=np.intp)
    column = Coded(many, index)
    other = Coded(many, np.array([5, 6, 7, 6, 6], dtype=np.intp))
    assert stand_again(column, other, column, other).tolist() == [False, True, False, True, False]


@given(ROWS)
def test_samples_have_all_there_is(rows: list[ImagePoint]) -> None:
    found = [rows[k] for k in samples(PointColumns.of_rows(rows))]
    for what in (
        lambda row: (row.photo, row.model),
        lambda row: row.use,
        lambda row: row.reason,
    ):
        assert set(map(what, found)) == set(map(what, rows))
    stated = [row.sigma_um for row in rows if row.sigma_um is not None]
    assert {min(stated, default=None), max(stated, default=None)} <= {
        None,
        *(row.sigma_um for row in found),
    }


def test_values_put_in_stand_in_their_rows_alone() -> None:
    column = Coded.of(["a", "b", "a", "c"])
    assert column.put({2: "b", 0: "d"}).listed() == ["d", "b", "b", "c"]
    assert column.listed() == ["a", "b", "a", "c"]
    assert column.put({}) is column
    assert column.put({2: "b"}).of_rows(np.array([1, 2, 3])).values == ("b", "c")
    assert Coded.numbered(np.array([7, 3, 7, 9])).values == (7, 3, 9)
    assert Coded.numbered(np.array([7, 3, 7, 9])).index.tolist() == [0, 1, 0, 2]


def test_a_block_takes_any_sequence_of_rows() -> None:
    rows = [ImagePoint("1", "a", 1.0, 2.0), ImagePoint("1", "b", 3, 4, math.nan)]
    block = Block(
        "b", Precision(), TestSettings(), (Camera("c", 1.0),), (Photo("1", "c"),), (), rows
    )
    assert isinstance(block.image_points, ImagePoints)
    assert block.image_points[1] is rows[1]  # as it was given
    assert columns_of(block.image_points) is columns_of(block.image_points)
    assert replace(block, image_points=tuple(rows)) == block
    assert replace(block, name="other").image_points is block.image_points
    assert replace(block, image_points=rows[:1]) != block
    assert block.image_points != 1
    with pytest.raises(IndexError):
        block.image_points[2]


def test_a_sigma_that_is_none_is_not_the_default() -> None:
    sigma = columns_of([ImagePoint("1", "a", 0.0, 0.0, s) for s in (math.nan, None, 3.0)]).sigma_um
    assert sigma is not None
    assert sigma[0] <= 0.0
    assert math.isnan(sigma[1])
    assert sigma[2] == 3.0


def test_columns_that_state_nothing_are_none() -> None:
    # so that "some row states one" is true of every column that is there
    rows = [ImagePoint("1", str(k), 0.0, 0.0) for k in range(3)]
    stated = PointColumns.of_rows([*rows, replace(rows[0], sigma_um=5.0, measured=(1.0, 2.0))])
    assert stated.sigma_um is not None
    assert stated.measured is not None
    nothing = (np.full(3, math.nan), np.full((3, 2), math.nan))
    given = replace(PointColumns.of_rows(rows), sigma_um=nothing[0], measured=nothing[1])
    for columns in (given, stated.of(np.arange(3))):
        assert columns.sigma_um is None
        assert columns.measured is None
        assert samples(columns) == [0]
        assert columns.rows() == tuple(rows)


def test_no_column_of_a_block_can_be_written_into() -> None:
    rows = [ImagePoint("1", str(k), 1.0, 2.0, 5.0, measured=(3.0, 4.0)) for k in range(3)]
    columns = columns_of(rows)
    ours = columns.xy.copy()
    outside = replace(columns, xy=ours)
    codes = [each.photo for each in (columns, columns.of(np.array([0, 2])))]
    codes += [columns.point, columns.model, columns.use, columns.reason]
    codes += [columns.photo.put({1: "2"}), Coded.read((("1",), [0])), Coded.same("1", 2)]
    arrays = [columns.xy, outside.xy, columns.sigma_um, columns.measured]
    for array in (*arrays, *(column.index for column in codes)):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    ours[0] = 9.0  # an array that was given stays its owner's


@pytest.mark.parametrize("rows", [None, 3, [None], [ImagePoint("1", "a", 1.0, 2.0), ("1", "b")]])
def test_what_is_no_sequence_of_rows_is_refused_at_once(rows: object) -> None:
    block = Block("b", Precision(), TestSettings(), (), (), ())
    with pytest.raises(TypeError):
        replace(block, image_points=rows)  # type: ignore[arg-type]
