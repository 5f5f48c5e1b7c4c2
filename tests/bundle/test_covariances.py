"""Covariances of any unknowns against an own dense adjustment, and what they are called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundleblocks import aerial
from conditionblocks import condition, dense_conditions, every_kind, flat_scene, with_conditions
from denseblock import dense
from givenblocks import campaigns, one_after_the_other
from scipy.linalg import null_space, qr, solve_triangular

from anaplot.bundle.adjust import adjust_block, adjust_bundle
from anaplot.bundle.solve import crosscofactors
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.covariances import covariance_of, unknown_cofactors
from anaplot.bundle.solve.parametercorrelations import parameter_matrix, photo_correlations
from anaplot.bundle.solve.parameterpriors import ParameterPrior
from anaplot.bundle.solve.posteriors import posterior_of
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.solve.unknownnames import unknowns_meant
from anaplot.bundle.solve.unknowns import unknown_values
from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Camera, ControlPoint, TestSettings
from anaplot.photogrammetry.rotation import rotation_angles, rotation_axes, rotation_matrix, turn

CAMERA = Camera("cam", 150.0)
EVERYTHING = ("photos", "points", "parameters")


def adjusted(scene=None, additional=None, datum="control", conditions=()):
    made = aerial(2, 4, noise_um=5.0, **(scene or {"control_sigma": 0.05}))
    rows = list(made.block.image_points)
    # some rays twice, as measured in two models
    rows += [replace(r, model="101/102", x=r.x + 0.004) for r in rows if r.photo == "102"][:5]
    made = made.with_rows(rows)
    problem = make_problem(
        made.block,
        datum=datum,
        additional=None if additional is None else additional_parameters(*additional),
    )
    return adjust_bundle(problem, made.start(problem, np.random.default_rng(2), 1.0, 0.001))


def conditioned(firm, datum="control"):
    scene = flat_scene()
    return with_conditions(scene, every_kind(scene, firm), datum=datum)


def given(firm=False):
    return one_after_the_other(campaigns(5.0, 0.0 if firm else 0.05), ("points",))


def barred(sigma):
    scene = flat_scene()
    bars = [
        condition(scene, "distance", points, own)
        for points, own in (("p2 p7", sigma), ("p9 p14", 0.03))
    ]
    return with_conditions(scene, bars, datum="free")


def two_cameras():
    """Two cameras' lenses; k1 of one is held, c of it weighted."""
    scene = aerial(2, 4, noise_um=5.0, control_sigma=0.05, relief=200.0)
    photos = [replace(p, camera="other" if p.id[0] == "2" else "cam") for p in scene.block.photos]
    made = replace(scene.block, photos=tuple(photos), cameras=(CAMERA, replace(CAMERA, id="other")))
    lenses = additional_parameters(
        "physical:c,x0,k1:camera", priors=[ParameterPrior("c", 0.0, 0.1, "other")]
    )
    problem = make_problem(made, additional=replace(lenses, still=frozenset({("other", "k1")})))
    return adjust_bundle(problem, scene.start(problem, np.random.default_rng(2), 1.0, 0.001))


CASES = {
    "weighted control": adjusted,
    "error-free control": lambda: adjusted({"control_sigma": 0.0}),
    "priors": lambda: adjusted({"control_sigma": 0.1, "priors": True}),
    "ebner": lambda: adjusted(additional=("ebner",)),
    "ebner by strip": lambda: adjusted(additional=("ebner:strip", 10.0)),
    "physical": lambda: adjusted({"control_sigma": 0.05, "relief": 200.0}, ("physical:k1,x0,c",)),
    "physical by photo": lambda: adjusted(
        {"control_sigma": 0.05, "priors": True}, ("physical:photo", 5.0)
    ),
    "two cameras, a parameter held": two_cameras,
    "conditions": lambda: conditioned(()),
    "conditions free of error": lambda: conditioned((0, 1, 4)),
    "free": lambda: adjusted(datum="free"),
    "free with parameters": lambda: adjusted(datum="free", additional=("ebner:camera", 5.0)),
    "free, scale by a distance": lambda: barred(0.02),
    "free, scale free of error": lambda: barred(0.0),
    "minimal": lambda: adjusted(datum="minimal"),
    "a given prior": given,
}


@pytest.fixture(scope="module")
def block():
    kept = {}

    def of(name):
        if name not in kept:
            kept[name] = CASES[name]()
        return kept[name]

    return of


