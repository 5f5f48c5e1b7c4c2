"""The command `anaplot inner`: measured fiducials in, inner orientations out."""

from __future__ import annotations

import argparse

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.fiducialfile import FiducialMeasurements, read_fiducials
from anaplot.photogrammetry.inner import (
    TRANSFORMATIONS,
    InnerOrientation,
    TransformationName,
    orient_inner,
)
from anaplot.report.innerdocument import inner_document
from anaplot.report.output import Output
from anaplot.report.streams import complain
from anaplot.textfiles.wording import hint, quoted

__all__ = ["orient_photos", "run_inner"]


def run_inner(options: argparse.Namespace) -> int:
    """Orient every photograph of a file, print the results, return the exit code.

    Raises
    ------
    InputError
        The file, its camera file or the name of the transformation is wrong.
    """
    name = options.transformation
    wanted = next((known for known in TRANSFORMATIONS if known == name), None)
    if name is not None and wanted is None:
        raise InputError(f"unknown transformation {quoted(name)}{hint(name, TRANSFORMATIONS)}")
    file = read_fiducials(options.file)
    output = Output.of(options)
    output.check({"is read": (options.file, file.camera_file)})
    found = orient_photos(file, wanted)
    output.show(inner_document(file.camera, found))
    errors = [(photo, why) for photo, why in found if isinstance(why, str)]
    for photo, why in errors:
        complain(f"photo {photo}: {why}")
    if errors:
        return NotComputableError.exit_code
    oriented = [inner for _, inner in found if isinstance(inner, InnerOrientation)]
    wrong = any(inner.flagged or inner.refused for inner in oriented)
    return 1 if options.fail_on_flag and wrong else 0


def orient_photos(
    file: FiducialMeasurements, transformation: TransformationName | None = None
) -> list[tuple[str, InnerOrientation | str]]:
    """Return name and inner orientation of each photograph of a file, or why there is none.

    Parameters
    ----------
    file
        The measured fiducials.
    transformation
        Instead of the one chosen from the data at hand.
    """
    found: list[tuple[str, InnerOrientation | str]] = []
    for photo in file.photos:
        measured = {fiducial: (x, y) for fiducial, x, y in photo.measured}
        try:
            inner = orient_inner(
                file.camera,
                measured,
                transformation=transformation,
                apriori_um=file.sigma_um,
                test=file.test,
            )
            found.append((photo.photo, inner))
        except NotComputableError as error:
            found.append((photo.photo, str(error)))
    return found
