"""anaplot plan pattern: the printed numbers of 1983, files, and their complaints."""

import csv
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from anaplot.adjustment.tested import Transfer
from anaplot.cli import main
from anaplot.planning.patternplan import PlannedPattern
from anaplot.report.patterndrawing import drawing

pytestmark = pytest.mark.slow  # whole commands, as in the rooms that are slow

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


def test_columns_of_a_list_never_touch():
    names = [f"point-{k:06d}" for k in range(12)]
    plan = PlannedPattern(tuple((n, -1e6 * k - 1e6, -123456.7) for k, n in enumerate(names)),
                          (), 90.0, 152.0)  # fmt: skip
    rows = [SimpleNamespace(key=(n, "y"), r=0.5) for n in names]
    lines = drawing(plan, SimpleNamespace(table=rows))
    assert [len(line.split()) for line in lines[1:]] == [4] * 12


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
    folder = tmp_path / "tables"
    call = ["plan", "pattern", "6", *LENGTHS, "--csv", str(path), "--to", str(folder)]
    assert main(call) == 0
    text = capsys.readouterr().out
    assert "y 0.083" in text
    assert "1 (y) --> 2 (y)" in text
    assert "helps the weakest redundancy number most: 0.083 -> " in text
    with path.open(newline="") as file:
        assert [row["point"] for row in csv.DictReader(file)] == list("123456")
    assert (folder / "rows.csv").read_bytes() == path.read_bytes()
    assert (folder / "points.csv").read_text().splitlines()[:2] == [
        "label,x_mm,y_mm,tie",
        f"1,0.0,{LENGTHS[3]}.0,0",
    ]
    assert json.loads((folder / "summary.json").read_text())["n"] == 6


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("label,x,y\n1,0,0\n1,2,3\n", "line 3"),
        ("label,x,y,tie\n1,0,0,perhaps\n", "must be yes, no or blank"),
        ("label,x,y\n1,0,zero\n", "y: must be a finite number"),
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


@pytest.mark.parametrize("suffix", ["csv", "toml"])
@pytest.mark.parametrize(
    ("points", "number", "what"),
    [
        ([("1", 0, 0), ("2", 1, 1), ("1", 2, 2)], 2, "label '1' stands in line {first} already"),
        ([("1", 0, 0), ("2", 1001, 0)], 1, "x: must lie between -1000 and 1000, not 1001"),
        ([(str(k), k, 0) for k in range(201)], 200, "more than 200 points"),
    ],
)
def test_both_kinds_of_file_refuse_the_same(capsys, tmp_path, suffix, points, number, what):
    tables = suffix == "toml"
    path = tmp_path / f"p.{suffix}"
    rows = [
        f'[[point]]\nlabel = "{label}"\nx = {x}\ny = {y}' if tables else f"{label},{x},{y}"
        for label, x, y in points
    ]
    path.write_text("\n".join(["format = 1" if tables else "label,x,y", *rows]) + "\n")
    assert main(["plan", "pattern", str(path)]) == 2
    error = capsys.readouterr().err
    assert what.format(first=3 if tables else 2) in error
    lines = range(4 * number + 2, 4 * number + 6) if tables else [number + 2]
    assert any(f"line {line}:" in error for line in lines)


def toml(points):
    tables = [
        f'[[point]]\nlabel = "{p["label"]}"\nx = {p["x_mm"]}\ny = {p["y_mm"]}\n'
        f"tie = {str(p['tie']).lower()}\n"
        for p in points
    ]
    return "format = 1\n" + "".join(tables)


