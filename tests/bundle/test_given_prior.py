"""What one adjustment leaves another: two halves one after the other are both at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from denseblock import dense
from givenblocks import Halves, beside, campaigns, of_rays, one_after_the_other, parted
from scipy.special import chdtrc

from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.errors.controllast import clean_control_last
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.snooping import classify
from anaplot.bundle.hypotheses.giventests import given_tests
from anaplot.bundle.hypotheses.verdict import HypothesisSettings
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.datum import priors_hold
from anaplot.bundle.solve.externalreliability import external_reliability
from anaplot.bundle.solve.posteriors import posterior_names, posterior_of
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.residuals import block_residuals, residuals_of
from anaplot.errors import InputError
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.objectconditions import ObjectCondition
from anaplot.photogrammetry.posterior import CoordinateName, Posterior

LINEAR = 1e-9
THOUSANDTH = 1e-3


def same(halves, of=("points",), limit=LINEAR, additional=None):
    """Both ways agree: coordinates, cofactors, redundancy, redundancy numbers of the rays."""
    after = one_after_the_other(halves, of, additional)
    once = adjust_block(halves.both, additional=additional)
    apart, cofactors = beside(after, once)
    assert apart < limit
    assert cofactors < limit
    first = adjust_block(halves.first, additional=additional)
    assert after.redundancy + first.redundancy == once.redundancy
    mine, whole = of_rays(after, after.cofactors.r), of_rays(once, once.cofactors.r)
    assert max(np.abs(value - whole[ray]).max() for ray, value in mine.items()) < limit
    return after, once


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.05, 0.0], ids=["weighted", "exact"])
@pytest.mark.parametrize("of", [("points",), ("points", "photos")], ids=["points", "both"])
def test_two_campaigns_at_the_same_place_of_linearisation(sigma, of):
    same(campaigns(control_sigma=sigma), of)


def test_two_sets_of_points_hang_together_by_their_photos():
    same(parted(), ("photos",))


@pytest.mark.parametrize("turned", [False, True], ids=["east", "and west"])
def test_rays_of_the_same_points_in_the_same_photos_in_two_halves(turned):
    """A strip flown back has its kappa on either side of pi."""
    same(parted(points=False, turned=turned), ("points", "photos"))


@pytest.mark.slow
@pytest.mark.parametrize("of", [("points",), ("points", "photos")], ids=["points", "both"])
def test_with_noise_to_a_thousandth_of_the_standard_deviations(of):
    after, once = same(campaigns(5.0, per_base=2), of, THOUSANDTH)
    mine, whole = of_rays(after, after.w), of_rays(once, once.w)
    # each by its own sigma0
    ratio = after.sigma0 / once.sigma0
    assert max(np.nanmax(np.abs(w * ratio - whole[ray])) for ray, w in mine.items()) < 0.01
    assert after.vtpv + adjust_block(campaigns(5.0, per_base=2).first).vtpv == pytest.approx(
        once.vtpv, rel=1e-3
    )


def test_a_small_error_goes_through_linearly():
    """Noise of a ten-thousandth: what is not linear is beyond what is compared."""
    halves = campaigns(5e-4)
    after, once = one_after_the_other(halves), adjust_block(halves.both)
    # in standard deviations for that noise
    assert beside(after, once)[0] < 1e-4 * 1e-3


@pytest.mark.slow
def test_with_additional_parameters_of_each_camera():
    halves = campaigns()
    chosen = additional_parameters("ebner:camera", 5.0)
    same(halves, ("points",), additional=chosen)
    same(halves, ("points",), additional=additional_parameters("ebner:photo", 5.0))


def test_with_conditions_in_the_second_half():
    halves = campaigns()
    at = dict.fromkeys(row.point for row in halves.second.image_points)
    names = list(at)
    truth = aerial(2, 4, seed=3).points
    conditions = (
        ObjectCondition(
            "distance",
            (names[1], names[6]),
            float(np.linalg.norm(truth[names[1]] - truth[names[6]])),
            0.01,
        ),
        ObjectCondition(
            "distance",
            (names[2], names[9]),
            float(np.linalg.norm(truth[names[2]] - truth[names[9]])),
            0.0,
        ),
    )
    same(
        replace(
            halves,
            second=replace(halves.second, conditions=conditions),
            both=replace(halves.both, conditions=conditions),
        )
    )


def test_points_of_two_rays_and_of_one():
    """Given points are held where one ray does not determine them; the datum is the prior's."""
    halves = campaigns()
    left = posterior_of(adjust_block(halves.first))
    seen: dict[str, int] = {}
    rows = []
    for row in halves.second.image_points:
        seen[row.point] = seen.get(row.point, 0) + 1
        if seen[row.point] <= 1 + int(row.point[1:]) % 3:
            rows.append(row)
    assert 1 in {min(n, 1 + int(p[1:]) % 3) for p, n in seen.items()}
    second = replace(halves.second, image_points=tuple(rows), control=())
    both = replace(
        halves.both,
        image_points=halves.first.image_points + tuple(rows),
        control=halves.first.control,
    )
    after = adjust_block(replace(second, given=left))
    once = adjust_block(both)
    assert max(beside(after, once)) < LINEAR
    # by themselves they are not determined
    assert len(after.problem.points) > len(make_problem(second).points)


