"""The paper's patterns and their printed numbers (Kratky and El-Hakim 1983, Figures 2-7)."""

import numpy as np
import pytest
from idealmodel import ideal

from anaplot.errors import InputError
from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.idealmodel import trace_in_bases
from anaplot.orientation.patterns import PATTERNS, Pattern, pattern

GEOMETRY = (60.0, 66.0, 100.0)  # b : d : c = 0.60 : 0.66 : 1


def r_of(name, geometry=GEOMETRY):
    return {row.key: row.r for row in ideal(pattern(name), *geometry).table}


def trace_of(p, *geometry):
    return trace_in_bases(ideal(p, *geometry), geometry[0])


def rounded(name, axis, labels):
    r = r_of(name)
    return [round(r[label, axis], 3) for label in labels]


def test_six_points_without_ties():
    r = r_of("6")
    for label in "1346":
        assert r[label, "y"] == pytest.approx(1.0 / 12.0, abs=1e-12)  # "8 percent"
    for label in "25":
        assert r[label, "y"] == pytest.approx(1.0 / 3.0, abs=1e-12)


def test_six_points_q_vv_of_figure_3_and_the_critical_transfers():
    m = ideal(pattern("6"), *GEOMETRY)
    influence = m.q_vv / m.q_l
    assert np.diag(m.q_vv) == pytest.approx([2.0 * row.r for row in m.table])
    keys = [row.point for row in m.table]
    one, two = keys.index("1"), keys.index("2")
    assert m.q_vv[one, one] == pytest.approx(1.0 / 6.0, abs=1e-12)
    assert m.q_vv[two, one] == pytest.approx(-1.0 / 3.0, abs=1e-12)
    assert abs(influence[two, one]) > influence[one, one]
    found = {(t.source[0], t.target[0]): t.value for t in diagnose(m).transfers}
    for corner, centre in (("1", "2"), ("3", "2"), ("4", "5"), ("6", "5")):
        assert found[corner, centre] == pytest.approx(-1.0 / 6.0, abs=1e-12)
    # a centre shows nowhere larger than at itself, but just as large at the other centre
    assert {target for source, target in found if source == "2"} == {"5"}


@pytest.mark.parametrize("geometry", [(60, 66, 100), (90, 100, 152), (30, 80, 88), (70, 20, 300)])
@pytest.mark.parametrize("name", ["6", "8", "9", "10", "10d", "12", "13", "15", "15r"])
def test_without_ties_r_does_not_depend_on_base_width_and_constant(name, geometry):
    assert r_of(name, geometry) == pytest.approx(r_of(name), abs=1e-9)


def test_with_ties_it_does():
    assert r_of("9/3", (30, 80, 88))["1", "x"] != pytest.approx(r_of("9/3")["1", "x"], abs=1e-3)


def test_thirteen_points_without_ties():
    r = list(r_of("13").values())
    assert min(r) == pytest.approx(0.567, abs=5e-4)
    assert max(r) == pytest.approx(0.80, abs=5e-3)
    assert np.mean(r) == pytest.approx(8.0 / 13.0)
    assert np.mean(r) == pytest.approx(0.62, abs=0.005)


def test_thirteen_points_trace():
    trace = trace_of(pattern("13"), 90.0, 100.0, 152.0)
    assert trace == pytest.approx(14.35, abs=0.005)
    assert trace == pytest.approx(14.3, abs=0.05)  # as printed


@pytest.mark.parametrize("name", list(PATTERNS))
def test_trace_is_in_units_of_the_base(name):
    p = pattern(name)
    assert trace_of(p, 180.0, 200.0, 304.0) == pytest.approx(trace_of(p, 90.0, 100.0, 152.0))
    unit = ideal(p, 1.0, 100.0 / 90.0, 152.0 / 90.0)
    assert trace_of(p, 90.0, 100.0, 152.0) == pytest.approx(np.trace(unit.q_gg))


@pytest.mark.parametrize("name", list(PATTERNS))
def test_mean_redundancy_numbers(name):
    p = pattern(name)
    n = len(p.labels)
    t = len(p.ties)
    expected = (n + t - 6.0) / (n + t) if t else 1.0 - 5.0 / n
    assert np.mean(list(r_of(name).values())) == pytest.approx(expected, abs=1e-12)


def test_six_points_three_ties_figure_4a():
    assert rounded("6/3", "y", "123456") == [0.095, 0.736, 0.095, 0.294, 0.338, 0.294]


def test_nine_points_three_ties_figures_4d_and_5():
    r = r_of("9/3")
    assert [round(r[label, "x"], 2) for label in "123"] == [0.25, 0.67, 0.25]
    m = ideal(pattern("9/3"), *GEOMETRY)
    keys = [row.key for row in m.table]
    middle = keys.index(("2", "x"))
    for k, (_, axis) in enumerate(keys):
        if axis == "y":
            assert m.q_vv[middle, k] == pytest.approx(0.0, abs=1e-12)


def test_thirteen_points_five_ties_figure_7c():
    r = r_of("13/5")
    for label in ("1", "1'", "3", "3'"):
        assert r[label, "x"] == pytest.approx(0.58, abs=0.005)
        assert r[label, "y"] == pytest.approx(0.59, abs=0.005)
    assert r["2", "x"] == pytest.approx(0.80, abs=0.005)
    assert r["2", "y"] == pytest.approx(0.85, abs=0.005)


