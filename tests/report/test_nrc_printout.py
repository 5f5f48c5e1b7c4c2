"""The printout after each model, and names that try to control the terminal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testedrows import observation, with_rows

from anaplot.orientation.model import orient
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Precision, TestSettings
from anaplot.report.astext import page_text, table_lines
from anaplot.report.modeldocument import model_document, model_rows

B, D, C = 92.0, 100.0, 152.4


def model(names=None, *, wrong=0.0, name="13/5", left="101", right="102"):
    p = pattern(name)
    places = p.positions(B, D)
    names = dict(zip(p.labels, names or p.labels, strict=True))
    xl = np.array([places[label] for label in p.labels])
    rng = np.random.default_rng(3)
    xr = xl - [B, 0.0] + 0.003 * rng.standard_normal(xl.shape)
    xr[p.labels.index("4"), 1] += wrong
    pair = Stereopair(
        left,
        right,
        tuple(names.values()),
        xl,
        xr,
        C,
        C,
        ties={names[label]: (*places[label], -C) for label in p.ties} or None,
        preceding_bx=B,
        base=B,
    )
    return orient(pair, Precision(), TestSettings())


def printout(solution, strip="1", **kw):
    return page_text(model_document(solution, strip=strip, number=1, count=2, **kw).page)


def lines_of(rows, suspects=()):
    return table_lines(model_rows(rows, suspects))


def test_printout_has_parallaxes_discrepancies_table_and_advice():
    solution = model(wrong=0.08)
    text = printout(solution, pooled_um=5.25)
    lines = text.splitlines()
    assert lines[0] == "STRIP 1  MODEL 101/102  (1 of 2)"
    assert "pooled 5.25 um" in text
    assert "tie variance paper" in text
    assert text.index("PARALLAXES") < text.index("TIE DISCREPANCIES") < text.index("RED-N")
    (flagged,) = [line for line in lines if "<< REMEASURE" in line]
    assert flagged.split()[:2] == ["4", "y"]
    assert any(line.strip().startswith("remeasure 4 (y): ") for line in lines)
    body = lines[next(k for k, line in enumerate(lines) if "RED-N" in line) + 2 :]
    for row, line in zip(solution.table, body, strict=False):
        cells = line.split()
        assert cells[:2] == [row.point, row.axis]
        assert float(cells[2]) == pytest.approx(row.r, abs=5.1e-4)
        assert float(cells[3]) == pytest.approx(row.residual, abs=0.051)
        assert float(cells[4]) == pytest.approx(row.expected, abs=0.051)
        assert float(cells[5]) == pytest.approx(row.size, abs=0.0051)
    assert all(line == line.rstrip() for line in lines)


def test_a_first_model_has_no_discrepancies_and_no_tie_variance():
    text = printout(model(name="13"))
    assert "TIE DISCREPANCIES" not in text
    assert "tie variance" not in text


def test_every_parallax_is_printed_once():
    text = printout(model())
    block = text[text.index("PARALLAXES") : text.index("TIE DISC")].splitlines()[1:]
    assert sum(len(line.split()) for line in block) == 2 * 13


def test_what_does_not_exist_is_a_dash():
    solution = model(name="6")
    rows = [row._replace(expected=None, w=None, flagged=False) for row in solution.table]
    for line in lines_of(rows)[2:]:
        assert line.split()[4:] == ["-", "-", "not", "testable"]
    test = solution.test._replace(critical=None)
    bare = with_rows(solution, rows, sigma0=None, redundancy=0, test=test)
    text = printout(bare)
    assert "sigma0    none" in text
    assert "critical value none" in text


def test_columns_never_touch():
    row = observation("103-1", "y", -90998.7, 0.727, 6.0, 15096.38)
    wild = row._replace(residual=-1.23456789e9, expected=1234567.8, w=None)
    for one in (row, wild, row._replace(residual=-1e300)):
        assert len(lines_of([one])[2].split()[:6]) == 6
    assert lines_of([row])[2].split()[2:] == ["0.727", "-90999", "6.0", "15096.4"]


def test_verdicts():
    row = observation("1", "y", 10.0, 0.5, 3.0, 3.3, flagged=True)

    def verdict(row, *suspects):
        return " ".join(lines_of([row], suspects)[2].split()[6:])

    assert verdict(row, ("1", "y")) == "<< REMEASURE"
    assert verdict(row, ("1", "x"), ("1", "y")) == "< flagged"
    assert verdict(row) == "< flagged"
    assert verdict(row._replace(flagged=False)) == ""
    # of correlated rows one that is not flagged may be why others are
    assert verdict(row._replace(flagged=False), ("1", "y")) == "<< REMEASURE"
    assert verdict(row._replace(flagged=False, w=None)) == "not testable"


HOSTILE = ["\x1b[2J", "a\nb", "\r7", "\x07", "\u202e8", "\x9b31m", "[red]x[/red]"]


def test_hostile_names_are_escaped_everywhere():
    names = [*HOSTILE, *"abcdef"]
    solution = model(names, wrong=0.08, left="\x1b]0;x\x07", right="\u2028")
    text = printout(solution, strip="\x1b[H\n")
    assert all(ch == "\n" or ch.isprintable() for ch in text)
    plain = printout(model(wrong=0.08))
    assert len(text.splitlines()) == len(plain.splitlines())
    assert "\\x1b[2J" in text
    assert "a\\x0ab" in text
    assert "\\u202e8" in text


@given(
    st.lists(
        st.builds(
            observation,
            st.text(max_size=12),
            st.sampled_from(["x", "y"]),
            st.floats(-1e6, 1e6),
            st.floats(0, 1),
            st.none() | st.floats(0, 1e5),
            st.none() | st.floats(-1e4, 1e4),
            flagged=st.booleans(),
        ),
        max_size=8,
    )
)
def test_a_table_is_a_heading_and_a_line_a_row_whatever_the_names(rows):
    lines = lines_of(rows)
    assert len(lines) == 2 + len(rows)
    assert all(line.isprintable() for line in lines)
