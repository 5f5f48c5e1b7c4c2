"""Movements of photos that the observations leave open: exactly, or but for their noise.

A movement that measurements without error would leave open is resisted by measurements with noise,
but only because noise has spoilt the geometry that leaves it open: photos that may turn about a
line of common points are held by what noise has put between those points and the line. Such a
resistance is no more than what another noise of the same size would give, and nothing that a
minimum could be found by. A weak movement that is determined is resisted in the same way whatever
the noise.

Nor is a movement determined whose own standard deviation makes many times more of what resists it:
a flat block that may turn about the line on which all its control of heights lies is held by the
cosine of that turn alone, the more the further it happens to be turned.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.datum import Anchor, anchor
from anaplot.bundle.solve.factor import Factor, NotPositiveError
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import Linearised, Unknowns, effects, linearise, move
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.problem import Problem, listed
from anaplot.bundle.solve.somepoints import of_points, some_points
from anaplot.bundle.solve.structure import Structure, make_structure
from anaplot.errors import NotComputableError
from anaplot.textfiles.wording import quoted

__all__ = [
    "LeftOpenError",
    "Solved",
    "held_by_noise",
    "held_by_noise_at",
    "parameters_left_open",
    "undetermined",
]


Solved = tuple[NormalEquations, Factor]  # the equations at a state, and their factor

_ITERATIONS = 4
_MOVES = 0.2  # of the largest movement: a photo that moves less is not named
_WEAKEST = 8  # movements that are looked at
_NOISES = 4  # realisations of noise
_NOISE = 0.1  # of a movement's resistance that changes with noise: all of it may be noise
_ITSELF = 5.0  # times that it changes where the movement goes on by its standard deviation
_TURNED = 1e-4  # rad, by one standard deviation of a movement: below, it is as good as linear
_STEP = 0.2  # rad, the most that a movement is followed by to see how its resistance changes
_APART = 0.2  # of what noise does to the movements left open: to the others it does less
_AS_WEAK = 0.01  # of how much the weakest movement yields: what is as good as open as well
_MOST = 10.0  # sigmas that errors spoil the geometry by, at most: larger ones lose their pull
_FAR = 20.0  # sigmas that a photo's rays are off in the median: it lies nowhere near its place


class LeftOpenError(NotComputableError):
    """The observations leave something open.

    Parameters
    ----------
    text
        What is said of it.
    state
        Where.

    Attributes
    ----------
    state
        As above.
    """

    def __init__(self, text: str, state: BlockState) -> None:
        super().__init__(text)
        self.state = state


def undetermined(
    problem: Problem,
    structure: Structure,
    state: BlockState,
    linear: Linearised,
    tie: Anchor | None,
    error: PointError | NotPositiveError,
) -> LeftOpenError:
    """Return the error that names the photos or points that the observations leave open.

    Parameters
    ----------
    problem, structure, state, linear
        The bundle, where it is, and linearised there.
    tie
        What holds a datum that is missing, or None.
    error
        Why the normal equations have no factor.
    """
    name = problem.block.name
    if isinstance(error, PointError):
        open_points = [problem.points[k] for k in error.points.tolist()]
        return LeftOpenError(
            f"block {name}: not determined: points {listed(open_points)}: their rays do not meet "
            "at an angle",
            state,
        )
    weights = None if tie is None else tie.weights
    # conditions between points are no part of what determines a block
    linear = replace(linear, conditions=None)
    try:
        normal = NormalEquations(problem, structure, linear, 1e-7, weights)
        factor = normal.factor()
    except (PointError, NotPositiveError):
        photo = "" if error.photo is None else f": photo {problem.photos[error.photo]}"
        return LeftOpenError(f"block {name}: not determined{photo}", state)
    found = _weakest(normal, factor, 1)
    text = _left_open(problem, _share(found.size[:, :, 0]), normal, factor)
    return LeftOpenError(text, state)


def held_by_noise(problem: Problem, structure: Structure, state: BlockState) -> str | None:
    """Return the remark on photos that are determined by measuring errors alone.

    Parameters
    ----------
    problem, structure
        The bundle.
    state
        Where photos lie about where they should.

    Returns
    -------
    str or None
        As `undetermined` says it; None where more than errors holds every photo, or where the
        photos in question are far from their rays: of such a state nothing can be said.
    """
    return _looked_at(problem, structure, state, None).remark


def held_by_noise_at(
    problem: Problem, structure: Structure, places: Sequence[tuple[BlockState, Solved | None]]
) -> tuple[str, BlockState] | None:
    """Return the first remark of `held_by_noise` at some places, and where that is; None without.

    Where the equations are known already it is looked first: other places that are as firm need
    none.

    Parameters
    ----------
    problem, structure
        The bundle.
    places
        States, each with the equations there, where they are known.
    """
    firm: tuple[BlockState, _Movements] | None = None
    remarks: dict[int, str] = {}
    for k in sorted(range(len(places)), key=lambda k: places[k][1] is None):
        state, solved = places[k]
        if firm is not None and _as_firm(problem, *firm, state):
            continue
        looked = _looked_at(problem, structure, state, solved)
        if looked.remark is not None:
            remarks[k] = looked.remark
        firm = None if looked.firm is None else (state, looked.firm)
    if not remarks:
        return None
    first = min(remarks)
    return remarks[first], places[first][0]


class _Looked(NamedTuple):
    """The remark, or the movements of a firm block that are resisted least; None where neither."""

    remark: str | None
    firm: _Movements | None


def _looked_at(
    problem: Problem, structure: Structure, state: BlockState, solved: Solved | None
) -> _Looked:
    """Look for what noise alone holds; see `held_by_noise`."""
    if solved is None or problem.conditions is not None:
        problem = replace(problem, conditions=None)
        tie = anchor(problem, state) if problem.defect else None
        weights = None if tie is None else tie.weights
        solved = _solvable(problem, structure, linearise(problem, state), weights)
        if solved is None:
            return _Looked(None, None)
    normal, factor = solved
    # gross errors spoil the geometry as noise does
    sigma0 = np.sqrt(normal.linear.vtpv / max(problem.redundancy, 1))
    try:
        found = _weakest(normal, factor, _WEAKEST)
        noise = float(np.clip(sigma0, 1.0, _MOST))
        by_itself = _by_itself(normal, factor, state, found, noise)
        loose = np.flatnonzero(by_itself > _ITSELF)
        if len(loose):
            share = _share_in(normal, found, loose)
            return _Looked(None if share is None else _photos_open(normal.problem, share), None)
        # in a firm block the most that it may be is little
        for seen in _first_some(normal.problem, state):
            if np.all(_by_noise(normal, factor, seen, found, noise, most=True) <= _NOISE):
                return _Looked(None, found)
        by_noise = _by_noise(normal, factor, _Seen(normal.problem, state, None), found, noise)
    except np.linalg.LinAlgError:
        return _Looked(None, None)
    return _Looked(_noise_remark(normal, factor, found, by_noise), None)


def _noise_remark(
    normal: NormalEquations, factor: Factor, found: _Movements, by_noise: Array
) -> str | None:
    """Return the remark on movements that noise alone resists; None where there are none.

    `by_noise`: (k,) how much of what resists each changes with noise.
    """
    loose = np.flatnonzero(by_noise > _NOISE)
    if len(loose) == 0:
        return None
    # a weak network is soft in all its movements, and held by its geometry all the same
    others = np.delete(by_noise, loose)
    if others.max(initial=0.0) > _APART * by_noise[loose].min() or len(others) == 0:
        return None
    share = _share_in(normal, found, loose)
    return None if share is None else _left_open(normal.problem, share, normal, factor)


def _share_in(normal: NormalEquations, found: _Movements, loose: Index) -> Array | None:
    """(n,) share of the photos in some movements; None where these are far from their rays."""
    problem = normal.problem
    share: Array = np.max([_share(found.size[:, :, k]) for k in loose.tolist()], axis=0)
    off = np.linalg.norm(normal.linear.e, axis=1)
    for photo in np.flatnonzero(share > _MOVES).tolist():
        if not np.median(off[problem.photo == photo]) <= _FAR:
            return None
    return share


def parameters_left_open(problem: Problem, state: BlockState) -> str:
    """Return the remark on free additional parameters that are not determined.

    Parameters
    ----------
    problem
        The bundle.
    state
        Where it is linearised to find out which ones.
    """
    structure = make_structure(problem, state.centres)
    tie = anchor(problem, state) if problem.defect else None
    linear = replace(linearise(problem, state), conditions=None)
    weights = None if tie is None else tie.weights
    solvable = _solvable(problem, structure, linear, weights)
    return _parameters_left_open(problem, "" if solvable is None else _loose(*solvable))


def _parameters_left_open(problem: Problem, names: str) -> str:
    assert problem.additional is not None
    chosen = problem.additional
    weights = " (--calibrate-sigma, --additional-sigma-um)" if names else ""
    return (
        f"block {problem.block.name}: not determined: the additional parameters "
        f"({chosen.set.name}, {chosen.scope}-invariant) together with the orientations"
        f"{names}; use fewer or weight them{weights}"
    )


def _loose(normal: NormalEquations, factor: Factor) -> str:
    """Return ": names" of cameras' parameters in the movements that are resisted least, or ""."""
    chosen, groups = normal.problem.additional, normal.problem.additional_groups
    # the terms of other sets come by the dozen, and are no quantities that a person knows
    if chosen is None or not chosen.set.lens or chosen.scope != "camera":
        return ""
    try:
        found = _weakest(normal, factor, _WEAKEST)
    except np.linalg.LinAlgError:
        return ""
    weak = np.flatnonzero(found.resisted > _AS_WEAK * found.resisted[0]).tolist()
    moved = [np.abs(found.unknowns[2][:, k]) for k in weak]
    shares = [one / one.max() for one in moved if one.max() > 0.0]
    if not shares:
        return ""
    loose = np.max(shares, axis=0).reshape(len(groups), -1) > _MOVES
    said = [
        f"{', '.join(name for name, one in zip(chosen.set.names, row, strict=True) if one)} of "
        f"{quoted(group)}"
        for group, row in zip(groups, loose, strict=True)
        if row.any()
    ]
    return f": {listed(said)}"


