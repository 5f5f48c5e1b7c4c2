"""Named scenarios at another significance than that of the papers."""

from __future__ import annotations

import json
from dataclasses import dataclass

import pytest

from anaplot.cli import main
from anaplot.planning.montecarlo import simulate
from anaplot.planning.scenarioalpha import PAPER_ALPHA, alpha_of, with_alpha
from anaplot.planning.scenarios import scenarios

WITHOUT_ERROR = {
    "size-models": ("13/5", "baarda", "size"),
    "size-strips": ("propagated", "baarda", "y rows flagged"),
    "size-blocks": ("no error, alpha {alpha:g}", "baarda", "share of rows flagged"),
}


def simulated(capsys, *call: str) -> dict:
    assert main(["plan", "simulate", *call, "--processes", "1", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow) if n == "size-strips" else n for n in WITHOUT_ERROR],
)
def test_good_rows_are_flagged_at_the_significance_asked_for(name, capsys) -> None:
    runs = {"size-strips": "60"}.get(name, "500")
    got = simulated(capsys, name, "--alpha", "0.05", "--runs", runs, "--strategy", "baarda")
    assert got["alpha"] == 0.05
    key = tuple(part.format(alpha=0.05) for part in WITHOUT_ERROR[name])
    [figure] = [f for f in got["figures"] if (f["case"], f["method"], f["quantity"]) == key]
    # rows of a run hang together: a bound that the scatter of independent runs keeps
    assert abs(figure["mean"] - 0.05) < 0.015
    if name != "size-blocks":
        assert figure["reference"] == 0.05


def test_more_is_rejected_at_a_larger_significance(capsys) -> None:
    call = ["bayes-G0A", "--runs", "20", "--strategy", "baarda"]
    few, many = (
        next(f["mean"] for f in simulated(capsys, *call, *alpha)["figures"]
             if f["quantity"] == "wrong")
        for alpha in ((), ("--alpha", "0.05"))
    )  # fmt: skip
    assert few < 0.5 < many


def test_every_named_scenario_has_a_level() -> None:
    for name in ("kratky-1983-6-3", "gruen-1978-methods", "block-errors-10", "bayes-G3C"):
        scenario = scenarios()[name]
        assert alpha_of(scenario) == PAPER_ALPHA
        changed = with_alpha(scenario, 0.01)
        assert changed is not None
        assert alpha_of(changed) == 0.01
        # what is known holds for the papers' significance
        assert changed.references == {}
        assert with_alpha(scenario, PAPER_ALPHA) == scenario
        tally = simulate(changed, runs=2, seed=1, methods=changed.methods[:1])
        assert tally


def test_what_has_no_level_keeps_its_own() -> None:
    @dataclass(frozen=True)
    class Fixed:
        name: str = "fixed"

    assert with_alpha(Fixed(), 0.01) is None
    assert alpha_of(Fixed()) is None


def test_runs_at_one_significance_are_not_gone_on_with_at_another(tmp_path, capsys) -> None:
    kept = str(tmp_path / "runs.jsonl")
    call = ["plan", "simulate", "bayes-G0A", "--runs", "10", "--strategy", "baarda", "--to", kept,
            "--processes", "1"]  # fmt: skip
    assert main([*call, "--alpha", "0.05"]) == 0
    assert ", alpha 0.05" in capsys.readouterr().out
    assert main(call) == 2
    assert main([*call, "--alpha", "0.5"]) == 2
    assert "must be less than 0.5" in capsys.readouterr().err
