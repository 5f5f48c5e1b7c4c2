"""One model: relative orientation with simultaneous scale transfer, and its table."""

from __future__ import annotations

from functools import partial
from itertools import combinations, repeat
from math import inf

import numpy as np

from anaplot.adjustment.leastsquares import Adjustment, RankDefectError, adjust_weighted
from anaplot.adjustment.tested import Dense, Observation, Tested, examine
from anaplot.aliases import Array, Axis
from anaplot.errors import NotComputableError, TooFewError
from anaplot.orientation.conditionequations import ConditionEquations, ModelUnknowns
from anaplot.orientation.interchange import Interchange, interchanged
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.results import ModelSolution, Row
from anaplot.orientation.solver import (
    IN_FRONT,
    find_orientation,
    iterate,
    vertical_start,
)
from anaplot.orientation.tieerrors import ExactStatistics, exact_statistics, point_cofactors
from anaplot.photogrammetry.block import Precision, TestSettings, TieVariance
from anaplot.photogrammetry.rotation import rotation_angles, rotation_axes

__all__ = ["BADLY_SPREAD", "LEAST_PARALLAX", "UNKNOWNS", "WrongPointsError", "orient", "warm_up"]


UNKNOWNS = ("bx", "beta_y", "beta_z", "kappa", "phi", "omega")
"""g of the paper; a first model has no bx."""

BADLY_SPREAD = 200.0
"""Condition number above which the operator is told that the points are badly spread."""

LEAST_PARALLAX = 1e-6
"""Mean x-parallax, as a share of the camera constant, below which it gives no base."""

_EVERY_PAIR_UP_TO = 10  # points of a model in which an interchange can turn the orientation round
_SAYS_TURNED = 3  # redundancy from which the base does not lie across x by points alone
_DUST_UM = 1e-6  # a parallax below this is rounding, whatever it is divided by
_UNCHANGED = np.eye(7)
_EVERY_Y: repeat[Axis] = repeat("y")
_EVERY_X: repeat[Axis] = repeat("x")


class WrongPointsError(NotComputableError):
    """Points so wrong that no least-squares orientation exists, while all others agree.

    Attributes
    ----------
    suspects
        Their names, the worst first.
    interchange
        Two points whose records are exchanged, or None.
    """

    def __init__(
        self, model: str, suspects: tuple[str, ...], interchange: Interchange | None = None
    ) -> None:
        self.suspects = suspects
        self.interchange = interchange
        what = f"the other points agree: remeasure {suspects[0]}"
        super().__init__(
            f"model {model}: no orientation with {', '.join(suspects)}; "
            + (what if interchange is None else interchange.text)
        )


def warm_up() -> None:
    """Load what the first model needs, so that it is as quick as the others."""
    import scipy.linalg.lapack
    import scipy.special  # noqa: F401


def orient(pair: Stereopair, precision: Precision, test: TestSettings) -> ModelSolution:
    """Orient the right photo of a model to the left one and to the ties (1983, eq. 1-7).

    Parameters
    ----------
    pair
        Measurements and what the strip already knows.
    precision
        A-priori sigma0 and the tie variance.
    test
        The test that flags rows.

    Raises
    ------
    NotComputableError
        Too few points, no ties, points that do not determine the model, images turned; names the
        model.
    WrongPointsError
        One or two points are so wrong that there is no orientation with them.
    """
    _check_finite(pair)
    conditions = ConditionEquations(pair, precision.tie_variance)
    _check_count(pair, conditions)
    bx = _first_base(pair) if conditions.first else None
    apriori_mm = precision.image_um * 1e-3
    found, suspects = find_orientation(pair, conditions, bx, apriori_mm)
    if suspects and (found is None or not found.usable):
        raise _hopeless(pair, precision, suspects)
    if found is None:
        raise _hopeless(pair, precision, (), _not_found_error(pair, conditions, bx))
    if not found.along:
        raise _hopeless(pair, precision, (), _turned_error(pair, conditions))
    solution = found.solution
    state = solution.state
    unknowns = UNKNOWNS[1:] if conditions.first else UNKNOWNS
    omega, phi, kappa = rotation_angles(state.rotation)
    q_l = conditions.cofactors(state.bx)
    try:
        rows = _by_unknowns(conditions, solution.rows, state.bx, omega, phi)
        correlated = precision.tie_variance == "exact"
        adjusted = adjust_weighted(rows, np.sqrt(q_l), unknowns=unknowns, complete=correlated)
    except RankDefectError as error:
        if suspects:
            raise _hopeless(pair, precision, suspects) from error
        raise _undetermined_error(pair, error) from error
    behind: tuple[str, ...] = ()
    if not all(found.front):
        behind = tuple(p for p, front in zip(pair.points, found.front, strict=True) if not front)
    if found.in_front < IN_FRONT:
        behind_error = NotComputableError(
            f"model {pair.name}: {len(behind)} of {len(pair.points)} points would lie behind a "
            "photo; are the photos interchanged, or is one mirrored?"
        )
        raise _hopeless(pair, precision, (), behind_error)
    exact = None
    if correlated:
        exact = exact_statistics(pair, conditions, solution, adjusted)
    tested = _tested(conditions, adjusted, exact, precision, test)
    return ModelSolution(
        left=pair.left,
        right=pair.right,
        centre=tuple(pair.fixed.centre.tolist()),
        base=(state.bx, state.bx * state.beta_y, state.bx * state.beta_z),
        rotation=(omega, phi, kappa),
        iterations=solution.iterations,
        tested=tested,
        names=pair.points,
        of_coordinates=partial(_coordinates, pair, conditions, state),
        ties=conditions.x_points,
        apriori_um=precision.image_um,
        tie_variance=precision.tie_variance,
        outliers=suspects,
        remarks=_remarks(adjusted, behind),
        q_l=q_l,
        unknowns=unknowns,
        of_design=partial(getattr, adjusted, "condition"),
        of_unknowns=(
            partial(getattr, adjusted, "q_xx")
            if exact is None
            else partial(getattr, exact, "unknowns")
        ),
        of_points=(
            partial(point_cofactors, pair, conditions, state)
            if exact is None
            else partial(getattr, exact, "points")
        ),
        exact=exact,
        off_rows=_off_rows(pair, state, precision.tie_variance),
        measured=(pair.aside or pair).points,
        pair=pair,
    )


