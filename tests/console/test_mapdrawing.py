from dataclasses import replace

import numpy as np
import pytest
from consolefake import picture, solution
from hypothesis import given
from hypothesis import strategies as st
from testedrows import with_rows

from anaplot.adjustment.tested import Transfer
from anaplot.console.mapdrawing import Layer, MapProjection, draw_map, nice_above
from anaplot.orientation.results import Diagnosis
from anaplot.station.snapshot import PointView


@pytest.mark.parametrize("size", [(28, 14), (60, 20), (20, 40), (160, 50), (200, 8)])
def test_the_scale_is_the_same_along_both_axes(size):
    projection = MapProjection.around(
        [(0.0, -100.0), (90.0, 100.0)], 2 * size[0], 4 * size[1], (6, 4)
    )
    x0, y0 = projection.dots(0.0, 0.0)
    x1, _ = projection.dots(30.0, 0.0)
    _, y1 = projection.dots(0.0, 30.0)
    assert x1 - x0 == pytest.approx(y0 - y1)
    for x, y in ((0.0, -100.0), (90.0, 100.0)):
        px, py = projection.dots(x, y)
        assert 0 <= px < 2 * size[0]
        assert 0 <= py < 4 * size[1]


def test_the_frame_stands_still_while_points_shift_a_little():
    a = MapProjection.around([(1.0, -98.0), (88.0, 97.0)], 60, 60, (6, 4))
    b = MapProjection.around([(1.3, -97.6), (88.4, 97.9)], 60, 60, (6, 4))
    assert a == b


def glyphs(canvas, layer):
    return "".join(text for row in canvas.runs() for text, number in row if number == layer)


def test_every_state_has_its_own_sign():
    points = list(picture().points)
    points[7] = replace(points[7], status="off")
    points[8] = replace(points[8], status="pending")
    canvas = draw_map(picture(points=tuple(points), next_point="999"), None, 60, 40)
    assert "x" in glyphs(canvas, Layer.OFF)
    assert "○" in glyphs(canvas, Layer.PENDING)
    assert "!" in glyphs(canvas, Layer.CULPRIT)
    assert glyphs(canvas, Layer.MEASURED).count("●") == 10
    assert glyphs(canvas, Layer.TARGET) == "()"


def test_every_name_is_there_when_there_is_room():
    text = draw_map(picture(), None, 90, 40).text()
    assert all(view.point in text for view in picture().points)


def test_residuals_are_as_long_as_the_bar_says():
    # A single y row of 41.7 um upwards; everything else without residual.
    rows = tuple(
        row._replace(residual=row.residual if row.key == ("103", "y") else 0.0)
        for row in solution().table
    )
    snapshot = picture(
        solution=with_rows(solution(), rows),
        diagnosis=None,
        points=tuple(v for v in picture().points if v.point == "103" or v.y < 90.0),
    )
    canvas = draw_map(snapshot, None, 60, 40)
    legend = canvas.text().splitlines()[-2]
    assert legend.startswith("⠒⠒⠒⠒⠒ 50 µm residual")
    y, _ = np.nonzero(canvas.dots())
    upper = y[y < 40]
    # 10 dots are 50 um, and both ends are drawn.
    assert np.ptp(upper) == pytest.approx(41.7 / 5.0, abs=1.0)
    assert upper.min() > 0


def test_y_rows_are_upright_and_x_rows_level():
    for axis, key in (("y", ("104", "y")), ("x", ("104", "x"))):
        rows = tuple(
            row._replace(residual=60.0 if row.key == key else 0.0, flagged=False)
            for row in solution().table
        )
        alone = with_rows(solution(), rows)
        canvas = draw_map(
            picture(solution=alone, diagnosis=None, points=picture().points[2:3]), None, 40, 30
        )
        dots = canvas.dots()[: 4 * 28]
        extent = (np.ptp(np.nonzero(dots.any(axis=1))[0]), np.ptp(np.nonzero(dots.any(axis=0))[0]))
        assert min(extent) == 0
        assert extent[0] > 5 if axis == "y" else extent[1] > 5


def test_arrows_of_the_selected_row_or_of_all():
    def arrows(selected, every):
        canvas = draw_map(picture(), selected, 80, 40, all_transfers=every)
        return len(glyphs(canvas, Layer.TRANSFER))

    assert arrows(("104", "y"), False) == 0
    assert arrows(("103", "y"), False) > 0
    assert arrows(("107", "y"), False) == arrows(("103", "y"), False)
    assert arrows(None, True) > arrows(("103", "y"), False)


def test_serious_transfers_are_dotted():
    def dots(own):
        transfer = Transfer(("103", "y"), ("107", "y"), -0.71, own)
        shown = replace(picture().diagnosis, transfers=(transfer,))
        canvas = draw_map(picture(diagnosis=shown), ("103", "y"), 80, 40)
        return int(canvas.dots().sum())

    assert dots(0.71) > dots(0.8)


def test_it_works_before_there_is_anything():
    empty = picture(points=(), solution=None, diagnosis=None, target=None, next_point=None)
    assert "○ open" in draw_map(empty, None, 40, 12).text()
    text = draw_map(picture(measured=0), ("102", "y"), 60, 30).text()
    assert text.count("○") == 13 + 1
    assert "µm" not in text


def test_coordinates_that_are_no_numbers_are_left_out():
    bad = PointView("bad", "new", float("nan"), float("inf"), "measured", 1)
    text = draw_map(picture(points=(*picture().points, bad)), None, 60, 30).text()
    assert "bad" not in text


def test_a_name_is_drawn_as_it_is_but_never_as_control():
    odd = replace(picture().points[2], point="\x1b[2J")
    points = picture().points
    snapshot = picture(points=(*points[:2], odd, *points[3:]), solution=None, diagnosis=None)
    text = draw_map(snapshot, None, 60, 30).text()
    assert "\\x1b[2J" in text
    assert "\x1b" not in text


@given(st.integers(0, 70), st.integers(0, 40), st.integers(0, 13))
def test_any_size_will_do(columns, rows, measured):
    canvas = draw_map(picture(measured=measured), ("103", "y"), columns, rows, all_transfers=True)
    assert [sum(len(text) for text, _ in row) for row in canvas.runs()] == [columns] * rows


@given(st.floats(1e-6, 1e9))
def test_nice_numbers(value):
    nice = nice_above(value)
    assert value * (1 - 1e-6) <= nice <= 5 / 3 * value * (1 + 1e-6)
    assert round(nice / 10.0 ** np.floor(np.log10(nice * (1 + 1e-9))), 6) in (1, 1.5, 2, 3, 5, 7.5)


def test_a_transfer_within_one_point_needs_no_arrow():
    snapshot = picture()
    within = snapshot.diagnosis.transfers[0]._replace(target=("103", "x"))
    diagnosis = Diagnosis((within,), (), (), ())
    canvas = draw_map(picture(diagnosis=diagnosis), ("103", "y"), 60, 30)
    assert glyphs(canvas, Layer.TRANSFER) == ""
