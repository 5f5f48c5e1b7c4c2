"""The command `anaplot plan network`: camera stations around an object, and what they see."""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from anaplot.bundle.adjusted import AdjustedBlock
from anaplot.errors import InputError
from anaplot.exchange.networkfile import NetworkFile, read_network
from anaplot.exchange.wording import quoted
from anaplot.photogrammetry.block import ControlPoint
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.idealblock import IdealBlock, Station
from anaplot.planning.networkplan import (
    Network,
    PointWorth,
    cube,
    looking_at,
    photo_worth,
    plan_network,
    point_worth,
)
from anaplot.report.correlations import (
    RayPair,
    correlated_rays,
    correlations_json,
    correlations_printout,
)
from anaplot.report.planblock import write_planned
from anaplot.report.printable import printable
from anaplot.report.progress import ProgressLine

__all__ = ["network_from_file", "run_plan_network"]

_FEW = 3  # with two rays one coordinate of each is checked by nothing, or next to nothing
_SHOWN, _NAMED = 12, 20


def run_plan_network(options: argparse.Namespace) -> int:
    """Plan a network and show what is to be expected of it.

    Raises
    ------
    InputError
        The network's name or file is wrong, or a file cannot be written.
    NotComputableError
        The stations do not determine the points.
    """
    network = _network(options)
    with ProgressLine(sys.stderr) as progress:
        progress("network", 0.0)
        made = plan_network(network)
        block = made.evaluated("control" if network.control else "free")
        points, photos = point_worth(block), photo_worth(block)
        pairs = correlated_rays(block, options.correlations)
    if options.to is not None:
        write_planned(options.to, made)
    if options.csv is not None:
        _write_csv(options.csv, points, photos)
    seen = _rays(made)
    if options.json:
        answer = _json(made, block, points, photos, pairs, seen)
        if options.point is not None:
            answer["point"] = _point_json(block, options.point)
        print(json.dumps(answer, indent=1, allow_nan=False))
        return 0
    print("\n".join(_lines(network, block, points, photos, seen)))
    print("\n" + _shortened(correlations_printout(pairs, options.correlations)))
    if options.point is not None:
        print("\n" + "\n".join(_point_lines(block, options.point)))
    return 0


def _network(options: argparse.Namespace) -> Network:
    if options.network == "cube":
        return cube(options.case or "A", options.image_um or 5.0)
    path = Path(options.network)
    if path.suffix.lower() != ".toml" and not path.exists():
        raise InputError(f"no network is called {quoted(options.network)}: cube, or a .toml file")
    if options.case is not None:
        raise InputError("--case goes with the cube")
    if options.image_um is not None:
        raise InputError("--image-um goes with the cube; a file says itself what it measures with")
    return network_from_file(read_network(path))


def network_from_file(found: NetworkFile) -> Network:
    """Return the network that a file declares."""
    stations = {}
    for entry in found.stations:
        if entry.rotation is not None:
            rotation = rotation_matrix(*entry.rotation)
        else:
            assert entry.look_at is not None
            rotation = looking_at(entry.position, entry.look_at, entry.roll)
        stations[entry.id] = Station(np.array(entry.position), rotation, entry.camera)
    return Network(
        found.name,
        found.cameras,
        stations,
        {point.id: np.array(point.position) for point in found.points},
        tuple(
            ControlPoint(point.id, point.position, (point.control,) * 3)
            for point in found.points
            if point.control is not None
        ),
        {point.id: np.array(point.normal) for point in found.points if point.normal is not None},
        found.incidence_deg,
        found.image_um,
    )


def _rays(made: IdealBlock) -> dict[str, int]:
    count = dict.fromkeys(made.points, 0)
    for row in made.block.image_points:
        count[row.point] += 1
    return count


def _lines(
    network: Network,
    block: AdjustedBlock,
    points: tuple[PointWorth, ...],
    photos: tuple[PointWorth, ...],
    seen: dict[str, int],
) -> list[str]:
    problem, got = block.problem, block.indicators()
    millimetres = [1e3 * value for value in (got.ai_x, got.ai_y, got.ai_z, got.ai)]
    lines = [
        f"PLANNED NETWORK {printable(network.name)}: {len(network.stations)} stations, "
        f"{len(network.points)} points, {len(network.control)} of them control",
        f"n {problem.observations}, u {problem.unknowns}, redundancy {block.redundancy}; "
        f"a-priori sigma0 {network.image_um:g} um",
        f"RI (mean r)         x' {got.ri_x:.3f}   y' {got.ri_y:.3f}   both {got.ri:.3f}",
        "AI (mean deviation)  X {:.3f}   Y {:.3f}   Z {:.3f}   all {:.3f} mm".format(*millimetres),
    ]
    if not network.control:
        lines.append("no control: a free network")
    lines += ["", "PHOTOS, the one with the weakest observation first", _head("PHOTO", "POINT")]
    lines += [_row(worth) for worth in photos[:_SHOWN]] + _more(len(photos))
    lines += ["", "POINTS, the one with the weakest observation first",
              _head("POINT", "PHOTO") + "      sX      sY      sZ mm"]  # fmt: skip
    lines += [_row(worth) + _deviations(worth) for worth in points[:_SHOWN]] + _more(len(points))
    lines += ["", *_few(seen)]
    spurs = block.spurs()
    if spurs:
        names = [f"{printable(point)} {axis} in {printable(photo)}" for photo, point, axis in spurs]
        lines += ["", f"SPUR OBSERVATIONS: next to nothing checks these {len(spurs)}"]
        lines += [f"  {', '.join(names[k : k + 5])}" for k in range(0, min(len(names), 20), 5)]
        lines += [f"  and {len(names) - 20} more"] if len(names) > 20 else []
    return lines