def _hopeless(
    pair: Stereopair,
    precision: Precision,
    suspects: tuple[str, ...],
    error: NotComputableError | None = None,
) -> NotComputableError:
    """Return the error of a pair without orientation: an interchange, wrong points, or another."""
    pairs: list[tuple[str, str]] = []
    if len(suspects) == 2:
        pairs = [(a, b) for a, b in combinations(pair.points, 2) if {a, b} == set(suspects)]
    elif not suspects and len(pair.points) <= _EVERY_PAIR_UP_TO:
        pairs = list(combinations(pair.points, 2))
    apriori_mm = precision.image_um * 1e-3
    exchanged = interchanged(pair, precision.tie_variance, apriori_mm, pairs)
    if exchanged is not None:
        return WrongPointsError(pair.name, exchanged.points, exchanged)
    return error or WrongPointsError(pair.name, suspects)


def _off_rows(
    pair: Stereopair, state: ModelUnknowns, tie_variance: TieVariance
) -> tuple[Observation[Row], ...]:
    """Return the rows that are switched off: F / a [um] at the solution of the others."""
    if pair.aside is None:
        return ()
    conditions = ConditionEquations(pair.aside, tie_variance)
    with np.errstate(all="ignore"):
        misclosures = conditions.evaluate(state)[6] * np.sqrt(conditions.cofactors(state.bx))
    parallaxes = np.where(np.isfinite(misclosures), 1e3 * misclosures, np.nan)
    keys = _keys(conditions)
    return tuple(
        Observation.off(key, "um", value)
        for key, value in zip(keys, parallaxes.tolist(), strict=True)
    )


def _coordinates(pair: Stereopair, conditions: ConditionEquations, state: ModelUnknowns) -> Array:
    """(3, n) coordinates of the points in the strip system [mm]."""
    with np.errstate(all="ignore"):
        return conditions.meet(state).points + pair.fixed.centre[:, None]


def _keys(conditions: ConditionEquations) -> list[Row]:
    """Return the rows that count: all y, then all x."""
    y_rows = zip(conditions.y_points, _EVERY_Y, strict=False)
    return [*y_rows, *zip(conditions.x_points, _EVERY_X, strict=False)]


def _check_count(pair: Stereopair, conditions: ConditionEquations) -> None:
    """Raise when counting alone shows that the model is not computable."""
    y_rows, x_rows = len(conditions.y_points), len(conditions.x_points)
    if pair.ties is None:
        if y_rows < 5:
            raise TooFewError(
                f"model {pair.name}: {_points(y_rows)} in common, a strip's first model needs five"
            )
        return
    if not pair.points:
        raise TooFewError(f"model {pair.name}: no points in common")
    if not x_rows:
        if any(point in pair.ties for point in pair.points):
            raise TooFewError(f"model {pair.name}: every tie is switched off, there is no scale")
        raise TooFewError(
            f"model {pair.name}: none of its {len(pair.points)} points is a point of the preceding "
            "model; without ties there is no scale"
        )
    if y_rows + x_rows < 6:
        raise TooFewError(
            f"model {pair.name}: {_points(y_rows)} and {x_rows} ties give {y_rows + x_rows} rows "
            "for 6 unknowns"
        )


def _check_finite(pair: Stereopair) -> None:
    """Raise where a coordinate is not a number, if it is not the count that is wrong first."""
    if abs(float(np.vdot(pair.xl, pair.xr))) < inf:
        return
    with np.errstate(all="ignore"):
        _check_count(pair, ConditionEquations(pair))
    for point, *xy in zip(pair.points, *pair.xl.T.tolist(), *pair.xr.T.tolist(), strict=True):
        if not all(abs(value) < inf for value in xy):
            raise NotComputableError(
                f"model {pair.name}: point {point} has a coordinate that is not a number"
            )


