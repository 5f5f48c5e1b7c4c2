"""Modified data snooping of a block beside the exact test: computed once, and its document."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from anaplot.adjustment.modelvalues import MODEL_TOLERANCE, beyond_model
from anaplot.bundle.errors.snooping import ObservationClass, Snooping, classify, snoop
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.report.document import (
    Block,
    Document,
    Listed,
    Table,
    for_programs,
    name,
    number,
    say,
    table,
    whole,
)
from anaplot.report.snoopingmodels import SAMPLED, ModelValues, snooping_models

__all__ = ["SnoopedBlock", "snoop_block", "snooping_document"]

_MOST = 30  # of single observations in the text; JSON holds them all


class Decided(NamedTuple):
    """An observation and what the two tests say of it.

    Attributes
    ----------
    photo, point, model, axis
        The image coordinate.
    w
        Standardized residual with the exact cofactor; None when it cannot be tested.
    rejected, exact
        What the modified and what the exact test decides.
    """

    photo: str
    point: str
    model: str | None
    axis: str
    w: float | None
    rejected: bool
    exact: bool


class ClassRow(NamedTuple):
    """A class of observations.

    Attributes
    ----------
    kind
        The class.
    model
        Its model value of sqrt(q_vv), in units of the a-priori sigma; None where there is none.
    smallest, largest
        Exact sqrt(q_vv) in the class.
    accepted, rejected
        Numbers of observations that the model value decides.
    undecided
        Number of those that it leaves to the exact cofactor.
    beyond
        Number of exact sqrt(q_vv) farther from the model value than the tolerance.
    untestable
        Number of observations that cannot be tested: the model value is next to zero.
    """

    kind: ObservationClass
    model: float | None
    smallest: float
    largest: float
    accepted: int
    rejected: int
    undecided: int
    beyond: int
    untestable: int

    @property
    def observations(self) -> int:
        """Number of its observations."""
        return self.accepted + self.rejected + self.undecided + self.untestable


@dataclass(frozen=True, slots=True, eq=False)
class SnoopedBlock:
    """Both tests of a block.

    Attributes
    ----------
    values
        The model values and where they come from.
    tolerance
        k_q, a share.
    critical
        Critical value of both.
    classes
        Class by class.
    undecided
        Observations that the model values leave open, decided with their exact cofactors; in this
        and the following the largest abs(w) first.
    rejected
        All observations that the modified test rejects.
    wrongly_accepted, wrongly_rejected
        Observations that the exact test decides the other way.
    """

    values: ModelValues
    tolerance: float
    critical: float
    classes: tuple[ClassRow, ...]
    undecided: tuple[Decided, ...]
    rejected: tuple[Decided, ...]
    wrongly_accepted: tuple[Decided, ...]
    wrongly_rejected: tuple[Decided, ...]

    @property
    def observations(self) -> int:
        """Number of image coordinates tested."""
        return sum(row.observations for row in self.classes)

    @property
    def untestable(self) -> int:
        """Number of image coordinates that cannot be tested by their model value."""
        return sum(row.untestable for row in self.classes)

    @property
    def beyond(self) -> int:
        """Number of exact sqrt(q_vv) farther from their model values than the tolerance."""
        return sum(row.beyond for row in self.classes)


def snoop_block(
    block: AdjustedBlock,
    *,
    tolerance: float = MODEL_TOLERANCE,
    model: str | os.PathLike[str] = SAMPLED,
    bridging: float | None = None,
) -> SnoopedBlock | None:
    """Test a block by model values, and exactly.

    Parameters
    ----------
    block
        The adjusted block.
    tolerance
        k_q of Gruen (1980), eqs. (9) to (11).
    model, bridging
        Where the model values come from, as `snooping_models` has them.

    Returns
    -------
    SnoopedBlock or None
        None when there is no test at all: the redundancy does not suffice.

    Raises
    ------
    InputError
        A file of model values is not good.
    """
    if block.critical is None or block.sigma is None or not block.sigma > 0.0:
        return None
    values = snooping_models(block, model, bridging)
    found = snoop(block, values.roots, tolerance)
    exact = block.flagged
    w = block.w

    def listed(chosen: np.ndarray[Any, np.dtype[np.bool_]]) -> tuple[Decided, ...]:
        problem = block.problem
        rows = []
        for ray, axis in np.argwhere(chosen).tolist():
            row = problem.block.image_points[problem.source[ray]]
            size = float(w[ray, axis])
            rows.append(
                Decided(
                    row.photo,
                    row.point,
                    row.model,
                    "xy"[axis],
                    size if np.isfinite(size) else None,
                    bool(found.rejected[ray, axis]),
                    bool(exact[ray, axis]),
                )
            )
        # of two that are equal the first in the block, whatever rounding says
        rows.sort(key=lambda row: -1.0 if row.w is None else round(abs(row.w), 6), reverse=True)
        return tuple(rows)

    return SnoopedBlock(
        values,
        tolerance,
        block.critical,
        _classes(block, values.roots, tolerance, found),
        listed(found.computed),
        listed(found.rejected),
        listed(exact & ~found.rejected),
        listed(found.rejected & ~exact),
    )


def _classes(
    block: AdjustedBlock,
    models: Mapping[ObservationClass, float],
    tolerance: float,
    found: Snooping,
) -> tuple[ClassRow, ...]:
    rows = []
    for kind, (rays, axis) in classify(block.problem).items():
        model = models.get(kind)
        root = np.sqrt(np.maximum(block.cofactors.r[rays, axis], 0.0))
        undecided = found.computed[rays, axis]
        rejected = found.rejected[rays, axis] & ~undecided
        untestable = found.untestable[rays, axis]
        beyond = beyond_model(
            block.cofactors.r[rays, axis], np.nan if model is None else model, tolerance
        )
        rows.append(
            ClassRow(
                kind,
                model,
                float(root.min()),
                float(root.max()),
                int((~rejected & ~undecided & ~untestable).sum()),
                int(rejected.sum()),
                int(undecided.sum()),
                int(beyond.sum()),
                int(untestable.sum()),
            )
        )
    return tuple(rows)


_CLASSES = (
    name("", "CLASS", 28),
    *for_programs("rays", "inner", "control"),
    name("axis", "AXIS", 4, gap=1),
    whole("observations", "OBS", 7),
    number("root_qvv", "MODEL", 3, 7),
    number("smallest", "EXACT FROM", 3, 12),
    replace(number("largest", "TO", 3, 7), head="   TO"),
    replace(whole("accepted", "ACCEPT", 6), head="  ACCEPT"),
    whole("rejected", "REJECT", 8),
    whole("undecided", "UNDECIDED", 11),
    whole("beyond_tolerance", "BEYOND k_q", 12),
    name("untestable", form=lambda count: "not testable" if count else ""),
)


def _class_table(classes: tuple[ClassRow, ...]) -> Table:
    rows = (
        (_named(row.kind), *row.kind, row.observations, row.model, row.smallest, row.largest,
         row.accepted, row.rejected, row.undecided, row.beyond, row.untestable)
        for row in classes
    )  # fmt: skip
    return table("snooping_classes", _CLASSES, rows)


def _decided(key: str, rows: tuple[Decided, ...]) -> Table:
    return table(f"snooping_{key}", for_programs(*Decided._fields), rows)


def snooping_document(snooped: SnoopedBlock | None) -> Document:
    """Return the document of both tests side by side; its answer is None without a test."""
    if snooped is None:
        nothing = say("  no test: the redundancy does not suffice")
        return Document(None, (say("MODIFIED DATA SNOOPING").of("heading"), nothing))
    classes = _class_table(snooped.classes)
    lists = {
        key: _decided(key, getattr(snooped, key))
        for key in ("undecided", "rejected", "wrongly_accepted", "wrongly_rejected")
    }
    different = len(snooped.wrongly_accepted) + len(snooped.wrongly_rejected)
    answer = {
        "model_values": snooped.values.source,
        "tolerance": snooped.tolerance,
        "critical": snooped.critical,
        "observations": snooped.observations,
        "classes": classes,
        **lists,
        "differences": different,
        "beyond_tolerance": snooped.beyond,
        "untestable": snooped.untestable,
    }
    share = say("{:g} %", 100.0 * snooped.tolerance)
    judged = say("  the exact test decides all of them alike")
    if different:
        judged = say(
            "  the exact test decides {} otherwise: {} wrongly accepted, {} wrongly rejected",
            different,
            len(snooped.wrongly_accepted),
            len(snooped.wrongly_rejected),
        ).of("look")
    page: list[Block] = [
        say("MODIFIED DATA SNOOPING (Gruen 1980) BESIDE THE EXACT TEST").of("heading"),
        say(
            "  model values of sqrt(q_vv) {}, k_q {}, critical value {:.2f}",
            snooped.values.words,
            share,
            snooped.critical,
        ),
        classes,
        say(
            "  of {} image coordinates the model values accept {} and reject {}; {} undecided are "
            "decided exactly",
            snooped.observations,
            sum(row.accepted for row in snooped.classes),
            sum(row.rejected for row in snooped.classes),
            len(snooped.undecided),
        )
        + (say(", {} cannot be tested", snooped.untestable) if snooped.untestable else ""),
        *_list("undecided, decided exactly", snooped.undecided),
        *_list("rejected", snooped.rejected),
        judged,
        *_list("wrongly accepted", snooped.wrongly_accepted),
        *_list("wrongly rejected", snooped.wrongly_rejected),
        say("  {} exact sqrt(q_vv) lie farther than {} from their model value", snooped.beyond,
            share),
    ]  # fmt: skip
    return Document(answer, tuple(page), (classes, *lists.values()))


def _named(kind: ObservationClass) -> str:
    rays = "1 ray" if kind.rays == 1 else "4+ rays" if kind.rays == 4 else f"{kind.rays} rays"
    return f"{rays}, {'inner' if kind.inner else 'outer'}{', control' if kind.control else ''}"


def _list(title: str, rows: tuple[Decided, ...]) -> list[Block]:
    if not rows:
        return []
    lines = []
    for row in rows:
        model = "" if row.model is None else say(" in {}", row.model)
        verdict = "rejected" if row.rejected else "not testable" if row.w is None else "accepted"
        other = "" if row.rejected == row.exact else f", exact test {_word(row.exact)}"
        lines.append(
            say("    photo {}{}  point {}  {}  w {:.2f}  {}{}", row.photo, model, row.point,
                row.axis, row.w, verdict, other)
        )  # fmt: skip
    return [say("  {}:", title), Listed(tuple(lines), _MOST)]


def _word(rejected: bool) -> str:
    return "rejects" if rejected else "accepts"
