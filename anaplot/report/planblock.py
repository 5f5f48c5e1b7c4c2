"""The command `anaplot plan block`: what a block would be worth before it is flown."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import (
    block_files,
    write_control,
    write_image_points,
    write_new_block,
)
from anaplot.planning.blockplan import (
    Accuracy,
    BlockPlan,
    PlannedClass,
    WeakPhoto,
    class_table,
    expected_accuracy,
    plan_block,
    weak_photos,
)
from anaplot.planning.idealblock import IdealBlock
from anaplot.report.columns import counted
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Column,
    Document,
    Line,
    Listed,
    for_programs,
    name,
    number,
    say,
    table,
    whole,
)
from anaplot.report.output import Output
from anaplot.report.progress import ProgressLine

__all__ = ["plan_block_document", "run_plan_block", "write_planned"]

_SHOWN = 6
_BRIDGING = 2.0  # bases


def run_plan_block(options: argparse.Namespace) -> int:
    """Plan a regular block and show what is to be expected of it.

    Raises
    ------
    InputError
        The plan is impossible, or a file cannot be written.
    NotComputableError
        The plan does not determine everything.
    """
    if options.twin and options.control == "none":
        raise InputError("--twin goes with control: --control none plans none")
    if options.bridging is not None and options.control != "perimeter":
        raise InputError("--bridging goes with --control perimeter")
    outputs = () if options.to is None else block_files(options.to)
    output = Output.of(options)
    output.check({"is written": outputs}, options.to)
    plan = BlockPlan(
        strips=options.strips,
        photos=options.photos,
        overlap=options.overlap / 100.0,
        sidelap=options.sidelap / 100.0,
        side=5 if options.points == "5x5" else 3,
        control=options.control,
        bridging=_BRIDGING if options.bridging is None else options.bridging,
        twin=options.twin,
        cross_strips=options.cross_strips,
        c=options.c,
        format=options.format,
        scale=options.scale,
        image_um=options.image_um,
        control_m=options.control_m,
    )
    with ProgressLine(sys.stderr) as progress:
        progress("block", 0.0)
        made = plan_block(plan)
        block = made.evaluated("free" if plan.control == "none" else "control")
        document = plan_block_document(plan, block)
    if options.to is not None:
        write_planned(options.to, made)
    output.show(document)
    return 0


def write_planned(folder: Path, made: IdealBlock) -> None:
    """Write a planned block, its image coordinates free of error, as a new block folder.

    Raises
    ------
    InputError
        There is a block already, or it cannot be written.
    """
    write_new_block(folder, made.block)
    write_image_points(folder, made.block.image_points)
    if made.block.control:
        write_control(folder, made.block.control)


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
_WEAK = for_programs(*WeakPhoto._fields)


def plan_block_document(plan: BlockPlan, block: AdjustedBlock) -> Document:
    """Return the document of a planned block.

    Parameters
    ----------
    plan
        The plan.
    block
        Its block, evaluated.
    """
    problem, indicators = block.problem, block.indicators()
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
        "classes": [_class_json(row) for row in classes],
        "weak_photos": weak,
        "accuracy_m": None if accuracy is None else _accuracy_json(accuracy),
    }
    page: tuple[Block, ...] = (
        *_plan(plan),
        say(
            "{photos} photos, {points} points; n {observations}, u {unknowns}, "
            "redundancy {redundancy}",
            **answer,
        ),
        say("mean r: x {ri_x:.3f}, y {ri_y:.3f}, both {ri:.3f}", **answer["indicators"]),
        BLANK,
        say("CLASSES (Gruen 1980): sqrt(q_vv) in a-priori sigmas, smallest detectable error").of(
            "heading"
        ),
        by_class,
        BLANK,
        say("WEAK PHOTOS: smallest mean redundancy number first").of("heading"),
        Listed(tuple(_weak(photo) for photo in weak.records()), _SHOWN, ""),
        BLANK,
        say("EXPECTED ACCURACY of new points [m]").of("heading"),
        *_accuracy(accuracy),
    )
    return Document(answer, page, (by_class, weak))


def _plan(plan: BlockPlan) -> list[Line]:
    twin = ", twin" if plan.twin else ""
    control = {
        "perimeter": f"perimeter, bridging {counted(plan.bridging, 'base')}{twin}",
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
