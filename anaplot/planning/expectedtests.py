"""What the tests would say, on average, of errors in a planned network (1978, Tables 3 and 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from anaplot.adjustment.consistency import GlobalTest
from anaplot.adjustment.significance import noncentral_f_power, normal_power
from anaplot.aliases import Axis
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Datum
from anaplot.errors import InputError
from anaplot.photogrammetry.planting import PlantedError, with_planted_errors
from anaplot.planning.idealblock import IdealBlock

__all__ = ["ExpectedSingle", "ExpectedTests", "expected_tests"]


class ExpectedSingle(NamedTuple):
    """What the test of one observation says of an error in it, were it the only one.

    Attributes
    ----------
    where, axis, um
        "PHOTO:POINT", the coordinate, and the error [um].
    r, mdb_um
        Redundancy number, and the smallest detectable error [um]; None: nothing checks it.
    w
        Expected size of w.
    power
        How often it exceeds its critical value.
    """

    where: str
    axis: Axis
    um: float
    r: float
    mdb_um: float | None
    w: float
    power: float


class ExpectedTests(NamedTuple):
    """What the tests say of errors.

    Attributes
    ----------
    single
        Of each by itself.
    noncentrality
        lambda of all together (Gruen 1978, eq. 18).
    theta
        Expected sigma0_hat^2 / sigma0^2, 1 + lambda / r (eq. 15); None without redundancy.
    global_test
        The global test that goes with the single ones, or None.
    power
        How often theta exceeds its limit; None without the test.
    """

    single: tuple[ExpectedSingle, ...]
    noncentrality: float
    theta: float | None
    global_test: GlobalTest | None
    power: float | None


def expected_tests(
    made: IdealBlock, block: AdjustedBlock, planted: Sequence[PlantedError], datum: Datum
) -> ExpectedTests:
    """Return what the tests would say of errors in error-free image coordinates.

    Parameters
    ----------
    made, block
        The planned block, and its evaluation.
    planted
        The errors.
    datum
        With which it was evaluated.

    Raises
    ------
    InputError
        There is no such image point.
    NotComputableError
        The block cannot be adjusted with errors that large.

    Notes
    -----
    lambda is v'Pv / sigma0^2 of the block that holds the errors and no noise: what Q_vv leaves of
    them.
    """
    wrong = replace(made, block=with_planted_errors(made.block, planted)).evaluated(datum)
    redundancy = block.redundancy
    size = 0.0 if wrong.sigma0 is None else redundancy * wrong.sigma0**2
    test = block.problem.test
    sigma = made.block.precision.image_um
    rows = {(f"{row.photo}:{row.point}", "xy"[k]): one
            for row in block.ray_rows() for k, one in enumerate(row.xy)}  # fmt: skip
    single = []
    for error in planted:
        row = rows.get((error.where, error.axis))
        if row is None:
            raise InputError(f"image point {error.where} is not determined in this network")
        w = abs(error.um) * float(row.r) ** 0.5 / sigma
        power = normal_power(w, test.alpha)
        single.append(ExpectedSingle(*error, row.r, row.mdb, w, power))
    overall = block.global_test()
    return ExpectedTests(
        tuple(single),
        size,
        1.0 + size / redundancy if redundancy > 0 else None,
        overall,
        None if overall is None else noncentral_f_power(size, overall.critical, redundancy, None),
    )