def dense_cofactors(block):
    """Cofactors of the vector of all unknowns by triangularisation, what is held out of it."""
    problem, change = block.problem, block.cofactors.change
    white, free = dense(block)
    u = white.shape[1]
    if problem.additional_still is not None:
        free[u - problem.in_border :] = ~problem.additional_still.ravel()
    held = [np.eye(u)[~free]]
    if problem.conditions is not None:
        rows, shared, sigma, firm = dense_conditions(block)
        both = np.hstack((rows, shared))
        white = np.pad(white, ((0, 0), (0, shared.shape[1])))
        white = np.vstack((white, both[~firm] / sigma[~firm, None]))
        held = [np.pad(part, ((0, 0), (0, shared.shape[1]))) for part in (*held,)] + [both[firm]]
    if problem.given is not None:
        equations = block.cofactors.normal.linear.given
        jacobian = np.hstack((equations.photos.toarray(), equations.points.toarray()))
        white = np.vstack((white, np.linalg.cholesky(problem.given.weight).T @ jacobian))
    if change is not None:
        n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
        datum = np.zeros((7, white.shape[1]))
        if problem.datum == "minimal":
            datum[:, : n * d] = change.held_photos.reshape(n * d, 7).T
            datum[:, n * d : n * d + 3 * p] = change.held_points.reshape(3 * p, 7).T
        else:
            middle = block.state.points.mean(axis=0)
            for k, place in enumerate(block.state.points - middle):
                x, y, z = place
                own = slice(n * d + 3 * k, n * d + 3 * k + 3)
                datum[:3, own] = np.eye(3)
                datum[3:6, own] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
                datum[6, own] = place
            if problem.defect == 6:
                datum = datum[:6]
        held.append(datum)
    scale = np.linalg.norm(white, axis=0)
    scale[scale == 0.0] = 1.0
    fixed = np.vstack(held) / scale
    fixed = fixed / np.linalg.norm(fixed, axis=1, keepdims=True)
    allowed = null_space(fixed) if len(fixed) else np.eye(len(scale))
    upper = qr((white / scale) @ allowed, mode="economic")[1]
    root = allowed @ solve_triangular(upper, np.eye(len(upper))) / scale[:, None]
    return (root @ root.T)[:u, :u]


def dense_functions(block, names):
    """Derivatives of the named unknowns, one after the other."""
    problem = block.problem
    n, d, p = len(problem.photos), problem.per_photo, len(problem.points)
    out = np.zeros((len(names), n * d + 3 * p + problem.in_border))
    for row, name in enumerate(names):
        if name.kind == "point":
            at = n * d + 3 * problem.points.index(name.owner) + "XYZ".index(name.unknown)
            out[row, at] = 1.0
        elif name.kind == "photo":
            photo = problem.photos.index(name.owner)
            if name.unknown in "XYZ":
                out[row, d * photo + "XYZ".index(name.unknown)] = 1.0
            else:
                omega, phi, _ = rotation_angles(block.state.rotations[photo])
                which = ("omega", "phi", "kappa").index(name.unknown)
                own = np.linalg.inv(rotation_axes(omega, phi))[which]
                out[row, d * photo + 3 : d * photo + 6] = own
        else:
            labels = problem.additional.set.names
            group, label = problem.additional_groups.index(name.owner), labels.index(name.unknown)
            unit = 1.0 if problem.lens_units is None else problem.lens_units[group, label]
            at = n * d + 3 * p + group * len(labels) + label
            out[row, group * d + 6 + label if problem.photo_invariant else at] = unit
    return out


def everything(block):
    wanted = EVERYTHING if block.problem.additional is not None else EVERYTHING[:2]
    return unknowns_meant(block.problem, wanted, "--covariance")


@pytest.mark.parametrize("name", CASES)
def test_every_covariance_equals_an_own_dense_adjustment(name, block) -> None:
    found = block(name)
    names = everything(found)
    n, p = len(found.problem.photos), len(found.problem.points)
    still = 0 if found.problem.additional_still is None else found.problem.additional_still.sum()
    q = len(found.problem.additional_groups) * found.problem.basis.shape[2] - still
    assert len(names) == 6 * n + 3 * p + q
    functions = dense_functions(found, names)
    wanted = functions @ dense_cofactors(found) @ functions.T
    own = unknown_cofactors(found, names)
    size = np.sqrt(np.diag(own))
    assert np.abs(wanted[size == 0.0]).max(initial=0.0) < 1e-12
    size[size == 0.0] = 1.0
    np.testing.assert_allclose(
        own / size[:, None] / size, wanted / size[:, None] / size, rtol=0.0, atol=1e-9
    )
    np.testing.assert_array_equal(own, own.T)


