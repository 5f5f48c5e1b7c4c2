"""Rows that do not touch are cleaned apart: as one by one, and exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial

from anaplot.adjustment.apart import clean_apart
from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.stepwise import rule_of, step_by_step
from anaplot.adjustment.tested import error_odds
from anaplot.adjustment.watch import Watch
from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.errors import basis, blockrows, laterresiduals, rowcoupling
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.bundle.errors.laterresiduals import LaterResiduals
from anaplot.bundle.errors.leftout import without
from anaplot.bundle.errors.parted import BlockParts
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.gaussnewton import NoConvergenceError, equations_at, find_minimum
from anaplot.bundle.solve.normal import PointError
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.reliability import compute_cofactors
from anaplot.bundle.solve.residuals import block_residuals
from anaplot.bundle.solve.structure import make_structure
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import ControlPoint

CRITICAL = critical_normal(0.001)


def with_priors(scene):
    """Every second photo stated to 5 cm and 10 mgon."""
    photos = tuple(
        replace(
            photo,
            position=tuple(scene.centres[photo.id].tolist()),
            position_sigma=(0.05, 0.05, 0.05),
        )
        if k % 2
        else photo
        for k, photo in enumerate(scene.block.photos)
    )
    return replace(scene, block=replace(scene.block, photos=photos))


def spoiled(scene, seed: int, count: int, low: float = 6.0, high: float = 60.0):
    """The scene with errors in image coordinates, one of them in a control coordinate."""
    rng = np.random.default_rng(seed)
    rows = list(scene.block.image_points)
    for k in rng.choice(len(rows), count, replace=False).tolist():
        axis = "xy"[int(rng.integers(2))]
        off = rng.uniform(low, high) * 5e-3 * rng.choice((-1.0, 1.0))
        rows[k] = replace(rows[k], **{axis: getattr(rows[k], axis) + off})
    control = list(scene.block.control)
    wrong = control[0]
    xyz = (wrong.xyz[0] + 2.0, *wrong.xyz[1:])
    control[0] = ControlPoint(wrong.point, xyz, wrong.sigma, wrong.use)
    block = replace(scene.block, image_points=tuple(rows), control=tuple(control))
    return replace(scene, block=block)


def scenes():
    return {
        "aerial": aerial(3, 5, per_base=2, control_sigma=0.05, noise_um=5.0),
        "tilted": aerial(2, 7, per_base=2, control_sigma=0.05, noise_um=5.0, tilt=0.05, seed=3),
        "stated": with_priors(aerial(2, 6, per_base=2, control_sigma=0.05, noise_um=5.0, seed=5)),
    }


def each_of(given, numbers):
    """The places one by one."""
    return [
        places.place(at) for places in given.places(numbers) for at in range(len(places.numbers))
    ]


def system_of(scene, **options):
    problem = make_problem(scene.block, **options)
    state = scene.start(problem)
    block = adjust_bundle(problem, state)
    structure = block.cofactors.normal.structure
    return block_residuals(problem, block.state, structure), block, structure


@pytest.mark.parametrize("kind", ["aerial", "tilted", "stated", "calibrated", "free"])
def test_without_rows_is_what_an_elimination_of_all_columns_has(kind: str) -> None:
    options = {}
    if kind == "calibrated":
        options["additional"] = additional_parameters("ebner")
    if kind == "free":
        options["datum"] = "free"
    system, block, structure = system_of(scenes().get(kind, scenes()["aerial"]), **options)
    rng = np.random.default_rng(4)
    rows = np.flatnonzero(system.r > 0.05)
    out: list[int] = []
    state = Elimination(system)
    for row in rng.permutation(rows).tolist():
        if len(out) < 12 and state.testable(row) and state.r[row] > 0.05:
            state.add(row)
            out.append(row)
    out.sort()
    error, sigma = state.estimates()
    own = dict(zip(state.rows, zip(error, sigma, strict=True), strict=True))
    parts = BlockParts(system, block.state, structure)
    kept = np.setdiff1d(np.arange(len(system.e)), out)
    good = kept[state.r[kept] > 1e-6]
    exact, draft = parts.adjusted(out), parts.drafted(out)
    for given in (exact, draft):
        assert given.vtpv == pytest.approx(state.vtpv, rel=1e-8)
        assert given.e[kept] == pytest.approx(state.e[kept], abs=1e-8)
        assert given.e[out] == pytest.approx([own[row][0] for row in out], rel=1e-7, abs=1e-8)
    assert exact.r[good] == pytest.approx(state.r[good], abs=1e-9)
    assert exact.r[out] ** -0.5 == pytest.approx([own[row][1] for row in out], rel=1e-8)
    # a draft leaves out what places do to each other, which only takes away
    assert np.all(draft.r[good] >= state.r[good] - 1e-9)
    # a place with all its rows in: those out elsewhere are
    numbers = np.unique(exact.places_of(np.array([*out, *rows[:40].tolist()])))
    for place in each_of(exact, numbers):
        there = Elimination(system)
        for row in set(out).difference(place.rows.tolist()):
            there.add(row)
        columns = np.array([there.column(row)[place.rows] for row in place.rows.tolist()])
        assert place.system.matrix == pytest.approx(columns, abs=1e-8)
        assert place.system.e == pytest.approx(there.e[place.rows], abs=1e-7)
        assert place.system.vtpv == pytest.approx(there.vtpv, rel=1e-8)


@pytest.mark.parametrize("kind", ["aerial", "tilted", "stated", "calibrated", "free"])
@pytest.mark.parametrize("kept", [0, 300_000_000])
def test_a_draft_is_seen_from_what_is_adjusted_already(monkeypatch, kind: str, kept: int) -> None:
    monkeypatch.setattr(basis, "_KEPT", kept)
    options = {}
    if kind == "calibrated":
        options["additional"] = additional_parameters("ebner")
    if kind == "free":
        options["datum"] = "free"
    system, block, structure = system_of(scenes().get(kind, scenes()["aerial"]), **options)
    rng = np.random.default_rng(7)
    out: list[int] = []
    state = Elimination(system)
    for row in rng.permutation(np.flatnonzero(system.r > 0.1)).tolist():
        if len(out) < 16 and state.testable(row) and state.r[row] > 0.1:
            state.add(row)
            out.append(row)
    reduced = without(system.rows, frozenset(out[:9]))
    parts = BlockParts(
        LaterResiduals(system.problem, block.state, structure),
        block.state,
        structure,
        reduced,
        lambda: compute_cofactors(*equations_at(reduced, structure, block.state)[:2]),
    )
    assert parts.begun == tuple(sorted(out[:9]))
    # some come back and others go, then all come back; other places have been laid out before
    first = parts.drafted(sorted(out[:9]))
    assert first.exact
    for rows in (out[4:], out[:4], []):
        rows = sorted(rows)
        there = Elimination(system)
        for row in rows:
            there.add(row)
        error, _ = there.estimates()
        draft = parts.drafted(rows)
        exact = BlockParts(system, block.state, structure).adjusted(rows)
        assert not draft.exact
        kept_rows = np.setdiff1d(np.arange(len(system.e)), rows)
        assert draft.vtpv == pytest.approx(there.vtpv, rel=1e-8)
        assert draft.e[kept_rows] == pytest.approx(there.e[kept_rows], abs=1e-8)
        order = np.argsort(there.rows)
        assert draft.e[rows] == pytest.approx(np.array(error)[order], rel=1e-7, abs=1e-8)
        assert np.abs(draft.r - exact.r).max() < 0.3
        # of what comes back the redundancy number has what places do to each other, if asked for
        for row in set(out[:9]).difference(rows):
            assert draft.back(row) == pytest.approx(there.r[row], abs=1e-9)
        assert draft.back(int(np.setdiff1d(kept_rows, out)[0])) is None
        if not rows:
            # coming back only makes other redundancy numbers larger
            assert np.all(draft.r <= exact.r + 1e-9)
        numbers = np.unique(draft.places_of(np.array(out)))
        places = {tuple(place.rows.tolist()): place for place in each_of(exact, numbers)}
        for place in each_of(draft, numbers):
            same = places[tuple(place.rows.tolist())].system
            assert place.system.e == pytest.approx(same.e, abs=0.3 * np.abs(same.e).max())
            assert np.abs(place.system.matrix - same.matrix).max() < 0.3
    again = parts.adjusted(sorted(out))
    assert again.exact
    assert parts.drafted(sorted(out)).exact
    assert again.e[np.array(sorted(out))] == pytest.approx(
        np.array(state.estimates()[0])[np.argsort(state.rows)], rel=1e-7, abs=1e-8
    )


@pytest.mark.parametrize("kind", ["aerial", "tilted", "stated", "calibrated"])
def test_where_a_block_lies_without_rows_is_foreseen_from_what_they_were_seen_from(
    kind: str,
) -> None:
    """Also where the equations are those of another place near the one that all is seen from."""
    options = {}
    if kind == "calibrated":
        options["additional"] = additional_parameters("ebner")
    system, block, structure = system_of(scenes().get(kind, scenes()["aerial"]), **options)
    out = sorted(np.flatnonzero(system.r > 0.3)[::9][:9].tolist())
    before, after = without(system.rows, frozenset(out[:6])), without(system.rows, frozenset(out))
    centres = (
        block.state.centres
        + np.random.default_rng(5).normal(size=(len(structure.pattern.order), 3)) * 0.01
    )
    elsewhere = replace(block.state, centres=centres)
    parts = BlockParts(
        LaterResiduals(system.problem, block.state, structure),
        block.state,
        structure,
        before,
        lambda: compute_cofactors(*equations_at(before, structure, elsewhere)[:2]),
    )
    assert parts.foreseen(after, out) == (block.state, 0)  # nothing has been looked at
    assert not parts.drafted(out).exact
    state, steps = parts.foreseen(after, out)
    assert 2 <= steps <= 5
    exact = find_minimum(after, block.state, structure)
    found = find_minimum(after, state, structure, led=steps)
    assert found.convergence.iterations == steps  # its first equations are those of the minimum
    for of in ("centres", "rotations", "points", "own", "shared"):
        np.testing.assert_allclose(
            getattr(found.state, of), getattr(exact.state, of), rtol=1e-9, atol=2e-8
        )
    # of other rows, or where a step leads upwards, there is none
    assert parts.foreseen(after, out[1:]) == (block.state, 0)
    parts._given.step = tuple(-part for part in parts._given.step)
    assert parts.foreseen(after, out) == (block.state, 0)


def test_a_place_of_which_rows_are_out_reaches_as_far_as_with_them() -> None:
    system, block, structure = system_of(scenes()["tilted"])
    problem = system.problem
    every = BlockParts(system, block.state, structure).drafted([])
    point = next(k for k in range(len(problem.points)) if np.sum(problem.point == k) == 3)
    rays = np.flatnonzero(problem.point == point)
    # of three rays x and y of one and x of another are left: they hardly place the point
    out = sorted([2 * int(rays[0]), 2 * int(rays[0]) + 1, 2 * int(rays[1]) + 1])
    seen = BlockParts(system, block.state, structure).adjusted(out)
    numbers = np.unique(every.places_of(np.arange(len(system.e))))
    lever = np.zeros(len(system.e))
    for place in each_of(seen, numbers):
        lever[place.rows] = place.lever
    # an element of R with a row elsewhere is within its bound, and that is none that bars the way
    mine = each_of(every, np.array([point]))[0]
    others = np.setdiff1d(np.arange(len(system.e)), mine.rows)
    elements = system.columns(mine.rows)[others]
    assert np.all(np.abs(elements) <= lever[others][:, None] * lever[mine.rows] + 1e-9)
    assert np.all(lever[mine.rows] <= 1.2 * mine.lever)


def test_all_rows_are_solved_when_they_are_asked_for() -> None:
    system, block, structure = system_of(scenes()["stated"])
    later = LaterResiduals(system.problem, block.state, structure)
    assert "whole" not in vars(later)
    assert list(later.names) == list(system.names)
    assert list(later.units) == list(system.units)
    assert later.redundancy == system.redundancy
    np.testing.assert_array_equal(later.sigma, system.sigma)
    assert "whole" not in vars(later)
    rows = np.array([0, 7, len(system.e) - 1])
    np.testing.assert_array_equal(later.e, system.e)
    np.testing.assert_array_equal(later.r, system.r)
    np.testing.assert_array_equal(later.columns(rows), system.columns(rows))
    assert later.vtpv == system.vtpv
    assert (later.design() != system.design()).nnz == 0
    ones = np.ones(len(system.e))
    assert later.reweighting()(ones) == pytest.approx(system.e, abs=1e-8)


@pytest.mark.parametrize(("count", "sure"), [(1, False), (6, False), (6, True)])
def test_odds_with_all_rows_are_exact_where_anything_is_open(
    monkeypatch, count: int, sure: bool
) -> None:
    scene = scenes()["tilted"]
    rows = list(spoiled(scene, 3, count, 5.0, 6.0).block.image_points)
    if sure:
        rows[11] = replace(rows[11], x=rows[11].x + 0.5)
    problem = make_problem(scene.with_rows(rows).block)
    block = adjust_bundle(problem, scene.start(problem))
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    asked: list[int] = []
    real = BlockParts.adjusted
    monkeypatch.setattr(
        BlockParts, "adjusted", lambda self, out: asked.append(len(out)) or real(self, out)
    )
    found = block_gross_errors(block, "baarda", SearchSettings(alpha=0.001))
    assert (0 in asked) is not sure
    there = found.system.whole
    odds = error_odds(400.0 * there.r, np.abs(there.e) / np.sqrt(there.r), 100, "baarda")
    assert found.findings.odds.rows == pytest.approx(odds.rows, abs=1e-9)
    assert found.findings.odds.none == pytest.approx(odds.none, abs=1e-9)
    assert not sure or max(odds.rows) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("kind", ["aerial", "tilted", "stated"])
def test_no_element_between_places_is_beyond_its_bound(kind: str) -> None:
    system, block, structure = system_of(scenes()[kind])
    given = BlockParts(system, block.state, structure).drafted([])
    places = each_of(given, np.unique(given.places_of(np.arange(len(system.e)))))
    assert sum(len(place.rows) for place in places) == len(system.e)
    lever, number = np.zeros(len(system.e)), np.zeros(len(system.e))
    for k, place in enumerate(places):
        lever[place.rows], number[place.rows] = place.lever, k
    elements = system.columns(np.arange(len(system.e)))
    bound = lever[:, None] * lever
    apart = number[:, None] != number
    assert np.all(np.abs(elements[apart]) <= bound[apart] + 1e-9)


@pytest.mark.parametrize("strategy", ["baarda", "search"])
@pytest.mark.parametrize(
    ("kind", "seed", "count"),
    [
        pytest.param("aerial", 1, 6, marks=pytest.mark.slow),
        pytest.param("aerial", 2, 8, marks=pytest.mark.slow),
        pytest.param("tilted", 3, 6, marks=pytest.mark.slow),
        ("stated", 6, 4),
    ],
)
def test_apart_is_as_one(monkeypatch, strategy: str, kind: str, seed: int, count: int) -> None:
    scene = spoiled(scenes()[kind], seed, count)
    problem = make_problem(scene.block)
    block = adjust_bundle(problem, scene.start(problem))
    settings = SearchSettings(alpha=0.001)
    one = block_gross_errors(block, strategy, settings)
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    apart = block_gross_errors(block, strategy, settings)
    assert set(apart.findings.rows) == set(one.findings.rows)
    assert len(one.findings.rows) >= count
    errors = {row.name: row for row in one.rejected}
    for row in apart.rejected:
        assert row.error == pytest.approx(errors[row.name].error, rel=1e-7)
        assert row.sigma == pytest.approx(errors[row.name].sigma, rel=1e-7)
    # the end is what the rule wants, with exact numbers: what is in and out at the limit
    end, rows = apart.findings.at_end, list(apart.findings.rows)
    assert end.vtpv == pytest.approx(one.findings.at_end.vtpv, rel=1e-9)
    good = one.findings.at_end.r > 1e-4
    assert end.r[good] == pytest.approx(one.findings.at_end.r[good], abs=1e-9)
    assert end.w[good] == pytest.approx(one.findings.at_end.w[good], abs=1e-6)
    assert np.all(np.abs(end.w[rows]) >= CRITICAL)
    assert apart.findings.odds.rows == pytest.approx(one.findings.odds.rows, abs=1e-9)
    assert apart.findings.untestable == one.findings.untestable
    assert apart.block.sigma0 == pytest.approx(one.block.sigma0, rel=1e-9)
    assert apart.block.cofactors.r == pytest.approx(one.block.cofactors.r, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 10])
def test_points_of_one_photo_that_are_off_alike_go_as_one_by_one(monkeypatch, seed: int) -> None:
    scene = aerial(3, 6, per_base=3, control_sigma=0.05, noise_um=5.0, seed=seed)
    rng = np.random.default_rng(seed)
    rows, moved = list(scene.block.image_points), set()
    for k, row in enumerate(rows):
        if row.photo == scene.block.photos[8].id and rng.random() < 0.45:
            rows[k] = replace(row, x=row.x + 0.1, y=row.y - 0.07)  # 20 and 14 sigmas
            moved |= {("image", row.photo, row.point, row.model, axis) for axis in "xy"}
    scene = scene.with_rows(rows)
    problem = make_problem(scene.block)
    block = adjust_bundle(problem, scene.start(problem))
    settings = SearchSettings(alpha=0.001)
    one = block_gross_errors(block, "baarda", settings)
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    apart = block_gross_errors(block, "baarda", settings)
    assert moved <= {row.name for row in one.rejected}
    assert set(apart.findings.rows) == set(one.findings.rows)


@pytest.mark.slow
def test_rows_of_one_sweep_go_together_and_few_sweeps_are_enough(monkeypatch) -> None:
    scene = aerial(4, 10, per_base=2, control_sigma=0.05, noise_um=5.0)
    scene = spoiled(scene, 7, 20, 20.0, 100.0)
    problem = make_problem(scene.block)
    block = adjust_bundle(problem, scene.start(problem))
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    outs: list[int] = []
    real = BlockParts.adjusted
    drafts: list[int] = []
    monkeypatch.setattr(
        BlockParts,
        "adjusted",
        lambda self, out: outs.append(len(out)) or real(self, out),
    )
    real_draft = BlockParts.drafted
    monkeypatch.setattr(
        BlockParts,
        "drafted",
        lambda self, out: drafts.append(len(out)) or real_draft(self, out),
    )
    told: list[str] = []
    found = block_gross_errors(
        block, "baarda", watch=Watch(lambda what, fraction: told.append(what))
    )
    assert len(found.findings.rows) >= 18
    # one adjustment a pass after the first, whatever is rejected; no column of the block
    assert len(outs) <= 3 * len(found.passes)
    assert len(drafts) < len(found.findings.rows)
    assert max(drafts[:5]) > len(found.findings.rows) // 2
    assert any(what.startswith("sweep 2, ") and what.endswith(" rejected") for what in told)


def test_what_conditions_tie_together_is_cleaned_as_one(monkeypatch) -> None:
    scene = spoiled(scenes()["aerial"], 1, 4)
    problem = make_problem(scene.block)
    block = adjust_bundle(problem, scene.start(problem))
    subject = blockrows.BlockRows(
        problem, block.cofactors.normal.structure, None, control_only=False
    )
    system = block_residuals(problem, block.state, block.cofactors.normal.structure)
    place = blockrows.BlockPlace(block.state)
    assert subject.apart(system, place) is None  # few rows
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    assert isinstance(subject.apart(system, place), BlockParts)
    monkeypatch.setattr(blockrows, "can_be_parted", lambda problem: False)
    assert subject.apart(system, place) is None


def mismatched(scene, seed: int, count: int):
    """The scene with rays to something else, half a millimetre to five away in the image."""
    rng = np.random.default_rng(seed)
    rows = list(scene.block.image_points)
    for k in rng.choice(len(rows), count, replace=False).tolist():
        off, toward = rng.uniform(0.5, 5.0), rng.uniform(0.0, 2.0 * np.pi)
        x, y = rows[k].x + off * np.cos(toward), rows[k].y + off * np.sin(toward)
        rows[k] = replace(rows[k], x=float(x), y=float(y))
    return scene.with_rows(rows)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["baarda", "search"])
@pytest.mark.parametrize(("seed", "count"), [(1, 6), (4, 9)])
def test_sweeps_begin_without_what_is_far_off(
    monkeypatch, strategy: str, seed: int, count: int
) -> None:
    scene = aerial(3, 6, per_base=3, control_sigma=0.05, noise_um=5.0, seed=seed)
    scene = mismatched(scene, seed, count)
    problem = make_problem(scene.block)
    block = adjust_bundle(problem, scene.start(problem))
    assert block.sigma0 > 4.0
    settings = SearchSettings(alpha=0.001)
    one = block_gross_errors(block, strategy, settings)
    monkeypatch.setattr(blockrows, "MOST_ROWS_AS_ONE", 0)
    told: list[str] = []
    watch = Watch(lambda what, fraction: told.append(what))
    apart = block_gross_errors(block, strategy, settings, watch=watch)
    assert set(apart.findings.rows) == set(one.findings.rows)
    assert len(apart.findings.rows) >= count
    errors = {row.name: row for row in one.rejected}
    for row in apart.rejected:
        assert row.error == pytest.approx(errors[row.name].error, rel=1e-6)
        # each has a step of its own in the last pass
        assert row.statistic is not None
    begun = next(what for what in told if what.startswith("sweep 1, "))
    assert int(begun.split()[2]) >= count
    # the last pass begins and ends with what the one before has rejected
    assert [what for what in told if what.startswith("sweep")][-1].startswith("sweep 1, ")


@pytest.mark.parametrize("seed", range(4))
def test_what_is_out_for_good_hides_nothing_at_its_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = aerial(3, 6, per_base=2, control_sigma=0.05, noise_um=5.0, seed=seed, tilt=0.2)
    rows, rays = list(scene.block.image_points), {}
    for k, row in enumerate(rows):
        rays.setdefault(row.point, []).append(k)
    far = set()
    for mine in [mine for mine in rays.values() if len(mine) == 3][:12]:
        # one ray is another point's; of the next one x or y is off as well
        first, second = (rows[k] for k in mine[:2])
        off, axis = rng.uniform(0.5, 2.0), "xy"[int(rng.integers(2))]
        rows[mine[0]] = replace(first, x=first.x - 45.0 * np.sign(first.x), y=first.y - off)
        rows[mine[1]] = replace(second, **{axis: getattr(second, axis) + 0.1})
        far |= {("image", first.photo, first.point, None, axis) for axis in "xy"}
    problem = make_problem(replace(scene.block, image_points=tuple(rows)))
    state = scene.start(problem)
    structure = make_structure(problem, state.centres)
    system = block_residuals(problem, state, structure)
    held = sorted(map(system.names.index, far))
    suspects, parts = np.ones(len(system.e), dtype=bool), BlockParts(system, state, structure)
    apart = clean_apart(parts, suspects, 60, 0.001, Watch(), held=held)
    one = Elimination(system)
    for row in held:
        one.add(row)
    suspects[held] = False
    for _ in step_by_step(one, rule_of("baarda", 0.001), suspects, 60, Watch(), together=False):
        pass
    assert set(apart.rows) == set(one.rows) - set(held)
    assert len(apart.rows) > 5


def test_rows_are_found_by_their_names() -> None:
    system, _, _ = system_of(scenes()["stated"])
    names = system.names
    assert [names.index(name) for name in names] == list(range(len(system.e)))
    for strange in (
        ("image", "no", "such", None, "x"),
        ("control", "no", "X"),
        ("prior", "a", "b"),
    ):
        with pytest.raises(ValueError, match="no observation"):
            names.index(strange)
    with pytest.raises(ValueError, match="no observation"):
        names.index(names[0], 1)


def test_equations_that_were_let_go_are_made_anew_as_they_were() -> None:
    scene = scenes()["tilted"]
    problem = make_problem(scene.block, datum="free")
    structure = make_structure(problem, scene.start(problem).centres)
    found = find_minimum(problem, scene.start(problem), structure)
    place = blockrows.BlockPlace.of(found)
    assert place.found is found
    q = place.cofactors.points
    place.let_go()
    assert place.found is not found
    assert place.found.convergence == found.convergence
    assert np.array_equal(place.found.normal.z, found.normal.z)
    assert np.array_equal(place.cofactors.points, q)
    given = blockrows.BlockPlace(found.state)
    assert given.found is None
    assert given.cofactors is None


def test_what_a_firm_start_leaves_open_is_not_sought_by_damping() -> None:
    scene = scenes()["aerial"]
    problem = make_problem(scene.block)
    state = scene.start(problem)
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    rejected[problem.photo == 0] = True  # nothing but zeros is left of a photo
    open_photo = replace(problem, rejected=rejected)
    structure = make_structure(problem, state.centres)
    with pytest.raises(NotComputableError, match="not determined: points p2") as told:
        find_minimum(open_photo, state, structure, firm=True)
    assert not isinstance(told.value, NoConvergenceError)
    with pytest.raises(NoConvergenceError):
        find_minimum(open_photo, state, structure)
    firm = find_minimum(problem, state, structure, firm=True)
    assert firm.convergence == find_minimum(problem, state, structure).convergence


def test_what_is_not_found_by_steps_is_adjusted_anew(monkeypatch) -> None:
    system, block, structure = system_of(scenes()["tilted"])
    rows = np.flatnonzero(system.r > 0.5)[::9][:6].tolist()
    exact = BlockParts(system, block.state, structure).adjusted(rows)
    monkeypatch.setattr(rowcoupling, "_STEPS", 2)
    parts = BlockParts(system, block.state, structure)
    draft = parts.drafted(rows)
    assert draft.exact
    np.testing.assert_array_equal(draft.e, exact.e)
    np.testing.assert_array_equal(draft.r, exact.r)
    assert draft.vtpv == exact.vtpv


def test_rows_without_which_a_point_is_open_are_one_line() -> None:
    system, block, structure = system_of(scenes()["tilted"])
    problem = system.problem
    counts = np.bincount(problem.point)
    counts[system.rows.ground[:, 1]] = 0
    point = int(np.flatnonzero(counts == 2)[0])
    rays = np.flatnonzero(problem.point == point)
    out = sorted([2 * int(rays[0]), 2 * int(rays[0]) + 1])
    parts = BlockParts(system, block.state, structure)
    with pytest.raises(NotComputableError, match=f"points {problem.points[point]}: their"):
        parts.adjusted(out)


def test_all_rows_that_leave_something_open_are_one_line(monkeypatch) -> None:
    system, block, structure = system_of(scenes()["tilted"])

    def refused(*_: object, **__: object) -> None:
        raise PointError(np.array([4]))

    monkeypatch.setattr(laterresiduals, "block_residuals", refused)
    later = LaterResiduals(system.problem, block.state, structure)
    with pytest.raises(NotComputableError, match=f"points {system.problem.points[4]}: their rays"):
        _ = later.e
