"""The page of ties, and the marks of points that are known from elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from anaplot.console.rows import ShownRow
from anaplot.console.tiespage import ties_page
from anaplot.orientation.stripgeometry import Located
from anaplot.orientation.striptie import Placed, tie_systems
from anaplot.photogrammetry.block import TestSettings
from anaplot.planning.synthetic import synthetic_strip
from anaplot.session.accidents import Accident
from anaplot.session.desk import Desk
from anaplot.session.state import start
from anaplot.session.tiecheck import GROUND, TieCheck
from anaplot.station.snapshot import LinkView, snapshot_of

SIGMA0 = 0.005


@pytest.fixture(scope="module")
def tie():
    """Six points in a plane and above it, known in both systems but for one."""
    rng = np.random.default_rng(2)
    at = rng.uniform(-90.0, 90.0, (6, 3))
    own = {f"p{k}": Located(xyz, np.eye(3, 18, 3 * k)) for k, xyz in enumerate(at)}
    other = {name: Located(2.0 * p.xyz + 5.0, 2.0 * p.errors) for name, p in own.items()}
    other["p3"] = Located(other["p3"].xyz + np.array((0.6, 0.2, 0.1)), other["p3"].errors)
    test = TestSettings("baarda")
    return tie_systems(Placed(own, 18), Placed(other, 18), SIGMA0, test)


def page(**fields):
    state = start(synthetic_strip(3, seed=1).block)
    snapshot = replace(snapshot_of(Desk.at(state), 1, LinkView("live")), **fields)
    return "\n".join(line.plain.rstrip() for line in ties_page(snapshot, 72))


def test_without_anything_to_tie_the_page_says_so():
    assert (
        page()
        == "Nothing ties this strip yet: no other strip is measured, and there is no\ncontrol."
    )


def test_the_page_has_every_point_with_its_test_and_names_the_wrong_one(tie):
    check = TieCheck("2", "1", 6, tie, "", tie, ("p3",), 10.0)
    text = page(ties=(check,), accidents=(Accident("p3", "p3 is another point", True),))
    assert text.startswith("p3 is another point")
    assert "STRIP 2 AND 1  6 common points" in text
    wrong = next(line for line in text.splitlines() if line.startswith("  p3"))
    assert wrong.endswith("<< WRONG")
    assert f"{tie.points[3].largest_w:8.2f}" in wrong
    assert f"redundancy {3 * 6 - 7}, test baarda 0.001, critical value 3.29" in text
    assert "checkable" not in text


def test_what_cannot_be_tied_or_tested_yet_says_why(tie):
    text = page(
        ties=(
            TieCheck("2", "1", 1, None, "1 common points, 2 are needed"),
            TieCheck("2", GROUND, 2, replace(tie, points=tie.points[:2], level=True)),
        )
    )
    assert "STRIP 2 AND 1  1 common point\n  1 common points, 2 are needed" in text
    assert "STRIP 2 AND CONTROL  2 common points" in text
    assert "both are taken to be level" in text
    assert "not yet checkable" in text


def test_a_row_that_is_offered_says_so():
    assert ShownRow("C1", "y", "pending", False, mark="control", offered=True).verdict == "offered"
    assert ShownRow("C1", "y", "pending", True, mark="control", offered=True).verdict == "next"
    assert ShownRow("7", "y", "pending", False).verdict == "pending"
