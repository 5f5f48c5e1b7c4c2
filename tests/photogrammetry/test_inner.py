"""Inner orientation: every transformation against an independent path, planted errors, refusals."""

from itertools import combinations
from math import hypot, pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.camera import CameraCalibration, Fiducial, FiducialDistance
from anaplot.photogrammetry.inner import (
    MINIMUM,
    TRANSFORMATIONS,
    Placement,
    candidates,
    orient_inner,
)
from anaplot.photogrammetry.inneradvice import inner_advice

CORNERS = [(-106.003, 106.001), (106.0, 105.998), (106.002, -106.0), (-105.998, -106.003)]
SIDES = [(-113.0, 0.012), (0.003, 113.004), (113.001, -0.004), (0.0, -112.998)]
EIGHT = CORNERS + SIDES


def camera(places):
    marks = (Fiducial(str(k + 1), x, y) for k, (x, y) in enumerate(places))
    return CameraCalibration("rmk", 152.4, fiducials=tuple(marks))


def named(plate):
    return {str(k + 1): (float(x), float(y)) for k, (x, y) in enumerate(plate)}


def laid(places, placement, noise_mm=0.004, seed=1):
    image = np.array(places, dtype=float)
    noise = np.random.default_rng(seed).normal(size=image.shape) * noise_mm
    return placement.transformation().to_plate(image) + noise


LIES = {
    "straight": Placement(120.0, 110.0, 0.01, 1e-4, 0.9995, 1.0003),
    "quarter turn": Placement(120.0, 110.0, pi / 2 + 0.01, 1e-4, 0.9995, 1.0003),
    "upside down": Placement(-50.0, 400.0, pi - 0.02, 0.0, 0.9990, 0.9985),
    "mirrored": Placement(120.0, 110.0, 0.02, -1e-4, 0.9995, 1.0003, True),
    "mirrored quarter": Placement(120.0, 110.0, -pi / 2, 1e-4, 0.9995, 1.0003, True),
}
lies = pytest.mark.parametrize("lie", LIES.values(), ids=LIES.keys())


# -- independent paths -----------------------------------------------------------------------


def complex_of(xy):
    return xy[:, 0] + 1j * xy[:, 1]


def similarity_residuals(image, plate, v, mirrored):
    """Plate residuals turned into the image's axes by the closed-form Helmert transformation."""
    z, w = complex_of(plate), complex_of(image)
    z, v = (z.conj(), complex_of(v).conj()) if mirrored else (z, complex_of(v))
    z, w = z - z.mean(), w - w.mean()
    a = (z.conj() * w).sum() / (z.conj() * z).sum()
    out = a * v
    return np.column_stack((out.real, out.imag)) * 1e3


def helmert_plate(image, plate, mirrored):
    """Adjusted plate of the fit plate = t + a image, in complex numbers."""
    w = complex_of(image).conj() if mirrored else complex_of(image)
    z = complex_of(plate)
    a = ((w - w.mean()).conj() * (z - z.mean())).sum() / (abs(w - w.mean()) ** 2).sum()
    fit = z.mean() + a * (w - w.mean())
    return np.column_stack((fit.real, fit.imag))


def affine_plate(image, plate, _mirrored):
    design = np.column_stack((np.ones(len(image)), image))
    return design @ np.linalg.lstsq(design, plate, rcond=None)[0]


def projective_plate(image, plate, _mirrored):
    """The inverse of a projective transformation is one: plate as a function of the image."""
    scale = 100.0

    def fit(g):
        x, y = image.T / scale
        under = 1.0 + g[6] * x + g[7] * y
        return np.column_stack(
            ((g[0] + g[1] * x + g[2] * y) / under, (g[3] + g[4] * x + g[5] * y) / under)
        )

    design = np.column_stack((np.ones(len(image)), image / scale))
    start = np.linalg.lstsq(design, plate, rcond=None)[0].T.ravel()
    found = optimize.least_squares(
        lambda g: (fit(g) - plate).ravel(), np.append(start, (0.0, 0.0)), xtol=1e-15, ftol=1e-15
    )
    return fit(found.x)


