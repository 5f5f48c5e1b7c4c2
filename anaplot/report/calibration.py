"""Calibration of cameras: how the options name its parameters, and what is told of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from anaplot.bundle.solve.additional import AdditionalParameters, physical
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.cameracalibration import CalibratedParameter, calibrated_cameras
from anaplot.bundle.solve.parameterpriors import ParameterPrior, checked_priors
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, Camera
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.lens import LENS_PARAMETERS
from anaplot.photogrammetry.measuredimage import mm_of_pixels
from anaplot.report.document import Block as Part
from anaplot.report.document import Document, name, number, say, table
from anaplot.textfiles.wording import hint, quoted

__all__ = ["calibration_asked", "calibration_document", "calibration_of"]

_LENGTHS = LENS_PARAMETERS[:3]
_AMOUNT = re.compile(r"([-+0-9.eE]{1,40})(px|mm)?")


class _Said(NamedTuple):
    """One parameter of an option."""

    camera: str | None
    name: str
    amount: float | None
    unit: str | None


def calibration_asked(
    block: Block,
    calibrate: str | Sequence[str] | None,
    sigmas: str | Sequence[str] | None,
    additional: str | None,
) -> AdditionalParameters | None:
    """Return what `calibration_of` makes of the options; None where none of them is given.

    Raises
    ------
    InputError
        As `calibration_of`; weights without parameters, or another set beside them.
    """
    if not calibrate:
        if sigmas:
            raise InputError("--calibrate-sigma goes with --calibrate")
        return None
    if additional is not None:
        raise InputError(
            "--calibrate and --additional are two sets of parameters: one of them (--calibrate is "
            "--additional physical:camera, chosen and weighted in the camera's own words)"
        )
    texts = [[one] if isinstance(one, str) else list(one) for one in (calibrate, sigmas or ())]
    return calibration_of(block, *texts)


def calibration_of(
    block: Block, calibrate: Sequence[str], sigmas: Sequence[str]
) -> AdditionalParameters:
    """Return the additional parameters that `--calibrate` and `--calibrate-sigma` ask for.

    Parameters
    ----------
    block
        Whose cameras are calibrated.
    calibrate
        "c,k1" of every camera, or "CAMERA:c,k1" of one; "k1=-0.05" is a whole value: what the
        parameter is tested against, weighted or held at, instead of what the camera states. c, x0
        and y0 in mm, or "c=4200px"; x0 and y0 from the stated principal point, in px from the
        upper left corner.
    sigmas
        "k1=0.01" or "CAMERA:k1=0.01": weights; 0: held at its value.

    What is said of one camera counts before what is said of all, wherever it stands.

    Raises
    ------
    InputError
        No such camera or parameter, or one twice; numbers that are none; a sigma of what is not
        calibrated.
    """
    measured = frozenset(columns_of(block.image_points).photo.values)
    used = dict.fromkeys(photo.camera for photo in block.photos if photo.id in measured)
    cameras = {camera.id: camera for camera in block.cameras if camera.id in used}
    values: dict[tuple[str, str], float | None] = {}
    for one in _said("--calibrate", calibrate, cameras):
        for camera in cameras if one.camera is None else (one.camera,):
            values[camera, one.name] = (
                None if one.amount is None else _correction(cameras[camera], one)
            )
    weights: dict[tuple[str, str], float] = {}
    for one in _said("--calibrate-sigma", sigmas, cameras):
        if one.amount is None or one.amount < 0.0:
            raise InputError(f"--calibrate-sigma {one.name}: a sigma is written as k1=0.01")
        mine = [key for key in values if key[1] == one.name and one.camera in (None, key[0])]
        if not mine:
            whose = "" if one.camera is None else f" of camera {quoted(one.camera)}"
            raise InputError(
                f"--calibrate-sigma {one.name}{whose}: it is not calibrated; name it in --calibrate"
            )
        for camera, _ in mine:
            weights[camera, one.name] = _mm(cameras[camera], one, one.amount)
    chosen = physical.only({parameter for _, parameter in values})
    priors, still = [], set()
    for camera in cameras:
        for parameter in chosen.names:
            key = camera, parameter
            if key not in values or weights.get(key) == 0.0:
                still.add(key)
            value, sigma = values.get(key), weights.get(key) or None
            if value is not None or key in weights:
                priors.append(ParameterPrior(parameter, value or 0.0, sigma, camera))
    return AdditionalParameters(
        chosen, "camera", priors=checked_priors(priors), still=frozenset(still)
    )


def _said(option: str, texts: Sequence[str], cameras: dict[str, Camera]) -> list[_Said]:
    out: list[_Said] = []
    for text in texts:
        named, colon, parts = text.rpartition(":")
        whose = named if colon else None
        if whose is not None and whose not in cameras:
            raise InputError(
                f"{option}: no camera {quoted(whose)} with image points{hint(whose, cameras)}"
            )
        for part in parts.split(","):
            parameter, equals, amount = (piece.strip() for piece in part.partition("="))
            if parameter not in LENS_PARAMETERS:
                raise InputError(
                    f"{option}: no parameter {quoted(parameter)}{hint(parameter, LENS_PARAMETERS)}"
                )
            said = _Said(whose, parameter, None, None)
            if equals:
                said = _amount(option, said, amount)
            if any((one.camera, one.name) == (whose, parameter) for one in out):
                of = "" if whose is None else f" of camera {quoted(whose)}"
                raise InputError(f"{option} {parameter}{of}: stands twice")
            out.append(said)
    # what is said of one camera counts before what is said of all, wherever it stands
    return sorted(out, key=lambda one: one.camera is not None)


def _amount(option: str, said: _Said, text: str) -> _Said:
    found = _AMOUNT.fullmatch(text)
    try:
        value = float(found[1]) if found else float("nan")
    except ValueError:
        value = float("nan")
    if found is None or not isfinite(value):
        raise InputError(f"{option} {said.name}: {quoted(text)} is no number")
    if found[2] is not None and said.name not in _LENGTHS:
        raise InputError(f"{option} {said.name}: it has no unit; c, x0 and y0 are in mm or px")
    return said._replace(amount=value, unit=found[2])


def _mm(camera: Camera, said: _Said, amount: float) -> float:
    """Return a length [mm], or a number."""
    if said.unit != "px":
        return amount
    if camera.pixels is None:
        raise InputError(f"{said.name} in px: camera {quoted(camera.id)} has no pixels")
    return amount * camera.pixel_mm


def _correction(camera: Camera, said: _Said) -> float:
    """Return a whole value minus what the camera states."""
    assert said.amount is not None
    at = LENS_PARAMETERS.index(said.name)
    value = _mm(camera, said, said.amount)
    if said.unit == "px" and said.name != "c":
        value = float(mm_of_pixels(camera, [(said.amount, said.amount)])[0, at - 1])
    if said.name == "c" and value <= 0.0:
        raise InputError(f"--calibrate c: {said.amount:g} is no camera constant")
    if said.name == "b1" and value <= -1.0:
        raise InputError(f"--calibrate b1: must be greater than -1, not {said.amount:g}")
    return value - camera.lens_parameters[at]


def _lengths(row: CalibratedParameter, *, in_px: bool) -> tuple[float | str | None, ...]:
    """Return value, s, unit, stated and correction; lengths in px where a pixel has no size."""
    unit = "mm" if row.name in _LENGTHS else ""
    if not (unit and in_px):
        return row.value, row.s, unit, row.stated, row.correction
    s = None if row.s is None else 1e3 * row.s
    return 1e3 * row.value, s, "px", 1e3 * row.stated, 1e3 * row.correction


_PARAMETERS = (
    name("camera", "CAMERA", 6),
    name("name", "PARAMETER", 9, gap=1),
    number("value", "value", 7, 14),
    number("s", "s", 7, 11),
    name("unit", least=2, gap=1, head="  "),
    number("stated", "stated", 7, 14),
    number("correction", "correction", 7, 13),
    number("value_px", "value [px]", 3, 12, unit="px"),
    number("s_px", "s [px]", 3, 9, unit="px"),
    name("freedom", gap=1, head="  "),
)


def calibration_document(block: AdjustedBlock) -> Document | None:
    """Return the document of calibrated cameras; None where no camera has parameters of its own."""
    cameras = [one for one in calibrated_cameras(block) if one.parameters]
    if not cameras:
        return None
    rows = [row for one in cameras for row in one.parameters]
    pixels = {one.stated.id for one in cameras if one.stated.pixels and not one.stated.pixel_um}
    cells = [
        (row.camera, row.name, *_lengths(row, in_px=row.camera in pixels), row.value_px, row.s_px,
         row.freedom)
        for row in rows
    ]  # fmt: skip
    in_px = any(row.value_px is not None for row in rows)
    shown = tuple(c.key for c in _PARAMETERS if in_px or not c.key.endswith("_px"))
    parameters = table("calibration", _PARAMETERS, cells, shown=shown)
    page: list[Part] = [
        say("CALIBRATION: the cameras' own values, from ideal to measured coordinates").of(
            "heading"
        ),
        parameters,
        say("  x0 and y0 from the stated principal point (in the columns [px] from the corner, y"),
        say("  down); k1 to b2 as COLMAP's OPENCV has them, p1 and p2 with y down"),
    ]
    answer = {
        "cameras": [
            {
                "camera": one.stated.id,
                "parameters": [
                    {**row._asdict(), "unit": "mm" if row.name in _LENGTHS else None}
                    for row in one.parameters
                ],
            }
            for one in cameras
        ]
    }
    return Document(answer, tuple(page), (parameters,))