def test_a_toml_file_says_the_same_as_the_name(capsys, tmp_path):
    named = said(capsys, "13/5")
    path = tmp_path / "thirteen.toml"
    path.write_text(toml(named["points"]))
    assert said(capsys, str(path)) == named


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ('format = 1\n[[point]]\nlabel = "1"\nx = 0\ny = 0\ntie = "yes"\n', 6, "true or false"),
        ('format = 1\n[[point]]\nlabel = "1"\nx = 0\ny = 2000\n', 5, "y: must lie between"),
        ('format = 1\n[[point]]\nlabel = "1"\nx = 0\nz = 0\n', 5, "unknown key"),
        (
            'format = 1\n[[point]]\nlabel = "1"\nx = 0\ny = 0\n'
            '[[point]]\nlabel = "1"\nx = 1\ny = 1\n',
            7,
            "stands in line 3 already",
        ),
        ("format = 2\n", 1, "newer version"),
        ("format = 1\n", None, "no points"),
    ],
)
def test_a_wrong_toml_file_is_one_line(capsys, tmp_path, text, line, what):
    path = tmp_path / "p.toml"
    path.write_text(text)
    assert main(["plan", "pattern", str(path)]) == 2
    error = capsys.readouterr().err
    assert what in error
    assert error.count("\n") == 1
    if line is not None:
        assert f"p.toml:{line}:" in error or f"line {line}" in error