def test_ten_regular_points_five_ties_figure_7a():
    m = ideal(pattern("10/5"), 90.0, 100.0, 152.0)
    keys = [row.key for row in m.table]
    influence = m.q_vv / m.q_l

    def shown(source, target):
        i, j = keys.index(source), keys.index(target)
        return influence[j, i], influence[j, i] / influence[i, i]

    # three pairs on the upper side, and their mirror images on the lower one
    for left, next_left, right, next_right in (("1", "12", "4", "45"), ("3", "23", "6", "56")):
        assert shown((left, "y"), (left, "y"))[0] == pytest.approx(0.258, abs=5e-4)
        assert shown((left, "y"), (next_left, "y"))[0] == pytest.approx(-0.339, abs=5e-4)
        assert abs(shown((right, "y"), (next_right, "y"))[1]) == pytest.approx(0.64, abs=5e-3)
        assert abs(shown((left, "x"), (next_left, "x"))[1]) == pytest.approx(0.78, abs=5e-3)
    transfers = diagnose(m).transfers
    assert {(*t.source, *t.target) for t in transfers if t.critical} == {
        ("1", "y", "12", "y"),
        ("3", "y", "23", "y"),
    }
    assert {(*t.source, *t.target) for t in transfers if not t.critical} == {
        ("1", "x", "12", "x"),
        ("3", "x", "23", "x"),
        ("4", "y", "45", "y"),
        ("6", "y", "56", "y"),
    }


def test_what_doubled_points_share_is_no_transfer():
    found = diagnose(ideal(pattern("13/5"), 90.0, 100.0, 152.0))
    assert found.transfers == ()


@pytest.mark.parametrize(
    ("name", "columns", "lines"),
    [("6", 2, 3), ("8", 2, 4), ("9", 3, 3), ("10", 2, 5), ("12", 3, 4), ("15r", 3, 5)],
)
def test_regular_patterns_are_lattices(name, columns, lines):
    at = pattern(name).positions(60.0, 66.0)
    lattice = {
        (60.0 * i / (columns - 1), 66.0 * (1.0 - 2.0 * k / (lines - 1)))
        for i in range(columns)
        for k in range(lines)
    }
    assert len(at) == len(lattice)
    assert np.array(sorted(at.values())) == pytest.approx(np.array(sorted(lattice)))
    # 12 lies between 1 and 2, 89 between 8 and 9
    for label, (x, y) in at.items():
        if len(label) == 2:
            assert all(x == at[end][0] for end in label if end in at)
            above, below = (at[end][1] if end in at else 0.0 for end in label)
            assert above > y > below


@pytest.mark.parametrize("name", list(PATTERNS))
def test_q_vv_p_is_idempotent_and_its_trace_the_redundancy(name):
    m = ideal(pattern(name), *GEOMETRY)
    projector = m.q_vv / m.q_l
    assert projector @ projector == pytest.approx(projector, abs=1e-12)
    assert np.trace(projector) == pytest.approx(m.redundancy, abs=1e-12)
    assert m.redundancy == len(m.table) - (6 if m.ties else 5)


def test_there_are_the_patterns_of_the_paper():
    names = (
        *("6", "6/3", "8", "8/4", "9", "9/3", "10", "10/3", "10/5", "10d", "10d/3", "10d/5"),
        *("12", "12/4", "13", "13/3", "13/5", "15", "15/3", "15/5", "15r", "15r/3", "15r/5"),
    )
    assert tuple(PATTERNS) == names
    for name, p in PATTERNS.items():
        assert p.name == name
        assert len(set(p.labels)) == len(p.labels) == int(name.split("/")[0].rstrip("dr"))
        assert len(p.ties) == int(name.split("/")[1] if "/" in name else 0)
        assert set(p.ties) <= set(p.labels)
    with pytest.raises(TypeError):
        PATTERNS["x"] = Pattern("x", "", ())


def test_positions():
    at = pattern("15/5").positions(92.0, 100.0, (4.0, 3.0))
    assert list(at) == list(pattern("15/5").labels)
    assert at["1"] == (0.0, 100.0)
    assert at["1'"] == (4.0, 97.0)
    assert at["2"] == (0.0, 0.0)
    assert at["3'"] == (4.0, -97.0)
    assert at["4"] == (92.0, 100.0)
    assert at["4'"] == (88.0, 97.0)
    assert at["6'"] == (88.0, -97.0)
    assert at["8"] == (46.0, 0.0)
    assert at["7'"] == (50.0, 97.0)
    twins = pattern("15").positions(92.0, 100.0)
    assert twins["1'"] == twins["1"]


def test_an_unknown_pattern_names_the_nearest():
    with pytest.raises(InputError, match="13/5") as caught:
        pattern("13-5")
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="no point pattern"):
        pattern("\x1b[2J\n")


def test_propagated_tie_variance_makes_ties_weaker_controlled_in_units_of_their_variance():
    paper = ideal(pattern("13/5"), *GEOMETRY)
    propagated = ideal(pattern("13/5"), *GEOMETRY, "propagated")
    assert propagated.q_l[-5:] == pytest.approx(np.full(5, 6.0))
    assert paper.q_l[-5:] == pytest.approx(np.ones(5))
    assert sum(row.r for row in propagated.table) == pytest.approx(12.0)