def _left_open(problem: Problem, share: Array, normal: NormalEquations, factor: Factor) -> str:
    """Say what may move, from the share that each of n photos has in the movement."""
    # weighted parameters are observed: they leave nothing open
    moving = np.count_nonzero(share > _MOVES)
    if problem.frees_parameters and moving > len(problem.photos) // 2:
        return _parameters_left_open(problem, _loose(normal, factor))
    return _photos_open(problem, share)


def _photos_open(problem: Problem, share: Array) -> str:
    """Say which photos may move, from the share that each of n photos has in the movement."""
    names = [problem.photos[k] for k in np.nonzero(share > _MOVES)[0].tolist()]
    begin = f"block {problem.block.name}: not determined: "
    what = "photos" if len(names) > 1 else "photo"
    return f"{begin}{what} {listed(names)}: their common points and control leave a movement open"


def _share(size: Array) -> Array:
    """(n,) largest part that each photo has in a movement (n, d), of the largest of all."""
    moved = np.abs(size).max(axis=1)
    return np.asarray(moved / moved.max())


class _Movements(NamedTuple):
    """k movements, that which is resisted least first; none of them pulls at another.

    Attributes
    ----------
    unknowns
        (n, d, k) of the photos, (p, 3, k) of the points and (g, k) shared parameters.
    right
        (n, d, k) what the normal equations make of them; of points and shared parameters nothing.
    resisted
        (k,) product of both.
    size
        (n, d, k) movements of the photos in units of what the observations determine alone.
    """

    unknowns: Unknowns
    right: Array
    resisted: Array
    size: Array

    def at(self, k: int) -> Unknowns:
        """Return the unknowns of one of them, with one column."""
        photos, points, shared = self.unknowns
        return photos[..., k : k + 1], points[..., k : k + 1], shared[..., k : k + 1]