@pytest.mark.parametrize("name", ["weighted control", "physical by photo", "minimal", "free"])
def test_deviations_are_those_of_the_rows(name, block) -> None:
    found = block(name)
    whole = covariance_of(found, everything(found))
    shown = {one.text: s for one, s in zip(whole.names, whole.deviations, strict=True)}
    values = {one.text: value for one, value in zip(whole.names, whole.values, strict=True)}
    for row in found.point_rows():
        for axis, value, s in zip("XYZ", row.xyz, row.s_xyz, strict=True):
            assert shown[f"point:{row.point}:{axis}"] == pytest.approx(s, rel=1e-7, abs=1e-12)
            assert values[f"point:{row.point}:{axis}"] == value
    for row in found.photo_rows():
        angles = ("omega", "phi", "kappa")
        for unknown, value, s in zip(
            (*"XYZ", *angles), (*row.position, *row.angles), (*row.s_position, *row.s_angles),
            strict=True,
        ):  # fmt: skip
            assert shown[f"photo:{row.photo}:{unknown}"] == pytest.approx(s, rel=1e-7, abs=1e-12)
            assert values[f"photo:{row.photo}:{unknown}"] == value
    for row in found.parameter_rows():
        key = f"parameter:{row.group}:{row.name}"
        assert shown[key] == pytest.approx(row.s_coefficient, rel=1e-7)
        assert values[key] == pytest.approx(row.coefficient, rel=1e-12)
    held = {"minimal": 7, "weighted control": 0, "physical by photo": 0, "free": 0}[name]
    assert int((whole.deviations == 0.0).sum()) == held
    assert int(np.isnan(whole.correlations).all(axis=1).sum()) == held
    assert whole.sigma == found.sigma
    assert whole.estimated
    np.testing.assert_array_equal(whole.matrix, whole.cofactors * found.sigma**2)


@pytest.mark.parametrize("name", CASES)
def test_correlations_of_photos_and_parameters_are_those_of_the_covariance(name, block) -> None:
    found = block(name)
    names = unknowns_meant(found.problem, ["photos"], "x")
    rho = covariance_of(found, names).correlations
    first, second = np.triu_indices(6, 1)
    expected = [
        rho[start : start + 6, start : start + 6][first, second]
        for start in range(0, len(names), 6)
    ]
    np.testing.assert_allclose(photo_correlations(found), expected, rtol=0.0, atol=1e-9)
    mine = parameter_matrix(found)
    if found.problem.additional is None or found.problem.photo_invariant:
        assert mine is None
        return
    names = unknowns_meant(found.problem, ["parameters"], "x")
    assert mine[0] == tuple((one.owner, one.unknown) for one in names)
    expected = covariance_of(found, names).correlations
    np.testing.assert_allclose(mine[1], expected, rtol=0.0, atol=1e-9)


def test_angles_are_those_of_the_small_rotations_that_are_adjusted(block) -> None:
    """By differences: what turning a photo about X, Y, Z makes of omega, phi, kappa."""
    found = block("weighted control")
    names = unknowns_meant(found.problem, ["photo:203"], "x")[3:]
    at = found.problem.photos.index("203")
    rotation, step = found.state.rotations[at], 1e-4
    own = np.empty((3, 3))
    for k, axis in enumerate(np.eye(3)):
        ends = [
            np.array(rotation_angles(turn(*(sign * step * axis)) @ rotation))
            for sign in (-1.0, 1.0)
        ]
        own[:, k] = (ends[1] - ends[0]) / (2.0 * step)
    q = found.cofactors.photos[at][3:, 3:]
    np.testing.assert_allclose(unknown_cofactors(found, names), own @ q @ own.T, rtol=1e-6)


def test_what_is_free_of_error_has_rows_of_zeros(block) -> None:
    found = block("error-free control")
    names = unknowns_meant(found.problem, ["points:p1,p6"], "x")
    assert found.problem.fixed[found.problem.points.index("p1")].all()
    own = covariance_of(found, names)
    assert (own.matrix[:3] == 0.0).all()
    assert (own.deviations[3:] > 0.0).all()
    assert np.isnan(own.correlations[:3]).all()


