"""What `inner` takes; light, `--help` reads it."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.report.arguments import add_output

__all__ = ["INNER_HELP", "add_inner_arguments"]

INNER_HELP = """\
FILE holds the measured fiducials of one or several photos, on the plate or in the scan:

  format = 1
  camera = "rmk.toml"          beside FILE, or an absolute path
  unit = "mm"                  or um, px, count; mm when left out
  sigma_um = 5.0               a priori, in the image; may be left out
  [test]                       as in block.toml, may be left out
  kind = "tau"
  [photo.101]
  1 = [14.021, 226.110]
  2 = [226.017, 225.934]

(of many photos: measured = "fiducials.csv" with photo,fiducial,x,y instead of [photo.NAME])

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
affine, bilinear, projective. RESID is adjusted minus measured, along the image's axes. Plate axes
may be turned and mirrored (y of a scan runs down); the fiducials say how.

With --apply the points of the files given by --points become image points of a block, through the
inner orientation found and the camera's refinement:

  photo,point,x,y              as image_points.csv, but x, y on the plate, in the same unit;
  101,7,84.121,203.482         with a column sigma (in that unit) or sigma_um, where they differ

All photos or none: where a photo cannot be oriented, is flagged, is mirrored and others of its file
are not, has another scale than its unit, or has rows in the block already, nothing is written.

exit codes: 1 with --fail-on-flag when a row is flagged or sigma0 exceeds its limit (n good rows:
with the probability alpha (n + 1) at most, alpha of [test]), 2 bad input, 4 not computable


"""


def add_inner_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments and its help to a parser."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = INNER_HELP
    parser.add_argument(
        "file", type=Path, nargs="+", metavar="FILE", help="measured fiducials (see below)"
    )
    parser.add_argument(
        "--transformation", metavar="NAME", help="instead of the one chosen from the data"
    )
    parser.add_argument(
        "--points",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="points measured on the plates, to be applied; may be given again",
    )
    parser.add_argument(
        "--apply",
        type=Path,
        metavar="BLOCK",
        help="put the points into image_points.csv of a block",
    )
    parser.add_argument(
        "--replace",
        action="store_true",
        help="with --apply: in place of the rows that these photos have already",
    )
    parser.add_argument(
        "--as-given",
        action="store_true",
        help="with --apply: also through inner orientations that are flagged, mirrored against "
        "others of their file, or of another scale than their unit",
    )
    add_output(parser, "the fiducials")
    parser.add_argument(
        "--fail-on-flag",
        action="store_true",
        help="exit with 1 when a row is flagged or sigma0 exceeds its limit",
    )
