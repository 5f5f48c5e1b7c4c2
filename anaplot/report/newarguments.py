"""What `new` takes; light, `--help` reads it."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.report.arguments import positive

__all__ = ["add_new_arguments"]


def add_new_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `new`."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="made when it does not exist")
    parser.add_argument("--name", metavar="NAME", help="of the block, default the folder's name")
    parser.add_argument(
        "--camera",
        metavar="CAMERA",
        help="a common type, a camera file, or c in mm; default rmk15, ? lists the types",
    )
    parser.add_argument(
        "--strip",
        action="append",
        metavar="PHOTOS",
        help="FIRST-LAST, counting up or down, or names with commas; NAME=PHOTOS names the strip; "
        "may be given again",
    )
    parser.add_argument(
        "--control",
        type=Path,
        metavar="FILE",
        help="control points: name, E, N, H and perhaps sigma",
    )
    parser.add_argument("--profile", metavar="NAME", help="the instrument's profile")
    parser.add_argument(
        "--pattern", metavar="NAME", help="of new models: a name or a file, default 13"
    )
    parser.add_argument(
        "--sigma", type=positive, metavar="UM", help="of an image coordinate, default 5"
    )