def test_an_a_priori_sigma_and_none_at_all() -> None:
    scene = aerial(2, 3, noise_um=9.0, control_sigma=0.05)
    by_baarda = adjust_block(replace(scene.block, test=TestSettings("baarda")))
    names = unknowns_meant(by_baarda.problem, ["points:p5"], "x")
    own = covariance_of(by_baarda, names)
    assert (own.sigma, own.estimated) == (1.0, False)
    np.testing.assert_array_equal(own.matrix, own.cofactors)
    # three points free of error for one photo: nothing is left over, and tau has no sigma
    rows = [r for r in scene.block.image_points if r.photo == "101"]
    firm = [r.point for r in rows][0::2][:3]
    control = tuple(
        ControlPoint(name, tuple(scene.points[name].tolist()), (0.0,) * 3) for name in firm
    )
    left = replace(
        scene.block,
        photos=scene.block.photos[:1],
        strips=(),
        image_points=tuple(r for r in rows if r.point in firm),
        control=control,
    )
    problem = make_problem(left)
    alone = adjust_bundle(problem, scene.start(problem))
    assert alone.redundancy == 0
    none = covariance_of(alone, unknowns_meant(alone.problem, ["photos"], "x"))
    assert none.sigma is None
    assert np.isnan(none.matrix).all()
    assert np.isnan(none.deviations).all()
    assert (np.diag(none.cofactors) > 0.0).all()


def test_in_portions_and_in_any_order_the_same(block, monkeypatch) -> None:
    found = block("free with parameters")
    names = everything(found)
    whole = unknown_cofactors(found, names)
    monkeypatch.setattr(crosscofactors, "_BYTES", 1)
    some = [names[k] for k in (70, 3, 41, 0, len(names) - 1)]
    at = [names.index(one) for one in some]
    np.testing.assert_allclose(
        unknown_cofactors(found, some), whole[np.ix_(at, at)], rtol=1e-9, atol=1e-13
    )


def test_a_posterior_is_the_same_computation(block) -> None:
    found = block("weighted control")
    left = posterior_of(found, ["p7", "photo:102", "point:p2:Z"])
    own = covariance_of(found, left.names)
    np.testing.assert_array_equal(left.covariance, own.cofactors)
    np.testing.assert_array_equal(left.x, unknown_values(found, left.names))
    assert [one.text for one in left.names[-2:]] == ["photo:102:kappa", "point:p2:Z"]
    with pytest.raises(InputError, match="additional parameters are not carried"):
        posterior_of(block("ebner"), ["points", "parameters"])


def test_omega_and_kappa_of_a_photo_that_looks_along_x() -> None:
    """phi = 90 degrees: they are one, and phi and the position go on."""
    rng = np.random.default_rng(3)
    scene = aerial(2, 3, noise_um=5.0, control_sigma=0.05)
    whole = rotation_matrix(0.0, np.pi / 2, 0.0)
    found = adjust_block(scene.block)
    at = found.problem.photos.index("102")
    rotations = found.state.rotations.copy()
    rotations[at] = whole @ rotation_matrix(0.0, 0.0, rng.uniform(-1, 1))
    looking = replace(found, state=replace(found.state, rotations=rotations))
    for wrong in ("photo:102:omega", "photo:102:kappa", "photos"):
        names = unknowns_meant(looking.problem, [wrong], "x")
        with pytest.raises(NotComputableError, match="photo 102: omega and kappa are one"):
            covariance_of(looking, names)
    known = np.isfinite(photo_correlations(looking))
    assert known.sum(axis=1).tolist() == [15, 3, 15, 15, 15, 15], "of its position alone"
    names = unknowns_meant(looking.problem, ["photo:102:phi", "photo:102:Z"], "x")
    assert (covariance_of(looking, names).deviations > 0.0).all()


# --- names ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def odd():
    """A block whose points and photos are called as nobody should call them."""
    scene = aerial(2, 3, noise_um=5.0, control_sigma=0.05)
    points = {"p1": "a,b", "p2": "a", "p3": "b", "p4": "7:Z", "p5": "7", "p6": "points",
              "p8": "102", "p9": "point:7"}  # fmt: skip
    photos = {"101": "left/cam 1,0.jpg", "103": "a"}
    made = replace(
        scene.block,
        photos=tuple(replace(p, id=photos.get(p.id, p.id)) for p in scene.block.photos),
        strips=(),
        image_points=(
            *(
                replace(r, photo=photos.get(r.photo, r.photo), point=points.get(r.point, r.point))
                for r in scene.block.image_points
            ),
            replace(scene.block.image_points[0], point="lonely"),
        ),
        control=(
            *(replace(c, point=points.get(c.point, c.point)) for c in scene.block.control),
            replace(scene.block.control[0], point="unseen"),
        ),
    )
    made = replace(
        made, image_points=tuple(replace(r, photo="left/cam 1,0.jpg") if r.point == "lonely" else r
                                 for r in made.image_points),
    )  # fmt: skip
    return make_problem(made, additional=additional_parameters("physical:k1,c:camera", 5.0))