def bilinear_plate(image, plate, mirrored):
    """x = 1, xi, eta, xi eta by least squares on the distances on the plate itself."""
    z, w = complex_of(plate), complex_of(image)
    z = z.conj() if mirrored else z
    a = ((z - z.mean()).conj() * (w - w.mean())).sum() / (abs(z - z.mean()) ** 2).sum()
    aligned = w.mean() + a * (z - z.mean())
    xi, target = np.column_stack((aligned.real, aligned.imag)) / 100.0, image / 100.0
    middle = image.mean(axis=0) / 100.0

    def forward(g, at):
        x, y = (at - middle).T
        powers = np.column_stack((np.ones_like(x), x, y, x * y))
        return powers @ g.reshape(2, 4).T

    def inverse(g):
        at = target.copy()
        for _ in range(60):  # the transformation is all but the identity: a fixed point
            at = at - (forward(g, at) - target)
        return at

    start = np.array([middle[0], 1.0, 0.0, 0.0, middle[1], 0.0, 1.0, 0.0])
    found = optimize.least_squares(
        lambda g: (inverse(g) - xi).ravel(), start, xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    fit = 100.0 * (inverse(found.x) @ [1.0, 1j])
    back = z.mean() + (fit - w.mean()) / a
    back = back.conj() if mirrored else back
    return np.column_stack((back.real, back.imag))


PATHS = {
    "helmert": (helmert_plate, 4),
    "affine": (affine_plate, 6),
    "bilinear": (bilinear_plate, 8),
    "projective": (projective_plate, 8),
}


@lies
@pytest.mark.parametrize("kind", PATHS)
def test_residuals_by_an_independent_path(kind, lie):
    path, unknowns = PATHS[kind]
    image, plate = np.array(EIGHT), laid(EIGHT, lie)
    inner = orient_inner(camera(EIGHT), named(plate), transformation=kind)
    fit = path(image, plate, lie.mirrored)
    expected = similarity_residuals(image, plate, fit - plate, lie.mirrored).ravel()
    assert [row.residual for row in inner.rows] == pytest.approx(expected, abs=2e-5)
    assert inner.redundancy == 16 - unknowns
    assert inner.sigma0_um == pytest.approx(sqrt((expected**2).sum() / (16 - unknowns)), rel=1e-6)
    # the adjusted plate is mapped onto the certificate, and back, exactly
    assert np.abs(inner.transformation.to_image(fit) - image).max() < 1e-7
    assert np.abs(inner.transformation.to_plate(image) - fit).max() < 1e-7
    assert inner.placement.mirrored == lie.mirrored


@pytest.mark.parametrize("kind", PATHS)
def test_redundancy_numbers_against_differences(kind):
    """r_i: how much of an error put into a row comes back as its residual."""
    plate = laid(EIGHT, LIES["straight"], 0.0)
    inner = orient_inner(camera(EIGHT), named(plate), transformation=kind)
    clean = np.array([row.residual for row in inner.rows])
    assert sum(row.r for row in inner.rows) == pytest.approx(inner.redundancy)
    z = complex_of(np.array(EIGHT)).conj() @ complex_of(plate - plate.mean(axis=0))
    turn = z / abs(z)
    for k in range(16):
        wrong = plate.copy()
        step = turn * (1j if k % 2 else 1.0) * 1e-3
        wrong[k // 2] += step.real, step.imag
        row = orient_inner(camera(EIGHT), named(wrong), transformation=kind).rows[k]
        assert -(row.residual - clean[k]) == pytest.approx(inner.rows[k].r, abs=2e-3)


def test_a_textbook_affine_transformation():
    """Four fiducials, worked by hand: x = 10 + 1.001 x', y = -5 + 0.999 y', residuals +-2 um."""
    image = [(-100.1, 99.9), (100.1, 99.9), (100.1, -99.9), (-100.1, -99.9)]
    plate = np.array([(-110.0, 105.0), (90.0, 105.0), (90.0, -95.0), (-110.0, -95.0)])
    plate[1, 0] += 0.008
    inner = orient_inner(camera(image), named(plate))
    assert inner.kind == "affine"
    residuals = [row.residual for row in inner.rows]
    # an error of 8 um in one x: a quarter of it in every x, with alternating sign
    assert residuals[::2] == pytest.approx([2.0, -2.0, 2.0, -2.0], rel=2e-4)
    assert residuals[1::2] == pytest.approx([0.0] * 4, abs=1e-4)
    assert [row.r for row in inner.rows] == pytest.approx([0.25] * 8, abs=1e-5)
    assert inner.sigma0_um == pytest.approx(sqrt(16.0 / 2.0), rel=2e-4)
    place = inner.placement
    # the shift takes its part: 8 um / 4 of the mean
    assert (place.x, place.y) == pytest.approx((-9.998, 5.0), abs=1e-4)
    assert place.scale_x == pytest.approx(1.0 / 1.001, abs=3e-5)
    assert place.scale_y == pytest.approx(1.0 / 0.999, abs=3e-5)


def test_a_textbook_helmert_transformation():
    """Three corners of a square, turned by 90 degrees and shifted: exact."""
    image = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0)]
    plate = [(5.0, 7.0), (5.0, 17.0), (-5.0, 7.0)]
    inner = orient_inner(camera(image), named(plate))
    assert inner.kind == "helmert"
    assert inner.transformation.to_image(np.array([[5.0, 12.0]]))[0] == pytest.approx((5.0, 0.0))
    assert inner.placement[:6] == pytest.approx((5.0, 7.0, pi / 2, 0.0, 1.0, 1.0))
    assert inner.sigma0_um == 0.0
    assert not inner.flagged
    assert all(row.w is None for row in inner.rows)


