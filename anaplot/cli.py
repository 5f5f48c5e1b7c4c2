"""The command line: one thin function per command."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

from anaplot import __version__
from anaplot.errors import AnaplotError, InputError

__all__ = ["main"]


class _Parser(argparse.ArgumentParser):
    """Usage errors are one line, like every other error."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")


def _bridge(options: argparse.Namespace) -> int:
    from anaplot.exchange.blockfolder import check_for_bridge, read_block
    from anaplot.orientation.diagnosis import diagnose
    from anaplot.orientation.strip import bridge_strip, pooled_sigma_um
    from anaplot.report.contract import bridge_json
    from anaplot.report.text import model_printout, printable

    block = read_block(options.block)
    check_for_bridge(block)
    strips = tuple(bridge_strip(block, strip) for strip in block.strips)
    if options.json:
        print(json.dumps(bridge_json(strips), indent=1, allow_nan=False))
    else:
        for strip, declared in zip(strips, block.strips, strict=True):
            for k, model in enumerate(strip.models):
                print(
                    model_printout(
                        model,
                        diagnose(model, block.test.power),
                        strip=strip.strip,
                        number=k + 1,
                        count=len(declared.models()),
                        pooled_um=pooled_sigma_um(strip.models[: k + 1]),
                    )
                )
                print()
    errors = [strip.error for strip in strips if strip.error is not None]
    for error in errors:
        print(f"anaplot: {printable(error)}", file=sys.stderr)
    if errors:
        return 4
    if options.fail_on_flag and any(m.flagged for strip in strips for m in strip.models):
        return 1
    return 0


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
    bridge.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    bridge.add_argument("--json", action="store_true", help="print JSON for programs")
    bridge.add_argument(
        "--fail-on-flag", action="store_true", help="exit with 1 when a row is flagged"
    )
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; errors are one line on standard error."""
    try:
        options = _parser().parse_args(arguments)
        code: int = options.run(options)
        sys.stdout.flush()
        return code
    except AnaplotError as error:
        from anaplot.report.text import printable

        print(f"anaplot: {printable(str(error))}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("anaplot: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # the reader of our output went away (a pager was closed): nothing is wrong
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == "__main__":
    sys.exit(main())
