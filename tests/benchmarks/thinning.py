"""What thinning costs and keeps, beside points that go by chance, and its time.

    python tests/benchmarks/thinning.py [side of the block, default 8] [R ...]

A side x side block, 60/60, with points at random places, is thinned to R; then as many rays go by
chance (points of control stay, and five rays a photo). Standard deviations are for the a-priori
sigma0, of the photos and of the points that are left, over those with all points; time is processor
time in Cholesky factors of a 2000 x 2000 matrix, of the same run. At last a block on a grid, with
tilts and noise, where many parts come as near to R as they can: its rounds, and its time.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

sys.path.insert(0, "tests/benchmarks")
sys.path.insert(0, "tests/bundle")

from bundle_speed import BASE, HEIGHT, C, unit
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block, adjust_problem
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.thinning.accuracy import deviations
from anaplot.bundle.thinning.thinned import block_without, bundle_without
from anaplot.bundle.thinning.thinning import Thinning, thin_block
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    TestSettings,
)  # fmt: skip

A_PHOTO = 25
REACH = 1.25 * BASE


def random_block(side: int, seed: int = 1) -> Block:
    """A block with points at random places, control on its border and within."""
    rng = np.random.default_rng(seed)
    extent = (side - 1) * BASE + 2.0 * REACH
    count = int(A_PHOTO * (extent / (2.0 * REACH)) ** 2)
    ground = np.column_stack((
        rng.uniform(-REACH, extent - REACH, (count, 2)), rng.uniform(-30.0, 30.0, count),
    ))  # fmt: skip
    photos, rows = [], []
    for j in range(side):
        for i in range(side):
            centre = np.array([i * BASE, j * BASE, HEIGHT])
            photos.append(Photo(f"{i}-{j}", "c", tuple(centre.tolist()), (0.0, 0.0, 0.0)))
            off = ground - centre
            seen = np.flatnonzero((np.abs(off[:, :2]) < REACH).all(axis=1))
            xy = C * off[seen, :2] / -off[seen, 2:] + rng.normal(size=(len(seen), 2)) * 5e-3
            rows += [
                ImagePoint(f"{i}-{j}", f"p{k}", x, y)
                for k, (x, y) in zip(seen.tolist(), xy.tolist(), strict=True)
            ]
    places = [(x, y) for x in range(0, side, 3) for y in range(0, side, 3)]
    nearest = {int(np.argmin(np.hypot(*(ground[:, :2] - np.array(at) * BASE).T))) for at in places}
    control = tuple(
        ControlPoint(f"p{k}", tuple(ground[k].tolist()), (0.05,) * 3) for k in sorted(nearest)
    )
    size = 2.04 * C * REACH / (HEIGHT - 30.0)
    camera = Camera("c", C, (size, size))
    return Block(
        "random", Precision(), TestSettings(), (camera,), tuple(photos), (), tuple(rows), control
    )


def by_chance(thinning: Thinning, rng: np.random.Generator) -> AdjustedBlock | None:
    """Return the block with as many rays, points gone by chance; None where it falls apart."""
    problem = thinning.before.problem
    firm = {row.point for row in problem.block.control}
    size = np.bincount(problem.point)
    left = np.bincount(problem.photo)
    too_many = len(problem.photo) - len(thinning.block.problem.photo)
    gone = set()
    for k in rng.permutation(len(size)).tolist():
        photos = problem.photo[problem.point == k]
        if problem.points[k] in firm or size[k] > too_many or (left[photos] <= 5).any():
            continue
        gone.add(problem.points[k])
        left[photos] -= 1
        too_many -= int(size[k])
    try:
        return adjust_problem(bundle_without(problem, block_without(problem.block, gone)))
    except NotComputableError:
        return None


def main(side: int = 8, *limits: float) -> int:
    """Print a table; 0 when thinning is better than chance everywhere."""
    before = adjust_block(random_block(side))
    one = unit()
    print(
        f"{side * side} photos, {len(before.problem.photo)} rays, RI {before.indicators().ri:.3f}"
    )
    print(
        "   R   rays   photos  points  worst part |  by chance: photos  points  worst part | time"
    )
    good = True
    for least in limits or (0.2, 0.3, 0.4, 0.5):
        start = time.process_time()
        found = thin_block(before, least)
        spent = (time.process_time() - start) / one
        share = len(found.block.problem.photo) / len(before.problem.photo)
        strong = ~found.weak
        mine = [*_more(found), found.means[strong].min()]
        others = []
        for seed in range(5):
            chance = by_chance(found, np.random.default_rng(seed))
            if chance is not None:
                others.append([*_more(replace(found, block=chance)), _worst(found, chance)])
        text = "falls apart"
        if others:
            theirs = np.mean(others, axis=0).tolist()
            text = f"         {_text(theirs)}"
            good &= mine[0] < theirs[0] and mine[2] > theirs[2]
        print(f"{least:4.2f}  {100 * share:4.0f} %  {_text(mine)} | {text} | {spent:6.1f}")
    tilted(side)
    return 0 if good else 1


def tilted(side: int, least: float = 0.25) -> None:
    """Print how often redundancy numbers of a tilted block of strips are computed anew."""
    block = aerial(
        side, side, per_base=3, seed=1, noise_um=5.0, tilt=0.05, control_sigma=0.05
    ).block  # fmt: skip
    before = adjust_block(block)
    one, start = unit(), time.process_time()
    found = thin_block(before, least)
    spent = (time.process_time() - start) / one
    print(
        f"tilted: {len(found.gone)} of {len(before.problem.points)} points go at {least:g}, "
        f"{found.rounds} rounds | {spent:6.1f}"
    )


def _text(values: list[float]) -> str:
    return f"{100 * values[0]:+5.1f} % {100 * values[1]:+5.1f} %   {values[2]:6.3f}    "


def _more(found: Thinning) -> list[float]:
    spread = deviations(found)
    return [float(pair[1].mean() / pair[0].mean() - 1.0) for pair in (spread[0], spread[2])]


def _worst(found: Thinning, chance: AdjustedBlock) -> float:
    """Return the least mean redundancy number of parts that were above R; 0 of one without rays."""
    problem = found.before.problem
    place = np.full(len(problem.block.image_points), -1)
    place[problem.source] = np.arange(len(problem.source))
    r, counted = np.zeros((len(problem.photo), 2)), np.zeros(len(problem.photo), dtype=np.intp)
    rays = place[chance.problem.source]
    r[rays], counted[rays] = chance.cofactors.r, 2
    return float(np.nan_to_num(found.parts.means(r, counted))[~found.weak].min())


if __name__ == "__main__":
    words = sys.argv[1:]
    sys.exit(main(*map(int, words[:1]), *map(float, words[1:])))
