"""The truth of one's own pointing: what models and repeated pointing say of its precision."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from anaplot.adjustment.pooling import (
    Pooled,
    VarianceTest,
    equal_variances,
    pooled_rows,
)
from anaplot.adjustment.significance import TESTABLE
from anaplot.adjustment.tested import Tested
from anaplot.aliases import Axis
from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import read_block
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import bridge
from anaplot.photogrammetry.block import Block
from anaplot.session.innerwork import solve_inner
from anaplot.session.models import solve
from anaplot.session.pointings import Pointings, pointings_of
from anaplot.session.state import EventRefusedError, SessionState, start
from anaplot.station.drift import Drift, drift_over_days
from anaplot.station.pooledrows import ALPHA, AdjustedRows, Row, Sigma, sigma_of, sums_by
from anaplot.station.repeatedpointing import RepeatedPointing, repeated_pointing
from anaplot.station.replay import recorded_block
from anaplot.station.sessionlog import read_history

__all__ = [
    "GroupTest",
    "Pointing",
    "PooledSigma",
    "pointing_of",
    "read_pointing",
]


Group = Literal["all", "strip", "operator", "kind"]


class PooledSigma(NamedTuple):
    """sigma0 of a group of rows: its kind and name, how many rows, and their redundancy."""

    group: Group
    name: str
    rows: int
    redundancy: float
    sigma: Sigma


class GroupTest(NamedTuple):
    """Whether groups of one kind have one sigma0."""

    group: Group
    test: VarianceTest

    @property
    def differ(self) -> bool:
        """Whether they have not, at ALPHA."""
        return self.test.probability < ALPHA


@dataclass(frozen=True, slots=True)
class Pointing:
    """What a block says of the precision of pointing.

    Attributes
    ----------
    apriori_um
        sigma0 that the block states [um].
    pooled
        sigma0 of all relative orientations, by strip, operator and kind of point; of the inner
        orientations under the kind "fiducial".
    tests
        Whether strips, and operators, differ.
    repeated
        Precision of repeated pointing by operator and kind.
    offer
        That of one coordinate of a point, of all operators; None without repeated pointing.
    pointings
        From how many pointings it is.
    against_models
        Whether it is the sigma0 of the models; None where there are not both.
    drift
        Day by day and operator by operator.
    remarks
        What was odd on the way.
    """

    apriori_um: float
    pooled: tuple[PooledSigma, ...] = ()
    tests: tuple[GroupTest, ...] = ()
    repeated: tuple[RepeatedPointing, ...] = ()
    offer: Sigma | None = None
    pointings: int = 0
    against_models: VarianceTest | None = None
    drift: tuple[Drift, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def offered(self) -> str:
        """What repeated pointing offers as the weight, in one line, or ""."""
        offer = self.offer
        if offer is None:
            return ""
        high = "open" if offer.high_um is None else f"{offer.high_um:.1f}"
        return (
            f"pointing {offer.um:.1f} um ({self.pointings} pointings, {offer.low_um:.1f} to "
            f"{high}): block.toml has sigma {self.apriori_um:g}"
        )

    @property
    def line_to_write(self) -> str:
        """The line of block.toml, [precision], that takes it as the weight; "" when it stands so.

        Whether it is written is the operator's decision.
        """
        offer = self.offer
        if offer is None or offer.holds(self.apriori_um):
            return ""
        return f"image_um = {offer.um:.1f}"

    @property
    def beside_models(self) -> str:
        """What it means that the models say something else, or ""."""
        models = next((one.sigma.um for one in self.pooled if one.group == "all"), None)
        against = self.against_models
        if against is None or models is None or self.offer is None or against.probability >= ALPHA:
            return ""
        shown = f"the models show {models:.2f} um (F {against.statistic:.2f}, "
        shown += f"P {against.probability:.3f}): "
        if models < self.offer.um:
            return shown + "less than pointing"
        return shown + (
            "more than pointing: identification, film and lens are in it, or the second "
            "pointings leaned on the first"
        )


def read_pointing(session: Path) -> Pointing:
    """Return what a block, or a recorded session, says of the precision of pointing.

    Parameters
    ----------
    session
        A block folder: models are then computed from its files; or a journal file or a folder
        `sessions`, whose accepted models are taken.

    Raises
    ------
    InputError
        It cannot be read; a journal that does not fit its block is a remark.
    """
    if not (session / "block.toml").is_file():
        records, history = read_history(session)
        block = recorded_block(session, records)
        try:
            return pointing_of(block, pointings_of(start(block), history))
        except EventRefusedError as error:
            raise InputError(f"{session}: the journal does not fit its block: {error}") from None
    block = read_block(session)
    said: Pointings | None = None
    remarks: tuple[str, ...] = ()
    if (session / "sessions").exists():
        try:
            said = pointings_of(start(block), read_history(session)[1])
        except (InputError, EventRefusedError) as error:
            remarks = (f"the journal was not read: {error}",)
    found = pointing_of(block, said)
    return replace(found, remarks=(*remarks, *found.remarks))


def pointing_of(block: Block, said: Pointings | None) -> Pointing:
    """Return what a block and its journal say of the precision of pointing.

    Parameters
    ----------
    block
        With its image points; a block without any is one whose accepted models are taken.
    said
        What the journal says, or None.
    """
    measured = {} if said is None else said.measured
    control = {point.point for point in block.control if point.use != "off"}
    remarks: list[str] = []
    models: list[AdjustedRows] = []
    flagged = 0
    for strip, solution in _models(block, said, remarks):

        def row(
            point: str, axis: str, solution: ModelSolution = solution, strip: str = strip
        ) -> Row:
            kind = "tie" if point in solution.ties else "new"
            pointed = measured.get((solution.left, solution.right, point))
            return _row(strip, "control" if point in control else kind, axis, pointed)

        whole = Pooled(
            len(solution.tested),
            (solution.tested.sigma0 or 0.0) ** 2 * solution.redundancy,
            solution.redundancy,
            solution.redundancy,
        )
        models += _adjusted(solution.tested, row, whole)
        flagged += len(solution.flagged)
    if flagged:
        rows = "1 flagged row counts" if flagged == 1 else f"{flagged} flagged rows count"
        remarks.append(f"{rows} in the sigma0 of the models")
    fiducials = _inner_orientations(said)
    apriori = block.precision.image_um
    pooled = _pooled(models, fiducials, apriori)
    repeated, offer, pointings = repeated_pointing(() if said is None else said.runs, control)
    against = None
    if offer is not None and pooled and pooled[0].group == "all":
        of_models = pooled[0].sigma
        against = equal_variances(
            (of_models.um**2, offer.um**2), (of_models.degrees, offer.degrees)
        )
    return Pointing(
        apriori_um=apriori,
        pooled=pooled,
        tests=_tests(pooled),
        repeated=repeated,
        offer=offer,
        pointings=pointings,
        against_models=against,
        drift=drift_over_days(models, apriori),
        remarks=tuple(remarks),
    )


def _models(
    block: Block, said: Pointings | None, remarks: list[str]
) -> Iterable[tuple[str, ModelSolution]]:
    if block.image_points or said is None:
        for strip in bridge(block):
            remarks += [] if strip.error is None else [strip.error]
            yield from ((strip.strip, model) for model in strip.models)
        return
    for model in said.state.models:
        try:
            yield model.strip, solve(said.state, model)
        except NotComputableError as error:
            remarks.append(str(error))


def _row(strip: str, kind: str, axis: str, pointed: tuple[str, str] | None) -> Row:
    along: Axis = "x" if axis == "x" else "y"
    if pointed is None:
        return Row(strip, None, kind, along, None)
    who, time = pointed
    return Row(strip, who, kind, along, datetime.fromisoformat(time))


def _adjusted(
    tested: Tested[Any], row: Callable[[str, str], Row], whole: Pooled | None
) -> list[AdjustedRows]:
    """Return an adjustment's testable rows; none where nothing is redundant."""
    keep = tested.r > TESTABLE
    if tested.dense is None or tested.redundancy < 1 or not keep.any():
        return []
    q = tested.q_vv[np.ix_(keep, keep)]
    size = np.sqrt(np.diag(q))
    correlation = q / size[:, None] / size
    w, r = (tested.residual / np.where(keep, tested.deviation, 1.0))[keep], tested.r[keep]
    rows = tuple(
        row(str(key[-2]), str(key[-1])) for key, kept in zip(tested.keys, keep, strict=True) if kept
    )
    if whole is None:
        whole = pooled_rows(w, r, correlation, np.ones(len(w), dtype=bool))
    return [AdjustedRows(rows, tested.residual[keep], w, r, correlation, whole)]


