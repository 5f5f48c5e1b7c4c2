"""What the commands on measured blocks take; light, `--help` reads it."""

from __future__ import annotations

import argparse
from pathlib import Path

from anaplot.report.arguments import (
    add_matrix,
    add_output,
    add_report_page,
    between,
    correlation,
    length,
    names,
    none_or_percentage,
    planted,
    positive,
    positive_or_none,
    redundancy_number,
    significance,
)

__all__ = [
    "add_adjust_arguments",
    "add_apply_arguments",
    "add_bridge_arguments",
    "add_compare_arguments",
    "add_fit_arguments",
]


def add_bridge_arguments(bridge: argparse.ArgumentParser) -> None:
    """Add what `bridge` takes."""
    bridge.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    _add_planted(bridge)
    add_matrix(bridge)
    bridge.add_argument(
        "--correlations",
        action="store_true",
        help="print the correlations of each model's orientation elements; --json always has them",
    )
    add_output(bridge, "the rows of the models")
    add_report_page(bridge)
    bridge.add_argument(
        "--fail-on-flag",
        action="store_true",
        help="exit with 1 when a row is flagged; of n good ones alpha n are, alpha of [test]",
    )
    bridge.add_argument(
        "--errors",
        choices=("baarda", "tau", "rms", "modified", "huber", "danish", "l1", "search", "odds"),
        metavar="NAME",
        help="take out what this strategy rejects before the next model: baarda, tau, rms, "
        "modified, huber, danish, l1, search or odds",
    )
    bridge.add_argument(
        "--partner",
        type=correlation,
        metavar="LIMIT",
        help="with --errors: correlation of residuals from which two rows are named as hard to "
        "tell apart, default 0.9",
    )
    bridge.add_argument(
        "--as-given",
        action="store_true",
        help="with --errors: clean also where the residuals say that image_um cannot be right",
    )
    bridge.add_argument(
        "--pairs", action="store_true", help="with --errors: add the odds over two gross errors"
    )


def _add_planted(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--plant",
        type=planted,
        metavar="PHOTO:POINT:AXIS:UM",
        help="show what an error in an image coordinate would do; several with commas between",
    )


