"""The command line: one thin function per command."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from anaplot.console.terminal import need_terminal
from anaplot.errors import AnaplotError, InputError, NotComputableError
from anaplot.report.adjustarguments import (
    add_adjust_arguments,
    add_apply_arguments,
    add_bridge_arguments,
    add_compare_arguments,
    add_fit_arguments,
)
from anaplot.report.arguments import add_output, positive, whole
from anaplot.report.doorarguments import add_export_arguments, add_import_arguments
from anaplot.report.innerarguments import add_inner_arguments
from anaplot.report.newcommand import add_new_arguments, run_new
from anaplot.report.planarguments import (
    add_additional_arguments,
    add_block_arguments,
    add_network_arguments,
    add_pattern_arguments,
    add_run_arguments,
    add_simulate_arguments,
)
from anaplot.report.plotterarguments import add_plotter_commands
from anaplot.report.reportarguments import add_report_command
from anaplot.version import __version__

if TYPE_CHECKING:
    from anaplot.aliases import Progress
    from anaplot.session.state import SessionState
    from anaplot.station.station import Station

__all__ = ["main"]


class _Parser(argparse.ArgumentParser):
    """Usage errors are one line, like every other error."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")


def _bridge(options: argparse.Namespace) -> int:
    from anaplot.report.bridgecommand import run_bridge

    return run_bridge(options)


def _adjust(options: argparse.Namespace) -> int:
    from anaplot.report.applyerrors import run_adjust

    return run_adjust(options)


def _demo(options: argparse.Namespace) -> int:
    from anaplot.report.democommand import demo_block, run_demo_auto
    from anaplot.report.output import Output

    with demo_block(options) as (demo, folder, keeping):
        if options.auto:
            return run_demo_auto(demo, folder, Output.of(options))
        need_terminal()
        station = demo.open(folder, time_scale=2.0)
        before = station.state
        temporary = options.keep is None
        code = _show(station, folder, partial(keeping.keep, folder) if temporary else None)
    options.simulate = True
    _part(station, before, keeping.folder or folder, options)
    return code


def _show(station: Station, folder: Path, keep: Callable[[], None] | None = None) -> int:
    """Show a station on a block folder; `keep` keeps a block that would be deleted."""
    from anaplot.console.app import run_console
    from anaplot.simulation.controls import controls_of

    def report(*, free: bool, progress: Progress) -> Path:
        from anaplot.report.keptreport import keep_report

        return keep_report(folder, datum="free" if free else "control", progress=progress).page

    return run_console(station, controls=controls_of(station), keep=keep, report=report)


def _open(options: argparse.Namespace) -> int:
    from anaplot.simulation.opening import check_options, open_station, truth_of

    asked = _is_missing(options.block)
    if asked:
        from anaplot.console.newblockscreen import ask_for_block

        # whoever answers the questions is not told afterwards what was wrong before
        check_options(
            profile=options.profile,
            port=options.port,
            simulate=options.simulate,
            truth=options.truth,
            point_pattern=options.pattern,
        )
        if options.truth is not None:
            truth_of(options.truth)
        waits = options.port is not None and options.profile is None
        for line in ask_for_block(options.block, instrument=waits):
            print(line)
        if options.port is None and not options.simulate:
            return 0
    try:
        station = open_station(
            options.block,
            profile=options.profile,
            port=options.port,
            simulate=options.simulate,
            truth=options.truth,
            seed=options.seed,
            point_pattern=options.pattern,
            operator=options.operator,
            story=options.story,
            ready=need_terminal,
        )
    except AnaplotError as error:
        if asked:
            from anaplot.report.partingline import open_again

            again = open_again(options.block, options)
            error.args = (f"{error}; the block is written - {again} opens it",)
        raise
    before = station.state
    code = _show(station, options.block)
    _part(station, before, options.block, options)
    return code


def _is_missing(folder: Path) -> bool:
    """Whether there is no block, nor anything else of one, and a terminal to ask for it."""
    parts = ("block.toml", "sessions")
    there = any(os.path.lexists(folder / part) for part in parts)
    if there or (folder.exists() and not folder.is_dir()):
        return False
    try:
        need_terminal()
    except InputError:
        return False
    return True


def _part(
    station: Station, before: SessionState, folder: Path, options: argparse.Namespace
) -> None:
    """Say in one line what was done since a state of the session, and what is next."""
    from anaplot.report.partingline import open_again, parting_line
    from anaplot.session.workdone import work_done

    status, kept = station.snapshot().status, folder.exists()
    step = None if status is None or not kept else status.next
    again = open_again(folder, options) if kept else "anaplot demo --keep FOLDER keeps it"
    print(parting_line(work_done(before, station.state), step, again))