def _inner_orientations(said: Pointings | None) -> list[AdjustedRows]:
    out: list[AdjustedRows] = []
    if said is None:
        return out
    state: SessionState = said.state
    for model in state.models:
        for inner in model.inner:
            try:
                solution = solve_inner(state.block, inner)
            except NotComputableError:
                continue
            if solution.distances:
                continue  # distances between fiducials, no coordinates, are what is tested

            def row(point: str, axis: str, photo: str = inner.photo, side: str = inner.side) -> Row:
                return _row("", "fiducial", axis, said.measured.get((photo, side, point)))

            out += _adjusted(solution.tested, row, None)
    return out


def _pooled(
    models: Sequence[AdjustedRows], fiducials: Sequence[AdjustedRows], apriori: float
) -> tuple[PooledSigma, ...]:
    groups: list[tuple[Group, Mapping[str, Pooled]]] = [
        ("all", sums_by(models, lambda _: "")),
        ("strip", sums_by(models, lambda row: row.strip)),
        ("operator", sums_by(models, lambda row: row.who)),
        ("kind", {**sums_by(models, _kind), **sums_by(fiducials, _kind)}),
    ]
    return tuple(
        PooledSigma(group, name, one.rows, one.redundancy, sigma)
        for group, sums in groups
        for name, one in sums.items()
        if (sigma := sigma_of(one, apriori)) is not None
    )


def _kind(row: Row) -> str:
    return row.kind


def _tests(pooled: Sequence[PooledSigma]) -> tuple[GroupTest, ...]:
    """Test strips and operators, whose models share nothing; kinds of points share their models."""
    out = []
    groups: tuple[Group, ...] = ("strip", "operator")
    for group in groups:
        members = [one.sigma for one in pooled if one.group == group]
        test = equal_variances([s.um**2 for s in members], [s.degrees for s in members])
        if test is not None:
            out.append(GroupTest(group, test))
    return tuple(out)
