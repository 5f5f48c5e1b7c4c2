"""Options of `import` and `export`; light, `--help` reads it."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path
from typing import Any

from anaplot.errors import InputError
from anaplot.report.arguments import add_target, length, positive

__all__ = ["add_export_arguments", "add_import_arguments", "refuse_unused"]

_NAMES = {
    "sigma_px": "--sigma-px",
    "control_m": "--control-m",
    "position_m": "--position-m",
    "sigma_um": "--sigma-um",
    "sigma_classes": "--sigma-class",
    "pixel_um": "--pixel-um",
    "columns": "--column",
    "files": "--with",
}


def add_import_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `import`."""
    from anaplot.exchange.formats.registry import FORMATS

    kinds = ", ".join(one.kind for one in FORMATS.values() if one.reads)
    parser.add_argument(
        "kind", metavar="KIND", help=f"{kinds}; may be left out where the source says what it is"
    )
    parser.add_argument("source", type=Path, nargs="?", metavar="SOURCE", help="a file or a folder")
    add_target(parser, "BLOCK", "the new block's folder")
    parser.add_argument(
        "--sigma-px",
        type=positive,
        metavar="PX",
        help="a-priori sigma of an image coordinate, default one pixel",
    )
    parser.add_argument(
        "--sigma-um", type=positive, metavar="UM", help="the same, where coordinates are lengths"
    )
    parser.add_argument(
        "--sigma-class",
        dest="sigma_classes",
        type=_length_pair,
        action=_Pairs,
        metavar="GROUP=UM",
        help="the same of a group of the source's; may be given again",
    )
    parser.add_argument("--unit", choices=("px", "mm", "um"), help="of image coordinates")
    parser.add_argument(
        "--column",
        dest="columns",
        type=_pair,
        action=_Pairs,
        metavar="OURS=THEIRS",
        help="the name of a column in the source; may be given again",
    )
    parser.add_argument("--camera", type=Path, metavar="FILE", help="a camera file")
    parser.add_argument("--c", type=length, metavar="MM", help="camera constant")
    parser.add_argument(
        "--pixels", type=_size, metavar="WIDTHxHEIGHT", help="size of the images in pixels"
    )
    parser.add_argument("--pixel-um", type=positive, metavar="UM", help="size of a pixel")
    parser.add_argument("--crs", metavar="CRS", help="of the ground coordinates: EPSG:25832")
    parser.add_argument(
        "--control-m",
        type=positive,
        metavar="M",
        help="a-priori sigma of control that states none, default 0.05",
    )
    parser.add_argument(
        "--position-m",
        type=positive,
        metavar="M",
        help="a-priori sigma of positions measured in flight, which become priors",
    )
    parser.add_argument(
        "--order", metavar="WORD", help="what the source does not say; the format's own words"
    )
    parser.add_argument(
        "--with",
        dest="files",
        type=_file,
        action=_Pairs,
        metavar="WHAT=FILE",
        help="a further file: control=points.txt; may be given again",
    )
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    parser.set_defaults(all=False)


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `export`."""
    from anaplot.exchange.formats.registry import FORMATS

    kinds = ", ".join(one.kind for one in FORMATS.values() if one.writes)
    parser.add_argument("kind", metavar="KIND", help=kinds)
    parser.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    add_target(parser, "TARGET", "a new file or folder")
    parser.add_argument("--unit", choices=("px", "mm", "um"), help="of image coordinates")
    parser.add_argument(
        "--order", metavar="WORD", help="how something is turned; the format's own words"
    )
    parser.add_argument(
        "--ellipses",
        type=positive,
        metavar="FACTOR",
        help="draw standard ellipses, so many times as large as they are",
    )
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    parser.set_defaults(all=False)


def refuse_unused(given: Any, usual: Any, kind: str, taken: Collection[str]) -> None:
    """Refuse an option that a format has no use for; raises InputError."""
    for name in type(given).__dataclass_fields__:
        if getattr(given, name) != getattr(usual, name) and name not in taken:
            raise InputError(f"{_NAMES.get(name, f'--{name}')}: {kind} has no use for it")


class _Pairs(argparse.Action):
    """Collects pairs into a mapping."""

    def __call__(
        self, parser: Any, namespace: Any, values: Any, option_string: str | None = None
    ) -> None:
        """Add one."""
        name, value = values
        found = dict(getattr(namespace, self.dest) or {})
        if name in found:
            parser.error(f"{option_string} {name}: given twice")
        setattr(namespace, self.dest, {**found, name: value})


def _pair(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not (name and sign and value):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=VALUE")
    return name, value


def _length_pair(text: str) -> tuple[str, float]:
    name, value = _pair(text)
    return name, positive(value)


def _file(text: str) -> tuple[str, Path]:
    name, value = _pair(text)
    return name, Path(value)


def _size(text: str) -> tuple[int, int]:
    width, sign, height = text.partition("x")
    digits = 7
    if (
        not (sign and width.isdecimal() and height.isdecimal())
        or max(map(len, (width, height))) > digits
    ):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form WIDTHxHEIGHT")
    return int(width), int(height)
