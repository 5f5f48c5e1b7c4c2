"""What cannot be computed says so, names the model and says what to do."""

from dataclasses import replace

import numpy as np
import pytest
from flightscene import PAPER, TAU, bridge_flight, fly, pair_of, project
from hypothesis import given, settings
from hypothesis import strategies as st

from anaplot.errors import NotComputableError, TooFewError
from anaplot.orientation import solver
from anaplot.orientation.conditionequations import ConditionEquations
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import WrongPointsError, orient
from anaplot.orientation.solver import find_orientation, iterate
from anaplot.orientation.strip import bridge, bridge_strip
from anaplot.photogrammetry.block import Block, ImagePoint, Photo, Precision, Strip, TestSettings
from anaplot.planning.blockplan import BlockPlan, plan_block


def seeds(count):
    """Return the first for the fast lane, too, the others for all tests."""
    return [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, count))]


def flight(seed=5, noise=0.003, **kw):
    return fly(seed, 3, tilt=3.0, kappa=10.0, noise=noise, **kw)


def refused(pair, match, kind=NotComputableError):
    with pytest.raises(kind, match=match) as caught:
        orient(pair, PAPER, TAU)
    assert caught.value.exit_code == 4
    text = str(caught.value)
    assert text.startswith(f"model {pair.name}: ")
    assert "\n" not in text
    return caught.value


def seen(flight, points):
    """Model 0/1 with the given ground points instead of the flight's."""
    images = [
        {
            f"p{k}": project(flight.cameras[i], flight.centres[i], flight.rotations[i], point)
            for k, point in enumerate(points)
        }
        for i in (0, 1)
    ]
    return replace(flight, images=[*images, flight.images[2]])


def on_ground(flight, places):
    b, c = flight.centres[1, 0], flight.cameras[0].c
    return [np.array([b * x, c * y, -c * z]) for x, y, z in places]


@pytest.mark.parametrize("count", [0, 1, 4])
def test_too_few_points(count):
    f = flight()
    points = list(f.images[0])[:count]
    word = "one point in" if count == 1 else f"{count} points in"
    refused(pair_of(f, 0, points=points), f"{word} common.*first model needs five")


@pytest.mark.parametrize(
    "direction", [(0.0, 1.0), (1.0, 0.0), (1.0, 0.7)], ids=["across", "along", "slanting"]
)
def test_points_on_one_line(direction):
    f = flight()
    steps = np.linspace(-0.5, 0.5, 8)
    places = [(0.5 + direction[0] * s, direction[1] * s, 1.0) for s in steps]
    view = seen(f, on_ground(f, places))
    error = refused(pair_of(view, 0, points=list(view.images[0])), "the points lie on one line")
    assert "not determined: " in str(error)
    assert "beta_y" in str(error)


def test_points_in_one_place():
    f = flight()
    view = seen(f, on_ground(f, [(0.5, 0.2, 1.0)] * 7))
    error = refused(pair_of(view, 0, points=list(view.images[0])), "the points lie in one place")
    assert "not determined" in str(error)


def test_points_too_close_together():
    f = flight()
    rng = np.random.default_rng(1)
    places = [(0.5 + x, y, 1.0 + z) for x, y, z in rng.uniform(-0.01, 0.01, (9, 3))]
    view = seen(f, on_ground(f, places))
    refused(pair_of(view, 0, points=list(view.images[0])), "not determined: .*condition number")


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("seed", seeds(6))
def test_images_turned_by_ninety_degrees(seed, sense):
    f = flight(seed)
    turned = [{p: (-sense * y, sense * x) for p, (x, y) in image.items()} for image in f.images]
    pair = pair_of(replace(f, images=turned), 0, points=[p for p in f.images[0] if p[0] in "01"])
    refused(pair, "images are turned.*turn them by 90 degrees")


def test_few_points_do_not_say_that_images_are_turned():
    f = flight()
    turned = [{p: (-y, x) for p, (x, y) in image.items()} for image in f.images]
    for count in range(5, 10):
        points = [p for p in f.images[0] if p[0] in "01"][:count]
        pair = pair_of(replace(f, images=turned), 0, points=points)
        if count < 8:
            refused(pair, "the base lies across x: more of them tell", TooFewError)
        else:
            refused(pair, "turn them by 90 degrees")


def test_one_image_alone_turned_is_a_large_kappa():
    f = flight(noise=0.0)
    right = {p: (-y, x) for p, (x, y) in f.images[1].items()}
    model = orient(pair_of(f, 0, right=right), PAPER, TAU)
    straight = orient(pair_of(f, 0), PAPER, TAU)
    assert np.sign(model.base[0]) == np.sign(straight.base[0])
    assert abs(model.rotation[2] - straight.rotation[2]) == pytest.approx(np.pi / 2, abs=1e-9)


