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
from time import monotonic
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
from anaplot.report.commandparser import CommandParser, Commands
from anaplot.report.doorarguments import add_export_arguments, add_import_arguments
from anaplot.report.innerarguments import add_inner_arguments
from anaplot.report.newarguments import add_new_arguments
from anaplot.report.plancommands import add_plan_commands
from anaplot.report.plotterarguments import add_plotter_commands
from anaplot.report.reportarguments import add_report_command
from anaplot.report.sessionarguments import (
    add_demo_arguments,
    add_log_arguments,
    add_open_arguments,
    add_pack_arguments,
    add_pointing_arguments,
    add_replay_arguments,
    add_status_arguments,
    add_unpack_arguments,
)
from anaplot.version import __version__

if TYPE_CHECKING:
    from anaplot.report.computed import Computed
    from anaplot.report.html.parts import Report
    from anaplot.session.state import SessionState
    from anaplot.station.station import Station

__all__ = ["command_parser", "main"]

_FIRST_STEPS = """\
anaplot: say what to do. To begin:
  anaplot demo                     a strip with planted mistakes, no instrument
  anaplot new FOLDER               a block from a few answers
  anaplot import SOURCE -o FOLDER  a block from another program's files
  anaplot open FOLDER              the console on a block
  anaplot adjust FOLDER            the block as one bundle, every ray tested
anaplot --help names all commands, anaplot COMMAND --help what one takes."""


def _bridge(options: argparse.Namespace) -> int:
    from anaplot.report.bridgecommand import run_bridge

    def report(found: Computed[Any]) -> Report:
        from anaplot.exchange.blockfolder import read_block
        from anaplot.report.figures.imageunits import image_units
        from anaplot.report.html.pages.strippage import strip_report

        block = read_block(options.block)
        return strip_report(found, block.name, image_units(block).small)

    return run_bridge(options, report)


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
    from anaplot.console.reportwriting import reports_of
    from anaplot.simulation.controls import controls_of

    station.adjust_apart()
    return run_console(station, controls=controls_of(station), keep=keep, report=reports_of(folder))


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


def _report(options: argparse.Namespace) -> int:
    from anaplot.report.reportcommand import run_report

    return run_report(options)


def _new(options: argparse.Namespace) -> int:
    from anaplot.report.newcommand import run_new

    return run_new(options)


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


def _completion(options: argparse.Namespace) -> int:
    from anaplot.report.completion import completion_script

    print(completion_script(command_parser(), options.shell))
    return 0


def _manual(_: argparse.Namespace) -> int:
    from anaplot.report.manualpage import manual_page

    print(manual_page(command_parser()), end="")
    return 0


def _compare(options: argparse.Namespace) -> int:
    from anaplot.exchange.blockfolder import block_files
    from anaplot.exchange.blockpack import block_paths
    from anaplot.report.comparecommand import compare
    from anaplot.report.pageoption import AskedPage
    from anaplot.report.running import run_computation

    epochs = (options.first, options.second, *options.more)
    reads = [file for epoch in epochs for file in block_files(epoch)]
    more = [] if options.given_movement is None else [options.given_movement]

    def report(found: Computed[Any]) -> Report:
        from anaplot.report.html.pages.epochpage import epoch_report

        return epoch_report(found)

    def paths() -> list[Path]:
        return [*(path for epoch in epochs for path in block_paths(epoch)), *more]

    page = AskedPage.of(options, "compare", add_compare_arguments, paths, report)
    return run_computation(options, partial(compare, *epochs), reads + more, page)


def _add_completion_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish"
    )


