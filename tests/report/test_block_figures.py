"""Figures of a block: what is planted is drawn where it belongs, numbers are the result's."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from svgs import SVG, parsed, paths, runs, sound, texts
from syntheticblocks import synthetic_block

from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.testdistribution import TestDistribution
from anaplot.bundle.adjust import adjust_block, adjust_problem
from anaplot.bundle.blockmap import flagged_points, mean_redundancy
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.block import ImagePoint, TestSettings
from anaplot.report.figures import blockmap, groundview, pointmaps
from anaplot.report.figures.blockmap import block_map
from anaplot.report.figures.imageunits import image_units
from anaplot.report.figures.pointmaps import (
    accuracy_maps,
    detectable_map,
    effect_map,
    redundancy_map,
)
from anaplot.report.figures.pointvalues import largest_detectable, largest_effect
from anaplot.report.figures.residuals import photo_residuals, residual_pattern
from anaplot.report.figures.testvalues import (
    histogram_of_w,
    image_coordinates,
    quantiles_of_w,
)

HOSTILE = "<b>x</b>&\"'>" + "y" * 200


@pytest.fixture(scope="module")
def block() -> AdjustedBlock:
    """Two strips with a gross error of 80 um in x of a point with a hostile name."""
    made = synthetic_block(2, 4, seed=4, test=TestSettings(kind="baarda"))
    random = np.random.default_rng(4)
    rows = [
        ImagePoint(photo, point, *(np.array(xy) + random.normal(0.0, 0.005, 2)).tolist())
        for photo, points in made.truth.items()
        for point, xy in points.items()
    ]
    at = next(k for k, row in enumerate(rows) if row.photo == "103" and row.point == "103-7")
    rows[at] = replace(rows[at], x=rows[at].x + 0.08)
    rows = [replace(row, point=HOSTILE) if row.point == "103-7" else row for row in rows]
    control = list(made.block.control)
    control[1] = replace(control[1], use="check")
    control[2] = replace(control[2], xyz=(None, None, control[2].xyz[2]))
    return adjust_block(replace(made.block, image_points=tuple(rows), control=tuple(control)))


def test_the_map_has_what_is_in_the_block(block: AdjustedBlock) -> None:
    drawing = block_map(block)
    root = sound(drawing)
    legend = " ".join(texts(root))
    for word in ("projection centre", "strip", "control", "check point", "height only", "flagged"):
        assert word in legend
    problem = block.problem
    (photos,) = paths(root, "faint")
    assert len(runs(photos)) == len(problem.photos)
    strips = [d for d in paths(root, "dashed") if d.count("l") > 1]
    assert len(strips) == 2
    assert "8 photos" in drawing.description
    flagged = int(flagged_points(block).sum())
    assert flagged >= 1
    assert f"{flagged} flagged" in drawing.description


def test_names_are_text_and_shortened(block: AdjustedBlock) -> None:
    root = sound(block_map(block))
    assert "<b>" not in block_map(block).svg
    shown = [text for text in texts(root) if "…" in text]
    assert shown
    assert all(len(text) <= 14 for text in shown)
    whole = [one.text for one in root.iter(f"{SVG}title")]
    assert HOSTILE in whole


def test_footprints_are_where_rays_of_the_corners_meet_the_ground(block: AdjustedBlock) -> None:
    view = groundview.ground_view(block)
    problem, state = block.problem, block.state
    for k in range(len(problem.photos)):
        height = state.points[problem.point[problem.photo == k], 2].mean()
        for corner in view.footprints[k]:
            ground = np.array([*(corner - state.origin[:2]), height])
            seen = state.rotations[k].T @ (ground - state.centres[k])
            image = -problem.c[k] * seen[:2] / seen[2]
            assert np.abs(image) == pytest.approx([115.0, 115.0], abs=1e-6)


def test_residuals_of_a_photo_are_drawn_at_their_points(block: AdjustedBlock) -> None:
    drawing = photo_residuals(block, "103")
    assert drawing is not None
    root = sound(drawing)
    problem = block.problem
    ray = next(
        k
        for k in range(len(problem.photo))
        if problem.photos[problem.photo[k]] == "103" and problem.points[problem.point[k]] == HOSTILE
    )
    assert block.flagged[ray].any()
    (arrow,) = (d for d in paths(root, "bold") if "m" in d)
    shaft = runs(arrow)[0]
    # the format gives the scale
    (corners,) = (runs(d)[0] for d in paths(root, "l-soft") if d.endswith("z"))
    scale = np.ptp(corners[:, 0]) / 230.0
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    expected = middle + problem.xy[ray] * scale * [1, -1]
    assert shaft[0] == pytest.approx(expected, abs=0.2)
    told = re.search(r"enlarged ([\d ]+) times", drawing.description)
    assert told is not None
    times = float(told[1].replace(" ", ""))
    v_um = block.tested.residual[2 * ray : 2 * ray + 2]
    assert (shaft[1] - shaft[0]) == pytest.approx(v_um * 1e-3 * times * scale * [1, -1], abs=0.2)
    assert v_um[0] < -30.0  # adjusted minus observed: against the error


def test_what_is_rejected_is_crossed_and_draws_no_vector(block: AdjustedBlock) -> None:
    problem = block.problem
    ray = next(k for k, point in enumerate(problem.point) if problem.points[point] == HOSTILE)
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    rejected[ray] = True
    without = adjust_problem(replace(problem, rejected=rejected))
    photo = problem.photos[problem.photo[ray]]
    drawing = photo_residuals(without, photo)
    assert drawing is not None
    assert "rejected or off (1)" in texts(sound(drawing))
    of_photo = int((problem.photo == problem.photo[ray]).sum())
    assert f"{of_photo - 1} rays" in drawing.description
    assert "a ray is rejected (1)" in texts(sound(block_map(without)))
    assert "rejected" not in " ".join(texts(sound(block_map(block))))


def test_a_photo_that_is_not_there(block: AdjustedBlock) -> None:
    with pytest.raises(KeyError):
        photo_residuals(block, "no such")
    with pytest.raises(KeyError):
        residual_pattern(block, "no such")


def test_a_pattern_shows_what_all_photos_have_in_common() -> None:
    made = synthetic_block(2, 6, seed=6, test=TestSettings(kind="baarda"))
    random = np.random.default_rng(6)

    def bent(x: float, y: float) -> tuple[float, float]:
        # 30 um of x where x and y have the same sign: no orientation takes it up
        return x + 0.03 * np.sign(x * y) * (abs(x) > 30.0) * (abs(y) > 30.0), y

    rows = [
        ImagePoint(photo, point, *(np.array(bent(*xy)) + random.normal(0.0, 0.005, 2)).tolist())
        for photo, points in made.truth.items()
        for point, xy in points.items()
    ]
    drawing = residual_pattern(adjust_block(replace(made.block, image_points=tuple(rows))))
    assert drawing is not None
    root = sound(drawing)
    found = re.search(r"; (\d+) larger than chance", drawing.description)
    assert found is not None
    beyond = int(found[1])
    assert beyond >= 3
    assert any("larger than chance" in text for text in texts(root))
    (bold,) = (d for d in paths(root, "l-series-2") if "m" in d or "l" in d)
    assert len([one for one in runs(bold) if len(one) == 2]) == beyond


@pytest.mark.parametrize("make", [redundancy_map, detectable_map, effect_map])
def test_maps_of_numbers(block: AdjustedBlock, make: object) -> None:
    drawing = make(block)  # type: ignore[operator]
    root = sound(drawing)
    drawn = sum(len(re.findall("M", d)) for k in range(1, 6) for d in paths(root, f"f-ramp-{k}"))
    legend = [text for text in texts(root) if re.search(r"\(\d+\)$", text)]
    classes = [text for text in legend if "control" not in text and "check" not in text]
    counted = sum(int(re.search(r"\((\d+)\)$", text)[1]) for text in classes)  # type: ignore[index]
    bounded = sum("no bound" in text for text in classes)
    assert counted == len(block.problem.points)
    assert drawn == counted + len(classes) - bounded or bounded  # a mark each, one in the legend


def test_accuracy_maps_tell_the_largest_deviation(block: AdjustedBlock) -> None:
    plan, height = accuracy_maps(block)
    sound(plan)
    rows = {row.point: row.s_xyz for row in block.point_rows()}
    worst = max(rows, key=lambda point: rows[point][2] or 0.0)
    assert f"at point {worst}"[:60] in height.description
    largest = rows[worst][2] or 0.0
    assert f"{1e3 * largest:.3g} mm" in height.description or f"{largest:.3g} m " in (
        height.description
    )


def test_redundancy_is_the_mean_of_a_points_coordinates(block: AdjustedBlock) -> None:
    at = block.problem.points.index(HOSTILE)
    rays = block.problem.point == at
    assert mean_redundancy(block)[at] == pytest.approx(block.cofactors.r[rays].mean())


def test_the_histogram_counts_every_value_but_rounding(block: AdjustedBlock) -> None:
    drawing = histogram_of_w(block.tested, image_coordinates(block), key="w", what="rays")
    assert drawing is not None
    sound(drawing)
    spurs = block.cofactors.r < SPUR
    assert np.isfinite(block.w[spurs]).any()  # with tilts r is no exact zero
    w = block.w[np.isfinite(block.w) & ~spurs]
    assert f"{len(w)} values, {int((np.abs(w) > block.critical).sum())} beyond" in (
        drawing.description
    )


def test_what_nothing_checks_is_detected_by_nothing(block: AdjustedBlock) -> None:
    problem, spurs = block.problem, block.cofactors.r < SPUR
    finite = np.isfinite(block.tested.mdb[: block.observations.image]).reshape(-1, 2)
    assert (finite & spurs).any()
    bare = np.zeros(len(problem.points), dtype=bool)
    bare[problem.point[spurs.any(axis=1)]] = True
    for values in (largest_detectable(block), largest_effect(block)):
        assert np.isposinf(values[bare]).all()
        assert np.isfinite(values[~bare]).all()


def test_the_quantile_plot_crosses_what_is_flagged(block: AdjustedBlock) -> None:
    drawing = quantiles_of_w(block.tested, image_coordinates(block), key="q", what="rays")
    assert drawing is not None
    root = sound(drawing)
    crosses = paths(root, "l-bad")
    flagged = int(block.flagged.sum())
    assert sum(len(runs(d)) for d in crosses) == 2 * flagged + 2  # two strokes; one in the legend


@pytest.mark.parametrize("f", [2, 3, 10, 500, None])
def test_the_distribution_of_tau(f: int | None) -> None:
    of = TestDistribution(f)
    p = np.array([0.001, 0.1, 0.5, 0.9, 0.9995])
    assert of.below(of.quantiles(p)) == pytest.approx(p, abs=1e-9)
    if f is not None:
        # E tau^2 = 1 for every f (Pope 1976)
        middle = of.quantiles((np.arange(200_000) + 0.5) / 200_000)
        assert np.mean(middle**2) == pytest.approx(1.0, abs=2e-3)
        assert of.below(np.array([-100.0, 100.0])) == pytest.approx([0.0, 1.0])


def test_large_blocks_are_thinned_and_say_so(
    block: AdjustedBlock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blockmap, "_MOST_POINTS", 20)
    monkeypatch.setattr(blockmap, "_MOST_PHOTOS", 4)
    monkeypatch.setattr(blockmap, "_MOST_ELLIPSES", 5)
    monkeypatch.setattr(pointmaps, "_MOST", 10)
    drawing = block_map(block)
    root = sound(drawing)
    drawn = sum(len(re.findall("M", d)) for k in range(1, 6) for d in paths(root, f"f-ramp-{k}"))
    assert drawn <= 20 + 5
    legend = [re.fullmatch(r"r [^(]*\((\d+)\)", one) for one in texts(root)]
    drawn_all = [int(found[1]) for found in legend if found]
    assert sum(drawn_all) == len(block.problem.points)  # the legend counts all
    notes = " ".join(texts(root))
    assert re.search(r"\d+ of \d+ points are drawn", notes)
    assert re.search(r"\d of 8 projection centres are drawn", notes)
    assert re.search(r"\d of \d+ error ellipses are drawn", notes)
    assert re.search(r"\d+ of \d+ points are drawn", redundancy_map(block).description)  # type: ignore[union-attr]


def test_the_curve_is_what_the_distribution_lets_expect(block: AdjustedBlock) -> None:
    drawing = histogram_of_w(block.tested, image_coordinates(block), key="w", what="rays")
    assert drawing is not None
    root = sound(drawing)
    (curve, *_) = sorted(paths(root, "l-series-2"), key=len, reverse=True)
    at = runs(curve)[0]
    w = block.w[np.isfinite(block.w)]
    (bars,) = paths(root, "gap")
    found = runs(bars)
    floor = max(one[:, 1].max() for one in found)
    counts, edges = np.histogram(w, 0.5 * np.arange(-16, 17))
    highest = int(counts.max())
    unit = (floor - min(one[:, 1].min() for one in found)) / highest
    expected = len(w) * float(np.diff(TestDistribution(None).below(np.array([-0.25, 0.25])))[0])
    assert floor - at[:, 1].min() == pytest.approx(unit * expected, abs=0.2)
    assert len(edges) == len(counts) + 1
    # the critical values are within
    assert {"−3.29", "3.29"} <= set(texts(root))


def test_images_without_a_size_of_their_pixels_are_in_px(block: AdjustedBlock) -> None:
    measured = block.problem.block
    assert image_units(measured) == ("µm", "mm", 1.0)
    cameras = tuple(replace(one, pixels=(230_000, 230_000)) for one in measured.cameras)
    unsized = adjust_block(replace(measured, cameras=cameras))
    assert image_units(unsized.problem.block) == ("px", "px", 1000.0)
    drawing = photo_residuals(unsized, "101")
    sized = photo_residuals(block, "101")
    assert drawing is not None
    assert sized is not None
    root = sound(drawing)
    assert {"x [px]", "y [px]"} <= set(texts(root))
    assert "µm" not in drawing.svg
    # the same picture: a pixel counts as 1 um
    arrows = [
        [d for d in paths(parsed(one.svg), "l-series-1") if "m" in d] for one in (drawing, sized)
    ]
    assert arrows[0] == arrows[1]