@pytest.mark.parametrize("which", ["left", "right"])
@pytest.mark.parametrize("seed", seeds(4))
def test_a_mirrored_photo(which, seed):
    f = flight(seed)
    index = 0 if which == "left" else 1
    images = list(f.images)
    images[index] = {p: (-x, y) for p, (x, y) in images[index].items()}
    pair = pair_of(replace(f, images=images), 0)
    refused(pair, "interchanged|mirrored|does not converge|turned")


def test_a_later_model_without_ties():
    f = flight()
    first = bridge_flight(f)[0]
    none = replace(first, names=(), of_coordinates=lambda: np.zeros((3, 0)))
    refused(pair_of(f, 1, none), "without ties there is no scale")
    ties = [p for p in f.images[1] if p[0] == "1"]
    off = frozenset((p, "x") for p in ties)
    refused(pair_of(f, 1, first, off=off), "every tie is switched off")


def test_a_later_model_with_too_few_rows():
    f = flight()
    first = bridge_flight(f)[0]
    refused(pair_of(f, 1, first, points=["1a", "2a", "2c"]), "3 points and 1 ties give 4 rows")


@pytest.mark.parametrize("points", [None, ["1a", "1c", "1d", "2a", "2c"]])
def test_ties_that_do_not_determine_the_base(points):
    f = flight()
    first = bridge_flight(f)[0]
    # every tie at the new projection centre: no ray from there can be wrong
    x, _, z = first.base
    at_centre = first.coordinates.copy()
    at_centre[0], at_centre[2] = x, z
    pair = pair_of(f, 1, replace(first, of_coordinates=lambda: at_centre), points=points)
    refused(pair, "ties do not determine the base")


@pytest.mark.slow
def test_rows_that_leave_an_unknown_without_any_hold():
    f = flight()
    first = orient(pair_of(f, 0, points=[p for p in f.images[0] if p[0] in "01"]), PAPER, TAU)
    ties = [p for p in f.images[1] if p[0] == "1"]
    off = frozenset((p, "y") for p in ties)
    refused(pair_of(f, 1, first, points=ties, off=off), "not determined: beta_y")


@pytest.mark.parametrize("seed", seeds(6))
def test_photos_of_a_later_model_interchanged(seed):
    f = flight(seed)
    first = bridge_flight(f)[0]
    pair = pair_of(f, 1, first)
    exchanged = replace(pair, xl=pair.xr, xr=pair.xl, c_left=pair.c_right, c_right=pair.c_left)
    refused(exchanged, "photos are interchanged")


@pytest.mark.parametrize("seed", seeds(6))
def test_one_tie_behind_the_photos_proves_no_interchange(seed):
    """The sign of its depth would be all that says so."""
    f = flight(seed)
    truly = bridge_flight(f)[0]
    right = dict(f.images[1])
    x, y = right["1c"]
    right["1c"] = (x + 1.5 * truly.base[0], y)  # a parallax of the other sign
    first = orient(pair_of(f, 0, right=right), PAPER, TAU)
    points = [p for p in f.images[1] if p == "1c" or p[0] == "2" or p.startswith("1m")]
    error = refused(pair_of(f, 1, first, points=points), "would lie behind a photo")
    assert "the photos are interchanged, " not in str(error)


@pytest.mark.parametrize("error_mm", [-0.2, 0.06, 0.2])
def test_a_gross_error_over_flat_ground_does_not_interchange_photos(error_mm):
    # exchanged photos in one and the same place would fit ties that lie in a line below it
    made = plan_block(BlockPlan(2, 4, 0.60, 0.60))
    rows = tuple(
        replace(row, x=row.x + error_mm) if (row.photo, row.point) == ("102", "01-02") else row
        for row in made.block.image_points
    )
    found = bridge_strip(replace(made.block, image_points=rows), made.block.strips[0])
    assert found.error is None
    assert [model.right for model in found.models] == ["102", "103", "104"]
    wrong = {(row.point, row.axis) for row in found.models[1].flagged}
    assert ("01-02", "x") in wrong


def test_photos_of_a_first_model_interchanged_only_turn_the_base():
    f = flight(noise=0.0)
    pair = pair_of(f, 0)
    exchanged = replace(pair, xl=pair.xr, xr=pair.xl, c_left=pair.c_right, c_right=pair.c_left)
    straight = orient(pair, PAPER, TAU)
    assert orient(exchanged, PAPER, TAU).base[0] * straight.base[0] < 0.0


