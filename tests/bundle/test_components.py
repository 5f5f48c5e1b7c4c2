"""Variance components of blocks: the factors that made the noise, and their limits."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from wild import text_of

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.components import block_components
from anaplot.errors import InputError
from anaplot.report.asjson import json_text
from anaplot.report.components import components_document

pytestmark = pytest.mark.slow


def noisy(sigma_x, sigma_y, *, seed=0, **options):
    """Return an adjusted block of a-priori sigma 5 um whose x and y have other ones [um]."""
    scene = aerial(strips=2, length=5, per_base=2, seed=seed, **options)
    rng = np.random.default_rng(seed)
    strips = {photo: k for k, strip in enumerate(scene.block.strips) for photo in strip.photos}

    def off(sigma, photo):
        return rng.normal() * (sigma[strips[photo]] if np.ndim(sigma) else sigma) * 1e-3

    rows = [
        replace(row, x=row.x + off(sigma_x, row.photo), y=row.y + off(sigma_y, row.photo))
        for row in scene.block.image_points
    ]
    return adjust_block(scene.with_rows(rows).block)


def test_x_and_y_get_the_variances_that_made_their_noise():
    found = [block_components(noisy(10.0, 4.0, seed=s)) for s in range(8)]
    assert all(each.variances.converged for each in found)
    assert [c.name for c in found[0].variances.components] == ["image x", "image y"]
    mean = np.mean([each.variances.factors for each in found], axis=0)
    deviation = np.mean([[c.deviation for c in each.variances.components] for each in found], 0)
    assert (np.abs(mean - [4.0, 0.64]) < 4.0 * deviation / np.sqrt(8)).all()
    sigma = found[0].sigmas[0]
    assert sigma is not None
    assert sigma.unit == "um"
    assert sigma.estimated == pytest.approx(5.0 * np.sqrt(found[0].variances.factors[0]))


def test_the_block_adjusted_with_them_has_sigma0_one():
    found = block_components(noisy(10.0, 4.0))
    assert found.block.sigma0 == pytest.approx(1.0, abs=1e-3)
    total = sum(c.redundancy for c in found.variances.components)
    assert total == pytest.approx(found.block.redundancy)
    # and its residuals are printed in micrometres of the axis they belong to
    row = next(found.block.ray_rows())
    k = int(np.nonzero(found.block.problem.source == row.row)[0][0])
    expected = found.block.v[k] * found.block.problem.sigma_xy[k] * 1e3
    np.testing.assert_allclose([one.residual for one in row.xy], expected)


def test_one_group_of_all_is_sigma0_squared():
    block = noisy(7.0, 7.0)
    found = block_components(block, "kinds")
    assert block.sigma0 is not None
    assert found.variances.factors[0] == pytest.approx(block.sigma0**2, rel=1e-3)


def test_strips_and_operators():
    block = noisy((3.0, 12.0), (3.0, 12.0), seed=4)
    found = block_components(block, "strips")
    one, two = found.variances.components
    assert (one.name, two.name) == ("strip s1", "strip s2")
    assert abs(one.factor - 0.36) < 4.0 * one.deviation
    assert abs(two.factor - 5.76) < 4.0 * two.deviation
    strips = {photo: strip.id for strip in block.problem.block.strips for photo in strip.photos}
    people = {photo: "Anna" if strip == "s1" else "Ben" for photo, strip in strips.items()}
    by_operator = block_components(block, "operators", operators=people)
    assert [c.name for c in by_operator.variances.components] == ["operator Anna", "operator Ben"]
    np.testing.assert_allclose(by_operator.variances.factors, found.variances.factors, rtol=1e-6)


def test_control_and_priors_are_groups_of_their_own():
    block = noisy(5.0, 5.0, control_sigma=0.05, priors=True)
    found = block_components(block, "kinds")
    components = {c.name: c for c in found.variances.components}
    assert list(components) == ["image", "control", "prior positions", "prior rotations"]
    assert [c.observations for c in components.values()] == [2 * len(block.v), 18, 30, 30]
    assert sum(c.observations for c in components.values()) == block.problem.observations
    image = components["image"]
    assert abs(image.factor - 1.0) < 4.0 * image.deviation


def test_deviations_are_those_of_the_dense_formula():
    block = noisy(10.0, 4.0, seed=2, control_sigma=0.05).problem.block
    rng = np.random.default_rng(2)
    control = [
        replace(row, xyz=tuple((np.array(row.xyz) + rng.normal(size=3) * 0.1).tolist()))
        for row in block.control
    ]
    found = block_components(adjust_block(replace(block, control=tuple(control))))
    problem, linear = found.block.problem, found.block.cofactors.normal.linear
    n, m = 6 * len(problem.photos), len(problem.photo)
    given = np.argwhere(np.isfinite(problem.known_sigma))
    rows = np.zeros((2 * m + len(given), n + 3 * len(problem.points)))
    for ray in range(m):
        f, p = 6 * int(problem.photo[ray]), n + 3 * int(problem.point[ray])
        rows[2 * ray : 2 * ray + 2, f : f + 6] = linear.a[ray]
        rows[2 * ray : 2 * ray + 2, p : p + 3] = linear.b[ray]
    for k, (p, axis) in enumerate(given):
        rows[2 * m + k, n + 3 * p + axis] = 1.0 / problem.known_sigma[p, axis]
    # orthogonal columns from columns of like size
    q, _ = np.linalg.qr(rows / np.linalg.norm(rows, axis=0))
    redundant = np.eye(len(rows)) - q @ q.T
    group = np.concatenate((np.tile([0, 1], m), np.full(len(given), 2)))
    traces = np.array(
        [
            [np.sum(redundant[np.ix_(group == g, group == h)] ** 2) for h in range(3)]
            for g in range(3)
        ]
    )
    expected = found.variances.factors * np.sqrt(2.0 * np.diag(np.linalg.inv(traces)))
    assert all(c.state == "estimated" for c in found.variances.components)
    deviations = [c.deviation for c in found.variances.components]
    np.testing.assert_allclose(deviations, expected, rtol=1e-4)


def test_unknown_groupings_and_operators_are_refused():
    block = noisy(5.0, 5.0)
    with pytest.raises(InputError, match="one of"):
        block_components(block, "colour")
    with pytest.raises(InputError, match="who measured"):
        block_components(block, "operators")
    with pytest.raises(InputError, match="unknown photo 999"):
        block_components(block, "operators", operators={"999": "Anna"})


def test_text_and_json_say_the_same():
    found = block_components(noisy(10.0, 4.0, control_sigma=0.05))
    document = components_document(found)
    text = text_of(document)
    value = json.loads(json_text(document.answer))
    assert [group["group"] for group in value["groups"]] == ["image x", "image y", "control"]
    for group in value["groups"]:
        assert f"{group['sigma_factor']:.3f}" in text
        assert group["sigma"] == pytest.approx(group["sigma_apriori"] * group["sigma_factor"])