def weakly_held(sigma):
    halves = campaigns(5.0, sigma)
    rng = np.random.default_rng(7)
    control = tuple(
        replace(row, xyz=tuple(v + rng.normal() * sigma for v in row.xyz))
        for row in halves.both.control
    )
    return Halves(
        replace(halves.first, control=control[:-1]),
        replace(halves.second, control=control[-1:]),
        replace(halves.both, control=control),
    )


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [1.0, 2.0])
def test_a_datum_of_metres_with_noise(sigma):
    """To .04 of the standard deviations, as docs/adjust.md has it."""
    halves = weakly_held(sigma)
    after, once = one_after_the_other(halves), adjust_block(halves.both)
    bending = given_tests(after).bending
    assert bending < 0.2
    apart, cofactors = beside(after, once)
    assert apart < 0.04
    assert cofactors < 0.04
    # of the square of the datum's standard deviation
    tenth = given_tests(one_after_the_other(weakly_held(sigma / 10.0))).bending
    assert bending == pytest.approx(100.0 * tenth, rel=0.1)


@pytest.mark.parametrize("sigma", [10.0, 20.0, 150.0])
def test_a_datum_too_weak_to_be_carried_on_is_refused(sigma):
    with pytest.raises(InputError, match="its datum is too weak to be carried on: movements as"):
        one_after_the_other(weakly_held(sigma))


# --- against a dense adjustment -------------------------------------------------------------


def dense_with_prior(block):
    """Normal matrix of all observations, the rows of the prior apart, and its pieces."""
    design, free = dense(block)
    given = block.cofactors.normal.linear.given
    jacobian = np.hstack((given.photos.toarray(), given.points.toarray()))
    more = design.shape[1] - jacobian.shape[1]
    jacobian = np.hstack((jacobian, np.zeros((len(jacobian), more))))
    return design[:, free], jacobian[:, free], given


@pytest.fixture(scope="module")
def shaken():
    halves = campaigns(5.0)
    return halves, one_after_the_other(halves, ("points",))


