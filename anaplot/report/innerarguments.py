"""What `inner` takes; light, `--help` reads it."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.report.arguments import add_output

__all__ = ["INNER_HELP", "add_inner_arguments"]

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
    add_output(parser, "the fiducials")
    parser.add_argument(
        "--fail-on-flag",
        action="store_true",
        help="exit with 1 when a row is flagged or sigma0 exceeds its limit",
    )