def texts(problem, *wanted):
    return [one.text for one in unknowns_meant(problem, wanted, "--covariance")]


def xyz(point):
    return [f"point:{point}:{axis}" for axis in "XYZ"]


def test_names_are_found_however_odd_they_are(odd) -> None:
    assert texts(odd, "points:a,b") == xyz("a") + xyz("b")
    assert texts(odd, "point:a,b") == xyz("a,b")
    assert texts(odd, "points: b , a") == xyz("b") + xyz("a")
    assert texts(odd, 'points:b,"a,b","a,b:Z"') == xyz("b") + xyz("a,b")
    assert texts(odd, "point:7:Z") == xyz("7:Z")
    assert texts(odd, "point:7:X", "point:7:Z:Y") == ["point:7:X", "point:7:Z:Y"]
    assert texts(odd, "points:7,7:X,b:Z") == [*xyz("7"), "point:b:Z"]
    assert texts(odd, "point:points") == xyz("points")
    assert texts(odd, "point:point:7", "point:7") == xyz("point:7") + xyz("7")
    assert texts(odd, "photo:left/cam 1,0.jpg:kappa") == ["photo:left/cam 1,0.jpg:kappa"]
    assert len(texts(odd, "left/cam 1,0.jpg")) == 6
    assert len(texts(odd, "points")) == 3 * len(odd.points)
    assert texts(odd, "parameters") == ["parameter:cam:c", "parameter:cam:k1"]
    assert texts(odd, "parameters:k1") == texts(odd, "parameter:cam:k1") == ["parameter:cam:k1"]
    assert texts(odd, "parameters:cam") == texts(odd, "parameters")
    # each once, where it was asked for first
    assert texts(odd, "point:b:Z", "points:b,a") == ["point:b:Z", "point:b:X", "point:b:Y",
                                                     *xyz("a")]  # fmt: skip


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ("points:a,p77", r"no point 'p77' in the adjusted block \(did you mean 'p7'\?\)"),
        ("point:lonely", "point 'lonely' takes no part in the adjustment: it has one ray only"),
        ("points:unseen", "point 'unseen' takes no part in the adjustment: it is not measured"),
        ("photo:203:omeg", r"photo '203' has no 'omeg' \(did you mean 'omega'\?\)"),
        ("point:7:omega", r"point '7' has no 'omega' \(known: X, Y, Z\)"),
        ("photo:204:X", "no photo '204:X' in the adjusted block"),
        ("parameter:cam:k2", "parameter 'cam' has no 'k2'"),
        ("parameters:k2", r"no parameter 'k2' in the adjusted block \(known: cam, c, k1\)"),
        ("102", "'102' is a point and a photo: point:102 or photo:102"),
        ("foto:203", "no point and no photo 'foto:203' in the adjusted block"),
        ("\x1b[31m", r"no point and no photo '\\x1b\[31m'"),
    ],
)
def test_a_name_that_is_none_is_said_with_the_nearest(odd, wanted, words) -> None:
    with pytest.raises(InputError, match=words) as caught:
        texts(odd, wanted)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("--covariance: ")


def test_a_parameter_that_is_held_is_said_to_be(block) -> None:
    problem = block("two cameras, a parameter held").problem
    assert texts(problem, "parameters:k1") == ["parameter:cam:k1"]
    assert texts(problem, "parameter:other") == ["parameter:other:c", "parameter:other:x0"]
    with pytest.raises(InputError, match="parameter 'other:k1' is held: it does not vary"):
        texts(problem, "parameter:other:k1")


def test_parameters_of_a_block_that_has_none(block) -> None:
    problem = block("free").problem
    for wanted in ("parameters", "parameters:k1", "parameter:cam:k1"):
        with pytest.raises(InputError, match="without additional parameters"):
            texts(problem, wanted)
