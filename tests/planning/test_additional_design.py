"""Sets of additional parameters before anything is measured: `plan additional`."""

from __future__ import annotations

import json
import re
from fractions import Fraction

import numpy as np
import pytest

from anaplot.bundle.solve.additional import ebner, gruen, gruen50, physical
from anaplot.bundle.solve.polynomialterms import EBNER, GRUEN50, LETTERS
from anaplot.cli import main
from anaplot.planning.additionaldesign import additional_design


@pytest.mark.parametrize(("chosen", "side"), [(ebner, 3), (gruen, 5), (gruen50, 5)])
def test_the_papers_sets_are_orthogonal_on_their_points(chosen, side) -> None:
    found = additional_design(chosen, side, 100.0, 150.0)
    assert found.orthogonal
    assert found.rank == 2 * side * side
    assert (found.largest_orientation == 0.0) == (chosen is not gruen50)
    assert [one.name for one in found.parameters] == list(chosen.names)


def test_a_grid_of_nine_points_cannot_tell_more_than_18() -> None:
    found = additional_design(gruen50, 3, 100.0, 150.0)
    assert found.rank == 18
    assert found.largest > 0.5
    a12 = found.parameters[0]
    line = np.array([-1.0, 0.0, 1.0])
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    first = np.concatenate((x, -y))
    other = gruen50.basis(x, y, 1.0, np.ones(9))[:, :, gruen50.names.index(a12.nearest)].T.ravel()
    cosine = abs(first @ other) / np.linalg.norm(first) / np.linalg.norm(other)
    assert a12.cosine == pytest.approx(cosine)
    assert a12.rms_mm == pytest.approx(np.sqrt((first**2).mean()))


def test_what_a_lens_shares_with_the_orientation_is_told() -> None:
    found = additional_design(physical, 5, 100.0, 150.0)
    share = {one.name: one.orientation for one in found.parameters}
    # over flat ground the camera constant is a height, the principal point a shift
    assert share["c"] == share["x0"] == share["y0"] == pytest.approx(1.0)
    assert 0.5 < share["k1"] < 1.0
    assert not found.orthogonal


def test_the_terms_are_written_as_they_are_computed() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-1.0, 1.0, (2, 20))
    for chosen, terms, letters in (
        (ebner, EBNER, LETTERS["ebner"]), (gruen50, GRUEN50, LETTERS["gruen"])
    ):  # fmt: skip
        basis = chosen.basis(x, y, 1.0, np.ones(20))
        values = {"x": x, "y": y, **{one: of_text(text, x, y) for one, text in letters.items()}}
        for k, term in enumerate(terms):
            for axis, text in enumerate((term.dx, term.dy)):
                expected = np.full(20, float(bool(text)))
                for factor in text.replace("-y", "-1 y").split():
                    expected *= values[factor] if factor in values else float(Fraction(factor))
                np.testing.assert_allclose(basis[:, axis, k], expected, atol=1e-14)


def of_text(text: str, x, y):
    """Evaluate "x^2 - 1/2" or "x^2 (x^2 - 31/28) + 9/70"."""
    z = x if text[0] == "x" else y
    first, *last = (float(Fraction(number)) for number in re.findall(r"\d+/\d+", text))
    if not last:
        assert text == f"{text[0]}^2 - {text.split()[-1]}"
        return z**2 - first
    assert "^2 (" in text
    return z**4 - first * z**2 + last[0]


def test_the_command_shows_terms_and_verdict(capsys) -> None:
    assert main(["plan", "additional", "gruen"]) == 0
    text = capsys.readouterr().out
    assert "ADDITIONAL PARAMETERS gruen: 44 of them on 5 x 5 points" in text
    assert "  r = x^2 (x^2 - 31/28) + 9/70" in text
    row = next(line for line in text.splitlines() if line.startswith("  a43 "))
    assert row.split()[1:5] == ["y", "k", "q", "0"]
    assert "all are orthogonal to each other on these points" in text
    assert "with the orientation's 6 they span 50 of the 50 that 25 points can show" in text
    said = ["plan", "additional", "gruen:-a43", "--points", "3x3", "--reach", "90", "--json"]
    assert main(said) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["count"] == 43
    assert answer["possible"] == 18
    assert "a43" not in {one["name"] for one in answer["parameters"]}
    assert main(["plan", "additional", "gruem"]) == 2
    assert "gruen" in capsys.readouterr().err
