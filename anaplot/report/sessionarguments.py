"""What the commands on sessions take; light, `--help` reads it."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.report.arguments import add_output, add_target, positive, whole

__all__ = [
    "add_demo_arguments",
    "add_log_arguments",
    "add_open_arguments",
    "add_pack_arguments",
    "add_pointing_arguments",
    "add_replay_arguments",
    "add_status_arguments",
    "add_unpack_arguments",
]


def add_demo_arguments(demo: argparse.ArgumentParser) -> None:
    """Add what `demo` takes."""
    demo.add_argument(
        "--auto",
        action="store_true",
        help="a simulated operator does the job; what became of the mistakes goes where --json, "
        "--all, --csv and --to say",
    )
    add_output(demo, "the planted mistakes")
    demo.add_argument("--seed", type=whole(0, 2**31), default=1, metavar="N", help="default 1")
    demo.add_argument(
        "--models",
        type=whole(1, 200),
        default=4,
        metavar="N",
        help="models of the strip, default 4",
    )
    demo.add_argument(
        "--fiducials",
        action="store_true",
        help="begin every model with the inner orientation of its photos: eight fiducials, plates "
        "that lie shifted, turned and shrunk, a little distortion, one fiducial missed",
    )
    demo.add_argument("--keep", type=Path, metavar="FOLDER", help="keep the block in a new folder")


def add_open_arguments(opening: argparse.ArgumentParser) -> None:
    """Add what `open` takes."""
    opening.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    opening.add_argument("--profile", metavar="NAME", help="device profile: a name or a file")
    opening.add_argument("--port", help="serial port: /dev/ttyUSB0, COM3, socket://host:port")
    opening.add_argument(
        "--simulate",
        action="store_true",
        help="connect a simulated plotter instead; --profile says which instrument it plays",
    )
    opening.add_argument(
        "--truth",
        type=Path,
        metavar="FOLDER",
        help="with --simulate: the block whose image_points.csv lies in the simulated plates",
    )
    opening.add_argument(
        "--seed", type=whole(0, 2**31), default=1, metavar="N", help="of the simulation, default 1"
    )
    opening.add_argument(
        "--pattern",
        metavar="NAME",
        help="point pattern of new models, a name or a file; default the block's, else 13",
    )
    opening.add_argument(
        "--operator", default="", metavar="NAME", help="your name, for the journal"
    )
    opening.add_argument(
        "--story", default="", metavar="TEXT", help="what the session is about, for the journal"
    )


def add_status_arguments(status: argparse.ArgumentParser) -> None:
    """Add what `status` takes."""
    status.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    add_output(status, "the models")


def add_log_arguments(log: argparse.ArgumentParser) -> None:
    """Add what `log` takes."""
    log.add_argument("session", type=Path, metavar="BLOCK", help="a block, or a recorded session")
    add_output(log, "the changes")


def add_pointing_arguments(pointing: argparse.ArgumentParser) -> None:
    """Add what `pointing` takes."""
    pointing.add_argument(
        "session", type=Path, metavar="BLOCK", help="a block, or a recorded session"
    )
    add_output(pointing, "the pooled sigma0")


def add_pack_arguments(pack: argparse.ArgumentParser) -> None:
    """Add what `pack` takes."""
    pack.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    add_target(pack, "FILE", "a new file")


def add_unpack_arguments(unpack: argparse.ArgumentParser) -> None:
    """Add what `unpack` takes."""
    unpack.add_argument("pack", type=Path, metavar="FILE", help="what pack has written")
    add_target(unpack, "FOLDER", "a new folder")


def add_replay_arguments(replay: argparse.ArgumentParser) -> None:
    """Add what `replay` takes."""
    replay.add_argument(
        "session", type=Path, metavar="SESSION", help="a journal file, or the block's folder"
    )
    replay.add_argument(
        "--check",
        action="store_true",
        help="compare every table with the recorded one; exit with 1 when one differs",
    )
    replay.add_argument(
        "--to", type=Path, metavar="BLOCK", help="rebuild the block in a new folder"
    )
    replay.add_argument(
        "--salvage",
        type=Path,
        metavar="BLOCK",
        help="bring what can be read of a damaged session into a new block; say what is missing",
    )
    add_output(replay, "the rows of the models (with --salvage: what is missing)", folder=False)
    replay.add_argument(
        "--speed", type=positive, metavar="X", help="watch it, X times as fast as it was recorded"
    )
    replay.add_argument("--console", action="store_true", help="watch it in the console")
