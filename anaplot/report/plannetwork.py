"""The command `anaplot plan network`: camera stations around an object, and what they see."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import block_files
from anaplot.exchange.networkfile import NetworkFile, read_network
from anaplot.photogrammetry.block import ControlPoint
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.idealblock import ExposureStation, IdealBlock
from anaplot.planning.networkplan import (
    Network,
    NetworkReliability,
    cube,
    looking_at,
    network_reliability,
    plan_network,
)
from anaplot.planning.plannedreliability import PlannedReliability
from anaplot.report.astext import page_text
from anaplot.report.correlations import (
    correlated_rays,
    correlations_document,
)
from anaplot.report.csvoutput import check_csv, write_csv
from anaplot.report.document import Document
from anaplot.report.networktext import network_lines, point_lines
from anaplot.report.planblock import write_planned
from anaplot.report.progress import ProgressLine
from anaplot.textfiles.wording import quoted

__all__ = ["network_from_file", "run_plan_network"]

_CUBE = "cube"
_CORRELATED = 24  # pairs that are shown


def run_plan_network(options: argparse.Namespace) -> int:
    """Plan a network and show what is to be expected of it.

    Raises
    ------
    InputError
        The network's name or file is wrong, or a file cannot be written.
    NotComputableError
        The stations do not determine the points.
    """
    inputs = () if options.network == _CUBE else (Path(options.network),)
    outputs = () if options.to is None else block_files(options.to)
    check_csv(options.csv, {"is read": inputs, "is written": outputs}, options.to)
    network = _network(options)
    if options.point is not None and options.point not in network.points:
        raise InputError(f"no point {quoted(options.point)} is seen in this network")
    with ProgressLine(sys.stderr) as progress:
        progress("network", 0.0)
        made = plan_network(network)
        block = made.evaluated("control" if network.control else "free")
        worth = network_reliability(network, made, block)
        pairs = correlated_rays(block, options.correlations)
    if options.point is not None and options.point not in block.problem.points:
        raise InputError(f"point {quoted(options.point)} is not determined in this network")
    if options.to is not None:
        write_planned(options.to, made)
    if options.csv is not None:
        _write_csv(options.csv, worth)
    related = correlations_document(
        pairs, options.correlations, most=_CORRELATED, more="  and {} more"
    )
    if options.json:
        answer = _json(made, block, worth, related)
        if options.point is not None:
            answer["point"] = _point_json(block, options.point)
        print(json.dumps(answer, indent=1, allow_nan=False))
        return 0
    print("\n".join(network_lines(network, block, worth)))
    print("\n" + page_text(related.page))
    if options.point is not None:
        print("\n" + "\n".join(point_lines(block, options.point)))
    return 0


def _network(options: argparse.Namespace) -> Network:
    if options.network == _CUBE:
        return cube(options.case or "A", options.image_um or 5.0)
    path = Path(options.network)
    if path.suffix.lower() != ".toml" and not os.path.lexists(path):
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
        stations[entry.id] = ExposureStation(np.array(entry.position), rotation, entry.camera)
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


def _point_json(block: AdjustedBlock, point: str) -> dict[str, Any]:
    labels, rho = block.point_correlations(point)
    return {
        "point": point,
        "coordinates": [{"photo": photo, "axis": axis} for photo, _, axis in labels],
        "correlations": [[None if np.isnan(v) else float(v) for v in row] for row in rho],
    }


def _json(
    made: IdealBlock,
    block: AdjustedBlock,
    worth: NetworkReliability,
    related: Document,
) -> dict[str, Any]:
    problem = block.problem
    return {
        "name": made.block.name,
        "observations": problem.observations,
        "unknowns": problem.unknowns,
        "redundancy": block.redundancy,
        "indicators": block.indicators()._asdict(),
        "new_points": {
            "determined": worth.new_determined,
            "mean_s_m": None if worth.new_s is None else list(worth.new_s),
            "not_determined": list(worth.not_determined),
        },
        "unused_photos": list(worth.unused_photos),
        "unused_control": list(worth.unused_control),
        "points": [_worth_json(one) for one in worth.points],
        "photos": [_worth_json(one) for one in worth.photos],
        "rays": worth.rays,
        "spurs": [{"photo": f, "point": p, "axis": a} for f, p, a in block.spurs()],
        "correlations": related.answer,
    }


def _worth_json(worth: PlannedReliability) -> dict[str, Any]:
    found = worth._asdict()
    found["s_m"] = found.pop("s_xyz")
    return found


def _write_csv(path: Path, worth: NetworkReliability) -> None:
    write_csv(
        path,
        (
            "kind",
            "name",
            "rays",
            "mean_r",
            "least_r",
            "weakest",
            "axis",
            "mdb_um",
            "sX",
            "sY",
            "sZ",
        ),
        (
            (kind, *one[:7], *(one.s_xyz or (None, None, None)))
            for kind, worths in (("point", worth.points), ("photo", worth.photos))
            for one in worths
        ),
    )
