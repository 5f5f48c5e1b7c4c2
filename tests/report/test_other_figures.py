"""Figures of models, correlations, epochs and plans."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from svgs import SVG, paths, runs, sound, texts

from anaplot.adjustment.hypothesis import critical_f
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.epochs.displacements import compare_series
from anaplot.bundle.epochs.displacementtests import EpochTests, epoch_tests
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.photogrammetry.block import Block
from anaplot.planning.idealblock import IdealBlock, photograph
from anaplot.report.figures.blockmap import block_map
from anaplot.report.figures.correlations import parameter_matrix
from anaplot.report.figures.displacements import displacement_maps
from anaplot.report.figures.modelfigure import model_figure
from anaplot.report.figures.photobars import photo_redundancy
from anaplot.report.planblock import planned_block
from anaplot.report.plannetwork import planned_network
from anaplot.report.planpattern import planned_pattern


@cache
def layout() -> IdealBlock:
    return planned_block(strips=2, photos=4).result.made


def epoch(seed: int, moved: Mapping[str, tuple[float, float, float]] | None = None) -> Block:
    """The same photos and points with other noise; `moved` by name [m]."""
    made, random = layout(), np.random.default_rng(seed)
    points = {
        name: at + np.array((moved or {}).get(name, (0.0, 0.0, 0.0)))
        for name, at in made.points.items()
    }
    control = tuple(replace(row, sigma=(0.02, 0.02, 0.02)) for row in made.block.control)
    found = photograph(
        f"of {seed}", made.block.cameras, made.stations, points, control=control
    ).block
    noise = random.normal(0.0, 0.005, (len(found.image_points), 2)).tolist()
    rows = (
        replace(row, x=row.x + x, y=row.y + y)
        for row, (x, y) in zip(found.image_points, noise, strict=True)
    )
    return replace(found, image_points=tuple(rows))


def test_the_figure_of_ten_points_has_the_transfers_of_1983() -> None:
    """Figure 7a: L1 to L2 in y -.339 at r .258, of three pairs critical or serious."""
    solution = planned_pattern("10/5", base=90.0, d=99.0, c=150.0).result.solution
    drawing = model_figure(solution, solution.tested.transfers())
    assert drawing is not None
    root = sound(drawing)
    shown = texts(root)
    assert "y→y −0.34" in shown or "y→y −0.33" in shown
    assert "y 0.26  x 0.62" in shown
    assert sum("→" in one for one in shown) == 8  # every value has room
    heavy = [one for d in paths(root, "bold") for one in runs(d) if len(one) == 2]
    # 1 to 12 and 3 to 23, and the one in the legend
    assert len(heavy) == 3
    upright = [one for one in heavy if abs(one[1, 0] - one[0, 0]) < 0.3]
    assert len(upright) == 2
    assert "2 critical transfers" in drawing.description


def test_a_flagged_point_is_ringed_and_bad() -> None:
    plan = planned_pattern("9/3").result
    solution = plan.solution
    plain = model_figure(solution)
    assert plain is not None
    assert not paths(sound(plain), "l-bad")
    flagged = np.zeros(len(solution.tested), dtype=bool)
    flagged[0] = True
    object.__setattr__(solution.tested, "flagged", flagged)
    solution.__dict__.pop("table", None)
    drawing = model_figure(solution)
    assert drawing is not None
    root = sound(drawing)
    assert sum(d.count("M") for d in paths(root, "l-bad")) == 2  # and the legend's
    bad = [one for one in root.iter(f"{SVG}text") if "t-bad" in one.get("class", "")]
    assert [one.text for one in bad] == [solution.tested.keys[0][0]]


@pytest.fixture(scope="module")
def compared() -> EpochTests:
    moved = {"03-02": (0.5, -0.3, 0.0), "03-03": (0.0, 0.0, -2.0)}
    found = compare_series((epoch(1), epoch(2, moved=moved))).as_two()
    return epoch_tests(found, alpha=0.05)


def test_displacements_and_their_ellipses_are_drawn_to_one_scale(compared: EpochTests) -> None:
    along, across = displacement_maps(compared)
    root = sound(along)
    sound(across)
    found = compared.differences
    moved = [p.point for p in compared.points if p.verdict is not None and p.verdict.rejected]
    assert "03-02" in moved
    assert f"{len(moved)} moved" in along.description
    arrows, _ = paths(root, "l-bad")  # and the legend's
    shaft = next(one for one in runs(arrows) if len(one) == 2)  # the largest is the first
    k = found.points.index("03-02")
    d = found.d.reshape(-1, 3)[k, :2]
    step = (shaft[1] - shaft[0]) * [1, -1]
    scale = np.hypot(*step) / np.hypot(*d)
    assert step == pytest.approx(d * scale, abs=0.2)
    # the region that holds no displacement, by the distribution of the test
    q = found.cofactors[3 * k : 3 * k + 2, 3 * k : 3 * k + 2]
    sigma2 = 1.0 if found.by_known else found.vtpv / found.redundancy
    degrees = None if found.by_known else found.redundancy
    half = scale * np.sqrt(np.linalg.eigvalsh(q) * sigma2 * 2.0 * critical_f(0.05, 2, degrees))
    sizes = [
        (float(a), float(b))
        for d in paths(root, "thin")
        for a, b in re.findall(r"a(\S+?) (\S+?) \S+? 1 0 ", d)[::2]
    ]
    assert any(
        a == pytest.approx(half[1], rel=0.05, abs=0.06)
        and b == pytest.approx(half[0], rel=0.05, abs=0.06)
        for a, b in sizes
    )


def test_plans_are_drawn_without_flags() -> None:
    block = planned_block(strips=2, photos=4).result.block
    drawing = block_map(block, planned=True)
    root = sound(drawing)
    assert "flagged" not in " ".join(texts(root))
    assert drawing.description.startswith("Planned block")
    bars = photo_redundancy(block)
    assert bars is not None
    assert "8 photos" in bars.description
    sound(bars)


def test_what_photos_look_at_levelly_is_drawn_from_the_side() -> None:
    found = planned_network("cube", case="B").result
    root = sound(block_map(found.block, planned=True))
    assert {"X [m]", "Z [m]"} <= set(texts(root))
    assert not paths(root, "faint")


def test_parameters_have_their_correlations() -> None:
    block = adjust_block(epoch(3), additional=additional_parameters("ebner", 20.0))
    drawing = parameter_matrix(block)
    assert drawing is not None
    assert "12 parameters" in drawing.description
    shown = texts(sound(drawing))
    assert shown.count("b12") == 2
    q = block.cofactors.shared
    rho = q[11, 5] / np.sqrt(q[11, 11] * q[5, 5])
    assert f"{rho:.2f}".replace("-", "−") in shown
    assert parameter_matrix(adjust_block(epoch(3))) is None
