"""Versions of a network side by side, and what its tests would say of errors (1978)."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from anaplot.adjustment.consistency import single_test
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.photogrammetry.planting import PlantedError
from anaplot.planning.expectedtests import expected_tests
from anaplot.planning.networkplan import cube, plan_network


def answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert main(["plan", "network", *arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_each_version_says_side_by_side_what_it_says_alone(capsys) -> None:
    found = answer(capsys, "cube", "--case", "A,E", "--image-um", "1")
    for version, row, verdict in zip("AE", found["networks"], found["verdicts"], strict=True):
        alone = answer(capsys, "cube", "--case", version, "--image-um", "1")
        assert row["network"] == verdict["network"] == alone["name"]
        for key in ("observations", "unknowns", "redundancy"):
            assert row[key] == alone[key]
        for key, value in alone["indicators"].items():
            assert row[key] == value
        assert verdict["reliable"] == alone["rules"]["reliability"]["met"]
        assert verdict["in_fewer"] == alone["rules"]["cover"]["in_fewer"]
        for key in ("alpha", "critical", "power"):
            assert verdict[key] == alone["global_test"][key]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cube", "--case", "A,F"], "is not versions of the cube"),
        (["cube", "--case", "A,A"], "is not versions of the cube"),
        (["cube", "--case", "A,B", "--point", "2"], "go with one version of the cube"),
        (["cube", "--case", "A,B", "--plant", "1:1:x:3"], "go with one version of the cube"),
        (["cube", "--plant", "1:99:x:3"], "no image point '1:99'"),
    ],
)
def test_what_does_not_go_together_is_refused(capsys, arguments, words) -> None:
    assert main(["plan", "network", *arguments]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("version", ["C", "E"])
def test_expected_sigma0_is_what_q_vv_leaves_of_the_errors(version: str) -> None:
    made = plan_network(cube(version))
    block = made.evaluated()
    photo = "3"
    errors = [PlantedError(f"{photo}:1", "x", -3.0), PlantedError(f"{photo}:1", "y", -3.0)]
    one, other = (expected_tests(made, block, [e], "control") for e in errors)
    both = expected_tests(made, block, errors, "control")
    for error, found in zip(errors, (one, other), strict=True):
        row = found.single[0]
        # eq. 18 with one error: lambda = r (error / sigma)^2, the size of w its root
        assert found.noncentrality == pytest.approx(row.r * (error.um / 5.0) ** 2, rel=1e-3)
        assert row.w == pytest.approx(found.noncentrality**0.5, rel=1e-3)
        assert row.mdb_um == pytest.approx(
            5.0 * (single_test(0.001, 0.8).noncentrality / row.r) ** 0.5
        )
    assert both.theta == pytest.approx(1.0 + both.noncentrality / block.redundancy)
    # Schwarz: what both leave together lies between the extremes
    roots = one.noncentrality**0.5, other.noncentrality**0.5
    assert (roots[0] - roots[1]) ** 2 <= both.noncentrality <= sum(roots) ** 2


def test_an_error_of_the_smallest_detectable_size_is_found_with_the_power_of_the_tests() -> None:
    made = plan_network(cube("E"))
    block = made.evaluated()
    row = next(r for r in block.ray_rows() if (r.photo, r.point) == ("3", "1")).xy[0]
    assert row.mdb is not None
    found = expected_tests(made, block, [PlantedError("3:1", "x", row.mdb)], "control")
    assert found.single[0].power == pytest.approx(0.8, abs=1e-6)
    assert found.power == pytest.approx(0.8, abs=2e-3)


@pytest.mark.slow
def test_theta_of_many_noises_has_the_expected_mean() -> None:
    made = plan_network(cube("D"))
    block = made.evaluated()
    errors = [PlantedError("1:1", "x", -30.0)]
    found = expected_tests(made, block, errors, "control")
    rng = np.random.default_rng(4)
    runs, theta = 30, []
    for _ in range(runs):
        noisy = tuple(
            replace(
                row,
                x=row.x + rng.normal(0.0, 5e-3) - 0.03 * ((row.photo, row.point) == ("1", "1")),
                y=row.y + rng.normal(0.0, 5e-3),
            )
            for row in made.block.image_points
        )
        wrong = replace(made, block=replace(made.block, image_points=noisy)).evaluated()
        assert wrong.sigma0 is not None
        theta.append(wrong.sigma0**2)
    assert found.theta is not None
    # variance of noncentral chi square over r; 3.3 standard deviations of the mean of the runs
    sd = (2.0 * (block.redundancy + 2.0 * found.noncentrality) / runs) ** 0.5 / block.redundancy
    assert abs(np.mean(theta) - found.theta) < 3.3 * sd


def test_a_coordinate_that_nothing_checks_is_never_noticed(capsys) -> None:
    found = answer(capsys, "cube", "--case", "A", "--plant", "1:2:x:-30")["planted"]
    assert found["errors"][0]["mdb_um"] is None
    assert found["errors"][0]["power"] == pytest.approx(0.001, abs=1e-6)
    assert found["theta"] == pytest.approx(1.0, abs=1e-6)


def test_an_error_in_a_ray_that_determines_nothing_is_refused() -> None:
    made = plan_network(cube("A"))
    alone = next(row for row in made.block.image_points if row.point == "2" and row.photo == "1")
    rows = tuple(row for row in made.block.image_points if row.point != "2" or row == alone)
    once = replace(made, block=replace(made.block, image_points=rows))
    with pytest.raises(InputError, match="1:2 is not determined"):
        expected_tests(once, once.evaluated(), [PlantedError("1:2", "x", 30.0)], "control")
