"""What is asked of a new block, once for questions, options and screen: words, defaults, checks."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from anaplot.errors import InputError
from anaplot.report.arguments import positive
from anaplot.textfiles.inputfile import real_path

if TYPE_CHECKING:
    from anaplot.exchange.controlcsv import GroundPoints
    from anaplot.exchange.newblock import ChosenCamera, NewBlock
    from anaplot.photogrammetry.block import Measuring, Strip

__all__ = [
    "NONE",
    "Answers",
    "Question",
    "answered",
    "camera_types",
    "new_block",
    "new_questions",
]

_PATTERN = "13"
NONE = "none"
"""The answer that leaves something out."""
Answers = Mapping[str, Sequence[str]]
"""By the question's name; where one answer is asked for, there is one."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question on a new block.

    Attributes
    ----------
    name
        As the command's option is called.
    text
        What is asked.
    short
        The same in a word or two, as the label of a field.
    default
        What an empty answer means.
    check
        Takes all answers to it; what it raises says what is wrong with them.
    many
        Whether it may be answered more than once.
    """

    name: str
    text: str
    short: str
    default: str
    check: Callable[[Sequence[str]], object]
    many: bool = False

    @property
    def optional(self) -> bool:
        """Whether "none" leaves it out."""
        return self.many or self.default == NONE

    def given(self, answers: Sequence[str]) -> list[str]:
        """Return the answers that leave nothing out."""
        return [answer for answer in answers if answer != NONE or not self.optional]

    def fault(self, answers: Sequence[str]) -> str:
        """Return what is wrong with the answers, or ""."""
        given = self.given(answers)
        try:
            if given:
                self.check(given)
        except (InputError, argparse.ArgumentTypeError) as error:
            return str(error)
        return ""


def new_questions(folder: Path) -> tuple[Question, ...]:
    """Return the questions, in the order in which they are asked."""
    measured = os.path.lexists(folder / "image_points.csv")
    return (
        Question("name", "name of the block", "name", _default_name(folder), _name),
        Question(
            "camera",
            "camera: a common type (? lists them), a camera file, or c in mm",
            "camera",
            "rmk15",
            _camera,
        ),
        Question(
            "strip",
            "photos of strip {number}, FIRST-LAST",
            "strips",
            NONE if measured else "101-103",
            _strips,
            many=True,
        ),
        Question("control", "control points, a file", "control", NONE, _control),
        Question("profile", "profile of the instrument", "instrument", NONE, _profile),
        Question("pattern", "point pattern, a name or a file", "pattern", _PATTERN, _pattern),
        Question("sigma", "sigma of an image coordinate, um", "sigma um", "5", _sigma),
    )


def new_block(folder: Path, answers: Answers) -> NewBlock:
    """Return the block that the answers describe.

    Parameters
    ----------
    folder
        The block's folder.
    answers
        What is not answered has its default; only strips that nobody names follow from the
        measurements.

    Raises
    ------
    InputError
        An answer is wrong.
    """
    from dataclasses import replace

    from anaplot.exchange.controlcsv import GroundPoints
    from anaplot.exchange.newblock import NewBlock
    from anaplot.photogrammetry.block import Measuring

    given = {
        question.name: question.given(
            answers.get(question.name, () if question.many else (question.default,))
        )
        for question in new_questions(folder)
    }
    camera, strips = _camera(given["camera"]), _strips(given["strip"])
    ground = _control(given["control"]) if given["control"] else GroundPoints()
    measuring = Measuring()
    if "pattern" in answers:
        measuring = _pattern(given["pattern"])
        _check_own(given["pattern"][0], folder, camera, strips)
    return NewBlock(
        _name(given["name"]),
        camera,
        strips,
        ground.control,
        ground.priors,
        _sigma(given["sigma"]),
        replace(measuring, profile=_profile(given["profile"]) if given["profile"] else None),
        ground.commas,
    )


def answered(folder: Path, answers: Answers) -> dict[str, list[str]]:
    """Return the answers but for those that are the default: block.toml need not repeat them."""
    return {
        question.name: list(answers[question.name])
        for question in new_questions(folder)
        if question.many or list(answers[question.name]) != [question.default]
    }


def camera_types() -> tuple[tuple[str, str], ...]:
    """Return the common cameras: short name, and title with the camera constant."""
    from anaplot.photogrammetry.nominalcameras import NOMINAL_CAMERAS

    return tuple((one.id, f"{one.title:30} c {one.c:g} mm") for one in NOMINAL_CAMERAS.values())


def _default_name(folder: Path) -> str:
    return real_path(folder).name or "block"


def _name(answers: Sequence[str]) -> str:
    from anaplot.textfiles.names import name_fault
    from anaplot.textfiles.wording import quoted

    fault = name_fault(answers[0])
    if fault is not None:
        raise InputError(f"the name {quoted(answers[0])} {fault}")
    return answers[0]


def _camera(answers: Sequence[str]) -> ChosenCamera:
    from anaplot.exchange.newblock import choose_camera

    return choose_camera(answers[0])


def _strips(answers: Sequence[str]) -> tuple[Strip, ...]:
    from anaplot.exchange.newblock import strip_of
    from anaplot.textfiles.wording import quoted

    strips: dict[str, Strip] = {}
    for number, text in enumerate(answers, 1):
        strip = strip_of(text, number)
        if strip.id in strips:
            raise InputError(f"strip {quoted(strip.id)} twice")
        strips[strip.id] = strip
    return tuple(strips.values())


def _control(answers: Sequence[str]) -> GroundPoints:
    from anaplot.exchange.controllist import read_control_list

    return read_control_list(Path(answers[0]))


def _profile(answers: Sequence[str]) -> str:
    from anaplot.plotter.profile import load_profile

    load_profile(answers[0])
    return answers[0]


def _pattern(answers: Sequence[str]) -> Measuring:
    """Return the pattern, by its name, or as a file that is to stand in the block's folder."""
    from anaplot.exchange.patternfile import is_pattern_file, read_pattern
    from anaplot.orientation.patterns import pattern
    from anaplot.photogrammetry.block import Measuring

    if is_pattern_file(answers[0]):
        path = Path(answers[0])
        return Measuring(pattern=path.name, points=read_pattern(path).points)
    return Measuring(pattern=pattern(answers[0]).name)


def _check_own(name: str, folder: Path, camera: ChosenCamera, strips: tuple[Strip, ...]) -> None:
    """Refuse a pattern of one's own that cannot be measured in these strips."""
    from anaplot.photogrammetry.block import Block, Photo, Precision, TestSettings
    from anaplot.station.pointpattern import point_pattern_of

    photos = (Photo(photo, camera.camera.id) for strip in strips for photo in strip.photos)
    cameras = (camera.camera,)
    block = Block("", Precision(), TestSettings(), cameras, tuple(photos), strips)
    point_pattern_of(name, folder, block)


def _sigma(answers: Sequence[str]) -> float:
    return positive(answers[0])
