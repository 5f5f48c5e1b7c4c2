"""The document of `anaplot pointing`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from anaplot.adjustment.pooling import VarianceTest
from anaplot.cli import main
from anaplot.report.astext import page_text
from anaplot.report.pointingcommand import pointing_document
from anaplot.station.drift import Drift, MeanShift
from anaplot.station.pointing import GroupTest, Pointing, PooledSigma
from anaplot.station.pooledrows import Sigma
from anaplot.station.repeatedpointing import RepeatedPointing

SESSION = Path(__file__).parents[1] / "sessions" / "changes.jsonl"
F = VarianceTest("F", 4.0, (30.0, 40.0), 0.0001)
OFFER = Sigma(3.1, 2.6, 3.9, 40.0)
FOUND = Pointing(
    apriori_um=5.0,
    pooled=(
        PooledSigma("all", "", 60, 40.0, Sigma(6.2, 5.1, 7.9, 40.0)),
        PooledSigma("operator", "ann\x1b[2J", 60, 0.5, Sigma(6.2, 5.1, None, 0.6)),
    ),
    tests=(GroupTest("operator", F),),
    repeated=(
        RepeatedPointing("ann", "tie", 4, 24, 2, OFFER, 3.0, 3.2, 4.4, 4.5, 20),
        RepeatedPointing("ann", "fiducial", 0, 0, 0, None, None, None, None, None, 0),
    ),
    offer=OFFER,
    pointings=24,
    against_models=F,
    drift=(
        Drift("2026-05-04", "ann", OFFER, OFFER, F, (MeanShift("y", 0.1, 0.4, 2.5, 0.02),)),
        Drift("2026-05-05", "ann", why="12 minutes of work: no first and last hour"),
    ),
    remarks=("1 flagged row counts in the sigma0 of the models",),
)


def test_it_offers_the_weight_and_leaves_the_decision() -> None:
    text = page_text(pointing_document(FOUND).page)
    assert "pointing 3.1 um (24 pointings, 2.6 to 3.9): block.toml has sigma 5" in text
    assert "to take it as the weight: in block.toml, [precision], image_um = 3.1" in text
    assert "operators: F 4.00, P 0.000: they differ" in text
    assert "2 more do not count" in text
    assert "the models show 6.20 um" in text
    assert "<< DRIFT" in text
    assert "drift: 2026-05-05 ann: 12 minutes of work" in text
    assert "remark: 1 flagged row" in text
    assert "\x1b" not in text
    assert all(len(line) <= 160 for line in text.splitlines())


def test_what_agrees_needs_no_change() -> None:
    agreed = Pointing(apriori_um=3.5, offer=OFFER, pointings=24)
    document = pointing_document(agreed)
    text = page_text(document.page)
    assert "that agrees" in text
    assert "image_um" not in text
    assert document.answer["offer"]["agrees"] is True
    assert "no model with redundancy" in text
    nothing = pointing_document(Pointing(apriori_um=5.0))
    assert nothing.answer["offer"] is None
    assert "nothing was pointed at twice" in page_text(nothing.page)


def test_json_and_csv_of_a_recorded_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["pointing", str(SESSION), "--json", "--csv", str(tmp_path / "p.csv")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert list(answer) == [
        "apriori_um",
        "pooled",
        "tests",
        "repeated",
        "offer",
        "drift",
        "remarks",
    ]
    whole = answer["pooled"][0]
    assert whole["group"] == "all"
    assert whole["low_um"] < whole["sigma_um"] < whole["high_um"]
    with (tmp_path / "p.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["sigma_um"]) for row in rows] == [one["sigma_um"] for one in answer["pooled"]]


def test_a_block_without_a_journal_and_one_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", str(tmp_path / "b"), "--strip", "1-3"]) == 0
    capsys.readouterr()
    assert main(["pointing", str(tmp_path / "b")]) == 0
    assert "no model with redundancy" in capsys.readouterr().out
    assert main(["pointing", str(tmp_path / "nowhere")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
