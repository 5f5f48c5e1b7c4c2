"""The command `anaplot inner FILE`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from anaplot.errors import InputError, NotComputableError

__all__ = ["INNER_HELP", "add_inner_arguments", "run_inner"]

INNER_HELP = """\
FILE holds the measured fiducials [mm on the plate] of one or several photos:

  format = 1
  camera = "rmk.toml"          beside FILE, or an absolute path
  sigma_um = 5.0               a priori, may be left out
  [test]                       as in block.toml, may be left out
  kind = "tau"
  [photo.101]
  1 = [14.021, 226.110]
  2 = [226.017, 225.934]

and the camera file what its certificate says:

  format = 1
  [camera]
  id = "rmk"
  c = 152.40
  [fiducials]                  mm; with distances only, instead:
  1 = [-106.003, 106.001]        [distances]
  2 = [106.000, 105.998]         mm = [["1", "3", 226.002], ["4", "2", 226.010]]

The transformation is chosen from the data at hand: three fiducials Helmert, four affine, more
bilinear, distances only a two-parameter similarity. NAME is one of distances, scales, helmert,
affine, bilinear, projective. RESID is adjusted minus measured, along the image's axes.

exit codes: 1 with --fail-on-flag when a row is flagged or sigma0 exceeds its limit (n good rows:
with the probability alpha (n + 1) at most, alpha of [test]), 2 bad input, 4 not computable

example: anaplot inner fiducials.toml --transformation affine
"""


def add_inner_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments and its help to a parser."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = INNER_HELP
    parser.add_argument("file", type=Path, metavar="FILE", help="measured fiducials (see below)")
    parser.add_argument(
        "--transformation", metavar="NAME", help="instead of the one chosen from the data"
    )
    parser.add_argument("--json", action="store_true", help="print JSON for programs")
    parser.add_argument(
        "--fail-on-flag",
        action="store_true",
        help="exit with 1 when a row is flagged or sigma0 exceeds its limit",
    )


def run_inner(options: argparse.Namespace) -> int:
    """Orient every photograph of a file, print the results, return the exit code.

    Parameters
    ----------
    options
        `file` (Path), `transformation` (str or None), `json`, `fail_on_flag` (bool).

    Raises
    ------
    InputError
        The file, its camera file or the name of the transformation is wrong.
    """
    # what the command needs is loaded when it runs, not when the command line is read
    from anaplot.exchange.fiducialfile import read_fiducials
    from anaplot.photogrammetry.inner import TRANSFORMATIONS, InnerOrientation, orient_inner
    from anaplot.report.innercontract import inner_json
    from anaplot.report.innertext import camera_remarks, inner_printout
    from anaplot.textfiles.wording import hint, plain, quoted

    name = options.transformation
    wanted = next((known for known in TRANSFORMATIONS if known == name), None)
    if name is not None and wanted is None:
        raise InputError(f"unknown transformation {quoted(name)}{hint(name, TRANSFORMATIONS)}")
    file = read_fiducials(options.file)
    found: list[tuple[str, InnerOrientation | str]] = []
    for photo in file.photos:
        try:
            found.append(
                (
                    photo.photo,
                    orient_inner(
                        file.camera,
                        {fiducial: (x, y) for fiducial, x, y in photo.measured},
                        transformation=wanted,
                        apriori_um=file.sigma_um,
                        test=file.test,
                    ),
                )
            )
        except NotComputableError as error:
            found.append((photo.photo, str(error)))
    oriented = [inner for _, inner in found if isinstance(inner, InnerOrientation)]
    if options.json:
        print(json.dumps(inner_json(file.camera, found), indent=1, allow_nan=False))
    else:
        for photo_name, inner in found:
            if isinstance(inner, InnerOrientation):
                print(inner_printout(photo_name, inner), end="\n\n")
        for remark in camera_remarks(file.camera):
            print(plain(remark))
    errors = [(photo_name, why) for photo_name, why in found if isinstance(why, str)]
    for photo_name, why in errors:
        print(f"anaplot: photo {plain(photo_name)}: {plain(why)}", file=sys.stderr)
    if errors:
        return NotComputableError.exit_code
    if options.fail_on_flag and any(inner.flagged or inner.refused for inner in oriented):
        return 1
    return 0