def add_adjust_arguments(adjust: argparse.ArgumentParser) -> None:
    """Add what `adjust` takes."""
    adjust.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    _add_planted(adjust)
    add_output(adjust, "the points")
    adjust.add_argument(
        "--fail-on-flag",
        action="store_true",
        help="exit with 1 when an observation is flagged; of n good ones alpha n are, alpha of "
        "[test]",
    )
    adjust.add_argument(
        "--time-limit",
        type=between(0.1, 1e6),
        metavar="SECONDS",
        help="end then: a search (--errors, --thin) with the best that it has found, anything else "
        "with 4 and how far it came",
    )
    adjust.add_argument(
        "--datum",
        choices=("control", "minimal", "free"),
        default="control",
        help="from control and priors (the default; a report without it takes a free one where "
        "they leave it open, and says so), minimal, or free by inner constraints",
    )
    adjust.add_argument(
        "--additional",
        metavar="SET",
        help="additional parameters: ebner, gruen, gruen50 or physical (a lens: c, x0, y0, k1, k2, "
        "k3, p1, p2, b1, b2; c > 0: longer), with :block (the default), :strip, :camera or :photo; "
        "some of them as ebner:b1,b2 or gruen:-a43; auto, auto:SET: chosen by tests, step by step",
    )
    adjust.add_argument(
        "--additional-sigma-um",
        type=positive,
        metavar="UM",
        help="weigh the additional parameters by what they may do at the edge of the format",
    )
    _add_prior(adjust)
    _add_calibration(adjust)
    _add_offsets(adjust)
    adjust.add_argument(
        "--snooping",
        action="store_true",
        help="add the modified data snooping of 1980 beside the exact test, differences counted",
    )
    adjust.add_argument(
        "--snooping-tolerance",
        type=none_or_percentage,
        metavar="PERCENT",
        help="its k_q: what sqrt(q_vv) may differ from its model value, default 25; 0: the model "
        "values alone decide",
    )
    adjust.add_argument(
        "--snooping-model",
        "--snooping-values",
        metavar="MODEL",
        help="its model values: sampled, from a few exact ones of this block (the default); paper, "
        "those printed in 1980 for the regular 60/60 block that is most like it, or 3x3, 3x3-twin, "
        "5x5, 5x5-twin for that one; or a file that plan block --csv has written",
    )
    adjust.add_argument(
        "--snooping-bridging",
        type=length,
        metavar="BASES",
        help="of control the paper's curves, at this distance from control to control",
    )
    adjust.add_argument(
        "--correlations",
        type=correlation,
        metavar="LIMIT",
        help="name the pairs of a point's rays whose residuals are correlated at LIMIT or more",
    )
    adjust.add_argument(
        "--test-set",
        action="append",
        metavar="SET",
        help="test observations together: point:POINT, photo:PHOTO, ray:PHOTO:POINT, or a file "
        "(set,photo,point,axis,condition,share); may stand several times",
    )
    adjust.add_argument(
        "--function",
        action="append",
        metavar="FUNCTION",
        help="a function of coordinates with its standard deviation and what an undetected error "
        "does to it: 'distance A B', 'height A B', 'centre A B C'; may stand several times",
    )
    adjust.add_argument(
        "--hypothesis-alpha",
        type=significance,
        default=0.05,
        metavar="ALPHA",
        help="significance of the tests of additional parameters, check points and control, "
        "default 0.05",
    )
    adjust.add_argument(
        "--errors",
        choices=("baarda", "tau", "rms", "modified", "huber", "danish", "l1", "search", "odds"),
        metavar="NAME",
        help="reject what this strategy finds, coordinate by coordinate, and adjust again: baarda, "
        "tau, rms, modified, huber, danish, l1, search or odds",
    )
    adjust.add_argument(
        "--control-last",
        action="store_true",
        help="with --errors: clean the image coordinates without control (under priors, or as a "
        "free network), then bring control in and clean that",
    )
    adjust.add_argument(
        "--partner",
        type=correlation,
        metavar="LIMIT",
        help="with --errors: correlation of residuals from which two observations are named as "
        "hard to tell apart, default 0.9",
    )
    adjust.add_argument(
        "--as-given",
        action="store_true",
        help="with --errors: clean also where the residuals say that image_um cannot be right",
    )
    adjust.add_argument(
        "--pairs",
        action="store_true",
        help="with --errors: add the odds over one and two gross errors",
    )
    adjust.add_argument(
        "--thin",
        nargs="?",
        const=0.3,
        type=redundancy_number,
        metavar="R",
        help="leave out as many tie points as can go while the mean redundancy number of every "
        "photo, and of every ninth of its format, stays at least R, default 0.3; what is lost is "
        "said",
    )
    adjust.add_argument(
        "--prior",
        choices=("known", "common", "separate"),
        metavar="FACTORS",
        help="how good image coordinates and prior knowledge (weighted control, stated positions "
        "and angles, weighted additional parameters) are: known, as stated; common, one unknown "
        "variance factor for both; separate, one for each, estimated",
    )
    adjust.add_argument(
        "--given",
        metavar="FILE.npz",
        help="take what an earlier adjustment wrote with --posterior, as far as this block knows "
        "its points and photos, as a prior with its full covariance, and test it",
    )
    adjust.add_argument(
        "--given-without",
        metavar="NAMES",
        help="leave these of its points and photos out, with commas between: a point that has "
        "moved since",
    )
    adjust.add_argument(
        "--posterior",
        metavar="FILE.npz",
        help="write coordinates and their full covariance [m, rad] for the a-priori sigma0: names, "
        "x and C of numpy.load",
    )
    adjust.add_argument(
        "--posterior-of",
        metavar="NAMES",
        help="of which: points (the default), photos, or names of points and photos, with commas "
        "between",
    )
    adjust.add_argument(
        "--covariance",
        nargs="+",
        action="extend",
        metavar="OF",
        help="after BLOCK (--covariance=OF also before it): the covariance of any unknowns, with "
        "error ellipses and distances: "
        "points:A,B photos:101 parameters:c,k1; points, photos, parameters, offsets for all; "
        "point:NAME, photo:NAME for a name that holds commas; point:7:Z for one unknown",
    )
    adjust.add_argument(
        "--covariance-to",
        metavar="FILE.npz",
        help="with --covariance: write it too: names, units, x, covariance and factor of "
        "numpy.load; of more unknowns than are shown",
    )
    adjust.add_argument(
        "--control-page",
        action="store_true",
        help="add a page for every control and check point: which errors in it would be found, "
        "what they would move, and what the block is without it",
    )
    adjust.add_argument(
        "--components",
        nargs="?",
        const="axes",
        choices=("kinds", "axes", "strips", "operators"),
        metavar="GROUPING",
        help="estimate the variances of image coordinates, control and priors: kinds, axes (x and "
        "y apart, the default), strips or operators (image coordinates by strip, by operator)",
    )
    adjust.add_argument(
        "--operators",
        type=Path,
        metavar="FILE",
        help="for --components operators: a CSV file of photo,operator",
    )


def _add_offsets(parser: argparse.ArgumentParser) -> None:
    for kind, what, unit in (
        ("shift", "off by the same", "M"),
        ("drift", "off by what grows with the time", "M/S"),
    ):
        parser.add_argument(
            f"--gnss-{kind}",
            choices=("none", "block", "strip"),
            help=f"whether the stated positions of the photos of a strip, or of the block, are "
            f"{what}: unknowns, tested; otherwise what [gnss] of block.toml says",
        )
        parser.add_argument(
            f"--gnss-{kind}-sigma",
            type=positive_or_none,
            metavar=unit,
            help="its a-priori standard deviation in X, Y and Z, or none: free"
            + (" (without times: m a photo)" if kind == "drift" else ""),
        )
    parser.add_argument(
        "--imu-boresight",
        choices=("none", "block", "camera"),
        help="whether the stated angles are those of an instrument that is turned against the "
        "camera: three unknowns, of each camera or of the block; otherwise what [imu] says",
    )
    parser.add_argument(
        "--imu-boresight-sigma",
        type=positive_or_none,
        metavar="DEG",
        help="the a-priori standard deviation of its three angles, in degrees, or none: free",
    )


