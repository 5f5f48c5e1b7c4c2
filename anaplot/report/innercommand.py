"""The command `anaplot inner`: measured fiducials in, inner orientations or image points out."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence

from anaplot.errors import InputError, NotComputableError
from anaplot.exchange.blockfolder import block_files
from anaplot.exchange.fiducialfile import FiducialMeasurements, read_fiducials
from anaplot.photogrammetry.inner import (
    TRANSFORMATIONS,
    InnerOrientation,
    TransformationName,
    orient_inner,
)
from anaplot.report.applieddocument import applied_document
from anaplot.report.innerapply import OrientedPhoto, carried, merged, points_of, write
from anaplot.report.innerdocument import InnerGroup, inner_documents
from anaplot.report.output import Output
from anaplot.report.progress import working
from anaplot.report.streams import complain
from anaplot.textfiles.wording import hint, place, quoted

__all__ = ["orient_photos", "run_inner"]


def run_inner(options: argparse.Namespace) -> int:
    """Orient the photographs of some files and print the results, or apply them to a block.

    Raises
    ------
    InputError
        A file, its camera file, a block or the name of the transformation is wrong; the block is
        as it was.
    """
    name = options.transformation
    wanted = next((known for known in TRANSFORMATIONS if known == name), None)
    if name is not None and wanted is None:
        raise InputError(f"unknown transformation {quoted(name)}{hint(name, TRANSFORMATIONS)}")
    if (options.apply is None) != (not options.points):
        raise InputError("--apply BLOCK goes with --points FILE, the points to be applied")
    if options.apply is None and (options.replace or options.as_given):
        raise InputError("--replace and --as-given go with --apply")
    files = [read_fiducials(path) for path in options.file]
    _refuse_twice(files)
    output = Output.of(options)
    reads = [*options.file, *options.points, *(file.camera_file for file in files)]
    reads += [file.measured_file for file in files if file.measured_file is not None]
    if options.apply is not None:
        reads += block_files(options.apply)
    output.check({"is read": reads})
    if options.apply is not None:
        return _apply(options, files, wanted, output)
    with working("inner orientations"):
        groups = [InnerGroup(file.camera, orient_photos(file, wanted), file.unit) for file in files]
    output.show(inner_documents(groups))
    found = [one for group in groups for one in group.photos]
    if _complained(found):
        return NotComputableError.exit_code
    return 1 if options.fail_on_flag and _wrong(found) else 0


def orient_photos(
    file: FiducialMeasurements,
    transformation: TransformationName | None = None,
    only: Collection[str] | None = None,
) -> list[tuple[str, InnerOrientation | str]]:
    """Return name and inner orientation of each photograph of a file, or why there is none.

    Parameters
    ----------
    file
        The measured fiducials.
    transformation
        Instead of the one chosen from the data at hand.
    only
        The photos that are asked for; all of them when left out.
    """
    found: list[tuple[str, InnerOrientation | str]] = []
    for photo in file.photos:
        if only is not None and photo.photo not in only:
            continue
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


def _apply(
    options: argparse.Namespace,
    files: Sequence[FiducialMeasurements],
    wanted: TransformationName | None,
    output: Output,
) -> int:
    measured = points_of(options.apply, options.points, files[0].camera_file)
    groups = [
        InnerGroup(file.camera, orient_photos(file, wanted, measured.photos), file.unit)
        for file in files
    ]
    found = [one for group in groups for one in group.photos]
    if _complained(found):
        complain("nothing is written")
        return NotComputableError.exit_code
    oriented = {
        photo: OrientedPhoto(file, inner)
        for file, group in zip(files, groups, strict=True)
        for photo, inner in group.photos
        if isinstance(inner, InnerOrientation)
    }
    photos = carried(measured, oriented, as_given=options.as_given)
    rows = merged(measured, photos, replace=options.replace)
    document = applied_document(measured, groups, photos, _without_points(files, measured.photos))
    write(measured, rows)
    _, points, _ = block_files(options.apply)
    output.show_done(document, f"the points are written into {place(points)}")
    return 1 if options.fail_on_flag and _wrong(found) else 0


def _refuse_twice(files: Sequence[FiducialMeasurements]) -> None:
    """Refuse a photo whose fiducials stand in two files."""
    first: dict[str, int] = {}
    for k, file in enumerate(files):
        for photo in file.photos:
            other = first.setdefault(photo.photo, k)
            if other != k:
                raise file.fail(
                    photo.photo,
                    f"photo {quoted(photo.photo)} stands in {place(files[other].path)} too",
                )


def _without_points(files: Sequence[FiducialMeasurements], photos: Collection[str]) -> list[str]:
    return [one.photo for file in files for one in file.photos if one.photo not in photos]


def _complained(found: Sequence[tuple[str, InnerOrientation | str]]) -> bool:
    """Say which photos have no inner orientation; return whether there are any."""
    errors = [(photo, why) for photo, why in found if isinstance(why, str)]
    for photo, why in errors:
        complain(f"photo {photo}: {why}")
    return bool(errors)


def _wrong(found: Sequence[tuple[str, InnerOrientation | str]]) -> bool:
    """Return whether a test does not accept what was measured."""
    oriented = [inner for _, inner in found if isinstance(inner, InnerOrientation)]
    return any(inner.flagged or inner.refused for inner in oriented)
