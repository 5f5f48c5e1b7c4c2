"""The relative orientation sample of Wolf and Dewitt: six points, redundancy 1.

The book observes all four coordinates with unit weight: omega 2.4077, phi 0.5550, kappa -0.2053
degrees; every standardized residual is the same. The combined form reproduces it; the paper's
pseudo-observations, which fix the left coordinates, come close to it.
"""

from math import degrees
from pathlib import Path

import numpy as np
import pytest
from flightscene import PAPER, TAU

from anaplot.adjustment.leastsquares import adjust_combined
from anaplot.orientation.model import orient
from anaplot.orientation.strip import stereopair
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix, turn

FILE = Path(__file__).parents[3] / "shared" / "data" / "wolf-dewitt" / "relor_sample.dat"
BOOK = (2.4077, 0.5550, -0.2053)

pytestmark = pytest.mark.skipif(not FILE.exists(), reason="sample data absent")


def sample():
    first, *rows = FILE.read_text().split("\n")
    measured = {}
    for row in rows:
        if row.strip() and not row.startswith("#"):
            name, *numbers = row.split()
            measured[name] = tuple(map(float, numbers))
    return float(first), measured


def test_the_combined_form_reproduces_the_book():
    c, measured = sample()
    observed = np.array(list(measured.values())).ravel()

    def misclosures(obs, g, R):
        obs = obs.reshape(-1, 4)
        minus_c = np.full(len(obs), -c)
        x1 = np.column_stack((obs[:, :2], minus_c))
        x2 = np.column_stack((obs[:, 2:], minus_c)) @ R.T
        return np.einsum("ni,ni->n", np.cross([1.0, *g], x1), x2) / c

    g, R, v = np.zeros(2), np.eye(3), np.zeros(24)
    for _ in range(12):
        obs = observed + v
        A = np.empty((6, 24))
        for k in range(24):
            h = np.zeros(24)
            h[k] = 1e-4
            A[:, k] = (misclosures(obs + h, g, R) - misclosures(obs - h, g, R)) / 2e-4
        B = np.empty((6, 5))
        for k in range(5):
            h = np.zeros(5)
            h[k] = 1e-6
            up = misclosures(obs, g + h[:2], turn(*h[2:].tolist()) @ R)
            down = misclosures(obs, g - h[:2], turn(*(-h[2:]).tolist()) @ R)
            B[:, k] = (up - down) / 2e-6
        a = adjust_combined(
            A, B, misclosures(obs, g, R) - A @ v, np.ones(24), unknowns=list("abcde")
        )
        g, v = g + a.g[:2], a.v
        R = turn(*a.g[2:].tolist()) @ R
    found = tuple(map(degrees, rotation_angles(R)))
    assert found == pytest.approx(BOOK, abs=6e-5)
    assert a.conditions.redundancy == 1
    w = np.abs(a.v) / np.sqrt(np.diag(a.q_vv))
    assert w == pytest.approx(np.full(24, w[0]), rel=1e-6)
    assert w[0] == pytest.approx(a.conditions.vtpv**0.5, rel=1e-6)
    assert rotation_matrix(*rotation_angles(R)) == pytest.approx(R, abs=1e-12)


def test_the_model_of_the_paper_comes_close():
    c, measured = sample()
    camera = Camera("w", c)
    left = {name: xy[:2] for name, xy in measured.items()}
    right = {name: xy[2:] for name, xy in measured.items()}
    pair = stereopair(("1", "2"), left, right, (camera, camera), preceding=None)
    model = orient(pair, PAPER, TAU)
    assert tuple(map(degrees, model.rotation)) == pytest.approx(BOOK, abs=0.005)
    assert model.redundancy == 1
    assert [row.size for row in model.table] == pytest.approx([1.0] * 6)
    assert model.base[0] == pytest.approx(91.989, abs=0.5)