def drawn(capsys, *arguments):
    assert main(["plan", "pattern", *arguments, *LENGTHS]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    return lines


def test_arrows_point_from_the_corners_to_the_centres(capsys):
    lines = drawn(capsys, "6")
    top = next(k for k, line in enumerate(lines) if line.startswith("o 1"))
    assert [line.split() for line in lines[top + 2 : top + 6]] == [
        ["|", "|"],
        ["|", "-0.167", "|", "-0.167"],
        ["v", "v"],
        ["o", "2", "<---", "-0.333", "-->", "o", "5"],
    ]
    assert lines[top + 7].split() == ["^", "^"]


def test_arrows_run_one_way_along_a_row(capsys):
    lines = drawn(capsys, "9")
    assert "o 1 ---- -0.333 --> o 7 <--- -0.333 --- o 4" in lines


def test_no_transfer_no_arrow(capsys):
    lines = drawn(capsys, "13/5")
    assert "no critical transfers" in lines
    assert not any("-->" in line or "|" in line for line in lines)


def test_points_at_many_places_are_listed(capsys, tmp_path):
    path = tmp_path / "many.csv"
    rows = [f"a{k},{10 * k},{(-1) ** k * (20 + 7 * k)}" for k in range(10)]
    path.write_text("\n".join(["label,x,y", *rows]) + "\n")
    lines = drawn(capsys, str(path))
    at = lines.index(next(line for line in lines if line.startswith("POINT ")))
    assert [line.split()[0] for line in lines[at + 1 : at + 11]] == [f"a{k}" for k in range(10)]


def small(tmp_path, shift=0.0):
    path = tmp_path / "small.csv"
    places = [(x + shift, y) for x in (0, 11, 22) for y in (25, 0, -25)]
    rows = [f"{k},{x},{y},{'yes' if k < 3 else ''}" for k, (x, y) in enumerate(places)]
    path.write_text("\n".join(["label,x,y,tie", *rows]) + "\n")
    return path


def test_the_advice_for_a_file_stays_among_its_points(capsys, tmp_path):
    path = small(tmp_path)
    paper = ["--tie-variance", "paper"]
    assert main(["plan", "pattern", str(path), *paper, "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert (out["base_mm"], out["base_derived"]) == (22.0, True)
    assert all(
        0.0 <= place["x_mm"] <= 22.0 and abs(place["y_mm"]) <= 25.0
        for one in out["advice_sets"]
        for place in one["points"]
    )
    for advice in out["advice"]:
        assert 0.0 <= advice["x_mm"] <= 22.0
        assert abs(advice["y_mm"]) <= 25.0
    assert out["advice"][0]["tie"] is True
    assert main(["plan", "pattern", str(path), *paper]) == 0
    text = capsys.readouterr().out
    assert "base 22 mm: the largest x of the points" in text
    assert " as a tie helps the weakest" in text.replace("\n", "").replace("  ", " ")
    assert main(["plan", "pattern", str(path), "--base", "30", "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert (out["base_mm"], out["base_derived"]) == (30.0, False)


def test_places_out_of_all_measure_are_no_advice(capsys, tmp_path):
    assert main(["plan", "pattern", str(small(tmp_path)), "--d", "1e6", "--json"]) == 0
    assert all(abs(a["y_mm"]) <= 25.0 for a in json.loads(capsys.readouterr().out)["advice"])


def test_a_file_without_a_point_to_the_right_is_asked_for_its_base(capsys, tmp_path):
    path = small(tmp_path, shift=-50.0)
    assert main(["plan", "pattern", str(path)]) == 2
    assert "small.csv: which --base?" in capsys.readouterr().err
    assert main(["plan", "pattern", str(path), "--base", "22"]) == 0


@pytest.mark.parametrize("option", ["--base", "--d", "--c"])
def test_lengths_have_limits(capsys, option):
    assert main(["plan", "pattern", "6", option, "1e-150"]) == 2
    assert f"{option}: '1e-150' is no number from 0.001 to 1e+06" in capsys.readouterr().err


def written(path, places):
    rows = [f"{label},{x},{y},{tie}" for label, x, y, tie in places]
    path.write_text("\n".join(["label,x,y,tie", *rows]) + "\n")
    return str(path)


def skeleton(lines):
    drawing = lines[lines.index("") + 1 :]
    end = next(k for k, line in enumerate(drawing) if line.startswith("n "))
    # a transfer that is critical by a hair may have one tip more or less
    ways = str.maketrans("<>^v", "--||")
    return [re.sub(r"[-+]?\d\.\d+", "N", line).translate(ways) for line in drawing[:end]]


@pytest.mark.parametrize("name", ["6", "6/3", "9", "9/3", "13", "13/5"])
def test_measured_positions_are_drawn_as_the_planned_ones(capsys, tmp_path, name):
    named = said(capsys, name)
    rng = np.random.default_rng(3)
    places = [
        (p["label"], p["x_mm"] + dx, p["y_mm"] + dy, "yes" if p["tie"] else "")
        for p, (dx, dy) in zip(named["points"], rng.normal(0.0, 0.5, (15, 2)), strict=False)
    ]
    scattered = drawn(capsys, written(tmp_path / "measured.csv", places))
    assert skeleton(scattered) == skeleton(drawn(capsys, name))


def test_arrows_run_across_empty_places(capsys, tmp_path):
    places = [
        ("1", 0, 100, ""), ("7", 45, 100, ""), ("4", 90, 100, ""), ("2", 0, 0, ""),
        ("5", 90, 0, ""), ("3", 0, -100, ""), ("9", 45, -100, ""), ("6", 90, -100, ""),
    ]  # fmt: skip
    lines = drawn(capsys, written(tmp_path / "hollow.csv", places))
    (line,) = (line for line in lines if line.startswith("o 2"))
    assert re.fullmatch(r"o 2 [<-]-+ [-+]\d\.\d{3} -+[>-] o 5", line)
    assert line.index("o 5") == next(line for line in lines if line.startswith("o 1")).index("o 4")


def test_crossing_arrows():
    points = (("L", 0.0, 0.0), ("T", 45.0, 50.0), ("B", 44.0, -50.0), ("R", 90.0, 1.0))
    plan = PlannedPattern(points, (), 90.0, 152.0)
    rows = tuple(SimpleNamespace(key=(label, "y"), r=0.5) for label, _, _ in points)
    transfers = [
        Transfer(("L", "y"), ("R", "y"), 0.25, 0.25),
        Transfer(("B", "y"), ("T", "y"), -0.75, 0.5),
    ]
    assert drawing(plan, SimpleNamespace(table=rows), transfers) == [
        "                    o T",
        "                      y 0.500",
        "                    ^",
        "                    | -0.750",
        "                    |",
        "o L ---- +0.250 ----+-----------------> o R",
        "  y 0.500           |                     y 0.500",
        "                    |",
        "                    |",
        "                    |",
        "                    o B",
        "                      y 0.500",
    ]


def test_serious_transfers_are_dotted():
    points = (("L", 0.0, 0.0), ("T", 0.0, 50.0), ("R", 90.0, 0.0))
    plan = PlannedPattern(points, (), 90.0, 152.0)
    rows = tuple(SimpleNamespace(key=(label, "y"), r=0.5) for label, _, _ in points)
    transfers = [
        Transfer(("L", "y"), ("R", "y"), 0.45, 0.5),
        Transfer(("R", "y"), ("L", "y"), 0.25, 0.25),
        Transfer(("T", "y"), ("L", "y"), -0.4, 0.5),
    ]
    assert drawing(plan, SimpleNamespace(table=rows), transfers) == [
        "o T",
        "  y 0.500",
        ":",
        ": -0.400",
        "v",
        "o L <--- +0.250 --- o R",
        "  y 0.500             y 0.500",
    ]


def test_what_is_not_suitable_is_said(capsys):
    assert not said(capsys, "9/3")["suitable"]
    assert said(capsys, "13/5")["suitable"]
    assert main(["plan", "pattern", "9/3"]) == 0
    assert "not suitable for on-line triangulation" in capsys.readouterr().out


def test_the_matrix_is_that_of_the_paper(capsys, tmp_path):
    call = ["9/3", "--tie-variance", "paper"]
    out = said(capsys, *call, "--matrix")
    q = np.array(out["matrix"]["values"])
    keys = [tuple(key) for key in out["matrix"]["rows"]]
    assert keys == [(row["point"], row["axis"]) for row in out["rows"]]
    assert np.diag(q) == pytest.approx([row["redn"] for row in out["rows"]])
    assert q @ q == pytest.approx(q, abs=1e-9)
    # Figure 5: the middle tie's x has nothing to do with any y
    middle = keys.index(("2", "x"))
    assert q[middle, : len(keys) - 3] == pytest.approx(0.0, abs=1e-9)
    folder = tmp_path / "tables"
    assert main(["plan", "pattern", *call, "--matrix", "--to", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "-0.000" not in text
    with (folder / "matrix.csv").open(newline="") as file:
        cells = list(csv.DictReader(file))
    assert len(cells) == len(keys) ** 2
    assert float(cells[1]["value"]) == pytest.approx(q[0, 1])
    assert (cells[1]["error_point"], cells[1]["error_axis"]) == keys[1]


def test_a_planted_error_changes_every_residual_as_its_column_says(capsys):
    out = said(capsys, "13/5", "--matrix", "--plant", "1:y:100, 2:x:-50")
    q, keys = np.array(out["matrix"]["values"]), [tuple(k) for k in out["matrix"]["rows"]]
    expected = 100.0 * q[:, keys.index(("1", "y"))] - 50.0 * q[:, keys.index(("2", "x"))]
    assert [row["change_um"] for row in out["planted"]["rows"]] == pytest.approx(expected)
    assert out["planted"]["errors"][1] == {"point": "2", "axis": "x", "um": -50.0}


@pytest.mark.parametrize(
    ("plant", "what"),
    [
        ("7:x:100", "no row '7' x"),
        ("12:y:100", "no row '12' y"),
        ("1:z:100", "'1:z:100' is not a place, x or y, and um"),
        ("1:y:much", "'1:y:much' is not a place"),
        ("1:y", "'1:y' is not a place"),
    ],
)
def test_an_error_cannot_be_planted_where_there_is_no_row(capsys, plant, what):
    assert main(["plan", "pattern", "13/5", "--plant", plant]) == 2
    error = capsys.readouterr().err
    assert what in error
    assert error.count("\n") == 1


def test_several_patterns_stand_side_by_side(capsys, tmp_path):
    points = "label,x,y,tie\n1,0,100,yes\n2,0,0,yes\n3,0,-100,yes\n4,90,100,\n5,90,0,\n6,90,-100,\n"
    (tmp_path / "own.csv").write_text(points)
    names = ["6", "9/3", "10/5", "13/5", str(tmp_path / "own.csv"), "6/3"]
    rows = said(capsys, *names)["patterns"]
    assert [row["pattern"] for row in rows] == ["6", "9/3", "10/5", "13/5", "own.csv", "6/3"]
    for row, pattern in zip(rows, names, strict=True):
        one = said(capsys, pattern)
        assert row["n"] == one["n"]
        assert row["least_redn"] == pytest.approx(min(r["redn"] for r in one["rows"]))
        assert row["mean_redn"] == pytest.approx(one["mean_redn"])
        assert row["trace_q_gg"] == pytest.approx(one["trace_q_gg"])
        assert row["critical"] == len(one["transfers"])
        assert row["serious"] == len(one["serious_transfers"])
    assert {**rows[4], "pattern": "6/3"} == rows[5]
    assert main(["plan", "pattern", *names]) == 0
    text = capsys.readouterr().out
    assert text.count("not suitable") == 5
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["6", "9", "6"], "pattern 6 is given twice"),
        (["6", "9", "--matrix"], "--plant and --matrix go with one pattern"),
        (["6", "nonsense"], "no point pattern 'nonsense'"),
    ],
)
def test_what_cannot_stand_side_by_side(capsys, arguments, what):
    assert main(["plan", "pattern", *arguments]) == 2
    assert what in capsys.readouterr().err


def test_the_two_classes_of_transfers(capsys):
    ten, twelve = said(capsys, "10/5", "--tie-variance", "paper"), said(capsys, "12")
    assert {(*t["source"], *t["target"]) for t in ten["transfers"]} == {
        ("1", "y", "12", "y"), ("3", "y", "23", "y")
    }  # fmt: skip
    # the paper's three pairs on the upper and the lower side: two of them are serious
    serious = {(*t["source"], *t["target"]) for t in ten["serious_transfers"]}
    assert {("4", "y", "45", "y"), ("6", "y", "56", "y"), ("1", "x", "12", "x"),
            ("3", "x", "23", "x")} <= serious  # fmt: skip
    assert twelve["transfers"] == []
    assert max(t["share"] for t in twelve["serious_transfers"]) == pytest.approx(0.95)
    assert all(0.6 <= t["share"] < 1.0 for t in twelve["serious_transfers"])


def test_evenly_spread_points_make_no_columns(capsys, tmp_path):
    places = [(f"a{k}", 5 * k, (-1) ** k * (20 + 7 * k), "") for k in range(20)]
    lines = drawn(capsys, written(tmp_path / "even.csv", places))
    assert any(line.startswith("POINT ") for line in lines)


def test_what_is_no_pattern_is_named_as_what_it_is(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dir").mkdir()
    (tmp_path / "6").mkdir()
    expected = "is no point pattern: a name as 13/5, or a .csv or .toml file of points"
    for name, what in (
        ("dir", f"'dir' {expected}"),
        ("", f"'' {expected}"),
        ("/dev/null", f"'/dev/null' {expected}"),
        ("13/4", "no point pattern '13/4' (did you mean '13/"),
        ("nonsense", "no point pattern 'nonsense'; there are 6, 8, 9, 10, 10d,"),
        ("x" * 5000, "no point pattern 'xxx"),
    ):
        assert main(["plan", "pattern", name]) == 2
        error = capsys.readouterr().err
        assert what in error
        assert len(error) < 200
    # a folder that happens to have the name of a pattern is no matter
    assert main(["plan", "pattern", "6"]) == 0
    capsys.readouterr()
    assert main(["plan", "pattern", "6/3", "--ties", "3"]) == 2
    assert "--ties 3: '6/3' says itself how many tie" in capsys.readouterr().err


def test_lengths_that_do_not_go_together_are_no_wrong_points(capsys):
    assert main(["plan", "pattern", "13/5", "--c", "1e6"]) == 4
    error = capsys.readouterr().err
    assert "not determined" in error
    assert "remeasure" not in error


def test_the_ties_err_as_in_a_long_strip_unless_asked_otherwise(capsys):
    assert main(["plan", "pattern", "6/3", "--json"]) == 0
    exact = json.loads(capsys.readouterr().out)
    assert main(["plan", "pattern", "6/3", "--tie-variance", "propagated", "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert (exact["tie_variance"], plain["tie_variance"]) == ("exact", "propagated")
    assert [r["redn"] for r in exact["rows"]] == pytest.approx([r["redn"] for r in plain["rows"]])
    ratio = [a["expd"] / b["expd"] for a, b in zip(exact["rows"], plain["rows"], strict=True)]
    assert max(ratio) == pytest.approx(1.294**0.5, abs=1e-3)
    assert "tie variance exact" in drawn(capsys, "6/3")


def test_sets_of_points_are_advised_where_no_single_one_helps(capsys):
    text = drawn(capsys, "6")
    assert "the best two together, symmetric: 0.083 -> 0.250" in text
    at = text.index("the best four together, symmetric: 0.083 -> 0.400")
    assert text[at + 1 : at + 5] == [f"  a double of {point}" for point in "1346"]