def _add_prior(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--additional-prior",
        action="append",
        metavar="PRIOR",
        help="an a-priori calibration, value and sigma as in the table of parameters (um; of a "
        "lens the coefficients): b1=12+-3,b2=5 (sigma 0: held, none: only tested against), or a "
        "file (parameter,value,sigma,group); may stand several times",
    )
    parser.add_argument(
        "--additional-reference-mm",
        type=positive,
        metavar="B",
        help="the length b of the terms in x/b, y/b: values of another block belong to its b "
        "(otherwise half the format, without one the largest coordinate measured)",
    )


def _add_calibration(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--calibrate",
        action="append",
        metavar="PARAMETERS",
        help="free parameters of every camera's lens: c,x0,y0,k1,k2,k3,p1,p2,b1,b2, or some; of "
        "one camera CAMERA:c,k1 (may stand several times); k1=-0.05 is a value in place of the "
        "camera's own",
    )
    parser.add_argument(
        "--calibrate-sigma",
        action="append",
        metavar="SIGMAS",
        help="weigh them about the camera's values, or those given: k1=0.01,c=5px or "
        "CAMERA:k1=0.01; 0: held there (c, x0, y0 in mm or px, the others as COLMAP has them)",
    )
    parser.add_argument(
        "--write-camera",
        action="append",
        metavar="FILE",
        help="write the calibrated camera as a camera file; of several CAMERA=FILE, for each",
    )


def add_apply_arguments(adjust: argparse.ArgumentParser) -> None:
    """Add what the command `adjust` takes beside: it writes then."""
    adjust.add_argument(
        "--apply",
        action="store_true",
        help="with --errors or --thin: switch off in image_points.csv what is rejected or thinned "
        "out (columns use and reason); control is left to you",
    )
    adjust.add_argument(
        "--apply-undo",
        action="store_true",
        help="first take back what --apply switched off; with --errors NAME only what NAME did, "
        "with --thin what that did, and nothing is thinned out again",
    )


def add_fit_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `fit` takes."""
    parser.add_argument("block", type=Path, metavar="BLOCK", help="the block's folder")
    parser.add_argument(
        "--degree",
        type=int,
        choices=(1, 2, 3),
        default=1,
        help="1: spatial similarity (default); 2, 3: with polynomials along the strip",
    )
    parser.add_argument(
        "--without",
        type=names,
        default=(),
        metavar="POINTS",
        help="control points, separated by commas, that are compared and do not take part",
    )
    parser.add_argument("--strip", metavar="NAME", help="only this strip")
    parser.add_argument(
        "--fail-on-flag", action="store_true", help="exit with 1 when a point is flagged"
    )
    add_output(parser, "the discrepancies")


def add_compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `compare` takes."""
    parser.add_argument("first", type=Path, metavar="EPOCH1", help="the earlier block's folder")
    parser.add_argument("second", type=Path, metavar="EPOCH2", help="the later block's folder")
    parser.add_argument(
        "more",
        type=Path,
        nargs="*",
        default=(),
        metavar="EPOCH",
        help="further ones, in the order of time",
    )
    parser.add_argument(
        "--separate",
        action="store_true",
        help="adjust each epoch by itself; otherwise all in one, with common control "
        "(of a point given in part, what is given)",
    )
    parser.add_argument(
        "--additional",
        metavar="SET",
        help="additional parameters: ebner, gruen, gruen50 or physical (a lens: c, x0, y0, k1, k2, "
        "k3, p1, p2, b1, b2; c > 0: longer), with :block (the default), :strip, :camera or :photo; "
        "some of them as ebner:b1,b2 or gruen:-a43",
    )
    parser.add_argument(
        "--additional-sigma-um", type=positive, metavar="UM", help="weigh them by their effect"
    )
    _add_prior(parser)
    parser.add_argument(
        "--common-parameters",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="whether all epochs have the same ones; jointly, of block and camera: they have",
    )
    parser.add_argument(
        "--stable",
        metavar="POINT,...",
        help="points that have not moved hold the datum in place of control: three or more",
    )
    parser.add_argument("--points", metavar="POINT,...", help="compare these only")
    parser.add_argument(
        "--given-movement",
        type=Path,
        metavar="FILE",
        help="test against this movement instead of none: a CSV file of point,dX,dY,dZ [m], of "
        "more than two epochs with from,to (1, 2, ...); what is not in it has not moved",
    )
    parser.add_argument(
        "--alpha",
        type=significance,
        default=0.05,
        metavar="ALPHA",
        help="significance of the global test, of every family of single tests, and of all of "
        "them together (ANYTHING MOVED), default 0.05",
    )
    add_output(parser, "the displacements")
    add_report_page(parser)
    parser.add_argument(
        "--fail-on-flag",
        action="store_true",
        help="exit with 1 when anything has moved: without movement with the probability ALPHA",
    )