@lies
def test_the_placement_is_found_again(lie):
    inner = orient_inner(camera(EIGHT), named(laid(EIGHT, lie, 0.0)), transformation="affine")
    assert inner.placement[:6] == pytest.approx(lie[:6], abs=1e-9)
    assert inner.placement.mirrored == lie.mirrored
    assert inner.transformation.kind == "affine"


# -- choice ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "kind"), [(3, "helmert"), (4, "affine"), (8, "bilinear")])
def test_the_transformation_is_chosen_from_the_data_at_hand(count, kind):
    inner = orient_inner(camera(EIGHT), named(laid(EIGHT, LIES["straight"])[:count]))
    assert inner.kind == kind == candidates(camera(EIGHT), count)[0]
    assert inner.unmeasured == tuple(str(k + 1) for k in range(count, 8))
    assert (f"not measured: {', '.join(inner.unmeasured)}" in inner_advice(inner)) == (count < 8)


def test_a_poorer_transformation_where_the_first_is_not_determined_and_said_so():
    places = [*SIDES, (0.0, 0.0)]
    for lie in LIES.values():
        inner = orient_inner(camera(places), named(laid(places, lie)))
        assert inner.kind == "affine"
        (remark,) = (text for text in inner_advice(inner) if "instead" in text)
        assert "bilinear" in remark
        assert "x y in x, x y in y" in remark
    with pytest.raises(NotComputableError, match=r"bilinear transformation .*x y in x, x y in y"):
        orient_inner(camera(places), named(laid(places, lie)), transformation="bilinear")


@pytest.mark.parametrize("kind", ["helmert", "affine", "bilinear", "projective"])
def test_too_few_are_counted(kind):
    least = MINIMUM[kind]
    plate = laid(EIGHT, LIES["straight"])
    enough = orient_inner(camera(EIGHT), named(plate[:least]), transformation=kind)
    assert enough.kind == kind
    with pytest.raises(NotComputableError, match=f"'{kind}' needs {least} fiducials, {least - 1}"):
        orient_inner(camera(EIGHT), named(plate[: least - 1]), transformation=kind)


def test_nothing_measured():
    with pytest.raises(NotComputableError, match=r"needs 3 fiducials, 0 measured$"):
        orient_inner(camera(EIGHT), {})
    with pytest.raises(NotComputableError, match=r"needs 3 fiducials, 2 measured \(1, 8\)"):
        orient_inner(camera(EIGHT), {"8": (0.0, 1.0), "1": (3.0, 4.0)})
    with pytest.raises(NotComputableError, match="'digital' states no fiducials"):
        orient_inner(CameraCalibration("digital", 50.0), {})
    with pytest.raises(KeyError, match="9"):
        orient_inner(camera(EIGHT), {"9": (0.0, 1.0)})
    with pytest.raises(ValueError, match="finite"):
        orient_inner(camera(EIGHT), {"1": (0.0, float("nan"))})


