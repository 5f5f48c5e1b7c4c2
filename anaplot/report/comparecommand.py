"""The command `anaplot compare`: two epochs in, displacements out."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from anaplot.bundle.epochs.displacements import compare_epochs
from anaplot.bundle.epochs.displacementtests import EpochTests, Located, PointMove, epoch_tests
from anaplot.bundle.hypotheses.verdict import Verdict
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files, read_block
from anaplot.report.columns import cell, column
from anaplot.report.csvoutput import check_csv, write_csv
from anaplot.report.hypotheses import probability, verdict_json
from anaplot.report.power import check_power
from anaplot.report.progress import ProgressLine
from anaplot.textfiles.wording import plain

__all__ = ["compare_json", "compare_printout", "run_compare"]

Json = dict[str, Any]

_LISTED = 12


def _names(text: str | None) -> tuple[str, ...]:
    return () if text is None else tuple(n for n in (p.strip() for p in text.split(",")) if n)


def run_compare(options: argparse.Namespace) -> int:
    """Compare two block folders and print the result.

    Returns
    -------
    int
        0, or 1 with `--fail-on-flag` when something has moved, all tests together at `--alpha`.

    Raises
    ------
    AnaplotError
        Bad input or epochs that cannot be compared; nothing is printed then.
    """
    for option, text in (("--stable", options.stable), ("--points", options.points)):
        if text is not None and not _names(text):
            raise InputError(f"{option}: no point is named")
    if options.additional is None and options.additional_sigma_um is not None:
        raise InputError("--additional-sigma-um goes with --additional")
    additional = None
    if options.additional is not None:
        additional = additional_parameters(options.additional, options.additional_sigma_um)
    inputs = (*block_files(options.first), *block_files(options.second))
    check_csv(options.csv, {"is read": inputs})
    first, second = read_block(options.first), read_block(options.second)
    check_power("--alpha", options.alpha, first.test, options.first)
    with ProgressLine(sys.stderr) as progress:
        found = compare_epochs(
            first,
            second,
            separate=options.separate,
            additional=additional,
            common_parameters=options.common_parameters,
            stable=_names(options.stable),
            points=_names(options.points),
            progress=progress,
        )
        tested = epoch_tests(found, alpha=options.alpha)
    if options.csv is not None:
        _write_csv(options.csv, tested)
    if options.json:
        print(json.dumps(compare_json(tested), indent=1, allow_nan=False))
    else:
        print(compare_printout(tested))
    return 1 if options.fail_on_flag and tested.any_moved else 0


def _write_csv(path: Path, found: EpochTests) -> None:
    write_csv(
        path,
        ("point", "X", "Y", "Z", "dX", "dY", "dZ", "sX", "sY", "sZ", "length", "s_length",
         "P", "moved_bonferroni", "moved_scheffe"),
        (_csv_row(p) for p in found.points),
    )  # fmt: skip


def _csv_row(p: PointMove) -> tuple[object, ...]:
    test = None if p.verdict is None else p.verdict.decisive
    return (
        p.point,
        *p.place,
        *(c.d for c in p.coordinates),
        *(c.s for c in p.coordinates),
        p.length,
        p.s_length,
        None if test is None else test.significance,
        *(None if m is None else int(m) for m in (_moved(p.verdict), p.scheffe)),
    )


def _moved(verdict: Verdict | None) -> bool | None:
    return None if verdict is None else verdict.rejected


def compare_json(found: EpochTests) -> Json:
    """Return what `--json` prints: lengths in metres, what does not exist is None."""
    differences = found.differences
    redundancy = differences.redundancy
    sigma0 = (differences.vtpv / redundancy) ** 0.5 if redundancy > 0 else None
    return {
        "epochs": list(differences.epochs),
        "adjustment": "joint" if differences.joint else "separate",
        "datum": differences.datum,
        "common_points": list(differences.common),
        "common_coordinates": [{"point": n, "axes": axes} for n, axes in differences.partly],
        "common_parameters": None
        if differences.own_parameters is None
        else not differences.own_parameters,
        "redundancy": redundancy,
        "sigma0": sigma0,
        "alpha": found.alpha,
        "power": found.power,
        "variance_ratio": None if found.variance is None else found.variance._asdict(),
        "all": verdict_json(found.everything),
        "agreement": verdict_json(found.agreement),
        "overall": _overall_json(found),
        "located": [step._asdict() for step in found.located],
        "points": [_point_json(p) for p in found.points],
        "only_first": list(differences.only_first),
        "only_second": list(differences.only_second),
        "located_stable": [step._asdict() for step in found.located_stable],
        "flagged": list(differences.flagged),
        "remarks": list(found.remarks),
    }


def _overall_json(found: EpochTests) -> Json | None:
    overall = found.overall
    if overall is None:
        return None
    return {**overall._asdict(), "families": list(overall.families), "rejected": overall.rejected}


def _point_json(p: PointMove) -> Json:
    return {
        "point": p.point,
        **dict(zip("XYZ", p.place, strict=True)),
        "length": p.length,
        "s_length": p.s_length,
        "bonferroni": verdict_json(p.verdict),
        "scheffe": p.scheffe,
        "coordinates": [
            {
                "axis": c.axis,
                "d": c.d,
                "s": c.s,
                "given": c.given,
                "bonferroni": verdict_json(c.verdict),
                "scheffe": c.scheffe,
                "half_bonferroni": c.half_bonferroni,
                "half_scheffe": c.half_scheffe,
                "detectable": c.detectable,
            }
            for c in p.coordinates
        ],
    }


def _line(label: str, verdict: Verdict | None) -> str:
    test = None if verdict is None else verdict.decisive
    if test is None:
        return f"  {label:<34}  not testable"
    degrees = "known" if test.redundancy is None else str(test.redundancy)
    end = "  << REJECTED" if test.rejected else "  accepted"
    return (
        f"  {label:<34}{column(test.dimension, 5)}{column(degrees, 7)}"
        f"{cell(test.statistic, 3, 10)}{cell(test.critical, 3, 10)}"
        f"{column(probability(test.significance), 9)}{end}"
    )


def _mm(value: float | None) -> str:
    return cell(None if value is None else value * 1e3, 2, 9)


def _few(names: tuple[str, ...]) -> str:
    text = ", ".join(plain(n) for n in names[:_LISTED])
    return text + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")


def compare_printout(found: EpochTests) -> str:
    """Return the report: displacements in millimetres."""
    of = found.differences
    sigma0 = (
        f"sigma0 {(of.vtpv / of.redundancy) ** 0.5:.3f}" if of.redundancy > 0 else "no redundancy"
    )
    lines = [
        f"COMPARE  {plain(of.epochs[0])} (1) and {plain(of.epochs[1])} (2), "
        f"{'adjusted jointly' if of.joint else 'adjusted separately'}, redundancy "
        f"{of.redundancy}, {sigma0}; tests with "
        f"{'the a-priori sigma0' if of.by_known else 'the estimated sigma0'}"
    ]
    what = "control" if of.datum == "control" else "stable points"
    common = (*of.common, *(f"{name} in {' and '.join(axes)}" for name, axes in of.partly))
    if common:
        lines.append(f"  common {what}: {_few(common)}")
    if of.own_parameters is not None:
        lines.append(
            "  additional parameters: "
            + ("each epoch its own" if of.own_parameters else "common to both epochs")
        )
    for number, names in ((1, of.only_first), (2, of.only_second)):
        if names:
            lines.append(f"  in epoch {number} alone: {_few(names)}")
    lines += [f"  note: {plain(remark)}" for remark in found.remarks]
    if found.variance is not None:
        lines.append(
            f"  variance of epoch 1 over epoch 2: {found.variance.ratio:.3f}, "
            f"P {probability(found.variance.significance)}"
            + ("  << THEY DIFFER" if found.variance.significance < found.alpha else "")
        )
    lines += ["", f"  {'HYPOTHESIS':<34}    b      f         T  critical        P"]
    lines.append(_line("no point has moved", found.everything))
    lines += _explained(found.located)
    if found.agreement is not None:
        lines.append(_line("the stable points have not moved", found.agreement))
        lines += _explained(found.located_stable)
    width = max(5, *(len(plain(p.point)) for p in found.points))
    lines += [
        "",
        f"  {'POINT':<{width}}  dX [mm]  dY [mm]  dZ [mm]       sX       sY       sZ   length"
        "        s        P",
    ]
    for p in found.points:
        test = None if p.verdict is None else p.verdict.decisive
        lines.append(
            f"  {plain(p.point):<{width}}"
            + "".join(column("given", 9) if c.given else _mm(c.d) for c in p.coordinates)
            + "".join(_mm(c.s) for c in p.coordinates)
            + _mm(p.length)
            + _mm(p.s_length)
            + column("-" if test is None else probability(test.significance), 9)
            + _marks(p)
        )
    points = f"all {len(found.points)} points" if len(found.points) > 1 else "the point"
    lines += [
        "  P of each point by itself; marked (B Bonferroni, S Scheffe) what exceeds the limit for",
        f"  {points}, or all coordinates, together at alpha {found.alpha:g}",
        *_conclusion(found),
    ]
    return "\n".join(lines)


def _conclusion(found: EpochTests) -> list[str]:
    """Return the one verdict that `--fail-on-flag` goes by."""
    overall = found.overall
    if overall is None:
        return []
    count = len(overall.families)
    if count > 1:
        families = f"{count} families ({', '.join(overall.families)}) together at"
    else:
        families = f"{overall.families[0]} at"
    return [
        "",
        f"  ANYTHING MOVED: {'yes' if overall.rejected else 'no'}, P "
        f"{probability(overall.significance)}; {families} alpha {overall.alpha:g}",
    ]


def _explained(located: tuple[Located, ...]) -> list[str]:
    if not located:
        return []
    names = _few(tuple(step.point for step in located))
    return [f"  explain it, one after the other until the rest is accepted: {names}"]


def _marks(p: PointMove) -> str:
    """Name the point's and its coordinates' verdicts."""

    def letters(bonferroni: bool | None, scheffe: bool | None) -> str:
        return ("B" if bonferroni else "") + ("S" if scheffe else "")

    own = letters(_moved(p.verdict), p.scheffe)
    single = [
        f"{c.axis} {found}"
        for c in p.coordinates
        if (found := letters(_moved(c.verdict), c.scheffe))
    ]
    parts = ([f"MOVED {own}"] if own else []) + single
    return f"  << {', '.join(parts)}" if parts else ""