def test_no_parallax_at_all():
    f = flight()
    pair = pair_of(f, 0)
    refused(replace(pair, xr=pair.xl), "mean x-parallax is zero.*block.toml")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_coordinate_that_is_no_number(value):
    f = flight()
    right = dict(f.images[1])
    right["0c"] = (value, 1.0)
    refused(pair_of(f, 0, right=right), "point 0c has a coordinate that is not a number")


def test_measurements_that_have_nothing_in_common():
    f = flight()
    rng = np.random.default_rng(2)
    right = {p: tuple(rng.uniform(-100, 100, 2).tolist()) for p in f.images[0]}
    refused(pair_of(f, 0, right=right), "model 0/1")


def test_two_points_so_wrong_that_no_solution_exists_are_named():
    f = flight()
    right = dict(f.images[1])
    right["0a"], right["0d"] = right["0d"], right["0a"]
    error = refused(pair_of(f, 0, right=right), "0a and 0d interchanged", WrongPointsError)
    assert error.suspects == error.interchange.points == ("0a", "0d")
    x, y = f.images[1]["0a"]
    wrong = f.images[1] | {"0a": (x + 70.0, 20.0 - y), "0d": right["0d"]}
    error = refused(pair_of(f, 0, right=wrong), "the other points agree", WrongPointsError)
    assert sorted(error.suspects) == ["0a", "0d"]
    assert error.interchange is None
    assert f"remeasure {error.suspects[0]}" in str(error)


def test_one_point_so_wrong_that_no_solution_exists_is_named_or_shows_as_the_worst():
    named = 0
    for seed in range(12):
        f = flight(seed)
        x, y = f.images[1]["0a"]
        right = f.images[1] | {"0a": (x + 3.0 * f.cameras[1].c, -4.0 * y)}
        worst = None
        try:
            model = orient(pair_of(f, 0, right=right), PAPER, TAU)
            worst = diagnose(model).suspects[0][0]
        except WrongPointsError as error:
            (worst,) = error.suspects
            named += 1
        assert worst == "0a"
    assert named > 4


@pytest.mark.slow
@settings(max_examples=80)
@given(
    st.integers(0, 10**6),
    st.integers(0, 9),
    st.lists(st.tuples(st.floats(-300, 300), st.floats(-300, 300)), min_size=9, max_size=9),
)
def test_whatever_is_measured_the_answer_is_a_model_or_one_line(seed, count, wrong):
    f = flight(seed)
    points = [p for p in f.images[0] if p[0] in "01"]
    right = dict(f.images[1]) | dict(zip(points[:count], wrong, strict=False))
    said = ""
    model = None
    try:
        model = orient(pair_of(f, 0, right=right), PAPER, TAU)
    except NotComputableError as error:
        said = str(error)
    if model is None:
        assert "\n" not in said
        assert said.startswith("model 0/1: ")
    else:
        assert np.isfinite(model.base).all()
        assert sum(row.r for row in model.table) == pytest.approx(model.redundancy, abs=1e-6)


def test_a_strip_ends_at_the_model_that_cannot_be_computed():
    f = flight()
    rows = [
        ImagePoint(str(k), p, x, y)
        for k, image in enumerate(f.images)
        for p, (x, y) in image.items()
        if not (k == 2 and p[0] == "1")
    ]
    strip = Strip("7", ("0", "1", "2"), 92.0)
    block = Block(
        "b",
        Precision(),
        TestSettings(),
        tuple(f.cameras),
        tuple(Photo(str(k), str(k)) for k in range(3)),
        (strip,),
        tuple(rows),
    )
    bridged = bridge_strip(block, strip)
    assert [m.name for m in bridged.models] == ["0/1"]
    assert bridged.error.startswith("strip 7, model 1/2: ")
    # the other strips go on
    whole = bridge(replace(block, strips=(strip, Strip("8", ("0", "1")))))
    assert [(b.strip, len(b.models), b.error is None) for b in whole] == [
        ("7", 1, False),
        ("8", 1, True),
    ]


def test_leaving_points_out_is_given_up_early(monkeypatch):
    """With five of thirteen points anywhere, no twelve of them agree."""
    f = flight()
    pair = pair_of(f, 0, points=list(f.images[0])[:13])
    rng = np.random.default_rng(1)
    xr = np.array(pair.xr)
    xr[:5] = rng.uniform(-80.0, 80.0, (5, 2))
    most = []

    def noted(*given, **options):
        most.append(options.get("most"))
        return iterate(*given, **options)

    monkeypatch.setattr(solver, "iterate", noted)
    conditions = ConditionEquations(replace(pair, xr=xr), "paper")
    _, suspects = find_orientation(replace(pair, xr=xr), conditions, 92.0, 0.005)
    assert suspects == ()
    assert most.count(solver.FEW_ITERATIONS) == len(pair.points)