def _replay(options: argparse.Namespace) -> int:
    if options.salvage is not None:
        from anaplot.report.salvagecommand import run_salvage

        return run_salvage(options)
    from anaplot.report.replaycommand import replay_station, run_replay

    if options.console:
        station = replay_station(options)
        need_terminal()
        from anaplot.console.app import run_console

        return run_console(station)
    return run_replay(options)


def _inner(options: argparse.Namespace) -> int:
    from anaplot.report.innercommand import run_inner

    return run_inner(options)


def _pack(options: argparse.Namespace) -> int:
    from anaplot.report.packcommand import run_pack

    return run_pack(options)


def _unpack(options: argparse.Namespace) -> int:
    from anaplot.report.packcommand import run_unpack

    return run_unpack(options)


def _import(options: argparse.Namespace) -> int:
    from anaplot.report.importcommand import run_import

    return run_import(options)


def _export(options: argparse.Namespace) -> int:
    from anaplot.report.exportcommand import run_export

    return run_export(options)


def _fit(options: argparse.Namespace) -> int:
    from anaplot.report.fitcommand import run_fit

    return run_fit(options)


def _status(options: argparse.Namespace) -> int:
    from anaplot.report.statuscommand import run_status

    return run_status(options)


def _log(options: argparse.Namespace) -> int:
    from anaplot.report.logcommand import run_log

    return run_log(options)


def _pointing(options: argparse.Namespace) -> int:
    from anaplot.report.pointingcommand import run_pointing

    return run_pointing(options)


def _plan_pattern(options: argparse.Namespace) -> int:
    from anaplot.report.patterncomparison import run_plan_pattern

    return run_plan_pattern(options)


def _plan_simulate(options: argparse.Namespace) -> int:
    from anaplot.report.simulatecommand import run_simulate

    return run_simulate(options)


def _plan_block(options: argparse.Namespace) -> int:
    from anaplot.report.planseries import run_plan_block

    return run_plan_block(options)


def _plan_network(options: argparse.Namespace) -> int:
    from anaplot.report.networkcomparison import run_plan_network

    return run_plan_network(options)


def _plan_additional(options: argparse.Namespace) -> int:
    from anaplot.report.planadditional import run_plan_additional

    return run_plan_additional(options)


def _compare(options: argparse.Namespace) -> int:
    from anaplot.exchange.blockfolder import block_files
    from anaplot.report.comparecommand import compare
    from anaplot.report.running import run_computation

    epochs = (options.first, options.second, *options.more)
    reads = [file for epoch in epochs for file in block_files(epoch)]
    if options.given_movement is not None:
        reads.append(options.given_movement)
    return run_computation(options, partial(compare, *epochs), reads)


def _add_plan(commands: Any) -> None:
    plan = commands.add_parser(
        "plan",
        help="what a measurement would be worth, before it is made",
        description="Planning: reliability from geometry alone.",
        epilog="example: anaplot plan pattern 13/5",
    )
    parts = plan.add_subparsers(dest="part", metavar="COMMAND", required=True)
    show = parts.add_parser(
        "pattern",
        help="redundancy numbers of a point pattern, and the point that would help most",
        epilog="example: anaplot plan pattern 6 --ties 3",
    )
    show.set_defaults(run=_plan_pattern)
    add_pattern_arguments(show)
    block = parts.add_parser(
        "block",
        help="a regular aerial block: classes of observations, weak photos, accuracy",
        epilog="example: anaplot plan block --strips 4 --photos 8 --bridging 3 --twin",
    )
    block.set_defaults(run=_plan_block)
    add_block_arguments(block)
    network = parts.add_parser(
        "network",
        help="camera stations around an object: what they see, check and determine",
        epilog="example: anaplot plan network cube --case C --point 2",
    )
    network.set_defaults(run=_plan_network)
    add_network_arguments(network)
    additional = parts.add_parser(
        "additional",
        help="a set of additional parameters: its terms, and what they have in common",
        epilog="example: anaplot plan additional gruen",
    )
    additional.set_defaults(run=_plan_additional)
    add_additional_arguments(additional)
    simulate = parts.add_parser(
        "simulate",
        help="Monte Carlo: how often errors are found, rightly or wrongly",
        epilog="example: anaplot plan simulate kratky-1983-6-3 --runs 20000",
    )
    simulate.set_defaults(run=_plan_simulate)
    add_simulate_arguments(simulate)
    add_run_arguments(simulate)