@pytest.mark.parametrize("kind", [None, "helmert", "affine", "projective"])
def test_fiducials_on_a_line(kind):
    places = [(-100.0, 0.0), (-30.0, 0.001), (40.0, 0.0), (110.0, 0.0)]
    with pytest.raises(NotComputableError, match="1, 2, 3, 4"):
        orient_inner(camera(places), named(laid(places, LIES["straight"])), transformation=kind)


def test_fiducials_at_one_place():
    plate = np.full((4, 2), 5.0)
    with pytest.raises(NotComputableError, match="measured at the same place"):
        orient_inner(camera(CORNERS), named(plate))
    with pytest.raises(NotComputableError, match="same place"):
        orient_inner(camera([(1.0, 2.0)] * 4), named(laid(CORNERS, LIES["straight"])))


def test_what_the_certificate_does_not_allow():
    plate = named(laid(CORNERS, LIES["straight"]))
    with pytest.raises(NotComputableError, match=r"'distances' is not possible.*coordinates"):
        orient_inner(camera(CORNERS), plate, transformation="distances")
    with pytest.raises(NotComputableError, match=r"'affine' is not possible.*distances"):
        orient_inner(FOUR_SIDES, {}, transformation="affine")


# -- what is wrong ---------------------------------------------------------------------------


@pytest.mark.parametrize("test", ["tau", "baarda"])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("wrong", range(8))
def test_one_wrong_fiducial_among_eight_is_found(wrong, axis, test):
    plate = laid(EIGHT, LIES["straight"], seed=5)
    plate[wrong, axis] += 0.12
    inner = orient_inner(camera(EIGHT), named(plate), test=TestSettings(test))
    assert inner.kind == "bilinear"
    assert inner.locatable
    assert inner.refused
    row = inner.flagged[0]
    assert row.key == (str(wrong + 1), "xy"[axis])
    assert row.residual == pytest.approx(-120.0 * row.r, abs=12.0)
    assert inner_advice(inner)[0].startswith(
        f"remeasure {wrong + 1} ({'xy'[axis]}): more than 1000 to 1"
    )


@pytest.mark.parametrize("wrong", range(4))
@pytest.mark.parametrize("places", [CORNERS, SIDES], ids=["corners", "sides"])
def test_one_wrong_fiducial_among_four_is_noticed_and_cannot_be_located(places, wrong):
    plate = laid(places, LIES["straight"])
    plate[wrong, 0] += 0.12
    for test in ("tau", "baarda"):
        inner = orient_inner(camera(places), named(plate), test=TestSettings(test))
        assert inner.kind == "affine"
        assert not inner.locatable
        assert inner.refused
        said = " / ".join(inner_advice(inner))
        assert "among four fiducials one wrong fiducial cannot be located" in said
        assert "remeasure" not in said
        assert "1, 2, 3 and 4" in said
        assert "is not known" in said
        x = [abs(row.residual) for row in inner.rows if row.axis == "x"]
        assert x == pytest.approx([30.0] * 4, abs=4.0)
        assert max(x) - min(x) < 0.02
        assert len(inner.partners) == 12  # every two of four, in x and in y


def test_four_good_fiducials_say_beforehand_what_they_cannot():
    inner = orient_inner(camera(CORNERS), named(laid(CORNERS, LIES["straight"])))
    assert not inner.refused
    assert inner_advice(inner)[0] == "nothing is flagged"
    assert "among four fiducials one wrong fiducial cannot be located" in inner_advice(inner)[1]


def test_without_redundancy_there_is_no_check_and_said_so():
    plate = named(laid(CORNERS, LIES["straight"]))
    inner = orient_inner(camera(CORNERS), plate, transformation="projective")
    assert (inner.redundancy, inner.sigma0_um, inner.test.critical) == (0, None, None)
    assert (inner.tested.power, inner.overall, inner.refused, inner.locatable) == (None, None) + (
        False,
    ) * 2
    assert all(row.w is None and row.mdb is None for row in inner.rows)
    assert inner_advice(inner) == (
        "four fiducials and the projective transformation: no check at all",
    )


