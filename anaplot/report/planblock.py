"""`anaplot plan block` and its call: what a block would be worth before it is flown."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from anaplot.aliases import Progress
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Datum
from anaplot.bundle.solve.rulesofthumb import rules_of_thumb
from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import block_files, write_block
from anaplot.planning.blockplan import (
    Accuracy,
    BlockPlan,
    PlannedClass,
    class_table,
    expected_accuracy,
    plan_block,
    rays_measured,
    weak_photos,
)
from anaplot.planning.idealblock import IdealBlock
from anaplot.planning.stabilizing import (
    AddedPoint,
    StabilizingSet,
    extra_points,
    stabilizing_sets,
    weak_ones,
)
from anaplot.report.columns import counted
from anaplot.report.computed import Computed
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Column,
    Document,
    Line,
    Listed,
    name,
    number,
    say,
    table,
    whole,
)
from anaplot.report.keywords import takes_options
from anaplot.report.output import Output
from anaplot.report.pageoption import AskedPage
from anaplot.report.planarguments import add_block_arguments
from anaplot.report.rules import rules_json, rules_lines
from anaplot.report.running import computed
from anaplot.report.stabilizing import stabilizing_json, stabilizing_lines

__all__ = ["PlannedBlock", "plan_block_document", "plan_lines", "planned_block", "run_planned"]

_SHOWN = 6
_BRIDGING = 2.0  # bases
_NEAR = 0.05  # bases: two points for two photos as near as that are one


class PlannedBlock(NamedTuple):
    """A block that is planned.

    Attributes
    ----------
    plan
        What was asked for.
    made
        The block with image coordinates free of error, and the truth behind it.
    block
        Its evaluation: redundancy numbers, smallest detectable errors, standard deviations.
    stabilizing
        Points that would help the weakest of its photos most.
    added
        Points that were planned beside the standard ones; None: nothing was asked for.
    """

    plan: BlockPlan
    made: IdealBlock
    block: AdjustedBlock
    stabilizing: tuple[StabilizingSet, ...] = ()
    added: tuple[AddedPoint, ...] | None = None


@takes_options(add_block_arguments)
def planned_block(
    *,
    strips: int = 3,
    photos: int = 6,
    overlap: float = 60.0,
    sidelap: float = 30.0,
    points: Literal["3x3", "5x5"] = "3x3",
    control: Literal["perimeter", "corners", "none"] = "perimeter",
    bridging: float | tuple[float, ...] | None = None,
    twin: bool = False,
    cross_strips: int = 0,
    c: float = 150.0,
    format: float = 230.0,  # noqa: A002, as the option
    scale: float = 10_000.0,
    image_um: float = 5.0,
    control_m: float = 0.0,
    measured: Literal["stereo", "mono"] = "stereo",
    stabilize: Literal[0, 1, 2, 4, "0", "1", "2", "4"] | None = None,
    progress: Progress | None = None,
) -> Computed[PlannedBlock]:
    """Plan a regular aerial block: what is to be expected of it before it is flown.

    Parameters
    ----------
    strips, photos
        Strips, and photos in each.
    overlap, sidelap
        Along and across the strips [percent].
    points
        Of a photo.
    control
        Where it stands.
    bridging
        Bases from control to control; None: 2. Of several `block_series` puts the blocks side by
        side.
    twin
        Full control in pairs.
    cross_strips
        Strips flown across.
    c, format
        Camera constant and side of the format [mm].
    scale
        Denominator of the photo scale.
    image_um
        A-priori sigma0 [um].
    control_m
        Standard deviation of control [m]; 0: free of error.
    measured
        "stereo": a ray in every model that shows it; "mono": once.
    stabilize
        How many points more to plan for every weak photo; None: none, they are only named;
        0: they are not looked for.
    progress
        Called with what is being done and the fraction of it (0 to 1).

    Raises
    ------
    InputError
        The plan is impossible.
    NotComputableError
        The plan does not determine everything.
    """
    if twin and control == "none":
        raise InputError("--twin goes with control: --control none plans none")
    if isinstance(bridging, tuple):
        if len(bridging) != 1:
            raise InputError("--bridging: one distance for one block")
        (bridging,) = bridging
    if bridging is not None and control != "perimeter":
        raise InputError("--bridging goes with --control perimeter")
    plan = BlockPlan(
        strips=strips,
        photos=photos,
        overlap=overlap / 100.0,
        sidelap=sidelap / 100.0,
        side=5 if points == "5x5" else 3,
        control=control,
        bridging=_BRIDGING if bridging is None else bridging,
        twin=twin,
        cross_strips=cross_strips,
        c=c,
        format=format,
        scale=scale,
        image_um=image_um,
        control_m=control_m,
        stereo=measured == "stereo",
    )
    if progress is not None:
        progress("block", 0.0)
    made = plan_block(plan)
    block = _evaluated(plan, made)
    added = None
    many = None if stabilize is None else int(stabilize)
    if many:
        sets = _stabilizing(plan, made, block)
        added = extra_points(sets, many, _NEAR * plan.base)
        made = plan_block(plan, {point.name: point.place for point in added})
        block = _evaluated(plan, made)
    sets = _stabilizing(plan, made, block, _SHOWN) if many != 0 else ()
    found = PlannedBlock(plan, made, block, sets, added)
    return Computed(found, plan_block_document(found))


def _evaluated(plan: BlockPlan, made: IdealBlock) -> AdjustedBlock:
    """Return what a block is worth.

    Raises
    ------
    NotComputableError
        It is not determined; the message says what would hold strips that turn.
    """
    datum: Datum = "free" if plan.control == "none" else "control"
    try:
        return made.evaluated(datum)
    except NotComputableError as error:
        if not plan.turns:
            raise
        raise NotComputableError(
            f"{error}: below 50 % side lap one line of points joins two strips, and they turn about"
            " it; control perimeter, a cross strip or a side lap from 50 % holds them"
        ) from error


def _stabilizing(
    plan: BlockPlan, made: IdealBlock, block: AdjustedBlock, most: int | None = None
) -> tuple[StabilizingSet, ...]:
    return stabilizing_sets(block, weak_ones(block)[:most], rays_measured(plan, made))


class _Planned(Protocol):
    """What has an error-free block."""

    @property
    def made(self) -> IdealBlock: ...


def run_planned(
    options: argparse.Namespace,
    compute: Callable[..., Computed[_Planned]],
    page: AskedPage,
    reads: Iterable[Path] = (),
) -> int:
    """Plan a block or a network, write it where that is asked for, and show what is to be expected.

    Parameters
    ----------
    options
        Of the command line.
    compute
        Plans it.
    page
        That `--report` writes.
    reads
        The files that it reads.

    Raises
    ------
    AnaplotError
        The plan is impossible or determines too little, or a file cannot be written.
    """
    outputs = () if options.to is None else block_files(options.to)
    output = Output.of(options)
    uses = {"is read": reads, "is written": outputs, **page.uses}
    output.check(uses, options.to)
    found = computed(options, compute)
    if options.to is not None:
        # its image coordinates are free of error
        write_block(options.to, found.result.made.block)
    output.show(page.shown(found))
    return 0


_CLASSES = (
    Column("rays", "rays", 4, form=lambda rays: "4+" if rays >= 4 else str(rays), align="<"),
    name("ray", "ray", 5),
    name("point", "point", 7, form=lambda point: "-" if point == "new" else point),
    name("axis", "axis"),
    whole("number", "number", 7),
    number("mean_root", "mean", 2, 6),
    number("least", "least", 2, 6),
    number("most", "most", 2, 6),
    number("mean_r", "mean r", 3, 7),
    number("mdb_um", "MDB um", 1, 9, unit="um"),
    Column("untestable", "untestable", 11, form=lambda count: str(count or "")),
)
_WEAK = (
    name("photo", "PHOTO", 5),
    whole("rays", "RAYS", 6),
    number("mean_r", "mean r", 3, 8),
    number("low_r", "least", 3, 7),
    name("point", "AT POINT", 8),
    name("axis", gap=1),
)


def plan_block_document(found: PlannedBlock) -> Document:
    """Return the document of a planned block."""
    plan, block = found.plan, found.block
    problem, indicators, rules = block.problem, block.indicators(), rules_of_thumb(block)
    classes, accuracy = class_table(block), expected_accuracy(block)
    rows = ((row.kind.rays, "inner" if row.kind.inner else "outer",
             "control" if row.kind.control else "new", row.kind.axis, *row[1:])
            for row in classes)  # fmt: skip
    by_class = table("classes", _CLASSES, rows)
    weak = table("weak_photos", _WEAK, weak_photos(block))
    answer: Answer = {
        "photos": len(problem.photos),
        "points": len(problem.points),
        "observations": problem.observations,
        "unknowns": problem.unknowns,
        "redundancy": block.redundancy,
        "indicators": indicators._asdict(),
        "rules": rules_json(rules),
        "classes": [_class_json(row) for row in classes],
        "weak_photos": weak,
        "accuracy_m": None if accuracy is None else _accuracy_json(accuracy),
        "stabilizing": stabilizing_json(found.stabilizing),
        "added_points": None if found.added is None else [one._asdict() for one in found.added],
    }
    page: tuple[Block, ...] = (
        *plan_lines(plan),
        say(
            "{photos} photos, {points} points; n {observations}, u {unknowns}, "
            "redundancy {redundancy}",
            **answer,
        ),
        say("mean r: x {ri_x:.3f}, y {ri_y:.3f}, both {ri:.3f}", **answer["indicators"]),
        *rules_lines(rules),
        BLANK,
        say("CLASSES (Gruen 1980): sqrt(q_vv) in a-priori sigmas, smallest detectable error").of(
            "heading"
        ),
        by_class,
        BLANK,
        say("WEAK PHOTOS: smallest mean redundancy number first").of("heading"),
        Listed(tuple(_weak(photo) for photo in weak.records()), _SHOWN, ""),
        *stabilizing_lines(found.stabilizing, found.added),
        BLANK,
        say("EXPECTED ACCURACY of new points [m]").of("heading"),
        *_accuracy(accuracy),
    )
    return Document(answer, page, (by_class, weak))


def plan_lines(plan: BlockPlan, bridging: Sequence[float] = ()) -> list[Line]:
    """Say what is planned: strips, distances, control; also at several bridging distances."""
    twin = ", twin" if plan.twin else ""
    distances = counted(plan.bridging, "base")
    if len(bridging) > 1:
        distances = f"{', '.join(f'{one:g}' for one in bridging)} bases"
    control = {
        "perimeter": f"perimeter, bridging {distances}{twin}",
        "corners": f"corners{twin}",
        "none": "none: a free network",
    }
    return [
        say(
            "PLANNED BLOCK: {} of {} photos{}, {:g} / {:g} %, {side} x {side} points",
            counted(plan.strips, "strip"),
            plan.photos,
            say(", {} across", plan.cross_strips) if plan.cross_strips else say(""),
            100 * plan.overlap,
            100 * plan.sidelap,
            side=plan.side,
        ).of("heading"),
        say("base {:.1f} m, strips {:.1f} m apart, 1 : {:g}, c {:g} mm", plan.base, plan.spacing,
            plan.scale, plan.c),
        say("control {}", control[plan.control]),
        *([] if plan.stereo else [say("every ray is measured once, as in a comparator")]),
    ]  # fmt: skip


def _weak(photo: Answer) -> Line:
    return say(
        "  {photo:<6} {rays:>3} rays  mean r {mean_r:.3f}  least {low_r:.3f} "
        "(point {point} {axis})",
        **photo,
    )


def _accuracy(found: Accuracy | None) -> list[Line]:
    if found is None:
        return [say("  every point is control")]
    return [
        say("           X        Y        Z"),
        say("  rms    {:.4f}  {:.4f}  {:.4f}", *found.rms),
        say("  worst  {:.4f}  {:.4f}  {:.4f}", *found.largest),
        say("  there  {:<6}  {:<6}  {}", *found.points),
    ]


def _class_json(row: PlannedClass) -> Answer:
    figures = row._asdict()
    return {**figures.pop("kind")._asdict(), **figures}


def _accuracy_json(found: Accuracy) -> Answer:
    return {"rms": found.rms, "largest": found.largest, "largest_at": found.points}
