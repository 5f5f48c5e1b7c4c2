"""`anaplot new`: a block from a few answers, or from options without questions."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from anaplot.errors import InputError
from anaplot.report.arguments import positive

if TYPE_CHECKING:
    from anaplot.exchange.newblock import NewBlock
    from anaplot.photogrammetry.block import Block, Strip

__all__ = ["add_new_arguments", "run_new"]

_CAMERA = "rmk15"
_STRIP = "101-103"
_PATTERN = "13"
_SIGMA = 5.0
_NONE = "none"
_GIVEN = ("name", "camera", "strip", "control", "profile", "pattern", "sigma")

T = TypeVar("T")


def add_new_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `new`."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="made when it does not exist")
    parser.add_argument("--name", metavar="NAME", help="of the block, default the folder's name")
    parser.add_argument(
        "--camera",
        metavar="CAMERA",
        help=f"a common type, a camera file, or c in mm; default {_CAMERA}, ? lists the types",
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
    parser.add_argument("--pattern", metavar="NAME", help=f"of new models, default {_PATTERN}")
    parser.add_argument(
        "--sigma", type=positive, metavar="UM", help=f"of an image coordinate, default {_SIGMA:g}"
    )


def run_new(options: argparse.Namespace) -> int:
    """Write a new block and say what is in it and what is next; see `add_new_arguments`."""
    from anaplot.exchange.newblock import write_new
    from anaplot.textfiles.wording import place, plain

    folder: Path = options.folder
    if os.path.lexists(folder / "block.toml"):
        raise InputError(f"{place(folder / 'block.toml')}: exists already and is not overwritten")
    if options.camera == "?":
        print(_cameras())
        return 0
    asked = all(getattr(options, name) is None for name in _GIVEN)
    if asked and sys.stdin is not None and sys.stdin.isatty():
        _ask(options)
    new = _answers(options)
    block = write_new(folder, new)
    shown = plain(str(folder), 200)
    print(_summary(shown, block))
    print(f"camera {plain(block.cameras[0].id)}: {new.camera.remark}")
    if block.image_points:
        print(f"next: anaplot {'bridge' if block.strips else 'adjust'} {shown}")
    else:
        print(f"next: anaplot open {shown} --simulate, or --profile NAME --port PORT")
    return 0


def _answers(options: argparse.Namespace) -> NewBlock:
    from anaplot.exchange.controllist import read_control_list
    from anaplot.exchange.newblock import NewBlock, choose_camera
    from anaplot.photogrammetry.block import Measuring
    from anaplot.textfiles.names import name_fault
    from anaplot.textfiles.wording import quoted

    name = options.name if options.name is not None else _name_of(options.folder)
    fault = name_fault(name)
    if fault is not None:
        raise InputError(f"the name {quoted(name)} {fault}")
    if options.profile is not None:
        _profile(options.profile)
    if options.pattern is not None:
        _pattern(options.pattern)
    return NewBlock(
        name,
        choose_camera(_CAMERA if options.camera is None else options.camera),
        _strips(options.strip or ()),
        () if options.control is None else read_control_list(options.control),
        _SIGMA if options.sigma is None else options.sigma,
        Measuring(options.profile, options.pattern),
    )


def _name_of(folder: Path) -> str:
    return folder.resolve().name or "block"


def _control(name: str) -> object:
    from anaplot.exchange.controllist import read_control_list

    return read_control_list(Path(name))


def _profile(name: str) -> object:
    from anaplot.plotter.profile import load_profile

    return load_profile(name)


def _pattern(name: str) -> object:
    from anaplot.orientation.patterns import pattern

    return pattern(name)


def _strips(texts: Sequence[str]) -> tuple[Strip, ...]:
    from anaplot.exchange.newblock import strip_of
    from anaplot.textfiles.wording import quoted

    strips: dict[str, Strip] = {}
    for number, text in enumerate(texts, 1):
        strip = strip_of(text, number)
        if strip.id in strips:
            raise InputError(f"strip {quoted(strip.id)} twice")
        strips[strip.id] = strip
    return tuple(strips.values())


def _ask(options: argparse.Namespace) -> None:
    """Ask for what no option said; an empty answer takes the default."""
    from anaplot.exchange.newblock import choose_camera

    measured = os.path.lexists(options.folder / "image_points.csv")
    options.name = _answer("name of the block", _name_of(options.folder), str)
    camera = "camera: a common type (? lists them), a camera file, or c in mm"
    options.camera = _answer(camera, _CAMERA, _checked(choose_camera))
    options.strip = _ask_strips(measured)
    control = _answer("control points, a file", _NONE, _checked(_control))
    options.control = None if control == _NONE else Path(control)
    profile = _answer("profile of the instrument", _NONE, _checked(_profile))
    options.profile = None if profile == _NONE else profile
    pattern = _answer("point pattern", _PATTERN, _checked(_pattern))
    options.pattern = None if pattern == _PATTERN else pattern
    options.sigma = _answer("sigma of an image coordinate, um", f"{_SIGMA:g}", positive)


def _ask_strips(measured: bool) -> list[str]:
    """Return the strips a person names; the first one is needed where nothing is measured yet."""
    strips: list[str] = []
    while True:
        default = _NONE if strips or measured else _STRIP
        answer = _answer(
            f"photos of strip {len(strips) + 1}, FIRST-LAST",
            default,
            _checked(lambda text: _strips([*strips, text])),
        )
        if answer == _NONE:
            return strips
        strips.append(answer)


def _checked(check: Callable[[str], object]) -> Callable[[str], str]:
    """Return what takes an answer as it is, if it can be read."""

    def read(text: str) -> str:
        if text != _NONE:
            check(text)
        return text

    return read


def _answer(question: str, default: str, read: Callable[[str], T]) -> T:
    """Ask until the answer can be read."""
    while True:
        try:
            text = input(f"{question} [{default}]: ").strip() or default
        except EOFError:
            raise InputError("the questions were not answered: nothing is written") from None
        if text == "?":
            print(_cameras())
            continue
        try:
            return read(text)
        except (InputError, argparse.ArgumentTypeError) as error:
            print(f"  {error}")


def _cameras() -> str:
    from anaplot.photogrammetry.nominalcameras import NOMINAL_CAMERAS

    return "\n".join(
        f"  {camera.id:9} {camera.title:30} c {camera.c:g} mm"
        for camera in NOMINAL_CAMERAS.values()
    )


def _summary(folder: str, block: Block) -> str:
    from anaplot.textfiles.wording import plain

    counts = (
        (len(block.strips), "strip"),
        (len(block.photos), "photo"),
        (len(block.image_points), "image point"),
        (len(block.control), "control point"),
    )
    parts = [f"{count} {what}{'' if count == 1 else 's'}" for count, what in counts if count]
    return f"{folder}: block {plain(block.name)}, " + ", ".join(parts)