def _parser() -> _Parser:
    parser = _Parser(
        prog="anaplot",
        description="On-line photogrammetric triangulation: measure, see at once what the model "
        "says of every measurement, re-measure the one that deserves it, go on.",
        epilog="example: anaplot demo",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"anaplot {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)

    def command(name: str, run: Callable[[argparse.Namespace], int], text: str, example: str):  # type: ignore[no-untyped-def]
        sub = commands.add_parser(name, help=text, description=text, epilog=f"example: {example}")
        sub.set_defaults(run=run)
        return sub

    bridge = command(
        "bridge",
        _bridge,
        "form the models of every strip from image_points.csv and print their tables",
        "anaplot bridge myblock --json",
    )
    add_bridge_arguments(bridge)
    adjust = command(
        "adjust",
        _adjust,
        "adjust the block as one bundle, with the redundancy number of every observation",
        "anaplot adjust myblock --additional ebner",
    )
    add_adjust_arguments(adjust)
    add_apply_arguments(adjust)
    add_report_command(command)
    compare = command(
        "compare",
        _compare,
        "what has moved between two or more epochs, and when",
        "anaplot compare spring autumn",
    )
    add_compare_arguments(compare)

    demo = command(
        "demo",
        _demo,
        "a small simulated strip with planted mistakes, on a simulated plotter behind a real "
        "serial line, in the console",
        "anaplot demo --auto --seed 7",
    )
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

    opening = command(
        "open",
        _open,
        "the console on a block; goes on where its journal ends",
        "anaplot open myblock --profile anaplot-ascii --port /dev/ttyUSB0",
    )
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

    new = command(
        "new",
        run_new,
        "a block from a few answers, or from options without questions",
        "anaplot new survey --strip 101-120 --strip 220-201 --camera rmk15 --control points.txt",
    )
    add_new_arguments(new)

    inner = command(
        "inner",
        _inner,
        "inner orientation of measured fiducials",
        "anaplot inner fiducials.toml",
    )
    add_inner_arguments(inner)

    status = command(
        "status",
        _status,
        "where a block stands, what needs a look, what to do next",
        "anaplot status myblock --json",
    )
    status.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    add_output(status, "the models")

    log = command(
        "log",
        _log,
        "who changed what, when: every measurement, re-measurement and row switched off",
        "anaplot log myblock --csv changes.csv",
    )
    log.add_argument("session", type=Path, metavar="BLOCK", help="a block, or a recorded session")
    add_output(log, "the changes")

    pointing = command(
        "pointing",
        _pointing,
        "the precision of pointing: pooled sigma0 of the models, repeated pointing, drift",
        "anaplot pointing myblock",
    )
    pointing.add_argument(
        "session", type=Path, metavar="BLOCK", help="a block, or a recorded session"
    )
    add_output(pointing, "the pooled sigma0")

    fit = command(
        "fit",
        _fit,
        "the strips on the control measured so far: similarity, polynomials, discrepancies",
        "anaplot fit myblock --degree 2 --without 7,12",
    )
    add_fit_arguments(fit)
    pack = command(
        "pack",
        _pack,
        "a whole block as one file: settings, measurements, control, cameras and journal",
        "anaplot pack myblock -o myblock.zip",
    )
    pack.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    pack.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="a new file")
    unpack = command(
        "unpack",
        _unpack,
        "a packed block as a folder again, every file checked",
        "anaplot unpack myblock.zip -o myblock",
    )
    unpack.add_argument("pack", type=Path, metavar="FILE", help="what pack has written")
    unpack.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FOLDER", help="a new folder"
    )

    door = command(
        "import",
        _import,
        "a block from another program's files",
        "anaplot import colmap sparse/0 -o myblock",
    )
    add_import_arguments(door)
    out = command(
        "export",
        _export,
        "a block as another program's files",
        "anaplot export colmap myblock -o cleaned",
    )
    add_export_arguments(out)

    add_plotter_commands(commands)
    _add_plan(commands)

    replay = command(
        "replay",
        _replay,
        "play a recorded session through the same code",
        "anaplot replay myblock --check",
    )
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
    return parser


def _end_cleanly() -> None:
    """Let a closed terminal or a polite kill end a command as an error would: with its clean-up."""

    def end(number: int, _: object) -> NoReturn:
        raise SystemExit(128 + number)

    if threading.current_thread() is threading.main_thread():
        for name in ("SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), end)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; errors are one line on standard error."""
    from anaplot.report.streams import complain, drop_output, prepare_streams, system_message

    prepare_streams()
    try:
        _end_cleanly()
        try:
            options = _parser().parse_args(arguments)
            code: int = options.run(options)
        except SystemExit:
            # --help has written something
            sys.stdout.flush()
            raise
        sys.stdout.flush()
        return code
    except AnaplotError as error:
        complain(str(error))
        drop_output()
        return error.exit_code
    except MemoryError:
        complain("this needs more memory than there is")
        drop_output()
        return NotComputableError.exit_code
    except KeyboardInterrupt:
        complain("interrupted")
        drop_output()
        return 130
    except BrokenPipeError:
        # the reader of our output went away (a pager was closed): nothing is wrong
        drop_output()
        return 0
    except OSError as error:
        complain(system_message(error, output_failed=drop_output()))
        return InputError.exit_code


if __name__ == "__main__":
    sys.exit(main())
