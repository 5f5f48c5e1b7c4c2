"""A new block from a few answers: its commented block.toml, its camera file, its control."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import (
    block_files,
    with_image_points,
    write_control,
    write_new_block,
)
from anaplot.exchange.blocktoml import (
    BLOCK_FORMAT,
    camera_texts,
    measuring_lines,
    parse_block_toml,
)
from anaplot.exchange.camerafile import pixel_lines, read_camera
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Measuring,
    PointPrior,
    Precision,
    Strip,
    TestSettings,
    calibrated_camera,
)
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.nominalcameras import NOMINAL_CAMERAS
from anaplot.photogrammetry.photorange import photo_range, split_range
from anaplot.photogrammetry.selection import model_splits
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.tomltext import toml_number, toml_numbers, toml_text
from anaplot.textfiles.wholefile import all_or_nothing, make_folder
from anaplot.textfiles.wording import hint, place, plain, quoted

__all__ = ["ChosenCamera", "NewBlock", "choose_camera", "strip_of", "strips_of_models", "write_new"]

_PRECISION = Precision(tie_variance="exact")
_TEST = TestSettings()


@dataclass(frozen=True, slots=True)
class ChosenCamera:
    """A camera, and what is to be said of it.

    Attributes
    ----------
    camera
        As block.toml declares it.
    remark
        What people are to know of its values.
    """

    camera: Camera
    remark: str


@dataclass(frozen=True, slots=True)
class NewBlock:
    """What is known of a new block.

    Attributes
    ----------
    name
        Its name.
    camera
        Its only camera.
    strips
        Its strips; none where models are not to be formed.
    control, priors
        Its control points, and what else is known of points.
    image_um
        Standard deviation of an image coordinate [um].
    measuring
        With what it is measured.
    commas
        How many numbers of the list of control points had a decimal comma.
    """

    name: str
    camera: ChosenCamera
    strips: tuple[Strip, ...] = ()
    control: tuple[ControlPoint, ...] = ()
    priors: tuple[PointPrior, ...] = ()
    image_um: float = _PRECISION.image_um
    measuring: Measuring = field(default_factory=Measuring)
    commas: int = 0


def choose_camera(text: str) -> ChosenCamera:
    """Return the camera that a person names.

    Parameters
    ----------
    text
        The short name of a common camera, a camera file, or a camera constant in mm.

    Raises
    ------
    InputError
        None of these.
    """
    nominal = NOMINAL_CAMERAS.get(text.lower())
    if nominal is not None:
        remark = f"nominal values of the {nominal.title}: replace them by the certificate's"
        return _with_file(nominal.calibration(), remark)
    try:
        c = float(text)
    except ValueError:
        c = 0.0
    if 0.0 < c < 1e6:
        return ChosenCamera(Camera("camera", c), "nothing but its constant is known")
    path = Path(text)
    if path.suffix or os.path.lexists(path):
        return _with_file(read_camera(path), f"as {plain(path.name, 100)} says")
    raise InputError(
        f"camera {quoted(text)}: neither a common type{hint(text, NOMINAL_CAMERAS)}, nor a camera"
        " file, nor a camera constant in mm"
    )


def _with_file(calibration: CameraCalibration, remark: str) -> ChosenCamera:
    stem = "".join(sign if sign.isalnum() or sign in "-_." else "-" for sign in calibration.id)
    file = f"camera-{stem}.toml"
    return ChosenCamera(calibrated_camera(calibration, file), remark)


def strip_of(text: str, number: int) -> Strip:
    """Return the strip that a person names.

    Parameters
    ----------
    text
        "101-120", "220-201" (counts down), "101,102,105", or one of these after "NAME=".
    number
        The strip's name where it is given none.

    Raises
    ------
    InputError
        It names no photos, or fewer than two, or one twice; or several ranges, with commas.
    """
    name, equals, named = text.partition("=")
    if not equals:
        name, named = str(number), text
    name = name.strip()
    parts = tuple(part.strip() for part in named.split(","))
    if _several_ranges(parts):
        raise InputError(
            f"strip {quoted(text)}: commas part photos; every strip stands on its own: "
            + plain("; ".join(parts), 200)
        )
    ends = split_range(named.strip())
    try:
        photos = photo_range(*ends) if ends is not None and len(parts) == 1 else parts
    except ValueError as error:
        raise InputError(f"strip {quoted(text)}: {plain(str(error), 200)}") from None
    if len(photos) < 2:
        raise InputError(
            f"strip {quoted(text)}: fewer than 2 photos (FIRST-LAST, or names with commas)"
        )
    for what, one in (("strip", name), *(("photo", p) for p in photos)):
        fault = name_fault(one)
        if fault is not None:
            raise InputError(f"strip {quoted(text)}: the {what} name {quoted(one)} {fault}")
    twice = next((photo for photo in photos if photos.count(photo) > 1), None)
    if twice is not None:
        raise InputError(f"strip {quoted(text)}: photo {quoted(twice)} twice")
    return Strip(name, photos)


def _several_ranges(parts: Sequence[str]) -> bool:
    """Whether what commas part can only be meant as ranges: numbers alike, no photo twice.

    1-101 and 1-102 are names, though each could be a range as well.
    """
    seen: set[str] = set()
    for part in parts:
        ends = split_range(part)
        if len(parts) == 1 or ends is None or len(ends[0]) != len(ends[1]):
            return False
        try:
            photos = photo_range(*ends)
        except ValueError:
            return False
        if len(photos) < 2 or not seen.isdisjoint(photos):
            return False
        seen.update(photos)
    return True


def strips_of_models(rows: Iterable[ImagePoint]) -> tuple[Strip, ...]:
    """Return the strips that the models of image points make: each goes on where one ended."""
    chains: list[list[str]] = []
    rows = tuple(rows)
    photos = {row.photo for row in rows}
    for name in dict.fromkeys(row.model for row in rows if row.model is not None):
        splits = model_splits(name)
        left, right = next((one for one in splits if photos.issuperset(one)), splits[0])
        after = next((chain for chain in chains if chain[-1] == left), None)
        before = next((chain for chain in chains if chain[0] == right), None)
        if after is not None and after is before:
            raise InputError(f"image_points.csv: the models make a ring at {quoted(name)}")
        if after is not None:
            after.append(right)
        if after is not None and before is not None:
            after += before[1:]
            chains.remove(before)
        elif before is not None:
            before.insert(0, left)
        elif after is None:
            chains.append([left, right])
    return tuple(Strip(str(number), tuple(chain)) for number, chain in enumerate(chains, 1))


def write_new(folder: Path, new: NewBlock) -> Block:
    """Write a new block; an image_points.csv or control.csv that is there stays.

    Parameters
    ----------
    folder
        Its folder, made when it does not exist.
    new
        What is known of it. Without strips they follow from the `model` column of
        image_points.csv, where it has one.

    Returns
    -------
    Block
        As it was written.

    Raises
    ------
    InputError
        There is a block already, a file there says something else, there is no photo at all, or
        it cannot be written: then no part of it is there.
    """
    path, points, control = block_files(folder)
    if os.path.lexists(path):
        raise InputError(f"{place(path)}: exists already and is not overwritten")
    block = Block(
        new.name,
        replace(_PRECISION, image_um=new.image_um),
        _TEST,
        (new.camera.camera,),
        (),
        (),
        measuring=new.measuring,
    )
    strips = new.strips
    if os.path.lexists(points):
        measured = with_image_points(folder, block).image_points
        strips = strips or strips_of_models(measured)
    text = _text(replace(block, strips=strips), new.camera.remark)
    # the strips may know fewer photos than the measurements
    parsed = replace(parse_block_toml(text, path, camera_texts(block)), measuring=new.measuring)
    block = with_image_points(folder, parsed)
    if not block.photos:
        raise InputError(
            f"{place(folder)}: no photo: name the photos of a strip (--strip 101-120), or put an"
            " image_points.csv there"
        )
    known = bool(new.control or new.priors)
    if known and os.path.lexists(control):
        raise InputError(f"{place(control)}: exists already and is not overwritten")
    with all_or_nothing():
        make_folder(folder)
        if known:
            write_control(folder, new.control, new.priors)
        # block.toml is the last file: without it there is no block
        write_new_block(folder, block, text=text, remark=new.camera.remark)
    return replace(block, control=new.control, priors=new.priors)


def _text(block: Block, remark: str) -> str:
    """Return a block.toml with comments for whoever changes it."""
    camera = block.cameras[0]
    lines: list[str] = [
        "# A block of anaplot. Everything here may be changed; image coordinates are in mm.",
        f"format = {BLOCK_FORMAT}",
        f"name = {toml_text(block.name)}",
        "",
        "[precision]",
        *_commented(
            (f"image_um = {toml_number(block.precision.image_um)}", "of an image coordinate, um"),
            (
                f"tie_variance = {toml_text(block.precision.tie_variance)}",
                "models know the errors of their ties",
            ),
            (
                f"control_m = {toml_number(block.precision.control_m)}",
                "of control without standard deviations, m",
            ),
        ),
        "",
        "[test]",
        *_commented(
            (f"kind = {toml_text(block.test.kind)}", '"tau", or "baarda": image_um is believed'),
            (f"alpha = {toml_number(block.test.alpha)}", "significance of one test"),
            (f"power = {toml_number(block.test.power)}", "of smallest detectable errors"),
        ),
        *measuring_lines(block.measuring),
        "",
        f"[[camera]]  # {plain(remark)}",
        f"id = {toml_text(camera.id)}",
        f"c = {toml_number(camera.c)}",
    ]
    if camera.pixels is None and camera.format is not None:
        lines.append(f"format = {toml_numbers(*camera.format)}")
    lines += pixel_lines(camera)
    if camera.file is not None:
        lines.append(f"file = {toml_text(camera.file)}")
    for strip in block.strips:
        lines += ["", "[[strip]]", f"id = {toml_text(strip.id)}", *_photos(strip.photos)]
    if not block.strips:
        lines += ["", "# Models need [[strip]]s: id, and first and last photo, or photos."]
    lines += [
        "",
        "# A photo of which more is known: [[photo]] with id, camera, position, rotation.",
    ]
    return "\n".join(lines) + "\n"


def _commented(*pairs: tuple[str, str]) -> list[str]:
    width = max(len(line) for line, _ in pairs) + 2
    return [f"{line:{width}}# {comment}" for line, comment in pairs]


def _photos(photos: Sequence[str]) -> list[str]:
    first, last = photos[0], photos[-1]
    try:
        counted = photo_range(first, last)
    except ValueError:
        counted = ()
    if len(photos) > 2 and counted == tuple(photos):
        return [f"first = {toml_text(first)}", f"last = {toml_text(last)}"]
    return [f"photos = [{', '.join(map(toml_text, photos))}]"]
