"""What the planning commands take; light, `--help` reads it."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.report.arguments import (
    add_matrix,
    add_on,
    add_output,
    add_report_page,
    between,
    correlation,
    length,
    lengths,
    none_or_length,
    planted,
    significance,
    sizes,
    versions,
    whole,
    wholes,
)

__all__ = [
    "add_additional_arguments",
    "add_block_arguments",
    "add_network_arguments",
    "add_pattern_arguments",
    "add_run_arguments",
    "add_series_arguments",
    "add_simulate_arguments",
]


def add_pattern_arguments(show: argparse.ArgumentParser) -> None:
    """Add what `plan pattern` takes."""
    show.add_argument(
        "pattern",
        nargs="+",
        metavar="NAME|FILE",
        help='"13", "13/5", ... or a .csv or .toml with label,x,y[,tie] (mm); several are shown '
        "side by side",
    )
    show.add_argument(
        "--ties", choices=("3", "4", "5"), help="points shared with the preceding model"
    )
    show.add_argument(
        "--base",
        type=length,
        metavar="MM",
        help="default 90, for a file the largest x of its points",
    )
    show.add_argument(
        "--d",
        type=length,
        metavar="MM",
        help="half the model in y, default 100, for a file as far as its points lie",
    )
    show.add_argument(
        "--c", type=length, default=152.0, metavar="MM", help="camera constant, default 152"
    )
    show.add_argument(
        "--tie-variance",
        choices=("paper", "propagated", "exact"),
        default="exact",
        help="how the ties err, default exact",
    )
    show.add_argument(
        "--plant",
        type=planted,
        metavar="POINT:AXIS:UM",
        help="show what an error in a row would change in all; several with commas between",
    )
    add_matrix(show)
    add_output(show, "the rows")


def add_block_arguments(block: argparse.ArgumentParser) -> None:
    """Add what `plan block` takes."""
    several = whole(1, 1000)
    block.add_argument("--strips", type=several, default=3, metavar="N", help="default 3")
    block.add_argument("--photos", type=several, default=6, metavar="N", help="a strip, default 6")
    block.add_argument(
        "--overlap", type=between(0.0, 100.0), default=60.0, metavar="PERCENT", help="default 60"
    )
    block.add_argument(
        "--sidelap", type=between(0.0, 100.0), default=30.0, metavar="PERCENT", help="default 30"
    )
    block.add_argument(
        "--points", choices=("3x3", "5x5"), default="3x3", help="a photo, default 3x3"
    )
    block.add_argument(
        "--control",
        choices=("perimeter", "corners", "none"),
        default="perimeter",
        help="where control stands, default perimeter, with heights inside",
    )
    block.add_argument(
        "--bridging",
        type=lengths,
        metavar="BASES",
        help="bases from control to control, default 2; several with commas between are shown side "
        "by side",
    )
    block.add_argument("--twin", action="store_true", help="full control in pairs")
    block.add_argument(
        "--cross-strips", type=whole(0, 100), default=0, metavar="N", help="flown across"
    )
    block.add_argument(
        "--c", type=length, default=150.0, metavar="MM", help="camera constant, default 150"
    )
    block.add_argument(
        "--format", type=length, default=230.0, metavar="MM", help="side, default 230"
    )
    block.add_argument(
        "--scale", type=length, default=10_000.0, metavar="N", help="1 : N, default 10000"
    )
    block.add_argument(
        "--image-um",
        type=length,
        default=5.0,
        metavar="UM",
        help="a-priori sigma0, default 5",
    )
    block.add_argument(
        "--control-m",
        type=none_or_length,
        default=0.0,
        metavar="M",
        help="standard deviation of control, default 0: free of error",
    )
    block.add_argument(
        "--measured",
        choices=("stereo", "mono"),
        default="stereo",
        help="stereo: a ray in every model that shows it (the default); mono: once",
    )
    block.add_argument(
        "--stabilize",
        choices=("0", "1", "2", "4"),
        metavar="POINTS",
        help="plan so many points more for every weak photo, those that help it most: 1, 2 or 4; "
        "0: they are not even looked for",
    )
    add_output(block, "the classes", folder=False)
    add_report_page(block)
    block.add_argument(
        "--to", type=Path, metavar="FOLDER", help="write it as a new block, free of error"
    )


def add_additional_arguments(additional: argparse.ArgumentParser) -> None:
    """Add what `plan additional` takes."""
    additional.add_argument(
        "additional",
        metavar="SET[:NAMES]",
        help="as adjust --additional has it: ebner, gruen, gruen50, physical, ebner:b1,b2, "
        "gruen50:-b12",
    )
    additional.add_argument(
        "--points", choices=("3x3", "5x5"), help="default 3x3 for ebner, 5x5 for the others"
    )
    additional.add_argument(
        "--reach", type=length, default=100.0, metavar="MM", help="of the points, default 100"
    )
    additional.add_argument(
        "--c", type=length, default=150.0, metavar="MM", help="camera constant, default 150"
    )
    add_output(additional, "the parameters")


def add_network_arguments(network: argparse.ArgumentParser) -> None:
    """Add what `plan network` takes."""
    network.add_argument(
        "network", metavar="cube|FILE", help="the cube of 1978, or a .toml of stations and points"
    )
    network.add_argument(
        "--case",
        type=versions,
        metavar="A,B",
        help="stations of the cube, A to E, default A; several are shown side by side",
    )
    network.add_argument(
        "--image-um", type=length, metavar="UM", help="a-priori sigma0 of the cube, default 5"
    )
    network.add_argument(
        "--correlations",
        type=correlation,
        default=0.9,
        metavar="LIMIT",
        help="correlation of a point's residuals from which it is named, default 0.9",
    )
    network.add_argument("--point", metavar="NAME", help="all correlations of this point")
    network.add_argument(
        "--plant",
        type=planted,
        metavar="PHOTO:POINT:AXIS:UM",
        help="what the tests would say on average of errors in image coordinates (1:2:x:-30); "
        "several with commas",
    )
    add_output(network, "points and photos", folder=False)
    add_report_page(network)
    network.add_argument(
        "--to", type=Path, metavar="FOLDER", help="write it as a new block, free of error"
    )


def add_series_arguments(block: argparse.ArgumentParser) -> None:
    """Add what the command `plan block` takes beside: several blocks are shares of work."""
    add_on(block)


def add_run_arguments(simulate: argparse.ArgumentParser) -> None:
    """Add what the command `plan simulate` takes beside: it writes a block then."""
    simulate.add_argument(
        "--to-block",
        type=Path,
        metavar="FOLDER",
        help="do no simulation, but write its first run as a new block (scenarios bayes-...), and "
        "say what is planted in it and what every strategy rejects",
    )


def add_simulate_arguments(simulate: argparse.ArgumentParser) -> None:
    """Add what `plan simulate` takes."""
    simulate.add_argument(
        "scenario",
        nargs="?",
        metavar="SCENARIO|PATTERN|BLOCK|NETWORK",
        help="one of those named by --list; or a pattern (13/5 or a file), a block's folder, "
        "cube:A (or cube) to cube:E or a network's file, in which errors are planted",
    )
    simulate.add_argument("--base", type=length, metavar="MM", help="of a pattern, default 90")
    simulate.add_argument(
        "--d", type=length, metavar="MM", help="half a named pattern in y, default 100"
    )
    simulate.add_argument(
        "--c", type=length, metavar="MM", help="camera constant of a pattern, default 152"
    )
    simulate.add_argument(
        "--tie-variance",
        choices=("paper", "propagated", "exact"),
        help="how the ties of a pattern err, default exact",
    )
    simulate.add_argument(
        "--errors", type=wholes, metavar="N,...", help="how many errors in a run, default 1"
    )
    simulate.add_argument(
        "--size", type=sizes, metavar="S,...", help="their sizes [sigma], default 6,10,20"
    )
    simulate.add_argument(
        "--place",
        action="append",
        metavar="NAME",
        help="only in rows of this photo, point or axis; photo:NAME, point:NAME or axis:NAME where "
        "NAME is more than one of them; several times: in one of the photos, and of the points, "
        "and of the axes",
    )
    simulate.add_argument(
        "--alpha",
        type=significance,
        metavar="ALPHA",
        help="of a single row, default 0.001; for named scenarios too",
    )
    simulate.add_argument("--list", action="store_true", help="name the scenarios")
    simulate.add_argument(
        "--strategy", metavar="NAME,...", help="only these of the scenario's methods"
    )
    simulate.add_argument(
        "--runs", type=whole(1, 100_000_000), metavar="N", help="default: the scenario's own"
    )
    simulate.add_argument(
        "--seed", type=whole(0, 2**63 - 1), default=0, metavar="S", help="default 0"
    )
    simulate.add_argument(
        "--processes", type=whole(1, 256), metavar="P", help="default: as many as processors"
    )
    add_on(simulate)
    add_output(simulate, "the figures", folder=False)
    simulate.add_argument(
        "--to",
        type=Path,
        metavar="FILE",
        help="keep what is done in a file; the same call goes on from there",
    )
