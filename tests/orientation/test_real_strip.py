"""Frames 8936, 8937, 8938 of the Strasbourg block (sxb): a short base along -x."""

from pathlib import Path

import pytest
from flightscene import BAARDA, EXACT, PAPER, PROPAGATED, TAU

from anaplot.orientation.diagnosis import diagnose
from anaplot.orientation.model import orient
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Camera

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "sxb" / "measurements"
CAMERA = Camera("sxb", 123.9392, (53.148, 77.976))

pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="sxb data absent")


def frames():
    out = {2: {}, 3: {}, 4: {}}
    for name in ("markpts.txt", "smartpts.txt"):
        for line in (FOLDER / name).read_text().splitlines():
            if line.strip() and not line.startswith("#"):
                point, image, column, row = (part.strip() for part in line.split(","))
                if int(image) in out:
                    out[int(image)][point] = (
                        0.006 * float(column) - 26.577,
                        38.811 - 0.006 * float(row),
                    )
    return out


def bridged(precision, test):
    images = frames()
    out = []
    for left, right in ((2, 3), (3, 4)):
        pair = stereopair(
            (str(left), str(right)),
            images[left],
            images[right],
            (CAMERA, CAMERA),
            preceding=out[-1] if out else None,
            once=frozenset(images[left]),
        )
        out.append(orient(pair, precision, test))
    return out


def test_counts_sigma_and_bases():
    first, second = bridged(PAPER, TAU)
    assert (len(first.points), len(second.points), len(second.ties)) == (233, 206, 95)
    assert (first.redundancy, second.redundancy) == (228, 295)
    assert first.sigma0_um == pytest.approx(5.6, abs=0.1)
    assert second.sigma0_um == pytest.approx(8.5, abs=0.1)
    assert first.base[0] == pytest.approx(-14.55, abs=0.02)
    assert second.base[0] == pytest.approx(-15.02, abs=0.02)
    assert all(p.Z < 0.0 for model in (first, second) for p in model.points)


def test_the_table_holds_together():
    for precision in (PAPER, PROPAGATED, EXACT):
        for model in bridged(precision, BAARDA):
            assert sum(row.r for row in model.table) == pytest.approx(model.redundancy)
            d = diagnose(model)
            flagged = {row.key for row in model.flagged}
            assert flagged <= set(d.suspects) if precision is EXACT else flagged == set(d.suspects)
            assert sum(
                row.probability for row in model.table
            ) + model.tested.odds.none == pytest.approx(1.0)


def test_propagated_ties_explain_most_of_the_excess():
    paper, propagated = bridged(PAPER, TAU)[1], bridged(PROPAGATED, TAU)[1]
    assert propagated.sigma0_um < 0.8 * paper.sigma0_um


def test_exact_ties_leave_the_orientation_and_explain_as_much():
    """95 ties and a frame measured once for both models: sigma0 is that of the first model."""
    (first, exact), (_, propagated) = bridged(EXACT, TAU), bridged(PROPAGATED, TAU)
    assert exact.base == propagated.base
    assert exact.points == propagated.points
    residuals = [row.residual for row in propagated.table]
    assert [row.residual for row in exact.table] == pytest.approx(residuals, rel=1e-12, abs=1e-12)
    assert exact.sigma0_um == pytest.approx(propagated.sigma0_um, rel=0.05)
    ratio = exact.sigma0_um / first.sigma0_um
    # two variance estimates of 228 and 295 redundancies: F within its bounds of .001
    assert 0.8 < ratio**2 < 1.25