def test_everything_against_a_dense_adjustment(shaken):
    _, after = shaken
    design, jacobian, given = dense_with_prior(after)
    prior = after.problem.given
    c0 = prior.covariance
    p = np.linalg.inv(c0)
    normal = design.T @ design + jacobian.T @ p @ jacobian
    inverse = np.linalg.inv(normal)
    adjusted = np.einsum("ij,jk,ik->i", design, inverse, design)
    r = 1.0 - adjusted[: 2 * len(after.problem.photo)].reshape(-1, 2)
    assert after.cofactors.r == pytest.approx(r, abs=1e-8)
    v = given.misclosure
    left = c0 - jacobian @ inverse @ jacobian.T
    m = p @ left @ p
    found = given_tests(after)
    rows = found.coordinates
    w = (p @ v) / np.sqrt(np.diag(m)) / after.sigma
    assert [one.w for one in rows] == pytest.approx(w.tolist(), rel=1e-6, abs=1e-8)
    assert [one.r for one in rows] == pytest.approx(np.diag(left @ p).tolist(), abs=1e-8)
    assert [one.mdb for one in rows] == pytest.approx(
        (after.test.delta0 / np.sqrt(np.diag(m))).tolist(), rel=1e-6
    )
    # the redundancy is that of the rays, of weighted control and of the prior
    image = after.cofactors.r.sum() + np.nansum(after.cofactors.r_ground)
    assert image + sum(one.r for one in rows) == pytest.approx(after.redundancy, abs=1e-7)
    # v'Pv of all
    rays = float((after.cofactors.normal.linear.e**2).sum())
    control = float((after.cofactors.normal.linear.point_e**2).sum())
    assert after.vtpv == pytest.approx(rays + control + v @ p @ v, rel=1e-12)


def test_the_global_test_is_that_of_the_two_solutions(shaken):
    """d'(C0 + C1)^-1 d, with control enough in the second half to stand alone."""
    halves, _ = shaken
    second = replace(halves.second, control=halves.both.control)
    left = posterior_of(adjust_block(halves.first))
    alone = posterior_of(adjust_block(second), ("points",))
    place = {name: k for k, name in enumerate(alone.names)}
    at = [place[name] for name in left.names]
    d = alone.x[at] - left.x
    spread = left.covariance + alone.covariance[np.ix_(at, at)]
    found = given_tests(adjust_block(replace(second, given=left)))
    test = found.verdict.known
    assert test.dimension == len(d)
    assert test.square == pytest.approx(float(d @ np.linalg.solve(spread, d)), rel=2e-3)
    assert test.significance == pytest.approx(chdtrc(len(d), test.square), rel=1e-9)


def test_external_reliability_is_that_of_both_at_once(shaken):
    halves = campaigns()
    after, once = one_after_the_other(halves), adjust_block(halves.both)
    mine = dict(zip([(r.photo, r.point) for r in after.ray_rows()],
                    external_reliability(after).rays, strict=True))  # fmt: skip
    whole = dict(zip([(r.photo, r.point) for r in once.ray_rows()],
                     external_reliability(once).rays, strict=True))  # fmt: skip
    for ray, pair in mine.items():
        for one, other in zip(pair, whole[ray], strict=True):
            assert one.point == other.point
            assert one.effect_m == pytest.approx(other.effect_m, rel=1e-6, abs=1e-9)
    rays, q = after.cofactors.point_rays(3)
    assert np.diag(q).reshape(-1, 2) == pytest.approx(after.cofactors.r[rays], abs=1e-10)


# --- contradiction --------------------------------------------------------------------------


def moved_prior(left, name, by):
    x = left.x.copy()
    for k, one in enumerate(left.names):
        if one.owner == name:
            x[k] -= by[one.axis]
    return replace(left, x=x)


@pytest.mark.slow
def test_a_point_that_has_moved_is_named_with_its_movement(shaken):
    halves, _ = shaken
    left = posterior_of(adjust_block(halves.first))
    off = moved_prior(left, "p7", (1.5, 0.0, -2.0))
    block = adjust_block(replace(halves.second, given=off))
    found = given_tests(block)
    assert found.verdict.rejected
    assert found.contradicted[0].name == "p7"
    worst = found.contradicted[0]
    # the estimate of what was planted, within four of its standard deviations (p below 1e-4)
    quiet = next(o for o in given_tests(adjust_block(replace(halves.second, given=left))).owners
                 if o.name == "p7")  # fmt: skip
    shift = np.array(worst.difference) - np.array(quiet.difference)
    assert shift == pytest.approx((1.5, 0.0, -2.0), abs=2e-3)
    assert found.flagged
    # of what is right, one in a thousand is rejected
    agreed = given_tests(
        adjust_block(replace(halves.second, given=off.without(["p7"]))), HypothesisSettings(0.001)
    )
    assert not agreed.verdict.rejected


