"""What the columns of a report mean: in words, with the equation, and where it comes from.

A column is found by its table and key, else by its key alone. Sources: Kratky and El-Hakim 1983
(on-line triangulation), Gruen 1978 (close-range bundles), Gruen 1980 (internal reliability),
Bayesian phototriangulation; docs/papers.md compares what they print with what is computed here.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Definition", "definition_of"]


class Definition(NamedTuple):
    """What a column means: words, an equation or "", and where it stands or ""."""

    words: str
    equation: str = ""
    source: str = ""


_RED = Definition(
    "redundancy number: the part of an error of this observation that shows in its own residual, "
    "from 0 (nothing checks it) to 1",
    "r = (Q_vv P)_ii, Q_vv = P^-1 - A (A'PA)^-1 A'; a residual changes by -r times the error",
    "Kratky and El-Hakim 1983, eq. (5), (6); Gruen 1978, eq. (11), (17)",
)
_MEAN_RED = Definition(
    "mean redundancy number of the image coordinates of the photo, or of its worst ninth: with all "
    "points, and with those that are left",
    "mean of r = (Q_vv P)_ii",
    "",
)
_THIN_S = Definition(
    "standard deviation of the position for the a-priori sigma0, before and after in one datum",
    "root of the mean of three squares",
    "",
)
_MORE = Definition("by how much that grows where points are left out")
_GIVEN_MINUS = "Gruen 1978, eq. (45), there with the opposite sign"
_W = Definition(
    "standardized residual: the residual over its standard deviation; flagged beyond the critical "
    "value of the test",
    "w = v / (sigma sqrt(q_vv)); sigma a priori (baarda) or estimated (tau)",
    "Gruen 1978, eq. (23), there with the opposite sign, (24); Kratky and El-Hakim 1983, eq. (7)",
)
_MDB = Definition(
    "smallest error that the test finds with the power of [test]",
    "delta0 sigma0 / (p sqrt(q_vv)); delta0 = 4.13 for alpha 0.001 and power 0.80",
    "Gruen 1978, eq. (21), (27); Gruen 1980, eq. (18)",
)
_V = Definition("residual: adjusted minus observed", "v = A x - l", "Gruen 1978, eq. (10)")
_S = Definition(
    "standard deviation, with the sigma of the test",
    "s = sigma sqrt(q_xx), Q_xx = (A'PA)^-1",
    "Gruen 1978, eq. (9)",
)
_P = Definition(
    "probability that a good value differs as much or more; the family of tests keeps its "
    "significance",
    "of T = R / (b sigma^2) by F(b, r), or by chi-square / b with the a-priori sigma0",
    "Gruen 1978, eq. (31), (32)",
)
_NAME = Definition("name, as the files have it")
_RHO = Definition("correlation of two unknowns", "rho = q_ij / sqrt(q_ii q_jj)", "")
_POSITION = Definition("coordinate in the ground system")
_ANGLE = Definition(
    "angle of the rotation from the image to the ground", "R = R1(omega) R2(phi) R3(kappa)"
)
_EFFECT = Definition(
    "how far an undetected error, as large as the smallest detectable one, moves a point",
    "dx = (A'PA)^-1 A'P e times the error",
    "Gruen 1978, eq. (9a), (14)",
)
_ELLIPSE = Definition(
    "semi-axis of the standard ellipse in plan (39 %), or its direction from X towards Y",
    "from the eigenvalues of the 2 x 2 covariance",
)
_COUNT = Definition("number")

_BY_KEY: dict[str, Definition] = {
    **dict.fromkeys(
        ("photo", "point", "other", "camera", "owner", "first", "second", "name", "strip", "file"),
        _NAME,
    ),
    **dict.fromkeys(("X", "Y", "Z"), _POSITION),
    **dict.fromkeys(("omega", "phi", "kappa"), _ANGLE),
    **dict.fromkeys(
        ("sX", "sY", "sZ", "somega", "sphi", "skappa", "s", "sdX", "sdY", "sdZ", "s_distance"), _S
    ),
    "s_block": Definition("standard deviation of the adjusted coordinate alone", _S.equation),
    "s_given": Definition("standard deviation of the given coordinate alone"),
    "s_plan": Definition(
        "standard deviation of the difference in plan, of both", "sqrt(q_X + q_Y) sigma0"
    ),
    "s_height": Definition("standard deviation of the difference in height, of both"),
    "axis": Definition("which coordinate: x and y of the image, X, Y and Z of the ground"),
    "unknown": Definition("which unknown of the owner"),
    "unit": Definition("unit of the numbers beside it"),
    "model": Definition("the model, left/right photo, in which it was measured"),
    "rays": Definition("number of rays: photos in which the point is measured, or points measured"),
    "r": _RED,
    "redundancy_number": _RED,
    "redundancy": Definition(
        "sum of the redundancy numbers: how many observations more than needed",
        "tr(Q_vv P)",
        "Gruen 1978, eq. (25)",
    ),
    "mean_r": Definition("mean redundancy number of its image coordinates", "RI", "Gruen 1978, "
                         "eq. (25)"),
    "error_um": Definition("estimated gross error, without all that is rejected"),
    "weakest": Definition("where its weakest observation is: its point, or its photo"),
    "low_r": Definition("smallest redundancy number of its image coordinates", _RED.equation),
    "least_r": Definition("smallest redundancy number of its image coordinates", _RED.equation),
    "rms_x_um": Definition("root mean square of the photo's residuals in x", "sqrt([v v] / n)"),
    "rms_y_um": Definition("root mean square of the photo's residuals in y", "sqrt([v v] / n)"),
    "w": _W,
    "v": _V,
    "v_um": _V,
    "vx_um": _V,
    "vy_um": _V,
    "mdb": _MDB,
    "mdb_um": _MDB,
    "detectable": _MDB,
    "effect": Definition(
        "what an undetected error does to the ray's own point, or to the function", _EFFECT.equation
    ),
    "largest_effect": Definition("the largest effect on any point", _EFFECT.equation),
    "largest_effect_at": Definition("the point that moves most"),
    "standardized_effect": Definition(
        "length of the effect on all unknowns: no function of them moves by more than this many of "
        "its standard deviations",
        "delta0 sqrt((1 - r) / r)",
        "Baarda 1968; Gruen 1978, section B",
    ),
    "verdict": Definition("what the test says: remeasure, rejected, not testable, off"),
    "flagged": Definition("whether the test rejects it", "abs(w) > critical value",
                          "Gruen 1978, eq. (24)"),
    "off": Definition("which coordinates are switched off, or that it is"),
    "reason": Definition("why, in the words of who decided"),
    "kind": Definition("what it is: image, control, prior, point, photo"),
    "use": Definition("as what it takes part: control, check, prior, off"),
    "dX": Definition("adjusted minus given coordinate", "", _GIVEN_MINUS),
    "dY": Definition("adjusted minus given coordinate", "", _GIVEN_MINUS),
    "dZ": Definition("adjusted minus given coordinate", "", _GIVEN_MINUS),
    "difference": Definition(
        "what the photographs make of it minus what is given; of control without it", "",
        "Gruen 1978, eq. (45), (50), there with the opposite sign",
    ),
    "plan": Definition("the difference in plan: its length", "sqrt(dX^2 + dY^2)"),
    "height": Definition("the difference in height, with its sign"),
    "plan_rejected": Definition("whether the test rejects the plan"),
    "height_rejected": Definition("whether the test rejects the height"),
    "P": _P,
    "P_plan": _P,
    "P_height": _P,
    "power": Definition(
        "probability that a value of the a-priori standard deviation is found", "beta(lambda)",
        "Gruen 1978, eq. (33), (38)",
    ),
    "inflation": Definition("how much the other parameters enlarge its variance"),
    "kept": Definition("part of the noncentrality that all other unknowns leave", "",
                       "Gruen 1978, eq. (38)"),
    "parameter": Definition("additional parameter, and of what"),
    "group": Definition("whose it is: block, strip, camera, photo; or a group of observations"),
    "value": Definition("estimated value; of additional parameters the effect in the image"),
    "coefficient": Definition("the coefficient of the lens formula", "Brown's formula, as COLMAP"),
    "s_coefficient": Definition("standard deviation of the coefficient", _S.equation),
    "observations": _COUNT,
    "id": Definition("name of the condition"),
    "what": Definition("of which points"),
    "of": Definition("of which kind of unknown"),
    "least": Definition("smallest value"),
    "middle": Definition("middle value; of an even number the lower of two"),
    "largest": Definition("largest value"),
    "at": Definition("where the largest one is"),
    "correlation": _RHO,
    "points": Definition("points measured in both photos"),
    "share": Definition("common points over all points of the photo"),
    "overlap": Definition(
        "part of what the photo shows that the other one shows too, in the plane across both axes "
        "through the common points"
    ),
    "order": Definition("in which step it was rejected; what went together shares it"),
    "error": Definition(
        "estimated gross error, without all that is rejected", "", "Gruen 1978, eq. (17)"
    ),
    "sigma": Definition("standard deviation of the estimated error"),
    "statistic": Definition("what the strategy compared when it was rejected"),
    "critical": Definition("with which critical value it was compared"),
    "variance_factor": Definition(
        "estimated variance of the group over the stated one", "s^2 = v'Pv / r, iterated",
        "Bayesian phototriangulation, eq. (3), with rigorous redundancies",
    ),
    "sigma_factor": Definition("its root"),
    "from": Definition("lower end of its interval of confidence"),
    "to": Definition("upper end of its interval of confidence"),
    "function": Definition("which function of coordinates"),
    "by": Definition("the observation whose undetected error does it"),
    "ellipse_a": _ELLIPSE,
    "ellipse_b": _ELLIPSE,
    "ellipse_direction": _ELLIPSE,
    "distance": Definition("distance between the two points"),
    "first_kind": Definition("what the first is: point or photo"),
    "second_kind": Definition("what the second is: point or photo"),
    "root_qvv": Definition("model value of the class", "sqrt(q_vv)", "Gruen 1980, eq. (7), (8)"),
    "smallest": Definition("smallest exact value of the class", "sqrt(q_vv)", "Gruen 1980"),
    "accepted": Definition("accepted by the model values", "abs(v) < c (1 - k_q/100) s",
                           "Gruen 1980, eq. (10)"),
    "rejected": Definition("rejected", "abs(v) > c (1 + k_q/100) s", "Gruen 1980, eq. (9)"),
    "undecided": Definition("left to the exact test", "", "Gruen 1980, eq. (11)"),
    "beyond_tolerance": Definition("exact values farther than k_q from the model value", "",
                                   "Gruen 1980, eq. (7)"),
    "untestable": Definition("coordinates that nothing checks"),
    "bytes": Definition("size of the file"),
    "sha256": Definition("checksum of the file as it was read"),
}  # fmt: skip

_PARX = Definition(
    "parallax left at the point: r times an error of this observation",
    "PARX = -v; v = -r times the error",
    "Kratky and El-Hakim 1983, eq. (5)",
)
_EXPD = Definition(
    "expected standard deviation of the parallax",
    "EXPD = sigma sqrt(q_ii)",
    "Kratky and El-Hakim 1983, eq. (6), (7)",
)
_SIGF = Definition(
    "standardized residual of a row, without its sign",
    "SIGF = abs(PARX) / EXPD",
    "Kratky and El-Hakim 1983, eq. (7)",
)
_BASE = Definition(
    "base along the axes of the strip", "b = bx (1, beta_y, beta_z)",
    "Kratky and El-Hakim 1983, eq. (1)",
)  # fmt: skip

_BY_KEY |= {
    **dict.fromkeys(("left", "right"), _NAME),
    "sigma0_um": Definition(
        "estimated standard deviation of an image x coordinate", "sqrt(v'Pv / redundancy)",
        "Gruen 1978, eq. (9b)",
    ),
    "ties": Definition("tie points: points of the model before that are measured in it again"),
    "redn": _RED,
    "parx_um": _PARX,
    "residual_um": _V,
    "expd_um": _EXPD,
    "sigf": _SIGF,
    **dict.fromkeys(("bx", "by", "bz"), _BASE),
    "element": Definition("element of the orientation"),
    "transformation": Definition("inner orientation: which transformation the fiducials allow"),
    "fiducial": _NAME,
    "time": Definition("when, in local time"),
    "who": Definition("who did it"),
    "old": Definition("what was before"),
    "new": Definition("what is now"),
    "w_before": _SIGF,
    "w_after": _SIGF,
    "stated": Definition("what the camera states"),
    "value_px": Definition("estimated value in pixels"),
    "s_px": Definition("its standard deviation in pixels"),
    "freedom": Definition("free, weighted or held"),
    "set": Definition("set of additional parameters"),
    "outcome": Definition("what became of the parameters: kept, left out, held"),
    "stage": Definition("step of the choice"),
    "dimension": Definition("number of parameters tested together", "b", "Gruen 1978, eq. (31)"),
    "noncentrality": Definition(
        "noncentrality of the test", "lambda (without the factor 1/2)", "Gruen 1978, eq. (33), (38)"
    ),
    "largest_m": Definition("largest shift of a point by this step"),
    "rms_m": Definition("root mean square shift of all points"),
    "sigma_before_m": Definition("mean standard deviation of points before the step"),
    "sigma_after_m": Definition("mean standard deviation of points after the step"),
    "T": Definition("test value", "T = R / (b sigma^2)", "Gruen 1978, eq. (31)"),
    "term": Definition("shift, slope or bowl"),
    "size": Definition("estimated size at the edge of the check points"),
    "flight": Definition("a further flight or control"),
    "bend": Definition("standard deviation of the bend of heights, middle against edge"),
}  # fmt: skip

_MATRICES = {"photo_correlations", "parameter_correlations", "correlations"}

_LENGTH = Definition(
    "length of the displacement, or its standard deviation along its own direction",
    "",
    "Gruen 1978, section D3",
)
_MOVED = Definition(
    "probability that a point that has not moved differs as much; of the point by itself",
    _P.equation,
    "Gruen 1978, eq. (55) to (58)",
)
_CLASS = Definition(
    "class of rays: how many the point has, inner or outer, control or new",
    "",
    "Gruen 1980, Table 2",
)
_ROOT = Definition(
    "mean, smallest and largest root of the cofactor of a residual, in a-priori sigmas",
    "sqrt(q_vv p)",
    "Gruen 1980",
)

_BY_TABLE: dict[tuple[str, str], Definition] = {
    ("accuracy", "unknown"): Definition("which coordinate"),
    ("accuracy_angles", "unknown"): Definition("which angle"),
    ("photos_correlated", "correlation"): _RHO,
    ("snooping_classes", "largest"): Definition(
        "largest exact value of the class", "sqrt(q_vv)", "Gruen 1980"
    ),
    ("snooping_classes", "observations"): _COUNT,
    ("calibration", "correction"): Definition("estimated value minus the stated one"),
    ("models", "largest"): _SIGF,
    ("models", "at"): Definition("the row with the largest SIGF"),
    ("models", "correlation"): Definition(
        "largest correlation of two elements of the orientation", _RHO.equation
    ),
    ("models", "of"): Definition("which two elements are correlated most"),
    ("models", "flagged"): Definition("number of flagged rows"),
    ("models", "off"): Definition("number of rows that are switched off"),
    # of a point's rays; the matrix of a model's orientation has this name, too
    ("correlations", "point"): _BY_KEY["point"],
    **{
        ("correlations", f"{which}_{part}"): Definition(
            "photo, model and coordinate of two residuals of the point that are correlated"
        )
        for which in ("first", "second")
        for part in ("photo", "model", "axis")
    },
    ("correlations", "correlation"): Definition(
        "correlation of these two residuals", "rho = q_ij / sqrt(q_ii q_jj) of Q_vv"
    ),
    ("orientation", "what"): Definition("value, or its standard deviation"),
    ("photos", "flagged"): Definition("number of its flagged image coordinates"),
    **{
        ("displacements", f"w{axis}"): Definition("the given movement that is tested against")
        for axis in "XYZ"
    },
    **dict.fromkeys((("displacements", "length"), ("displacements", "s_length")), _LENGTH),
    **dict.fromkeys((("displacements", "P"), ("points", "P")), _MOVED),
    ("points", "moved"): Definition("from which epoch to which it has moved"),
    ("thinning", "rays_before"): Definition("rays of the photo with all points"),
    ("thinning", "rays"): Definition("rays that are left"),
    ("thinning", "redn_before"): _MEAN_RED,
    ("thinning", "redn"): _MEAN_RED,
    ("thinning", "worst_before"): _MEAN_RED,
    ("thinning", "worst"): _MEAN_RED,
    ("thinning", "worst_region"): Definition("which ninth of the format that is now"),
    **dict.fromkeys((("thinning", "s_before"), ("thinning", "s")), _THIN_S),
    **dict.fromkeys((("thinning", "s_more"), ("thinning", "s_angle_more")), _MORE),
    **dict.fromkeys((("classes", "rays"), ("classes", "ray"), ("classes", "point")), _CLASS),
    ("classes", "number"): Definition("number of image coordinates of the class"),
    ("classes", "mean_root"): _ROOT,
    ("classes", "least"): _ROOT,
    ("classes", "most"): _ROOT,
    ("classes", "untestable"): Definition("how many of them nothing checks"),
    ("inner", "largest"): _SIGF,
    ("inner", "at"): Definition("the fiducial with the largest SIGF"),
    ("inner", "flagged"): Definition("number of flagged rows"),
}


def definition_of(table: str, column: str) -> Definition | None:
    """Return what a column of a table means, by their keys; None where it is not known."""
    found = _BY_TABLE.get((table, column))
    if found is None and table in _MATRICES and column not in ("photo", "group", "name", "element"):
        return _RHO
    if found is None and table == "points" and column.startswith("length_"):
        return _LENGTH  # to this epoch
    return found or _BY_KEY.get(column)
