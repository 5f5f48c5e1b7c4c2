"""anaplot plan pattern: the printed numbers of 1983, files, and their complaints."""

import csv
import json

import pytest

from anaplot.cli import main

LENGTHS = ["--base", "90", "--d", "100", "--c", "152"]


def said(capsys, *arguments):
    assert main(["plan", "pattern", *arguments, *LENGTHS, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_six_points(capsys):
    out = said(capsys, "6")
    redn = {(r["point"], r["axis"]): r["redn"] for r in out["rows"]}
    assert redn["1", "y"] == pytest.approx(1 / 12)
    assert redn["2", "y"] == pytest.approx(1 / 3)
    assert (["1", "y"], ["2", "y"]) in [(t["source"], t["target"]) for t in out["transfers"]]


def test_thirteen_points(capsys):
    out = said(capsys, "13")
    assert out["n"] == 13
    assert out["mean_redn"] == pytest.approx(8 / 13)
    assert out["trace_q_gg"] == pytest.approx(14.35, abs=0.01)


def test_ties_are_named_either_way(capsys):
    one, two = said(capsys, "13", "--ties", "5"), said(capsys, "13/5")
    assert one == two
    assert one["mean_redn"] == pytest.approx(12 / 18)


def test_a_file_says_the_same_as_the_name(capsys, tmp_path):
    named = said(capsys, "9/3")
    path = tmp_path / "nine.csv"
    rows = [
        f"{p['label']},{p['x_mm']},{p['y_mm']},{'yes' if p['tie'] else ''}" for p in named["points"]
    ]
    path.write_text("\n".join(["label,x,y,tie", *rows]) + "\n")
    assert said(capsys, str(path)) == named


def test_text_and_csv(capsys, tmp_path):
    path = tmp_path / "rows.csv"
    assert main(["plan", "pattern", "6", *LENGTHS, "--csv", str(path)]) == 0
    text = capsys.readouterr().out
    assert "y 0.083" in text
    assert "1 (y) --> 2 (y)" in text
    assert "helps the weakest redundancy number most: 0.083 -> " in text
    with path.open(newline="") as file:
        assert [row["point"] for row in csv.DictReader(file)] == list("123456")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("label,x,y\n1,0,0\n1,2,3\n", "line 3"),
        ("label,x,y,tie\n1,0,0,perhaps\n", "must be yes, no or blank"),
        ("label,x,y\n1,0,zero\n", "y = "),
        ("label,x,y\n", "no points"),
    ],
)
def test_a_wrong_file_is_one_line(capsys, tmp_path, text, what):
    path = tmp_path / "p.csv"
    path.write_text(text)
    assert main(["plan", "pattern", str(path)]) == 2
    error = capsys.readouterr().err
    assert what in error
    assert error.count("\n") == 1
