"""What self-calibration says of cameras: whole values, as a camera's file has them.

Additional parameters of a lens are corrections of what a camera states; a camera is their sum.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.lens import LENS_PARAMETERS
from anaplot.photogrammetry.measuredimage import pixels_of_mm

__all__ = ["CalibratedCamera", "CalibratedParameter", "Freedom", "calibrated_cameras"]

Freedom = Literal["free", "weighted", "held"]

_LENGTHS = LENS_PARAMETERS[:3]


class CalibratedParameter(NamedTuple):
    """A parameter of a camera's lens.

    Attributes
    ----------
    camera, name
        Whose, and which of `LENS_PARAMETERS`.
    value, s
        c, x0 and y0 [mm], the others as COLMAP has them; its standard deviation for the sigma of
        the block's test, None where it is held, or there is no redundancy.
    stated, correction
        What the camera states, and the value minus that. x0 and y0 are counted from the stated
        principal point.
    value_px, s_px
        c [px], and the principal point [px] from the upper left corner; None for the others, and
        for a camera without pixels.
    freedom
        "free", "weighted" (observed, with a standard deviation) or "held".
    """

    camera: str
    name: str
    value: float
    s: float | None
    stated: float
    correction: float
    value_px: float | None
    s_px: float | None
    freedom: Freedom


class CalibratedCamera(NamedTuple):
    """A camera and its calibration.

    Attributes
    ----------
    stated
        The camera as the block has it.
    parameters
        Those of its lens that take part.
    camera
        With the values that were found, for a file. Without pixels its principal point stays:
        x0 and y0 are beside it.
    offset
        x0, y0 [mm]: where the principal point was found, from the stated one.
    """

    stated: Camera
    parameters: tuple[CalibratedParameter, ...]
    camera: Camera
    offset: tuple[float, float]


def calibrated_cameras(block: AdjustedBlock) -> tuple[CalibratedCamera, ...]:
    """Return the cameras whose lenses have parameters of their own; none where several share them.

    Of a set for the whole block these are those of the only camera.
    """
    problem, additional = block.problem, block.problem.additional
    if additional is None or problem.lens_units is None:
        return ()
    used = [problem.block.cameras[k] for k in np.unique(problem.cameras).tolist()]
    by_name = {camera.id: camera for camera in used}
    if additional.scope == "camera":
        cameras = [by_name[name] for name in problem.additional_groups]
    elif len(problem.additional_groups) == 1 and len(used) == 1:
        cameras = used
    else:
        return ()
    names = additional.set.names
    still = problem.additional_still
    asked = {(prior.group, prior.parameter) for prior in additional.priors}
    rows = {(row.group, row.name): row for row in block.parameter_rows()}
    out = []
    for k, (group, camera) in enumerate(zip(problem.additional_groups, cameras, strict=True)):
        lens = np.array(camera.lens_parameters)
        if problem.lens_held is not None:
            lens += problem.lens_held[k]
        known = []
        for j, name in enumerate(names):
            at, stated = LENS_PARAMETERS.index(name), camera.lens_parameters
            fixed = still is not None and bool(still[k, j])
            unit = float(problem.lens_units[k, j])
            q = float(problem.additional_given[k, j]) if fixed else rows[group, name].value
            s = None if fixed else rows[group, name].s_coefficient
            lens[at] += q * unit
            if fixed and lens[at] == stated[at] and (group, name) not in asked:
                continue  # as the camera states it: nothing was asked of it
            weighted = len(problem.additional_sigma) and np.isfinite(problem.additional_sigma[k, j])
            freedom: Freedom = "held" if fixed else "weighted" if weighted else "free"
            known.append(_parameter(camera, name, lens[at], s, freedom))
        for name in () if additional.held is None else additional.held.names:
            known.append(_parameter(camera, name, lens[LENS_PARAMETERS.index(name)], None, "held"))
        found = _with_lens(camera, lens.tolist())
        out.append(CalibratedCamera(camera, tuple(known), found, (lens[1], lens[2])))
    return tuple(out)


def _parameter(
    camera: Camera, name: str, value: float, s: float | None, freedom: Freedom
) -> CalibratedParameter:
    stated = camera.lens_parameters[LENS_PARAMETERS.index(name)]
    value_px = s_px = None
    if camera.pixels is not None and name in _LENGTHS:
        px = pixels_of_mm(camera, [(value, value)])[0]
        by_name = {"c": value / camera.pixel_mm, "x0": float(px[0]), "y0": float(px[1])}
        value_px = by_name[name]
        s_px = None if s is None else s / camera.pixel_mm
    return CalibratedParameter(
        camera.id, name, float(value), s, stated, float(value - stated), value_px, s_px, freedom
    )


def _with_lens(camera: Camera, lens: list[float]) -> Camera:
    """Return a camera with ten parameters of a lens as its own."""
    c, x0, y0, *coefficients = lens
    brown = BrownLens(*coefficients)
    found = replace(camera, c=c, lens=brown if any(coefficients) else None)
    if camera.pixels is not None:
        x, y = pixels_of_mm(camera, [(x0, y0)])[0].tolist()
        found = replace(found, principal_px=(x, y))
    return found