def test_what_only_the_prior_holds_cannot_contradict_it():
    """The whole prior shifted: seven of its combinations are the datum, and stay unseen."""
    halves = campaigns(5.0)
    second = replace(halves.second, control=())
    left = posterior_of(adjust_block(halves.first))
    shifted = replace(left, x=left.x + np.where([n.axis == 2 for n in left.names], 30.0, 0.0))
    there = given_tests(adjust_block(replace(second, given=left)))
    away = given_tests(adjust_block(replace(second, given=shifted)))
    assert there.conditions == len(left.names) - 7
    assert away.verdict.known.square == pytest.approx(there.verdict.known.square, rel=1e-4)
    assert sum(one.r for one in there.coordinates) < there.conditions


@pytest.mark.slow
def test_the_global_test_keeps_its_size():
    """With the known and the estimated variance."""
    settings = HypothesisSettings(alpha=0.25)
    rejected = np.zeros(2, dtype=int)
    quiet = aerial(1, 3, noise_um=0.0, control_sigma=0.05, seed=1).block
    rng = np.random.default_rng(17)
    start = adjust_block(quiet).state
    for _ in range(60):
        halves = []
        for prefix in ("a", "b"):
            rows = tuple(
                replace(row, photo=prefix + row.photo, x=row.x + rng.normal() * 5e-3,
                        y=row.y + rng.normal() * 5e-3)
                for row in quiet.image_points
            )  # fmt: skip
            photos = tuple(replace(photo, id=prefix + photo.id) for photo in quiet.photos)
            control = tuple(
                replace(c, xyz=tuple(v + rng.normal() * 0.05 for v in c.xyz)) for c in quiet.control
            )
            halves.append(
                replace(quiet, photos=photos, strips=(), image_points=rows, control=control)
            )
        left = posterior_of(adjust_bundle(make_problem(halves[0]), start))
        after = adjust_bundle(make_problem(replace(halves[1], given=left)), start)
        verdict = given_tests(after, settings).verdict
        rejected += [verdict.known.rejected, verdict.estimated.rejected]
    # of 60, each with the probability 1/4: fewer than 3 in 6e-6, more than 29 in 4e-5 of all cases
    assert (rejected >= 3).all()
    assert (rejected <= 29).all()


# --- with the searches for gross errors -----------------------------------------------------


@pytest.mark.parametrize(
    "strategy", ["tau", *(pytest.param(name, marks=pytest.mark.slow) for name in ("search", "l1"))]
)
def test_strategies_reject_as_with_both_at_once(shaken, strategy):
    halves, _ = shaken
    rows = list(halves.second.image_points)
    rows[17] = replace(rows[17], x=rows[17].x + 0.08)
    second = replace(halves.second, image_points=tuple(rows))
    left = posterior_of(adjust_block(halves.first))
    found = block_gross_errors(replace(second, given=left), strategy)
    wanted = ("image", rows[17].photo, rows[17].point, None, "x")
    assert wanted in [one.name for one in found.rejected]
    # and the block without it is the one adjusted without it
    assert found.block.problem.given is not None
    assert len(found.rejected) < 6