def command_parser() -> CommandParser:
    """Return the parser of the whole command line; light: nothing is computed or read."""
    parser = CommandParser(
        prog="anaplot",
        description="On-line photogrammetric triangulation: measure, see at once what the model "
        "says of every measurement, re-measure the one that deserves it, go on.",
        examples=("anaplot demo", "anaplot adjust --help"),
    )
    parser.add_argument("--version", action="version", version=f"anaplot {__version__}")
    commands = Commands(parser, "command")

    commands.group("to begin")
    demo = commands.add(
        "demo",
        _demo,
        "a small simulated strip with planted mistakes, on a simulated plotter behind a real "
        "serial line, in the console",
        "anaplot demo",
        "anaplot demo --auto --seed 7",
    )
    demo.later(add_demo_arguments)
    add_plan_commands(commands)
    new = commands.add(
        "new",
        _new,
        "a block from a few answers, or from options without questions",
        "anaplot new survey --strip 101-105",
        "anaplot new flight --strip 101-120 --strip 220-201 --camera rmk15 --control points.txt",
    )
    new.later(add_new_arguments)
    door = commands.add(
        "import",
        _import,
        "a block from another program's files",
        "anaplot import colmap sparse/0 -o fromcolmap",
        "anaplot import sparse/0 -o halved --sigma-px 0.5",
    )
    door.later(add_import_arguments)

    commands.group("at the instrument")
    add_plotter_commands(commands)
    opening = commands.add(
        "open",
        _open,
        "the console on a block; goes on where its journal ends",
        "anaplot open myblock --simulate",
        "anaplot open myblock --profile anaplot-ascii --port /dev/ttyUSB0",
    )
    opening.later(add_open_arguments)
    inner = commands.add(
        "inner",
        _inner,
        "inner orientation of measured fiducials",
        "anaplot inner fiducials.toml",
        "anaplot inner fiducials.toml --points plates.csv --apply flight",
    )
    inner.later(add_inner_arguments)
    status = commands.add(
        "status",
        _status,
        "where a block stands, what needs a look, what to do next",
        "anaplot status myblock",
        "anaplot status myblock --json",
    )
    status.later(add_status_arguments)
    log = commands.add(
        "log",
        _log,
        "who changed what, when: every measurement, re-measurement and row switched off",
        "anaplot log myblock",
        "anaplot log myblock --csv changes.csv",
    )
    log.later(add_log_arguments)
    pointing = commands.add(
        "pointing",
        _pointing,
        "the precision of pointing: pooled sigma0 of the models, repeated pointing, drift",
        "anaplot pointing myblock",
        "anaplot pointing myblock --to pointing",
    )
    pointing.later(add_pointing_arguments)
    replay = commands.add(
        "replay",
        _replay,
        "play a recorded session through the same code",
        "anaplot replay myblock --check",
        "anaplot replay myblock --to rebuilt",
    )
    replay.later(add_replay_arguments)

    commands.group("the block as a whole")
    bridge = commands.add(
        "bridge",
        _bridge,
        "form the models of every strip from image_points.csv and print their tables",
        "anaplot bridge myblock",
        "anaplot bridge myblock --errors tau --csv rows.csv",
    )
    bridge.later(add_bridge_arguments)
    fit = commands.add(
        "fit",
        _fit,
        "the strips on the control measured so far: similarity, polynomials, discrepancies",
        "anaplot fit myblock",
        "anaplot fit myblock --degree 2 --csv discrepancies.csv",
    )
    fit.later(add_fit_arguments)
    adjust = commands.add(
        "adjust",
        _adjust,
        "adjust the block as one bundle, with the redundancy number of every observation",
        "anaplot adjust myblock",
        "anaplot adjust myblock --additional ebner --to tables",
    )
    adjust.later(add_adjust_arguments, add_apply_arguments)
    add_report_command(commands, _report)
    compare = commands.add(
        "compare",
        _compare,
        "what has moved between two or more epochs, and when",
        "anaplot compare spring autumn",
        "anaplot compare spring summer autumn --csv moved.csv --report moved.html",
    )
    compare.later(add_compare_arguments)

    commands.group("to pass on")
    out = commands.add(
        "export",
        _export,
        "a block as another program's files",
        "anaplot export colmap myblock -o cleaned",
        "anaplot export geojson myblock -o map.geojson --ellipses 1000",
    )
    out.later(add_export_arguments)
    pack = commands.add(
        "pack",
        _pack,
        "a whole block as one file: settings, measurements, control, cameras and journal",
        "anaplot pack myblock -o myblock.zip",
        "anaplot pack myblock -o backup/monday.zip",
    )
    pack.later(add_pack_arguments)
    unpack = commands.add(
        "unpack",
        _unpack,
        "a packed block as a folder again, every file checked",
        "anaplot unpack myblock.zip -o again",
        "anaplot unpack backup/monday.zip -o monday",
    )
    unpack.later(add_unpack_arguments)

    commands.group("for the shell")
    completion = commands.add(
        "completion",
        _completion,
        "a script with which a shell completes commands, options, names and files",
        "anaplot completion bash > anaplot.bash",
        "anaplot completion fish > anaplot.fish",
    )
    completion.later(_add_completion_arguments)
    commands.add(
        "manual",
        _manual,
        "the manual page of all commands, for man",
        "anaplot manual > anaplot.1",
        "anaplot manual | man -l -",
    )
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
    begun = monotonic()
    try:
        _end_cleanly()
        try:
            if not (sys.argv[1:] if arguments is None else arguments):
                print(_FIRST_STEPS, file=sys.stderr)
                return InputError.exit_code
            options = command_parser().parse_args(arguments)
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
    except KeyboardInterrupt as interrupt:
        complain(str(interrupt) or f"interrupted, after {monotonic() - begun:.1f} s")
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
