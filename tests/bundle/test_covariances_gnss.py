"""Covariances with offsets of stated positions and angles, against one dense matrix of all."""

from __future__ import annotations

import numpy as np
import pytest
from test_gnss import CASES, both

from anaplot.bundle.hypotheses.offsettests import offset_rows
from anaplot.bundle.solve.covariances import covariance_of
from anaplot.bundle.solve.unknownnames import unknowns_meant
from anaplot.errors import InputError


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_offsets_with_photos_and_points(name) -> None:
    found = both(name)
    block, rows = found.ours, offset_rows(found.ours)
    n = len(block.problem.photos)
    names = unknowns_meant(
        block.problem, ["points", "photos", *["offsets"] * bool(rows)], "--covariance"
    )
    # the other's order: positions, angles, points, offsets
    at = {f"photo:{photo}:{unknown}": 3 * k + axis + 3 * n * late
          for k, photo in enumerate(block.problem.photos)
          for late, three in enumerate(("XYZ", ("omega", "phi", "kappa")))
          for axis, unknown in enumerate(three)}  # fmt: skip
    at |= {f"point:{point}:{axis}": 6 * n + 3 * k + "XYZ".index(axis)
           for k, point in enumerate(block.problem.points) for axis in "XYZ"}  # fmt: skip
    at |= {f"offset:{row.group}:{row.kind}_{row.axis}": len(at) + k for k, row in enumerate(rows)}
    assert {one.text for one in names} == at.keys()
    assert len(names) == len(found.q)
    index = [at[one.text] for one in names]
    own, wanted = covariance_of(block, names), found.q[np.ix_(index, index)]
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        own.cofactors / size[:, None] / size, wanted / size[:, None] / size, rtol=0.0, atol=1e-9
    )
    shown = {one.text: (value, s, one.unit) for one, value, s in
             zip(names, own.values, own.deviations, strict=True)}  # fmt: skip
    for row in rows:
        value, s, unit = shown[f"offset:{row.group}:{row.kind}_{row.axis}"]
        assert (value, unit) == (row.value, row.unit)
        assert s == pytest.approx(row.s, rel=1e-9)


def test_what_offsets_are_called() -> None:
    problem = both("mixed").ours.problem
    group = problem.block.strips[0].id

    def texts(*wanted):
        return [one.text for one in unknowns_meant(problem, wanted, "--covariance")]

    assert texts("offset:block:drift_Z") == ["offset:block:drift_Z"]
    assert len(texts(f"offsets:{group}")) == 3
    assert len(texts("offsets:shift_X")) == len(problem.block.strips)
    with pytest.raises(InputError, match=r"offset 'block' has no 'drift_z' \(did you mean 'drift_"):
        texts("offset:block:drift_z")
    problem = both("lever arm alone").ours.problem
    with pytest.raises(InputError, match="adjusted without offsets of what photos state"):
        texts("offsets")