def test_residuals_linearised_anywhere_have_the_priors_part(shaken):
    _, after = shaken
    there = block_residuals(after.problem, after.state, after.cofactors.normal.structure)
    at = residuals_of(after)
    assert there.vtpv == pytest.approx(after.vtpv, rel=1e-9)
    assert there.e == pytest.approx(at.e, abs=1e-6)
    column = there.columns(np.array([5]))[:, 0]
    assert column[5] == pytest.approx(after.cofactors.r.reshape(-1)[5], abs=1e-9)


def test_a_given_prior_holds_the_datum_when_control_comes_last(shaken):
    halves, _ = shaken
    left = posterior_of(adjust_block(halves.first))
    second = replace(halves.second, control=halves.both.control, given=left)
    assert priors_hold(make_problem(replace(second, control=())))
    found = clean_control_last(second, "tau")
    assert found.datum == "priors"
    assert not priors_hold(make_problem(replace(second, given=None)))


def test_a_given_prior_stays_when_control_comes_last_also_where_it_holds_no_datum(shaken):
    halves, _ = shaken
    first = adjust_block(halves.first)
    seen = {row.point for row in halves.second.image_points}
    two = tuple(name for name in first.problem.points if name in seen)[:2]
    second = replace(halves.second, control=halves.both.control, given=posterior_of(first, two))
    found = clean_control_last(second, "tau")
    images = found.images.block
    assert (found.datum, images.problem.defect) == ("partly free", 1)
    assert len(images.problem.given) == 6
    # six coordinates of two points hold six movements, and check nothing
    bare = adjust_block(replace(second, control=(), given=None), datum="free")
    assert images.redundancy == bare.redundancy + len(images.problem.given) - 6


# --- what is given --------------------------------------------------------------------------


def test_what_is_given_is_counted(shaken):
    halves, _ = shaken
    exact = posterior_of(adjust_block(campaigns(5.0, 0.0).first), ("points", "photos"))
    problem = make_problem(replace(halves.second, given=exact, control=()))
    points = len({name.owner for name in exact.names if name.kind == "point"})
    assert problem.given.unknown == len(exact.names) - 3 * points
    assert problem.given.exact == int((np.diag(exact.covariance) == 0.0).sum())
    assert len(problem.given) == 3 * points - problem.given.exact
    assert problem.fixed.sum() == problem.given.exact


def test_all_of_it_free_of_error_is_counted_and_held():
    halves = campaigns()
    control = halves.first.control[0]
    names = tuple(CoordinateName("point", one, axis)
                  for one in (control.point, "nobody") for axis in "XYZ")  # fmt: skip
    firm = Posterior(names, np.array([*control.xyz] * 2), np.zeros((6, 6)))
    block = adjust_block(replace(halves.first, control=halves.first.control[1:], given=firm))
    assert block.problem.given is None
    found = given_tests(block)
    assert (found.exact, found.unknown, found.coordinates, found.verdict) == (3, 3, (), None)
    assert not found.flagged
    assert given_tests(adjust_block(halves.first)) is None


def test_points_given_and_weighted_control_as_well(shaken):
    halves, after = shaken
    left = posterior_of(adjust_block(halves.first))
    assert given_tests(after).doubled == (halves.both.control[-1].point,)
    away = left.without(given_tests(after).doubled)
    assert given_tests(adjust_block(replace(halves.second, given=away))).doubled == ()


def test_what_nothing_checks_has_no_w_and_no_smallest_error():
    """A datum of a thousand metres: seven combinations, and rounding must not make more of it."""
    halves = campaigns()
    second = replace(halves.second, control=())
    left = posterior_of(adjust_block(halves.first))
    # a point of its own, which one ray sees: its height has nothing that checks it
    lone = "p7"
    rows = [row for row in second.image_points if row.point != lone]
    rows.append(next(row for row in second.image_points if row.point == lone))
    given = replace(left, covariance=left.covariance + np.diag([
        1e8 if (name.owner, name.unknown) == (lone, "Z") else 0.0 for name in left.names
    ]))  # fmt: skip
    found = given_tests(adjust_block(replace(second, image_points=tuple(rows), given=given)))
    row = next(one for one in found.coordinates if one.name == CoordinateName("point", lone, "Z"))
    assert (row.w is None, row.mdb is None) == (row.r < 1e-6, row.r < 1e-6)
    owners = {one.name: one.conditions for one in found.owners}
    for one in found.coordinates:
        assert (one.w is None) == (one.mdb is None)
        if one.w is not None:
            assert owners[one.name.owner] > 0