def _solvable(
    problem: Problem, structure: Structure, linear: Linearised, weights: Array | None
) -> tuple[NormalEquations, Factor] | None:
    """Return equations that can be solved, as little damped as possible; None: by no damping."""
    for damping in (0.0, 1e-10, 1e-7):
        try:
            normal = NormalEquations(problem, structure, linear, damping, weights)
            return normal, normal.factor()
        except PointError:
            return None
        except NotPositiveError:
            continue
    return None


def _weakest(normal: NormalEquations, factor: Factor, count: int) -> _Movements:
    """Inverse iteration: what the observations resist least, in units of what they do alone."""
    problem, structure = normal.problem, normal.structure
    n, d = len(problem.photos), problem.per_photo
    count = min(count, n * d)
    diagonal = np.einsum("nii->ni", normal.blocks[structure.pattern.diagonal])
    unit = np.sqrt(np.maximum(diagonal, 1e-300))[:, :, None]
    right = np.random.default_rng(1).normal(size=(n, d, count))
    for _ in range(_ITERATIONS):
        moved = _photos_moved(normal, factor, right * unit) * unit
        right = np.linalg.qr(moved.reshape(n * d, count))[0].reshape(n, d, count)
    x = normal.solve(factor, right * unit, *_of_others(problem, count))
    yielding = right.reshape(n * d, count).T @ (x[0] * unit).reshape(n * d, count)
    resisted, axes = np.linalg.eigh((yielding + yielding.T) / 2.0)
    axes = axes[:, ::-1]
    photos, points, shared = (part @ axes for part in x)
    return _Movements(
        (photos, points, shared), (right * unit) @ axes, resisted[::-1], photos * unit
    )