@given(
    st.permutations(range(8)).map(lambda order: sorted(order[:2])),
    st.sampled_from(list(LIES.values())),
)
def test_two_exchanged_fiducials_are_named(pair, lie):
    plate = laid(EIGHT, lie)
    plate[pair] = plate[pair[::-1]]
    inner = orient_inner(camera(EIGHT), named(plate), transformation="helmert")
    assert inner.exchanged == (str(pair[0] + 1), str(pair[1] + 1))
    assert inner_advice(inner)[0].startswith(
        f"{pair[0] + 1} and {pair[1] + 1} seem to be exchanged"
    )


@pytest.mark.parametrize("pair", [(0, 1), (1, 2), (2, 3), (0, 3)])
@lies
def test_two_neighbours_of_four_exchanged(pair, lie):
    plate = laid(CORNERS, lie)
    plate[[*pair]] = plate[[*reversed(pair)]]
    # the other two would do as well
    with pytest.raises(NotComputableError, match="exchanged they would") as caught:
        orient_inner(camera(CORNERS), named(plate), apriori_um=4.0)
    assert f"{pair[0] + 1} and {pair[1] + 1}" in str(caught.value)


@pytest.mark.parametrize("pair", list(combinations(range(8), 2)), ids=str)
@lies
def test_any_two_of_eight_exchanged_are_named(pair, lie):
    plate = laid(EIGHT, lie)
    plate[[*pair]] = plate[[*reversed(pair)]]
    first, second = (str(k + 1) for k in pair)
    said = f"{first} and {second} seem to be exchanged"
    try:
        told = inner_advice(orient_inner(camera(EIGHT), named(plate), apriori_um=4.0))[0]
    except NotComputableError as error:
        told = str(error).partition("do not fit: ")[2]
    assert told.startswith(said)


def test_plate_coordinates_in_another_unit():
    plate = laid(CORNERS, LIES["straight"]) * 1000.0
    inner = orient_inner(camera(CORNERS), named(plate))
    assert any("are the plate coordinates in mm" in text for text in inner_advice(inner))


def test_film_that_shrank_unequally_asks_for_more_than_a_similarity():
    plate = laid(EIGHT, LIES["straight"])
    inner = orient_inner(camera(EIGHT), named(plate), transformation="helmert")
    assert inner.refused
    assert any("asks for the affine transformation" in text for text in inner_advice(inner))


def test_detectable_errors_limits_and_power():
    inner = orient_inner(camera(EIGHT), named(laid(EIGHT, LIES["straight"])), apriori_um=4.0)
    for row in inner.rows:
        assert row.mdb == pytest.approx(4.1324 * 4.0 / sqrt(row.r), rel=1e-4)
        assert row.expected == pytest.approx(inner.sigma0_um * sqrt(row.r))
        assert row.size == pytest.approx(abs(row.residual) / row.expected)
        assert row.flagged == (row.size > inner.test.critical)
    assert inner.overall == pytest.approx(4.0 * sqrt(stats.chi2.isf(0.001, 8) / 8))
    assert 0.1 < inner.tested.power < 0.8
    total = sum(row.probability for row in inner.rows) + inner.tested.odds.none
    assert total == pytest.approx(1.0)


@given(st.integers(0, 2**31), st.sampled_from(["helmert", "affine", "bilinear", "projective"]))
@settings(max_examples=40)
def test_the_sum_of_redundancy_numbers_is_the_redundancy(seed, kind):
    rng = np.random.default_rng(seed)
    image = np.array(EIGHT)[: rng.integers(5, 9)] + rng.normal(size=(1, 2))
    lie = Placement(*rng.normal(size=2) * 100, rng.uniform(-3, 3), mirrored=bool(seed % 2))
    inner = orient_inner(camera(image), named(laid(image, lie, seed=seed)), transformation=kind)
    assert sum(row.r for row in inner.rows) == pytest.approx(inner.redundancy, abs=1e-7)
    P = inner.tested.q_vv
    assert np.abs(P @ P - P).max() < 1e-7
    again = inner.transformation.to_plate(image)
    assert np.abs(inner.transformation.to_image(again) - image).max() < 1e-9