def test_a_photo_free_of_error_is_refused(shaken):
    halves, _ = shaken
    photo = halves.second.photos[0].id
    firm = posterior([("photo", photo, "omega"), ("point", "p7", "X")], np.diag([0.0, 1.0]))
    with pytest.raises(InputError, match=f"omega of photo {photo} is free of error: only points"):
        make_problem(replace(halves.second, given=firm))


def posterior(names, covariance, x=None):
    names = tuple(CoordinateName(*name) for name in names)
    x = np.zeros(len(names)) if x is None else np.asarray(x, dtype=float)
    return Posterior(names, x, np.asarray(covariance, dtype=float), "old.npz")


def test_what_cannot_be_a_prior_is_said_in_one_line(shaken):
    halves, _ = shaken
    left = posterior_of(adjust_block(halves.first))
    xyz = [("point", "p7", axis) for axis in "XYZ"]
    strange = posterior([("point", "nobody", "X")], [[1.0]])
    with pytest.raises(InputError, match=r"old\.npz: block synthetic knows none of its 1 coord"):
        make_problem(replace(halves.second, given=strange))
    flat = posterior(xyz, [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match=r"old\.npz: C is singular: .*point:p7:X.*free datum"):
        make_problem(replace(halves.second, given=flat))
    negative = posterior(xyz, [[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]])
    with pytest.raises(InputError, match="a combination has a negative variance"):
        make_problem(replace(halves.second, given=negative))
    control = halves.second.control[0].point
    firm = posterior([("point", control, "X")], [[0.0]])
    with pytest.raises(InputError, match=f"X of point {control} is free of error, but is weighted"):
        make_problem(replace(halves.second, given=firm))
    with pytest.raises(InputError, match=r"no point and no photo 'p77'.*did you mean"):
        posterior_names(adjust_block(halves.first), ["p77"])
    free = adjust_block(replace(halves.first, control=()), datum="free")
    with pytest.raises(InputError, match="--posterior goes with the datum of control"):
        posterior_of(free)
    assert left.without(["p7"]).names == tuple(n for n in left.names if n.owner != "p7")


def test_as_many_as_memory_holds(shaken, monkeypatch):
    halves, _ = shaken
    left = posterior_of(adjust_block(halves.first))
    monkeypatch.setattr("anaplot.bundle.solve.givenprior._BYTES", 20_000)
    with pytest.raises(InputError, match=r"coordinates as a prior of 96 unknowns: at most 26 are"):
        make_problem(replace(halves.second, given=left))


def test_the_test_of_the_block_says_which_sigma(shaken):
    halves, after = shaken
    left = posterior_of(adjust_block(halves.first))
    known = adjust_bundle(
        make_problem(replace(halves.second, given=left, test=TestSettings(kind="baarda"))),
        after.state,
    )
    by_known, by_own = given_tests(known), given_tests(after)
    assert by_known.verdict.by_known
    assert by_own.coordinates[4].w * after.sigma0 == pytest.approx(by_known.coordinates[4].w)


def test_points_given_with_weights_are_no_control_for_model_values():
    halves = campaigns()
    left = posterior_of(adjust_block(halves.first))
    problem = make_problem(replace(halves.second, given=left))
    (control,) = (row.point for row in halves.second.control)
    points = {
        problem.points[problem.point[ray]]
        for of, (rays, _) in classify(problem).items()
        if of.control
        for ray in rays.tolist()
    }
    assert points == {control}