def _of_others(problem: Problem, count: int) -> tuple[Array, Array]:
    """(p, 3, k) and (g, k) zeros: right-hand sides of photos alone."""
    return np.zeros((len(problem.points), 3, count)), np.zeros((problem.in_border, count))


def _photos_moved(normal: NormalEquations, factor: Factor, right: Array) -> Array:
    """(n, d, k) changes of the photos for right-hand sides of photos alone."""
    points, shared = _of_others(normal.problem, right.shape[2])
    if normal.changes(factor):
        return normal.solve(factor, right, points, shared)[0]
    # points without right-hand sides of their own are eliminated already
    return factor.solve(right, shared)[0]


class _Seen(NamedTuple):
    """A bundle at a state, and which points of a larger one these are; None: all."""

    problem: Problem
    state: BlockState
    chosen: Bools | None

    def own(self, unknowns: Unknowns) -> Unknowns:
        """Return what belongs to its points, of photos, points and shared parameters."""
        photos, points, shared = unknowns
        return photos, points if self.chosen is None else points[self.chosen], shared

    def moved(self, unknowns: Unknowns) -> Linearised:
        """Return its rows where the unknowns have moved."""
        return linearise(self.problem, move(self.state, *self.own(unknowns)))


def _first_some(problem: Problem, state: BlockState) -> Iterator[_Seen]:
    """Yield some points of a large block, then all of them.

    A point follows each movement of its photos as well as it can, whatever the others do. So what
    some points resist is a part of what all of them do: where that part hardly changes with noise,
    more than noise holds the photos.
    """
    chosen = some_points(problem)
    if chosen is not None:
        there = replace(state, points=state.points[chosen])
        yield _Seen(of_points(problem, chosen), there, chosen)
    yield _Seen(problem, state, None)


def _as_firm(problem: Problem, firm: BlockState, found: _Movements, other: BlockState) -> bool:
    """Whether a block that is firm at one state is as firm at another.

    Both lie near each other: what is resisted least in one changes less than noise may change it.
    """
    problem = replace(problem, conditions=None)
    seen, there = next(_first_some(problem, firm)), next(_first_some(problem, other))
    own = seen.own(found.unknowns)
    linear, elsewhere = (linearise(at.problem, at.state) for at in (seen, there))
    resistance = effects(seen.problem, linear, own)
    changes = map(_less, effects(seen.problem, elsewhere, own), resistance)
    return all(
        change.vtpv <= _NOISE**2 * each.vtpv
        for change, each in zip(changes, resistance, strict=True)
    )