# -- distances only --------------------------------------------------------------------------

FOUR_SIDES = CameraCalibration(
    "old",
    210.0,
    distances=(FiducialDistance("1", "3", 226.001), FiducialDistance("4", "2", 226.002)),
)
SQUARE = CameraCalibration(
    "square",
    210.0,
    distances=tuple(
        FiducialDistance(a, b, hypot(*(np.subtract(CORNERS[int(a) - 1], CORNERS[int(b) - 1]))))
        for a, b in ("12", "41", "23", "34", "13", "24")
    ),
)


@lies
def test_two_distances_by_hand(lie):
    """Scale by least squares over both distances; x along the first, origin where they cross."""
    plate = laid(SIDES, lie)
    inner = orient_inner(FOUR_SIDES, named(plate))
    assert inner.kind == "distances"
    assert inner.redundancy == 1
    d = np.array([np.hypot(*(plate[2] - plate[0])), np.hypot(*(plate[1] - plate[3]))])
    D = np.array([226.001, 226.002])
    # s d = D + noise of 2 ends (5 um each, sigma s) and of the certificate (2 um): equal weights
    # but for d itself; both distances have all but one length
    scale = float(d @ D / (d @ d))
    place = inner.placement
    assert place.mirrored == lie.mirrored
    assert place.scale_x == place.scale_y == pytest.approx(1.0 / scale, rel=1e-6)
    x = plate[2] - plate[0]
    assert place.rotation == pytest.approx(np.arctan2(x[1], x[0]), abs=1e-9)
    image = inner.transformation.to_image(plate)
    assert image[[0, 2], 1] == pytest.approx([0.0, 0.0], abs=1e-9)  # the origin lies on 1 - 3
    side = image[1] - image[3]
    assert image[3, 0] - side[0] * image[3, 1] / side[1] == pytest.approx(0.0, abs=1e-9)
    assert image[1, 1] > 0.0
    for row, measured, mm in zip(inner.distances, d, D, strict=True):
        assert row.difference_um == pytest.approx((scale * measured - mm) * 1e3, abs=0.05)
    # a distance cannot say which of its ends is wrong, nor anything across it
    r = {row.key: row.r for row in inner.rows}
    assert r["1", "x"] == pytest.approx(r["3", "x"], abs=1e-6)
    # of the one redundancy, each distance carries half; its two ends 25 of 54 parts each
    assert r["1", "x"] == pytest.approx(0.5 * 25.0 / 54.0, rel=1e-3)
    assert r["1", "y"] == pytest.approx(0.0, abs=1e-6)
    assert not inner.locatable
    assert "x runs from 1 to 3" in " ".join(inner_advice(inner))


def test_scales_along_x_and_y_on_request():
    lie = Placement(30.0, 40.0, 0.3, 0.0, 0.999, 1.001, False)
    plate = laid(CORNERS, lie, 0.0)
    inner = orient_inner(SQUARE, named(plate), transformation="scales")
    assert inner.kind == "scales"
    assert inner.redundancy == 4
    assert inner.placement[2:6] == pytest.approx((0.3, 0.0, 0.999, 1.001), abs=2e-5)
    assert max(abs(d.difference_um) for d in inner.distances) < 3.0
    similarity = orient_inner(SQUARE, named(plate))
    assert similarity.redundancy == 5
    assert similarity.placement.scale_x == pytest.approx(1.0, abs=1e-4)
    assert max(abs(d.difference_um) for d in similarity.distances) > 100.0
    assert any("asks for scales along x and y" in text for text in inner_advice(similarity))


