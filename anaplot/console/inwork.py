"""What is in work, in one form for table, map and keys: the model's points, or fiducials."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

from anaplot.adjustment.tested import Observation
from anaplot.aliases import Axis, Side
from anaplot.orientation.results import Row
from anaplot.station.snapshot import InnerView, PointView, Snapshot

__all__ = ["InWork", "in_work", "recorded"]

_AXES: tuple[Axis, Axis] = ("x", "y")


@dataclass(frozen=True, slots=True, eq=False)
class InWork:
    """The model, or the inner orientation that comes before its points.

    Attributes
    ----------
    points
        Points, or fiducials with their place in the fiducial system; NaN where it is not known.
    keys
        Every row (point, axis) that there is or will be, in the order of the table.
    table
        The rows so far.
    off
        Those of a model that are switched off.
    none
        Probability that none of them holds a gross error.
    suspects
        Rows to measure again, the one to begin with first; axis None: the whole fiducial.
    flagged
        Rows that the test rejects, the most suspicious first.
    solved
        Whether there is a solution; what follows is of it.
    sigma0_um, apriori_um, redundancy, critical
        Estimated and a-priori sigma0, redundancy, critical value of the test.
    """

    points: tuple[PointView, ...]
    keys: tuple[tuple[str, Axis], ...]
    table: tuple[Observation[Row], ...] = ()
    off: tuple[Observation[Row], ...] = ()
    none: float = 0.0
    suspects: tuple[tuple[str, Axis | None], ...] = ()
    flagged: tuple[tuple[str, str], ...] = ()
    solved: bool = False
    sigma0_um: float | None = None
    apriori_um: float = 0.0
    redundancy: int = 0
    critical: float | None = None

    @property
    def needed(self) -> tuple[PointView, ...]:
        """Those without which the model is not complete: not what is only offered, or left out."""
        return tuple(
            view
            for view in self.points
            if not (view.offered or (view.status == "off" and not view.times))
        )


_latest: tuple[Snapshot, InWork] | None = None


def in_work(snapshot: Snapshot) -> InWork:
    """Return what is in work: y of every point, then x of every tie; or x and y of fiducials."""
    global _latest  # every part of the screen asks of the same snapshot
    latest = _latest
    if latest is None or latest[0] is not snapshot:
        latest = _latest = snapshot, _in_work(snapshot)
    return latest[1]


def recorded(snapshot: Snapshot) -> tuple[tuple[str, int, tuple[Side, ...]], ...]:
    """Return what changes with every record, and when one is taken back.

    In a mono comparator a point counts once both photos have it; where it was seen tells of each.
    """
    points = [(view.point, view.times, view.seen) for view in snapshot.points]
    fiducials = (view for inner in snapshot.inners for view in inner.fiducials)
    return (*points, *((view.fiducial, view.times, ()) for view in fiducials))


def _in_work(snapshot: Snapshot) -> InWork:
    if snapshot.inner is not None:
        return _inner(snapshot.inner)
    keys: list[tuple[str, Axis]] = [(view.point, "y") for view in snapshot.points]
    keys += [(view.point, "x") for view in snapshot.points if view.role == "tie"]
    solution, diagnosis = snapshot.solution, snapshot.diagnosis
    if solution is None:
        return InWork(snapshot.points, tuple(keys))
    suspects = () if diagnosis is None else diagnosis.suspects
    flagged = [row.key for row in solution.flagged]
    table, none = solution.table, solution.tested.odds.none
    if diagnosis is not None and diagnosis.chances:
        # the odds that are shown are those of which the advice speaks
        chances, none = diagnosis.chances, diagnosis.none
        table = tuple(
            row._replace(probability=chance) for row, chance in zip(table, chances, strict=True)
        )
    return InWork(
        points=snapshot.points,
        keys=tuple(keys),
        table=table,
        off=solution.off_rows,
        none=none,
        suspects=suspects,
        flagged=tuple(dict.fromkeys([*(key for key in suspects if key in flagged), *flagged])),
        solved=True,
        sigma0_um=solution.sigma0_um,
        apriori_um=solution.apriori_um,
        redundancy=solution.redundancy,
        critical=solution.test.critical,
    )


def _inner(inner: InnerView) -> InWork:
    points = tuple(
        PointView(f.fiducial, "new", *(f.place or (nan, nan)), f.status, f.times, f.off_axes)
        for f in inner.fiducials
    )
    keys = tuple((f.fiducial, axis) for f in inner.fiducials for axis in _AXES)
    solution = inner.solution
    if solution is None:
        return InWork(points, keys)
    return InWork(
        points=points,
        keys=keys,
        table=solution.rows,
        none=solution.tested.odds.none,
        suspects=inner.suspects,
        flagged=tuple(row.key for row in solution.flagged),
        solved=True,
        sigma0_um=solution.sigma0_um,
        apriori_um=solution.apriori_um,
        redundancy=solution.redundancy,
        critical=solution.test.critical,
    )
