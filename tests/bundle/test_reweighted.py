"""A block adjusted with other weights, by its normal equations and by the columns of R."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest
from conditionblocks import every_kind, flat_scene, with_conditions
from givenblocks import campaigns, one_after_the_other
from gnssblocks import flown
from test_block_residuals import CASES, adjusted

from anaplot.adjustment.leftout import ReducedSystem
from anaplot.adjustment.reweighting import reweight, weighted_adjustments, weighted_misclosures
from anaplot.adjustment.watch import Watch
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve import reweighted
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.residuals import BlockResiduals, residuals_of
from anaplot.photogrammetry.prioroffsets import PriorOffsets


def conditions() -> BlockResiduals:
    scene = flat_scene()
    return residuals_of(with_conditions(scene, every_kind(scene, firm=(5,))))


def positions() -> BlockResiduals:
    return residuals_of(adjust_block(flown(PriorOffsets(drift="strip")).scene.block))


def given() -> BlockResiduals:
    return residuals_of(one_after_the_other(campaigns(5.0)))


ERRORS = PointError(np.array([3, 7])), NotPositiveError(0)
OTHERS = {"conditions": conditions, "positions with offsets": positions, "given": given}


def system(name: str) -> BlockResiduals:
    return OTHERS[name]() if name in OTHERS else residuals_of(adjusted(CASES[name]))


def suspects(of: BlockResiduals) -> np.ndarray:
    """All but priors of parameters, offsets, and conditions free of error."""
    rows = of.rows
    out = np.ones(rows.count, dtype=bool)
    out[rows.starts[2] : rows.starts[3]] = False
    if of.problem.conditions is not None:
        out[rows.starts[3] :] = ~of.problem.conditions.firm
    return out


@pytest.mark.parametrize("name", [*CASES, *OTHERS])
def test_changing_weights_agree_with_the_columns(name: str) -> None:
    of = system(name)
    rng, allowed = np.random.default_rng(3), suspects(of)
    low = allowed & (rng.random(len(allowed)) < 0.3)
    weights = np.where(low, 10.0 ** rng.uniform(-3.0, 0.0, len(low)), 1.0)
    adjust = weighted_adjustments(of)
    for share in (0.0, 0.3, 0.02, 0.02, 1e-4):  # of the weights: some are formed anew, some not
        weights = np.where(
            low, np.clip(weights * (1.0 + share * rng.normal(size=len(low))), 0, 1), 1
        )
        np.testing.assert_allclose(adjust(weights), weighted_misclosures(of, weights), atol=1e-7)
    reduced = ReducedSystem(of, np.flatnonzero(low & (of.r > 0.3))[:3].tolist())
    there = weighted_adjustments(reduced)
    for one in (weights, np.where(low, 0.99 * weights, 1.0)):
        np.testing.assert_allclose(there(one), weighted_misclosures(reduced, one), atol=1e-7)


def light(of: BlockResiduals, weight: float) -> np.ndarray:
    """Weights of which all rays of a photo, and all but one of a point, have hardly any."""
    problem = of.problem
    point = int(np.argmax(np.bincount(problem.point)))
    weights = np.ones(of.rows.count)
    of_rays = weights[: of.rows.image].reshape(-1, 2)
    of_rays[np.flatnonzero(problem.point == point)[1:]] = weight
    of_rays[problem.photo == problem.photo[0]] = weight
    return weights


def test_hardly_any_weight_is_as_exact_as_an_orthogonal_adjustment() -> None:
    of = system("weighted control")
    weights = light(of, 1e-8)
    root = np.sqrt(weights)
    order = np.argsort(
        -weights, kind="stable"
    )  # heavy rows first, to keep the digits of light ones
    design = of.design().toarray()[order] * root[order, None]
    q = np.linalg.qr(design / np.linalg.norm(design, axis=0))[0]
    e = (root * of.e)[order]
    expected = np.zeros_like(e)
    expected[order] = e - q @ (q.T @ e)
    np.testing.assert_allclose(weighted_adjustments(of)(weights), expected / root, atol=1e-5)


@pytest.mark.parametrize("photo", [False, True])
def test_a_datum_that_weights_lose_is_changed_by_columns(photo: bool) -> None:
    of = system("weighted control")
    first, _, third, _ = of.rows.starts
    weights = np.ones(of.rows.count)
    weights[first:third] = 0.0
    if photo:
        weights[:first] = np.where(np.repeat(of.problem.photo == 1, 2), 0.0, 1.0)
    found, expected = weighted_adjustments(of)(weights), weighted_misclosures(of, weights)
    np.testing.assert_allclose(found[weights > 0.0], expected[weights > 0.0], atol=1e-7)
    assert not found[weights == 0.0].any()


@pytest.mark.parametrize("error", ERRORS)
def test_what_low_weights_leave_open_is_changed_by_columns(error, monkeypatch) -> None:
    of = system("priors")
    weights = np.where(suspects(of), np.linspace(0.01, 0.9, of.rows.count), 1.0)
    formed: list[np.ndarray] = []

    def form(problem, structure, linear, *rest):
        formed.append(linear.e)
        if len(formed) == 1:
            raise error
        return NormalEquations(problem, structure, linear, *rest)

    monkeypatch.setattr(reweighted, "NormalEquations", form)
    found = weighted_adjustments(of)(weights)
    changed = (formed[0] != formed[1]).any(axis=1)
    of_error = of.problem.photo == 0 if error is ERRORS[1] else np.isin(of.problem.point, [3, 7])
    assert changed.any()
    assert not changed[~of_error].any()
    np.testing.assert_allclose(found, weighted_misclosures(of, weights), atol=1e-7)


def spoiled(of: BlockResiduals) -> BlockResiduals:
    """The same with gross errors in some image coordinates."""
    problem, normal = of.problem, of.cofactors.normal
    xy, rng = problem.xy.copy(), np.random.default_rng(5)
    wrong = rng.choice(np.flatnonzero(of.r[: of.rows.image] > 0.4), 6, replace=False)
    xy.reshape(-1)[wrong] += rng.choice((-0.06, 0.06), 6)
    linear = normal.linear
    e = linear.e + (problem.xy - xy) / problem.sigma_xy
    moved = replace(linear, e=e)
    return of.adjusted(NormalEquations(problem, normal.structure, moved, 0.0, normal.anchor))


@dataclass(frozen=True)
class ByColumns:
    """A system of which nothing but the columns is known."""

    names: Sequence[Hashable]
    e: np.ndarray
    r: np.ndarray
    vtpv: float
    redundancy: int
    columns: Callable[[np.ndarray], np.ndarray]


@pytest.mark.parametrize("method", ["huber", "danish"])
@pytest.mark.parametrize("name", ["ebner", "priors", "conditions", "positions with offsets"])
def test_weights_settle_where_those_by_columns_do(
    name: str, method: Literal["huber", "danish"]
) -> None:
    of = spoiled(system(name))
    plain = ByColumns(of.names, of.e, of.r, of.vtpv, of.redundancy, of.columns)
    told: list[float] = []
    watch = Watch(lambda what, fraction: told.append(fraction))
    found = reweight(of, method, suspects(of), watch)
    other = reweight(plain, method, suspects(of))
    assert found.converged
    assert 0 < (found.weights < 1.0).sum() < of.redundancy
    assert len(found.changes) == len(other.changes) == len(told)
    assert told[0] < told[-1] == 1.0
    np.testing.assert_allclose(found.weights, other.weights, atol=1e-7)
    np.testing.assert_allclose(found.misclosures, other.misclosures, atol=1e-7)


def test_where_the_end_is_asked_for_the_weights_are_not_settled() -> None:
    of, watch = system("priors"), Watch()
    watch.stop()
    found = reweight(of, "danish", suspects(of), watch)
    assert len(found.changes) == 1
    assert not found.converged
