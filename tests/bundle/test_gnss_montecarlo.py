"""Standard deviations of blocks with GNSS and IMU are true: simulated flights, by chi-square."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gnssblocks import flown
from scipy.special import chdtri

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.offsettests import offset_rows, offset_tests
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.prioroffsets import PriorOffsets

FLIGHTS = 120
SHARE = 1e-4  # of good programs that this test would fail


def bounds(degrees: int, tests: int) -> tuple[float, float]:
    """Where chi-square lies but for `SHARE` in all of so many tests."""
    each = SHARE / tests / 2.0
    return float(chdtri(degrees, 1.0 - each)), float(chdtri(degrees, each))


@pytest.mark.slow
def test_standard_deviations_of_a_block_with_shift_drift_and_boresight_are_true():
    offsets = PriorOffsets("strip", "strip", "block", drift_sigma=(0.02, 0.02, 0.02))
    groups: dict[str, list[np.ndarray]] = {}
    together = vtpv = redundancy = 0.0
    rejected = tested = 0
    for seed in range(FLIGHTS):
        rng = np.random.default_rng(seed)
        made = flown(
            offsets,
            seed=seed,
            position=0.08,
            drift=rng.normal(size=(2, 3)) * 0.02,
            far=(432_100.0, 5_234_000.0, 320.0),
        )
        scene = made.scene
        block = replace(scene.block, test=TestSettings(kind="baarda"))
        adjusted = adjust_block(block)
        assert adjusted.sigma == 1.0
        for row in adjusted.photo_rows():
            off = np.array(row.position) - scene.centres[row.photo]
            groups.setdefault("positions", []).append(off / np.array(row.s_position))
        for row in adjusted.point_rows():
            off = np.array(row.xyz) - scene.points[row.point]
            groups.setdefault("points", []).append(off / np.array(row.s_xyz))
        rows = offset_rows(adjusted)
        y = np.array([row.value - made.offsets[row.kind, row.group, row.axis] for row in rows])
        for row, off in zip(rows, y.tolist(), strict=True):
            groups.setdefault(f"{row.kind} {row.axis}", []).append(np.array([off / row.s]))
        q = adjusted.cofactors.offsets.own
        together += float(y @ np.linalg.solve(q, y))
        vtpv += adjusted.vtpv
        redundancy += adjusted.redundancy
        # against the truth: a test that is right rejects in alpha of the flights
        found = offset_tests(adjusted)
        tested += len(found.groups)
        rejected += sum(one.verdict.rejected for one in found.groups)
    low, high = bounds(FLIGHTS * len(rows), 3)
    assert low < together < high
    low, high = bounds(round(redundancy), 3)
    assert low < vtpv < high
    for name, values in groups.items():
        # of one flight they are correlated: each flight counts as one for each of its coordinates
        each = np.array(values).reshape(FLIGHTS, -1)
        low, high = bounds(FLIGHTS, each.shape[1] * len(groups))
        sums = np.sum(each**2, axis=0)
        assert low < sums.min() <= sums.max() < high, name
    assert rejected > 0.5 * tested  # shifts of a metre and drifts of some cm/s are there