def _few(seen: dict[str, int]) -> list[str]:
    """Return which points are seen in too few photos."""
    lines = []
    for count in range(_FEW):
        names = [printable(name) for name, rays in seen.items() if rays == count]
        if names:
            more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
            photos = "1 photo" if count == 1 else f"{count or 'no'} photos"
            lines.append(f"  {photos}: {', '.join(names[:_NAMED])}{more}")
    if not lines:
        return [f"every point is seen in {_FEW} photos or more"]
    return [f"SEEN IN FEWER THAN {_FEW} PHOTOS", *lines]


def _more(count: int) -> list[str]:
    return [f"  and {count - _SHOWN} more"] if count > _SHOWN else []


def _shortened(text: str) -> str:
    lines = text.splitlines()
    most = 2 * _SHOWN
    return "\n".join(lines[: most + 1] + ([f"  and {len(lines) - 1 - most} more"]
                                          if len(lines) - 1 > most else []))  # fmt: skip


def _head(first: str, other: str) -> str:
    return f"  {first:<10} RAYS  mean r   least  AT {other:<10} AXIS    MDB um"


def _row(worth: PointWorth) -> str:
    mdb = "-" if worth.mdb_um is None else f"{worth.mdb_um:.1f}"
    return (
        f"  {printable(worth.name):<10} {worth.rays:>4}  {worth.mean_r:>6.3f}  {worth.low_r:>6.3f}"
        f"     {printable(worth.weakest):<10} {worth.axis:<4} {mdb:>9}"
    )


def _deviations(worth: PointWorth) -> str:
    values = worth.s_xyz or (None, None, None)
    return "".join(f" {'-' if v is None else format(1e3 * v, '.3f'):>7}" for v in values)


def _point_lines(block: AdjustedBlock, point: str) -> list[str]:
    labels, rho = _point(block, point)
    lines = [f"POINT {printable(point)}: correlations of its residuals, and what is detectable"]
    names = [f"{printable(photo)} {axis}" for photo, _, axis in labels]
    width = max(7, *(len(name) + 1 for name in names))
    lines.append(" " * (width + 2) + "".join(f"{name:>{width}}" for name in names) + "   MDB um")
    mdb = {
        (row.photo, axis): value
        for row in block.ray_rows()
        if row.point == point
        for axis, value in zip("xy", row.mdb_um, strict=True)
    }
    for name, (photo, _, axis), values in zip(names, labels, rho, strict=True):
        cells = "".join(f"{'-' if np.isnan(v) else format(v, '.3f'):>{width}}" for v in values)
        size = mdb[photo, axis]
        lines.append(f"  {name:<{width}}{cells}{'-' if size is None else format(size, '.1f'):>9}")
    return lines


def _point(block: AdjustedBlock, point: str) -> tuple[list[tuple[str, str | None, str]], Any]:
    if point not in block.problem.points:
        raise InputError(f"no point {quoted(point)} is seen in this network")
    return block.point_correlations(point)


def _point_json(block: AdjustedBlock, point: str) -> dict[str, Any]:
    labels, rho = _point(block, point)
    return {
        "point": point,
        "coordinates": [{"photo": photo, "axis": axis} for photo, _, axis in labels],
        "correlations": [[None if np.isnan(v) else float(v) for v in row] for row in rho],
    }


def _json(
    made: IdealBlock,
    block: AdjustedBlock,
    points: tuple[PointWorth, ...],
    photos: tuple[PointWorth, ...],
    pairs: tuple[RayPair, ...],
    seen: dict[str, int],
) -> dict[str, Any]:
    problem = block.problem
    return {
        "name": made.block.name,
        "observations": problem.observations,
        "unknowns": problem.unknowns,
        "redundancy": block.redundancy,
        "indicators": block.indicators()._asdict(),
        "points": [_worth_json(worth) for worth in points],
        "photos": [_worth_json(worth) for worth in photos],
        "rays": seen,
        "spurs": [{"photo": f, "point": p, "axis": a} for f, p, a in block.spurs()],
        "correlations": correlations_json(pairs),
    }


def _worth_json(worth: PointWorth) -> dict[str, Any]:
    found = worth._asdict()
    found["s_m"] = found.pop("s_xyz")
    return found


def _write_csv(path: Path, points: Iterable[PointWorth], photos: Iterable[PointWorth]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ("kind", "name", "rays", "mean_r", "least_r", "weakest", "axis", "mdb_um", "sX", "sY",
             "sZ")
        )  # fmt: skip
        for kind, worths in (("point", points), ("photo", photos)):
            for worth in worths:
                values = (*worth[:7], *(worth.s_xyz or (None, None, None)))
                writer.writerow((kind, *("" if value is None else value for value in values)))
