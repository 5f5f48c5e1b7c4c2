"""The command line of `anaplot plotter` and its parts; light, `--help` reads it."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import TextIO

from anaplot.report.arguments import add_output, positive, whole
from anaplot.report.commandparser import CommandParser, Commands

__all__ = ["add_plotter_commands"]


def _plotter_list(options: argparse.Namespace) -> int:
    from anaplot.report.instrumentlist import list_instruments

    return list_instruments(options)


def _plotter_check(options: argparse.Namespace) -> int:
    from anaplot.report.plottercommand import check_profile

    return check_profile(options.profile, sys.stdout)


def _plotter_watch(options: argparse.Namespace) -> int:
    from anaplot.report.plottercommand import watch

    return watch(
        options.port, options.profile, sys.stdout, seconds=options.seconds, raw=options.raw
    )


def _plotter_sim(options: argparse.Namespace) -> int:
    from anaplot.plotter.device.hand import Hand
    from anaplot.report.simulatorcommand import grid_photographs, laid_pair, run_simulator

    photographs = in_right = None
    if options.truth is not None:
        from anaplot.simulation.opening import plates_in

        photographs, in_right = plates_in(options.truth, options.seed)
    laid = None
    if options.lay is not None:
        there = grid_photographs() if photographs is None else photographs
        laid = laid_pair(options.lay, there)
    return run_simulator(
        options.profile,
        sys.stdout,
        photographs=photographs,
        in_right=in_right,
        laid=laid,
        mistakes=options.mistake or (),
        symlink=options.link,
        tcp=options.tcp is not None,
        tcp_port=options.tcp or 0,
        seed=options.seed,
        noise_um=options.noise_um,
        time_scale=options.time_scale,
        fault_rates=dict(options.fault or ()),
        hand=Hand(auto_pedal=options.auto_pedal),
        control=_control(),
    )


def _control() -> TextIO | None:
    """Return standard input, where lines can come from it."""
    control = sys.stdin
    if control is None or control.closed:
        return None
    if sys.platform != "win32" and control.isatty():
        try:
            # a terminal stops what reads from it in the background
            return control if os.tcgetpgrp(control.fileno()) == os.getpgrp() else None
        except OSError:  # no terminal of this session: it stops nobody
            return control
    return control


def _fault(text: str) -> tuple[str, float]:
    name, equals, rate = text.partition("=")
    try:
        value = float(rate) if equals else 0.01
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r}: the rate must lie between 0 and 1")
    return name, value


def add_plotter_commands(commands: Commands) -> None:
    """Add `plotter` and its parts."""
    plotter = commands.add(
        "plotter",
        None,
        "list ports and profiles, check a profile, watch a line, run a simulated plotter",
        "anaplot plotter list",
        "anaplot plotter check anaplot-ascii",
        description="Instruments: ports, profiles, and a simulated plotter by itself.",
    )
    plotter.later(_add_parts)


def _add_parts(plotter: CommandParser) -> None:
    parts = Commands(plotter, "part")
    listing = parts.add(
        "list",
        _plotter_list,
        "ports and device profiles",
        "anaplot plotter list",
        "anaplot plotter list --csv profiles.csv",
    )
    add_output(listing, "the profiles")
    check = parts.add(
        "check",
        _plotter_check,
        "read a profile and decode its examples",
        "anaplot plotter check anaplot-ascii",
        "anaplot plotter check ./my-counter.toml",
    )
    check.add_argument("profile", metavar="PROFILE", help="a name or a file")

    watch = parts.add(
        "watch",
        _plotter_watch,
        "print what an instrument says",
        "anaplot plotter watch /dev/ttyUSB0 heidenhain-nd720",
        "anaplot plotter watch left=/dev/ttyUSB0 right=/dev/ttyUSB1 heidenhain-nd281b --seconds 10",
    )
    watch.add_argument(
        "port", nargs="+", metavar="PORT", help="an address; LINK=ADDRESS for several cables"
    )
    watch.add_argument("profile", metavar="PROFILE", help="a name or a file")
    watch.add_argument("--seconds", type=positive, metavar="S", help="end after so long")
    watch.add_argument("--raw", action="store_true", help="print the bytes as well")

    sim = parts.add(
        "sim",
        _plotter_sim,
        "run the simulated plotter by itself",
        "anaplot plotter sim anaplot-ascii --truth myblock --lay 101/102",
        "anaplot plotter sim anaplot-ascii --tcp 4001 --fault drop=0.01",
        description="Runs the simulated plotter for a profile until interrupted; lines on standard "
        "input press its pedal, move its plates and plant faults (help lists them).",
    )
    sim.add_argument("profile", metavar="PROFILE", help="a name or a file")
    sim.add_argument(
        "--truth",
        type=Path,
        metavar="FOLDER",
        help="the block whose image_points.csv lies in the plates (shifted, turned and shrunk "
        "where its cameras have fiducials); a grid when left out",
    )
    sim.add_argument(
        "--lay",
        metavar="LEFT/RIGHT",
        help="photographs to begin with; one alone lies in both carriages",
    )
    sim.add_argument("--link", type=Path, metavar="PATH", help="stable name of the port")
    sim.add_argument(
        "--tcp", type=whole(0, 65535), metavar="PORT", help="serve loopback TCP instead; 0: any"
    )
    sim.add_argument("--seed", type=whole(0, 2**31), default=1, metavar="N", help="default 1")
    sim.add_argument(
        "--noise-um", type=positive, default=5.0, metavar="UM", help="of a pointing, default 5"
    )
    sim.add_argument(
        "--time-scale", type=positive, default=1.0, metavar="X", help="simulated seconds a second"
    )
    sim.add_argument("--auto-pedal", action="store_true", help="press the pedal after pointing")
    sim.add_argument(
        "--fault",
        type=_fault,
        action="append",
        metavar="NAME=RATE",
        help="let a fault strike records at this rate; may be given again",
    )
    sim.add_argument(
        "--mistake",
        nargs="+",
        action="append",
        metavar="WORD",
        help="have the hand make a mistake in the model laid first: parallax POINT UM, "
        "wrong-point POINT OTHER, swap POINT OTHER, transfer POINT DX_UM DY_UM, drift DY_UM; "
        "may be given again",
    )
