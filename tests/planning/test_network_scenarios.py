"""1978: snooping against thresholds over many noises, and the failures that must happen."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.planning.montecarlo import figures, simulate
from anaplot.planning.networkscenarios import scenarios

(SCENARIO,) = scenarios()
ALL = "23 errors in 18 runs"


@pytest.fixture(scope="module")
def means():
    tally = simulate(SCENARIO, runs=200, seed=5)
    return {
        (figure.case, figure.method, figure.quantity): figure
        for figure in figures(
            tally, SCENARIO.prepare().quantities(SCENARIO.methods), SCENARIO.references, 0.999
        )
    }


def test_ranking(means) -> None:
    right = {method: means[ALL, method, "right"].mean for method in SCENARIO.methods[:3]}
    assert right["snooping"] == pytest.approx(17.5, abs=0.5)
    assert right["3 sigma0"] == pytest.approx(14.4, abs=0.5)
    assert right["3 sigma0_hat"] == pytest.approx(8.8, abs=0.5)
    assert means[ALL, "snooping", "wrong"].mean == pytest.approx(3.6, abs=0.6)


def test_global_test_has_the_alpha_of_table_4(means) -> None:
    for name in "ABCDE":
        figure = means[f"{name}, no gross error", "global test", "rejected"]
        assert figure.reference is not None
        assert figure.low <= figure.reference <= figure.high


def test_failures_that_must_happen(means) -> None:
    assert means["Ac", "snooping", "right"].mean == 0.0
    assert means["Bc", "snooping", "right"].mean < 0.05
    # one of two, and one of four, that cannot be told apart
    assert 0.2 < means["Ad", "snooping", "right"].mean < 0.55
    assert 0.02 < means["Bd", "snooping", "right"].mean < 0.4
    assert means["Cc", "snooping", "right"].mean < means["Cd", "snooping", "right"].mean


def test_remarks_name_them() -> None:
    remarks = SCENARIO.prepare().remarks()
    text = "\n".join(remarks)
    assert "A: r 39, global test alpha 0.213, c(theta) 1.172" in remarks
    assert "Ac: x' of point 2 is a spur observation" in text
    for label in ("Ad", "Bd"):
        (line,) = (remark for remark in remarks if remark.startswith(label))
        assert "cannot be located" in line
    assert "Cc: x' of point 2 is hard to locate: its residual correlates by -0.960" in text


def test_only_the_methods_asked() -> None:
    tally = SCENARIO.prepare().run(np.random.default_rng(1), 3, ("3 sigma0",))
    assert {method for _, method, _ in tally} == {"3 sigma0"}