def _by_noise(
    normal: NormalEquations,
    factor: Factor,
    seen: _Seen,
    found: _Movements,
    noise: float,
    *,
    most: bool = False,
) -> Array:
    """(k,) how much of what resists each movement changes where noise has moved all else.

    Parameters
    ----------
    normal, factor
        The equations.
    seen
        The bundle where they are linearised, or some of its points there.
    found
        The movements.
    noise
        Of the measurements, in a-priori sigmas.
    most
        Whether no less than that is enough where it is little: nothing is solved for then. Of some
        points it always is.
    """
    problem, own = seen.problem, seen.own(found.unknowns)
    linear = normal.linear if seen.chosen is None else linearise(problem, seen.state)
    resistance = effects(problem, linear, own)
    resisted = np.array([max(each.vtpv, np.finfo(float).tiny) for each in resistance])
    changed = np.zeros(len(resistance))
    rng = np.random.default_rng(2)
    for _ in range(_NOISES):
        moved = list(normal.solution(factor, normal.gradient(_random(normal.linear, rng, noise))))
        along = np.tensordot(moved[0], found.right, 2) / found.resisted
        for part, of in zip(moved, found.unknowns, strict=True):
            part -= of @ along
        there = seen.moved((moved[0], moved[1], moved[2]))
        each = list(map(_less, effects(problem, there, own), resistance))
        change = np.array([one.vtpv for one in each])
        asked = np.flatnonzero((change > _NOISE**2 * resisted) | (not most))
        if len(asked) and seen.chosen is None:
            change[asked] -= _taken_up(normal, factor, [each[k] for k in asked.tolist()])[0]
        changed += np.maximum(change, 0.0)
    return np.asarray(np.sqrt(changed / _NOISES / resisted))


def _taken_up(
    normal: NormalEquations, factor: Factor, changes: Sequence[Linearised]
) -> tuple[Array, Unknowns]:
    """(k,) how much of k changes the unknowns take up, so that it resists nothing; their gradients.

    Of these the last index is that of the changes.
    """
    sides = [normal.gradient(change) for change in changes]
    photos, points, shared = (np.stack(part, axis=-1) for part in zip(*sides, strict=True))
    right = photos, points, shared
    taken = np.zeros(len(changes))
    for side, each in zip(right, normal.solve(factor, *right), strict=True):
        taken += (side * each).sum(axis=tuple(range(side.ndim - 1)))
    return taken, right


def _by_itself(
    normal: NormalEquations, factor: Factor, state: BlockState, found: _Movements, noise: float
) -> Array:
    """(k,) how much of what resists each movement changes with its own standard deviation.

    Nothing where one turns no photo by as much as `_TURNED`: of a firm block it is not asked.
    """
    problem, out = normal.problem, np.zeros(len(found.resisted))
    deviations = noise / np.sqrt(np.maximum(found.resisted, np.finfo(float).tiny))
    turned = np.abs(found.unknowns[0][:, 3:6]).max(axis=(0, 1)) * deviations
    for k in np.flatnonzero(turned > _TURNED).tolist():
        own, followed = found.at(k), min(1.0, _STEP / turned[k])
        photos, points, shared = (part[..., 0] * (followed * deviations[k]) for part in own)
        there = linearise(problem, move(state, photos, points, shared))
        now, then = (effects(problem, at, own)[0] for at in (normal.linear, there))
        change = _less(then, now)
        taken, sides = _taken_up(normal, factor, [change])
        # what goes along the movement itself is what is asked for
        along = sum(float((side * part).sum()) for side, part in zip(sides, own, strict=True))
        left = change.vtpv - taken.item() + along**2 / found.resisted[k]
        out[k] = np.sqrt(max(left, 0.0) / found.resisted[k]) / followed
    return out


def _less(one: Linearised, other: Linearised) -> Linearised:
    """Return the difference of misclosures."""
    return replace(
        one,
        e=one.e - other.e,
        point_e=one.point_e - other.point_e,
        photo_e=one.photo_e - other.photo_e,
        own_e=one.own_e - other.own_e,
        shared_e=one.shared_e - other.shared_e,
        given=one.given.less(other.given) if one.given and other.given else None,
        offsets=one.offsets.with_e(one.offsets.e - other.offsets.e)
        if one.offsets and other.offsets
        else None,
    )


def _random(linear: Linearised, rng: np.random.Generator, sigma: float) -> Linearised:
    """Return misclosures by chance; those of observations that do not exist are never used."""
    return replace(
        linear,
        e=rng.normal(size=linear.e.shape) * sigma,
        point_e=rng.normal(size=linear.point_e.shape) * sigma,
        photo_e=rng.normal(size=linear.photo_e.shape) * sigma,
        own_e=rng.normal(size=linear.own_e.shape) * sigma,
        shared_e=rng.normal(size=linear.shared_e.shape) * sigma,
        given=None if linear.given is None else linear.given.random(rng, sigma),
        offsets=None
        if linear.offsets is None
        else linear.offsets.with_e(rng.normal(size=linear.offsets.e.shape) * sigma),
    )
