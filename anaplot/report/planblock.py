"""The command `anaplot plan block`: what a block would be worth before it is flown."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

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
from anaplot.report.columns import counted, fitted
from anaplot.report.csvoutput import check_csv, write_csv
from anaplot.report.progress import ProgressLine

__all__ = ["run_plan_block", "write_planned"]

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
    check_csv(options.csv, {"is written": outputs}, options.to)
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
        classes, weak, accuracy = class_table(block), weak_photos(block), expected_accuracy(block)
    if options.to is not None:
        write_planned(options.to, made)
    if options.csv is not None:
        _write_csv(options.csv, classes)
    if options.json:
        print(json.dumps(_json(block, classes, weak, accuracy), indent=1, allow_nan=False))
    else:
        print("\n".join(_lines(plan, block, classes, weak, accuracy)))
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


def _kind(row: PlannedClass) -> str:
    rays = "4+" if row.kind.rays >= 4 else str(row.kind.rays)
    control = "control" if row.kind.control else "-"
    return f"{rays:<4}  {'inner' if row.kind.inner else 'outer':<5}  {control:<7}  {row.kind.axis}"


def _lines(
    plan: BlockPlan,
    block: AdjustedBlock,
    classes: tuple[PlannedClass, ...],
    weak: tuple[WeakPhoto, ...],
    accuracy: Accuracy | None,
) -> list[str]:
    problem = block.problem
    twin = ", twin" if plan.twin else ""
    cross = f", {plan.cross_strips} across" if plan.cross_strips else ""
    control = {
        "perimeter": f"perimeter, bridging {counted(plan.bridging, 'base')}{twin}",
        "corners": f"corners{twin}",
        "none": "none: a free network",
    }[plan.control]
    lines = [
        f"PLANNED BLOCK: {counted(plan.strips, 'strip')} of {plan.photos} photos{cross}, "
        f"{100 * plan.overlap:g} / {100 * plan.sidelap:g} %, {plan.side} x {plan.side} points",
        f"base {plan.base:.1f} m, strips {plan.spacing:.1f} m apart, 1 : {plan.scale:g}, "
        f"c {plan.c:g} mm",
        f"control {control}",
        f"{len(problem.photos)} photos, {len(problem.points)} points; "
        f"n {problem.observations}, u {problem.unknowns}, redundancy {block.redundancy}",
    ]
    got = block.indicators()
    lines += [
        f"mean r: x {got.ri_x:.3f}, y {got.ri_y:.3f}, both {got.ri:.3f}",
        "",
        "CLASSES (Gruen 1980): sqrt(q_vv) in a-priori sigmas, smallest detectable error",
        "  rays  ray    point    axis number  mean least  most mean r   MDB um untestable",
    ]
    for row in classes:
        mdb = fitted(row.mdb_um, 1, 8)
        line = (
            f"  {_kind(row)}   {row.number:>7} {row.mean:>5.2f} {row.low:>5.2f} "
            f"{row.high:>5.2f} {row.r:>6.3f} {mdb:>8} {row.untestable or '':>10}"
        )
        lines.append(line.rstrip())
    lines += ["", "WEAK PHOTOS: smallest mean redundancy number first"]
    lines += [
        f"  {photo.photo:<6} {photo.rays:>3} rays  mean r {photo.mean_r:.3f}  "
        f"least {photo.low_r:.3f} (point {photo.point} {photo.axis})"
        for photo in weak[:_SHOWN]
    ]
    lines += ["", "EXPECTED ACCURACY of new points [m]"]
    if accuracy is None:
        lines.append("  every point is control")
    else:
        lines.append("           X        Y        Z")
        lines.append("  rms    " + "  ".join(f"{value:.4f}" for value in accuracy.rms))
        lines.append("  worst  " + "  ".join(f"{value:.4f}" for value in accuracy.largest))
        lines.append("  there  " + "  ".join(f"{name:<6}" for name in accuracy.points).rstrip())
    return lines


def _json(
    block: AdjustedBlock,
    classes: tuple[PlannedClass, ...],
    weak: tuple[WeakPhoto, ...],
    accuracy: Accuracy | None,
) -> dict[str, Any]:
    problem, got = block.problem, block.indicators()
    return {
        "photos": len(problem.photos),
        "points": len(problem.points),
        "observations": problem.observations,
        "unknowns": problem.unknowns,
        "redundancy": block.redundancy,
        "indicators": got._asdict(),
        "classes": [{**row.kind._asdict(), **_without_kind(row)} for row in classes],
        "weak_photos": [photo._asdict() for photo in weak],
        "accuracy_m": None
        if accuracy is None
        else {
            "rms": list(accuracy.rms),
            "largest": list(accuracy.largest),
            "largest_at": list(accuracy.points),
        },
    }


def _without_kind(row: PlannedClass) -> dict[str, Any]:
    found = row._asdict()
    del found["kind"]
    return found


def _write_csv(path: Path, classes: tuple[PlannedClass, ...]) -> None:
    write_csv(
        path,
        ("rays", "ray", "point", "axis", "number", "mean_root", "least", "most", "mean_r",
         "mdb_um", "untestable"),
        (
            (
                row.kind.rays,
                "inner" if row.kind.inner else "outer",
                "control" if row.kind.control else "new",
                row.kind.axis,
                *row[1:],
            )
            for row in classes
        ),
    )  # fmt: skip