def _points(count: int) -> str:
    return "one point" if count == 1 else f"{count} points"


def _first_base(pair: Stereopair) -> float:
    """Return the magnitude of a first model's bx: nominal, or the mean x-parallax."""
    if pair.base is not None:
        return abs(pair.base)
    mean = abs(float(np.mean(pair.xl[:, 0] - pair.xr[:, 0])))
    if mean < LEAST_PARALLAX * pair.c_left:
        raise NotComputableError(
            f"model {pair.name}: the mean x-parallax is zero; state the strip's base in block.toml"
        )
    return mean


def _line_hint(pair: Stereopair) -> str:
    """Say so when the left photo's points lie on one line or in one place."""
    spread = np.linalg.svd(pair.xl - pair.xl.mean(axis=0), compute_uv=False)
    if spread[0] < 1e-3 * pair.c_left:
        return "; the points lie in one place"
    if spread[1] < 0.02 * spread[0]:
        return "; the points lie on one line"
    return ""


def _turned_error(pair: Stereopair, conditions: ConditionEquations) -> NotComputableError:
    if conditions.row_count < len(UNKNOWNS) - conditions.first + _SAYS_TURNED:
        return TooFewError(
            f"model {pair.name}: with {_points(len(pair.points))} the base lies across x: more of "
            "them tell whether the images are turned"
        )
    return NotComputableError(
        f"model {pair.name}: the base lies across x; the images are turned: x must run along the "
        "flight, turn them by 90 degrees"
    )


def _undetermined_error(pair: Stereopair, error: RankDefectError) -> NotComputableError:
    return NotComputableError(f"model {pair.name}: {error}{_line_hint(pair)}")


def _not_found_error(
    pair: Stereopair, conditions: ConditionEquations, bx: float | None
) -> NotComputableError:
    """Say why nothing converged: unknowns without any hold, contradicting ties, or neither."""
    start = vertical_start(pair, conditions, bx)
    unknowns = UNKNOWNS[1:] if conditions.first else UNKNOWNS
    with np.errstate(all="ignore"):
        rows = _by_unknowns(conditions, conditions.evaluate(start), start.bx, 0.0, 0.0)
    if np.isfinite(rows).all():
        q_l = conditions.cofactors(start.bx)
        try:
            adjust_weighted(rows, np.sqrt(q_l), unknowns=unknowns)
        except RankDefectError as error:
            return _undetermined_error(pair, error)
    reason = "the solution does not converge"
    if not conditions.first and len(conditions.y_index) >= 5:
        with np.errstate(all="ignore"):
            plane = iterate(conditions, start, ties=False)
        if plane is not None:
            reason = (
                "the ties do not determine the base, their coordinates from the preceding model "
                "contradict this one"
            )
    return NotComputableError(
        f"model {pair.name}: no orientation found, {reason}{_line_hint(pair)}"
    )


def _by_unknowns(
    conditions: ConditionEquations, rows: Array, bx: float, omega: float, phi: float
) -> Array:
    """(u + 1, n) weighted rows, derivatives with respect to UNKNOWNS, not d ln bx and turns."""
    change = _UNCHANGED.copy()
    change[0, 0] = 1.0 / bx
    change[3:6, 3:6] = rotation_axes(omega, phi).T[::-1]
    out: Array = change.dot(rows)
    return out[1:] if conditions.first else out


def _tested(
    conditions: ConditionEquations,
    adjusted: Adjustment,
    exact: ExactStatistics | None,
    precision: Precision,
    test: TestSettings,
) -> Tested[Row]:
    keys = _keys(conditions)
    apriori = precision.image_um
    sigma = apriori * adjusted.root
    vtpv, left, moved = adjusted.vtpv, None, None
    if exact is not None:
        vtpv, moved = exact.vtpv, exact.effects
        left = np.sqrt(exact.left.diagonal())
    return examine(
        keys,
        ["um"] * len(keys),
        adjusted.w * 1e3,
        adjusted.r,
        sigma,
        vtpv=vtpv / (apriori * 1e-3) ** 2,
        redundancy=adjusted.redundancy,
        test=test,
        left=left,
        moved=moved,
        rounding=_DUST_UM,
        dense=partial(_dense, adjusted, exact),
    )


def _dense(adjusted: Adjustment, exact: ExactStatistics | None) -> Dense:
    return Dense(adjusted.q_vv if exact is None else exact.residuals, adjusted.influence)


def _remarks(adjusted: Adjustment, behind: tuple[str, ...]) -> tuple[str, ...]:
    out = []
    if adjusted.redundancy == 0:
        out.append("no redundancy: an orientation without any check")
    elif adjusted.redundancy == 1:
        out.append("redundancy 1: an error may show, but nothing can be located")
    if adjusted.worse_than(BADLY_SPREAD):
        out.append(f"the points are badly spread (condition number {adjusted.condition:.0f})")
    if behind:
        out.append(f"not in front of both photos: {', '.join(behind)}")
    return tuple(out)