def test_distances_of_a_net_by_an_independent_adjustment():
    """Six distances: scale and rotation with adjusted coordinates, minimised by brute force."""
    plate = laid(CORNERS, LIES["straight"], 0.01, seed=3)
    inner = orient_inner(SQUARE, named(plate), apriori_um=10.0)
    ends = [(int(d.first) - 1, int(d.second) - 1) for d in SQUARE.distances]
    mm = np.array([d.mm for d in SQUARE.distances])
    # in the frame of the adjustment: the mean scale of all distances
    raw = np.array([np.hypot(*(plate[j] - plate[i])) for i, j in ends])
    frame = plate * (mm.sum() / raw.sum())

    def cost(unknowns):
        v, s = unknowns[:8].reshape(4, 2), 1.0 + 1e-5 * unknowns[8]
        moved = frame + v * 1e-3
        distance = [s * np.hypot(*(moved[j] - moved[i])) for i, j in ends]
        return np.append(unknowns[:8] / 10.0, (np.array(distance) - mm) * 1e3 / 2.0)

    found = optimize.least_squares(cost, np.zeros(9), "3-point", xtol=1e-15, ftol=1e-15)
    a, b = frame[ends[0][0]], frame[ends[0][1]]
    turn = (b - a) @ [1.0, 1j] / np.hypot(*(b - a))
    v = found.x[:8].reshape(4, 2) @ [1.0, 1j] / turn
    expected = np.column_stack((v.real, v.imag))
    got = {row.key: row.residual for row in inner.rows}
    for k, (x, y) in enumerate(expected):
        assert (got[str(k + 1), "x"], got[str(k + 1), "y"]) == pytest.approx((x, y), abs=1e-3)
    assert inner.sigma0_um == pytest.approx(10.0 * sqrt(2.0 * found.cost / 5.0), rel=1e-6)
    assert sum(row.r for row in inner.rows) < 5.0  # the rest is the certificate's


def test_distances_that_say_nothing():
    plate = named(laid(SIDES, LIES["straight"]))
    with pytest.raises(NotComputableError, match="fiducial 2 is not measured: with distances only"):
        orient_inner(FOUR_SIDES, {name: plate[name] for name in "134"})
    with pytest.raises(NotComputableError, match="1 and 3 are measured at one place"):
        orient_inner(FOUR_SIDES, plate | {"3": plate["1"]})
    with pytest.raises(NotComputableError, match="4 to 2 lies on the plate along 1 to 3"):
        orient_inner(FOUR_SIDES, plate | {"2": plate["1"], "4": plate["3"]})
    with pytest.raises(NotComputableError, match="needs 2 fiducials, 1 measured"):
        orient_inner(FOUR_SIDES, {"1": (0.0, 0.0)})
    with pytest.raises(NotComputableError, match="have no centre"):
        orient_inner(FOUR_SIDES, {"1": (0, 0), "3": (200, 0), "2": (90, 10), "4": (100, 150)})


def test_the_centre_of_more_than_four_is_their_mean():
    wide = CameraCalibration(
        "five", 210.0, distances=(*SQUARE.distances, FiducialDistance("1", "5", 100.0))
    )
    places = [*CORNERS, (-106.0, 6.0)]
    plate = laid(places, LIES["straight"])
    inner = orient_inner(wide, named(plate))
    image = inner.transformation.to_image(plate)
    assert image.mean(axis=0) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert "mean of the fiducials" in " ".join(inner_advice(inner))


def test_every_name_can_be_asked_for():
    for kind in TRANSFORMATIONS:
        source = SQUARE if kind in ("distances", "scales") else camera(EIGHT)
        plate = laid(CORNERS if source is SQUARE else EIGHT, LIES["mirrored"])
        assert orient_inner(source, named(plate), transformation=kind).kind == kind


@pytest.mark.slow
@given(
    st.integers(0, 7),
    st.floats(-200.0, 200.0),
    st.floats(-200.0, 200.0),
    st.sampled_from([None, "helmert", "affine", "projective"]),
)
def test_however_wrong_one_is_there_is_an_answer_or_a_reason(wrong, dx, dy, kind):
    plate = laid(EIGHT, LIES["straight"])
    plate[wrong] += dx, dy
    try:
        inner = orient_inner(camera(EIGHT), named(plate), transformation=kind)
    except NotComputableError as error:
        said = str(error)
    else:
        assert sum(row.r for row in inner.rows) == pytest.approx(inner.redundancy, abs=1e-6)
        said = " ".join(inner_advice(inner))
        if hypot(dx, dy) > 1.0:
            assert inner.refused
    assert said.isprintable()
    assert len(said) > 10
