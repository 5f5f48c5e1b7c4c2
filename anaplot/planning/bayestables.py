"""Tables 1 and 3 of the Bayesian paper: its method step by step, over many realisations.

Every unknown has a prior value that errs as its variance says (angles, which are free, have none).
Step 1 cleans the image coordinates under these priors, without control; step 2 brings the four
corners in as control. The paper prints one experiment for each group; of these are the means.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.significance import critical_tau
from anaplot.aliases import Array, Bools
from anaplot.planning.bayesblock import CORNERS, SIGMA_MM, BayesBlock, bayes_block
from anaplot.planning.bayesfolder import CONTROL_M
from anaplot.planning.bayesscenarios import noise_within_three
from anaplot.planning.montecarlo import QuantityKey, Scenario, Tally, sums
from anaplot.planning.plantederrors import FATES, Case, plant
from anaplot.planning.quantities import COUNT, MEASURE, Quantity, out_of
from anaplot.planning.rejections import rejected_rows
from anaplot.planning.scenarioalpha import PAPER_ALPHA

__all__ = ["BayesTables", "Group", "bayes_step", "rows_by_rms", "scenarios"]

METHODS = ("rms", "baarda", "search")
MEASURES = (
    *("GL", "VUP", "largest V"),
    *(f"{what} {axis}" for what in ("EMQ", "DPE", "EMQ/DPE") for axis in "XYZ"),
)
_UM = 1e3 * SIGMA_MM
_CORNERS = (60 + 3 * np.array(CORNERS)[:, None] + np.arange(3)).ravel()  # their unknowns


class Group(NamedTuple):
    """One of the paper's experiments.

    Attributes
    ----------
    name
        As in its tables.
    variance
        Of the priors (VPP) [m^2].
    case
        What is planted.
    printed
        right, wrong, missed and the figures of Tables 1 and 3, in the order of `MEASURES`.
    """

    name: str
    variance: float
    case: Case
    printed: Mapping[str, float]


# name, VPP, gross errors and their size [um]; then C E F, GL, VUP, max V; EMQ, DPE, EMQ/DPE
_PRINTED = """
G0A  10  0  0 | 0 0 0 21  1.89  9.4 | 0.11 0.10 0.70  0.10 0.11 0.55  1.1 0.9 1.3
G0B 100  0  0 | 0 0 0 21  3.68  9.8 | 0.10 0.10 2.16  0.10 0.11 0.56  1.1 0.9 1.4
G1A  10  2 30 | 2 0 0 19  2.51  7.4 | 0.11 0.12 0.60  0.10 0.11 0.55  1.1 1.1 1.1
G1B  10  6 30 | 3 1 3 17  3.31  7.3 | 0.07 0.11 0.60  0.10 0.12 0.55  0.7 0.9 1.1
G1C  10 10 30 | 1 0 9 20 11.22 16.8 | 0.14 0.10 0.82  0.10 0.11 0.55  1.4 0.9 1.5
G2A 100  2 30 | 2 0 0 19  1.27  7.3 | 0.11 0.12 1.38  0.10 0.11 1.59  1.1 1.0 0.9
G2B 100  6 30 | 3 0 3 18  4.20  9.0 | 0.10 0.12 1.39  0.10 0.12 1.59  1.0 1.1 0.9
G2C 100 10 30 | 1 0 9 20 10.98 16.4 | 0.14 0.11 2.88  0.10 0.11 1.56  1.4 1.0 1.9
G3A  10  2 90 | 2 0 0 19  1.32  7.4 | 0.11 0.12 0.60  0.10 0.11 0.55  1.1 1.1 1.1
G3B  10  6 90 | 5 5 1 11  1.24  4.8 | 0.21 0.69 0.51  0.24 0.72 0.60  0.9 1.0 0.9
G3C  10 10 90 | 5 0 5 16 12.01 20.1 | 0.16 0.21 0.68  0.10 0.11 0.55  1.6 1.9 1.2
G4A 100  2 90 | 2 0 0 19  1.27  7.4 | 0.11 0.12 1.38  0.10 0.11 1.59  1.1 1.0 0.9
G4B 100  6 90 | 4 3 2 14  2.11  7.5 | 0.14 2.26 1.32  0.11 2.24 1.60  1.2 1.0 0.8
G4C 100 10 90 | 5 0 5 16 11.87 20.1 | 0.16 0.23 1.41  0.10 0.12 1.59  1.6 2.0 0.9
"""


def _groups() -> tuple[Group, ...]:
    out = []
    for line in _PRINTED.strip().splitlines():
        name, variance, number, size, *figures = line.replace("|", "").split()
        keys = (*FATES, *MEASURES)
        out.append(
            Group(
                name,
                float(variance),
                Case(name, int(number), float(size) / _UM),
                dict(zip(keys, map(float, figures), strict=True)),
            )
        )
    return tuple(out)


@dataclass(frozen=True, slots=True)
class BayesTables:
    """All groups, at both levels of prior variance; see `Scenario`.

    Attributes
    ----------
    alpha
        Significance of a single row.
    """

    name: str
    about: str
    groups: tuple[Group, ...]
    methods: tuple[str, ...] = METHODS
    runs: int = 40
    chunk: int = 10
    references: Mapping[QuantityKey, float] = field(default_factory=dict)
    alpha: float = PAPER_ALPHA

    def prepare(self) -> _Trial:
        """Linearise the block under both variances."""
        levels = {group.variance for group in self.groups}
        blocks = {one: bayes_block(one) for one in levels}
        every = np.ones(len(blocks[min(levels)].rows), dtype=bool)
        inverses = {one: _normal_inverse(block, every) for one, block in blocks.items()}
        return _Trial(self.groups, blocks, inverses, self.alpha)


class _Experiment(NamedTuple):
    """The block, and its misclosures: (156,) of the image coordinates, (135,) of the priors."""

    block: BayesBlock
    errors: Array
    prior: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """See `Trial`."""

    groups: tuple[Group, ...]
    blocks: Mapping[float, BayesBlock]
    inverses: Mapping[float, Array]
    alpha: float

    def remarks(self) -> tuple[str, ...]:
        """Say what the figures are."""
        return (
            "right, wrong, missed: C, E, F of Table 1; GL: n - u = 21 less what is rejected; VUP: "
            "v'Pv / GL of the image coordinates; largest V [um] of those that are kept",
            "EMQ, DPE: rms over the 25 points of what they are off, and of their standard "
            "deviations for the a-priori sigma0 [m]",
            f"step 1 without control; step 2 with the four corners as control of {CONTROL_M:g} m; "
            "prior values err as their variance says; known: the paper's one experiment",
        )

    def quantities(self, methods: tuple[str, ...]) -> dict[QuantityKey, Quantity]:
        """Say what is counted and measured."""
        out: dict[QuantityKey, Quantity] = {}
        for group in self.groups:
            some = out_of(group.case.number)
            kinds = {"right": some, "wrong": COUNT, "missed": some}
            for method in methods:
                out |= {(group.name, method, what): kinds[what] for what in FATES}
                out |= {(group.name, method, what): MEASURE for what in MEASURES}
        return out

    def run(self, rng: np.random.Generator, runs: int, methods: tuple[str, ...]) -> Tally:
        """Make the experiments, clean them, bring control in."""
        tally: Tally = {}
        for group in self.groups:
            block = self.blocks[group.variance]
            n, u = block.design.shape
            errors = noise_within_three(rng, runs, n)
            planted = plant(rng, errors, np.arange(n), group.case, np.ones(n))
            prior = _of_lengths(rng.normal(size=(runs, u)))
            control = rng.normal(size=(runs, 3 * len(CORNERS)))
            found: dict[tuple[str, str], list[float]] = {}
            for k in range(runs):
                made = _Experiment(block, errors[k], prior[k])
                for method in methods:
                    out = self._rejected(made, method)
                    figures = _counts(planted[k], out) | bayes_step(*made, control[k], out)
                    for what, value in figures.items():
                        found.setdefault((method, what), []).append(value)
            for (method, what), values in found.items():
                tally[group.name, method, what] = sums(values)
        return tally

    def _rejected(self, made: _Experiment, method: str) -> Bools:
        block = made.block
        right = block.design.T @ made.errors + made.prior / sqrt(block.prior_variance)
        x = self.inverses[block.prior_variance] @ right
        e = made.errors - block.design @ x
        if method == "rms":
            return rows_by_rms(block, e, self.alpha)
        whole = float(made.errors @ made.errors + made.prior @ made.prior - right @ x)
        system = replace(block.residuals(made.errors), e=e, vtpv=max(whole, 0.0))
        out = np.zeros(len(e), dtype=bool)
        out[list(rejected_rows(system, (method,), self.alpha)[method])] = True
        return out


def _of_lengths(values: Array) -> Array:
    """Return errors of the priors of all coordinates; those of the angles are zero."""
    out = values.copy()
    angles = np.arange(60).reshape(10, 6)[:, 3:].ravel()
    out[:, angles] = 0.0
    return out


def _counts(planted: Bools, out: Bools) -> dict[str, float]:
    counts = (out & planted, out & ~planted, planted & ~out)
    return {what: float(of.sum()) for what, of in zip(FATES, counts, strict=True)}


def _normal_inverse(block: BayesBlock, kept: Bools, control: float = 0.0) -> Array:
    a = block.design[kept]
    normal = a.T @ a
    normal[np.diag_indices_from(normal)] += 1.0 / block.prior_variance
    normal[_CORNERS, _CORNERS] += control
    return np.asarray(np.linalg.inv(normal))


def rows_by_rms(block: BayesBlock, e: Array, alpha: float) -> Bools:
    """Reject what exceeds Pope's value times the rms of the residuals, until nothing does (eq. 4).

    Not more than half of the superabundant equations.

    Parameters
    ----------
    block
        Under its prior variance.
    e
        (156,) residuals with all image coordinates.
    alpha
        Significance of a single row.
    """
    n, u = block.design.shape
    out = np.zeros(n, dtype=bool)
    while True:
        v = e
        if out.any():
            # what one adjustment without them leaves; their partners may be out as well
            inner = block.matrix[np.ix_(out, out)]
            v = e - block.matrix[:, out] @ np.linalg.lstsq(inner, e[out], rcond=1e-9)[0]
            v[out] = 0.0
        rejected = int(out.sum())
        critical = critical_tau(alpha, n - u - rejected)
        limit = np.inf if critical is None else critical * np.sqrt((v[~out] ** 2).mean())
        beyond = np.flatnonzero(np.abs(v) > limit)
        room = (n - u) // 2 - rejected
        if not len(beyond) or room <= 0:
            return out
        out[beyond[np.argsort(-np.abs(v[beyond]), kind="stable")[:room]]] = True


def bayes_step(
    block: BayesBlock, errors: Array, prior: Array, control: Array, out: Bools
) -> dict[str, float]:
    """Bring control into the cleaned block: the figures of Tables 1 and 3.

    Parameters
    ----------
    block
        Under its prior variance.
    errors, prior, control
        (156,), (135,) and (12,) errors of image coordinates, prior values and the corners' X, Y,
        Z, in their standard deviations.
    out
        (156,) image coordinates that are rejected.

    Returns
    -------
    dict
        The values of `MEASURES`.
    """
    kept = ~out
    a = block.design[kept]
    inverse = _normal_inverse(block, kept, CONTROL_M**-2.0)
    right = a.T @ errors[kept] + prior / sqrt(block.prior_variance)
    right[_CORNERS] += control / CONTROL_M
    x = inverse @ right
    v = errors[kept] - a @ x
    left = len(errors) - len(x) - int(out.sum())
    off = np.sqrt((x[60:].reshape(-1, 3) ** 2).mean(axis=0))
    deviation = np.sqrt(np.diag(inverse)[60:].reshape(-1, 3).mean(axis=0))
    largest = _UM * float(np.abs(v).max())
    values = (left, float(v @ v) / left, largest, *off, *deviation, *(off / deviation))
    return dict(zip(MEASURES, map(float, values), strict=True))


def scenarios() -> tuple[Scenario, ...]:
    """Return the tables."""
    groups = _groups()
    known = {
        (group.name, "rms", what): value
        for group in groups
        for what, value in group.printed.items()
    }
    about = (
        "The Bayesian paper's Tables 1 and 3: counts, GL, VUP, largest V, EMQ and DPE of all "
        "fourteen groups, priors of 10 and 100 m^2."
    )
    return (BayesTables("bayes-tables", about, groups, references=known),)
