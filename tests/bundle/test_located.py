"""What is named as moved: a part that moves as a whole, and the points that adjoin it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from epochblocks import compare_epochs, epoch, stable_names

from anaplot.adjustment.hypothesis import f_test
from anaplot.bundle.epochs.displacementtests import epoch_tests
from anaplot.bundle.epochs.located import free_one_by_one


@pytest.mark.slow
@pytest.mark.parametrize("height", [0.6, 1.2])  # some five and ten standard deviations
def test_a_part_that_moves_as_a_whole_is_named_and_nothing_that_adjoins_it(height) -> None:
    runs, alpha = 60, 0.05
    found = compare_epochs(epoch(11), epoch(12), stable=stable_names())
    assert len(found.points) == 30
    third = sorted(range(30), key=lambda k: found.places[k, 0])[-10:]
    movement = np.zeros((30, 3))
    movement[third] = (height / 3, -height / 3, height)
    root = np.linalg.cholesky(found.cofactors)
    rng = np.random.default_rng(3)
    right, missed = 0, 0
    for _ in range(runs):
        d = root @ rng.normal(size=90) + movement.reshape(-1)
        fresh = replace(found, d=d, vtpv=float(rng.chisquare(found.redundancy)))
        named = {step.point for step in epoch_tests(fresh, alpha=alpha).located}
        moved = {found.points[k] for k in third}
        right += named <= moved
        missed += len(moved - named)
    # without what has moved the rest is accepted in 1 - alpha: binomial, within 3.3 deviations
    assert right > runs * (1.0 - alpha) - 3.3 * np.sqrt(runs * alpha * (1.0 - alpha))
    assert missed == 0 or height < 1.0


def test_the_steps_are_what_r_falls_by_one_after_the_other() -> None:
    rng = np.random.default_rng(5)
    n = 24
    spread = rng.normal(size=(n, n))
    cofactors = spread @ spread.T + np.eye(n)
    owners = [k // 2 for k in range(n - 2)] + [n, n + 1]
    for _ in range(20):
        d = np.linalg.cholesky(cofactors) @ (rng.normal(size=n) + 9.0 * (rng.random(n) < 0.3))
        total = float(d @ np.linalg.solve(cofactors, d))
        whole = f_test(total, n, alpha=0.05)
        steps = free_one_by_one(owners, d, np.linalg.inv(cofactors), whole)
        held, before = list(range(n)), total
        for step in steps:
            held = [k for k in held if owners[k] != step.owner]
            rest = d[held] @ np.linalg.solve(cofactors[np.ix_(held, held)], d[held])
            np.testing.assert_allclose([step.rest, step.square], [rest, before - rest], atol=1e-6)
            before = float(rest)
        assert not held or not f_test(before, len(held), alpha=0.05).rejected
        assert len({step.owner for step in steps}) == len(steps)
