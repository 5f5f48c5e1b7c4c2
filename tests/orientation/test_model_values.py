"""Model values of sqrt(q_vv) for a stereo model: those of the ideal model with its points."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from flightscene import (
    BAARDA,
    EXACT,
    PAPER,
    PROPAGATED,
    bridge_flight,
    fly,
    pair_of,
)
from idealmodel import ideal_pair, spoiled

from anaplot.orientation.grosserrors import model_gross_errors, strategy_findings
from anaplot.orientation.model import orient
from anaplot.orientation.modelvalues import ideal_roots


def roots(solution):
    return np.sqrt([row.r for row in solution.table])


@pytest.mark.parametrize("precision", [PAPER, PROPAGATED])
@pytest.mark.parametrize("name", ["6", "6/3", "13/5"])
def test_an_ideal_model_has_its_own(name: str, precision) -> None:
    solution = orient(ideal_pair(name), precision, BAARDA)
    assert ideal_roots(solution) == pytest.approx(roots(solution), abs=1e-9)


def test_rows_that_are_off_are_off_in_the_ideal_model() -> None:
    pair = replace(ideal_pair("13/5"), off=frozenset({("1'", "y"), ("2", "x"), ("8", "y")}))
    solution = orient(pair, PROPAGATED, BAARDA)
    assert len(solution.table) == 15
    assert ideal_roots(solution) == pytest.approx(roots(solution), abs=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_a_tilted_model_over_hills_is_near_its_ideal_one(seed: int) -> None:
    """Flights along +x and -x, the images turned by up to 60 degrees, bases changing by 15 %."""
    flight = fly(seed, tilt=4.0, relief=0.05, same_camera=True)
    for solution in bridge_flight(flight, PROPAGATED, base=50.0):
        exact, ideal = roots(solution), ideal_roots(solution)
        assert np.abs(ideal - exact).max() > 1e-4
        assert (np.abs(exact - ideal) <= 0.25 * ideal).mean() > 0.85


def test_flown_the_other_way_it_is_the_same() -> None:
    """Both photos turned by 180 degrees: the base of the same model points to -x."""
    pair = ideal_pair("6/3")
    ties = {name: (-x, -y, z) for name, (x, y, z) in pair.ties.items()}
    back = replace(pair, xl=-pair.xl, xr=-pair.xr, ties=ties, preceding_bx=-pair.preceding_bx)
    solution = orient(back, PROPAGATED, BAARDA)
    assert solution.base[0] < 0.0
    assert ideal_roots(solution) == pytest.approx(roots(solution), abs=1e-9)


def test_points_that_do_not_determine_the_ideal_model_have_none() -> None:
    solution = orient(ideal_pair("6"), PAPER, BAARDA)
    line, level = solution.coordinates.copy(), solution.coordinates.copy()
    line[1] = 0.0
    assert np.isnan(ideal_roots(replace(solution, of_coordinates=lambda: line))).all()
    # at the height of the projection centre there is no photo place at all
    level[2, 0] = solution.centre[2]
    assert np.isnan(ideal_roots(replace(solution, of_coordinates=lambda: level))).all()


def test_modified_snooping_of_a_model_computes_exactly_only_in_doubt() -> None:
    flight = fly(3, tilt=4.0, relief=0.05, same_camera=True, noise=0.005)
    pair = pair_of(flight, 0)
    sound = strategy_findings(orient(pair, PROPAGATED, BAARDA), "modified")
    assert sound.model_values is not None
    assert sound.model_values.decided > 0
    wrong = spoiled(pair, "0c", "y", 0.3)
    exact = model_gross_errors(wrong, PROPAGATED, BAARDA, "baarda")
    modified = model_gross_errors(wrong, PROPAGATED, BAARDA, "modified")
    assert [row.name for row in modified.rejected] == [row.name for row in exact.rejected]
    assert modified.rejected[0].name == ("0c", "y")


@pytest.mark.parametrize("precision", [PAPER, EXACT])
def test_a_model_is_kept_without_what_can_be_made_again(precision) -> None:
    solution = list(bridge_flight(fly(3, tilt=4.0), precision, base=50.0))[-1]
    before = len(pickle.dumps(solution.of_unknowns)), len(pickle.dumps(solution.of_points))
    asked = (solution.q_gg, solution.q_points, solution.condition, solution.q_vv)
    assert (
        len(pickle.dumps(solution.of_unknowns)),
        len(pickle.dumps(solution.of_points)),
    ) == before
    kept = pickle.loads(pickle.dumps(solution))
    assert not {"q_gg", "q_points", "condition"} & vars(kept).keys()
    again = (kept.q_gg, kept.q_points, kept.condition, kept.q_vv)
    assert all(map(np.array_equal, again, asked))
    assert kept.table == solution.table
