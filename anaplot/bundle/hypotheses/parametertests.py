"""Are additional parameters significant: all, groups, pairs, single ones (Gruen 1978, D1).

They are tested against given values, H0: dz = dz' (eq. 34): those of an a-priori calibration, else
zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from anaplot.adjustment.hypothesis import (
    Component,
    DependentConditionsError,
    f_power,
    principal_components,
    quadratic_form,
    removable,
    sequential_components,
    sidak_alpha,
    variance_inflation,
)
from anaplot.aliases import Array
from anaplot.bundle.hypotheses.verdict import (
    CORRELATED,
    USUAL,
    HypothesisSettings,
    VarianceFactor,
    Verdict,
)
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import own_parameter_cofactors

__all__ = [
    "ComponentTest",
    "GroupTest",
    "PairTest",
    "ParameterTest",
    "ParameterTests",
    "SetTest",
    "parameter_tests",
]

Label = tuple[str, str]

_JOINT = 600  # photo-invariant parameters up to which all are tested together


class ParameterTest(NamedTuple):
    """One additional parameter against its given value (eq. 40).

    Attributes
    ----------
    group, name
        Which one.
    value, s
        Its value [mm], and its standard deviation for the a-priori sigma0.
    verdict
        Of its single test; the family of all parameters keeps the significance.
    mdb
        Smallest deviation [mm] from the given value that is found with the settings' power.
    power
        Power against a value as large as the block's a-priori image sigma.
    inflation
        How much its variance grows by correlation with the other parameters of its set; None
        where the set is not of full rank.
    kept
        Share of the noncentrality that is left by correlation with all other unknowns
        (eq. 38b): 1 if it is orthogonal to them.
    given
        What it is tested against [mm].
    """

    group: str
    name: str
    value: float
    s: float
    verdict: Verdict
    mdb: float
    power: float
    inflation: float | None
    kept: float
    given: float = 0.0


class GroupTest(NamedTuple):
    """The parameters of one group (strip, camera or photo) together."""

    group: str
    verdict: Verdict


class PairTest(NamedTuple):
    """Two correlated parameters together (eq. 43)."""

    first: Label
    second: Label
    correlation: float
    verdict: Verdict


class ComponentTest(NamedTuple):
    """One of the independent components of a correlated set.

    Attributes
    ----------
    parameter
        The parameter a sequential component belongs to; the weightiest of a principal one.
    value
        Of the parameters minus their given values; standardized by the a-priori sigma0.
    variance
        See `anaplot.adjustment.hypothesis.Component`.
    loadings
        At the members of the set, divided by their standard deviations.
    verdict
        The family of a set's components keeps the significance.
    """

    parameter: Label
    value: float
    variance: float
    loadings: tuple[float, ...]
    verdict: Verdict


class SetTest(NamedTuple):
    """A set of correlated parameters, together and after orthogonalisation.

    Attributes
    ----------
    members
        Its parameters.
    verdict
        All of them against their given values; the family of sets keeps the significance.
    sequential
        Each parameter with the earlier ones left out, the worst separated first.
    principal
        Along the eigenvectors of the correlations, the best determined first.
    """

    members: tuple[Label, ...]
    verdict: Verdict
    sequential: tuple[ComponentTest, ...]
    principal: tuple[ComponentTest, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ParameterTests:
    """The hypotheses about additional parameters.

    Attributes
    ----------
    everything
        All parameters have their given values (eq. 35); None when it is not tested, see
        the remarks.
    groups
        Each group, when there are several.
    parameters
        Every single one.
    pairs, sets
        Those correlated beyond the settings' limit.
    orthogonal
        All parameters of a block-wide set taken apart one after the other; empty where the set is
        not tested as a whole.
    removable
        The parameters that may be left out together, the least significant first; None when the
        set is not tested as a whole.
    remarks
        Sentences for a person.
    """

    everything: Verdict | None
    groups: tuple[GroupTest, ...]
    parameters: tuple[ParameterTest, ...]
    pairs: tuple[PairTest, ...]
    sets: tuple[SetTest, ...]
    orthogonal: tuple[ComponentTest, ...] = field(repr=False)
    removable: tuple[Label, ...] | None
    remarks: tuple[str, ...]


class _Family(NamedTuple):
    """Parameters whose common cofactors are known."""

    labels: tuple[Label, ...]
    given: Array
    z: Array  # values minus given ones
    q: Array
    information: Array  # (p,) their diagonal elements of the normal equations


def parameter_tests(
    block: AdjustedBlock, settings: HypothesisSettings = USUAL
) -> ParameterTests | None:
    """Test the additional parameters of a block against given values; None when it has none.

    Priors on the parameters count as what they are in the adjustment: observations of the given
    value, else of zero, with their a-priori standard deviation.
    """
    problem = block.problem
    if problem.additional is None or not block.parameter_rows():
        return None
    variance = VarianceFactor.of(block)
    families, remarks = _families(block)
    if len(problem.additional_sigma):
        what = "values" if problem.additional_given.any() else "zeros"
        remarks.append(
            f"the parameters are weighted: their a-priori {what} count as observations, which "
            "makes the tests cautious if they are only an assumption"
        )
    inflations = [_inflation(family) for family in families]
    regular = [f for f, found in zip(families, inflations, strict=True) if found is not None]
    deficient = [
        group
        for family, found in zip(families, inflations, strict=True)
        if found is None
        for group, _ in family.labels
    ]
    if deficient:
        remarks.append(
            "additional parameters repeat each other in "
            f"{', '.join(dict.fromkeys(deficient))}: only single ones are tested; "
            "leave some out or weigh them"
        )
    everything: Verdict | None = None
    orthogonal: tuple[ComponentTest, ...] = ()
    away: tuple[Label, ...] | None = None
    if len(families) == 1 and regular:
        family = families[0]
        everything = variance.test(
            quadratic_form(family.z, family.q), len(family.z), settings.alpha
        )
        orthogonal = _components(
            sequential_components(family.z, family.q), family.labels, variance, settings
        )
        away = _removable(family, variance, settings)
    image_mm = problem.block.precision.image_um * 1e-3
    return ParameterTests(
        everything,
        _groups(regular, variance, settings),
        _singles(families, inflations, image_mm, variance, settings),
        _pairs(families, variance, settings),
        _sets(regular, variance, settings),
        orthogonal,
        away,
        tuple(remarks),
    )


def _inflation(family: _Family) -> Array | None:
    """Return (p,) how much each variance grows by correlation; None without full rank."""
    try:
        return variance_inflation(family.q)
    except DependentConditionsError:
        return None


def _singles(
    families: Sequence[_Family],
    inflations: Sequence[Array | None],
    image_mm: float,
    variance: VarianceFactor,
    settings: HypothesisSettings,
) -> tuple[ParameterTest, ...]:
    """Test every parameter by itself; power against a value of `image_mm`."""
    alone = sidak_alpha(settings.alpha, sum(len(family.z) for family in families))
    noncentrality = variance.detectable(alone, settings.power)
    out = []
    for family, inflation in zip(families, inflations, strict=True):
        for k, (group, name) in enumerate(family.labels):
            cofactor = float(family.q[k, k])
            out.append(
                ParameterTest(
                    group,
                    name,
                    float(family.z[k] + family.given[k]),
                    sqrt(cofactor),
                    variance.test(float(family.z[k]) ** 2 / cofactor, 1, alone),
                    sqrt(noncentrality * cofactor),
                    f_power(image_mm * image_mm / cofactor, alone, 1, variance.degrees),
                    None if inflation is None else float(inflation[k]),
                    min(1.0, 1.0 / (cofactor * float(family.information[k]))),
                    float(family.given[k]),
                )
            )
    return tuple(out)


def _removable(
    family: _Family, variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[Label, ...] | None:
    """Return the parameters that may be left out together; None where tests have no sigma."""
    sigma = variance.used
    if sigma is None:
        return None
    steps = removable(
        family.z, family.q, alpha=settings.alpha, sigma=sigma, redundancy=variance.degrees
    )
    return tuple(family.labels[step.member] for step in steps)


def _families(block: AdjustedBlock) -> tuple[list[_Family], list[str]]:
    problem = block.problem
    assert problem.additional is not None
    names = problem.additional.set.names
    labels = tuple((group, name) for group in problem.additional_groups for name in names)
    own = problem.photo_invariant
    linear = block.cofactors.normal.linear
    white = linear.a[:, :, 6:] if own else linear.h
    owner = problem.photo if own else problem.additional_group
    information = np.zeros((len(problem.additional_groups), len(names)))
    np.add.at(information, owner, np.einsum("mij,mij->mj", white, white))
    if len(problem.additional_sigma):
        information += problem.additional_sigma**-2.0
    if not own:
        given, z, q = problem.additional_given, block.state.shared, block.cofactors.shared
        if problem.additional_still is not None:
            free = np.flatnonzero(~problem.additional_still)
            labels = tuple(labels[k] for k in free.tolist())
            given, z, q = given.ravel()[free], z[free], q[np.ix_(free, free)]
            information = information.ravel()[free]
        return [_family(labels, given, z, q, information)], []
    if len(labels) <= _JOINT:
        q = own_parameter_cofactors(block)
        return [_family(labels, problem.additional_given, block.state.own, q, information)], []
    count = len(names)
    families = [
        _family(
            labels[k * count : (k + 1) * count],
            problem.additional_given[k],
            block.state.own[k],
            block.cofactors.photos[k, 6:, 6:],
            information[k],
        )
        for k in range(len(problem.photos))
    ]
    remark = (
        f"{len(labels)} additional parameters are tested photo by photo, not all together "
        f"(that is done up to {_JOINT})"
    )
    return families, [remark]


def _family(labels: tuple[Label, ...], given: Array, z: Array, q: Array, known: Array) -> _Family:
    given = given.reshape(-1)
    return _Family(labels, given, z.reshape(-1) - given, q, known.reshape(-1))


def _groups(
    families: Sequence[_Family], variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[GroupTest, ...]:
    found: list[tuple[str, float, int]] = []
    for family in families:
        for group in dict.fromkeys(label[0] for label in family.labels):
            mine = [k for k, label in enumerate(family.labels) if label[0] == group]
            square = quadratic_form(family.z[mine], family.q[np.ix_(mine, mine)])
            found.append((group, square, len(mine)))
    if len(found) < 2:
        return ()
    alpha = sidak_alpha(settings.alpha, len(found))
    return tuple(GroupTest(group, variance.test(r, b, alpha)) for group, r, b in found)


def _correlations(q: Array) -> Array:
    scale = np.sqrt(np.diag(q))
    out: Array = np.clip(q / scale[:, None] / scale, -1.0, 1.0)
    return out


def _pairs(
    families: Sequence[_Family], variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[PairTest, ...]:
    found: list[tuple[Label, Label, float, float]] = []
    for family in families:
        rho = _correlations(family.q)
        t = family.z / np.sqrt(np.diag(family.q))
        for i, j in np.argwhere(np.triu(np.abs(rho) >= CORRELATED, 1)).tolist():
            r = float(rho[i, j])
            if not 1.0 - r * r > 0.0:
                continue  # the same parameter twice; the remark on rank says so
            square = float((t[i] ** 2 - 2.0 * r * t[i] * t[j] + t[j] ** 2) / (1.0 - r * r))
            found.append((family.labels[i], family.labels[j], r, max(square, 0.0)))
    if not found:
        return ()
    alpha = sidak_alpha(settings.alpha, len(found))
    return tuple(PairTest(i, j, r, variance.test(s, 2, alpha)) for i, j, r, s in found)


def _sets(
    families: Sequence[_Family], variance: VarianceFactor, settings: HypothesisSettings
) -> tuple[SetTest, ...]:
    """Parameters that hang together by correlations beyond the limit."""
    found: list[tuple[_Family, list[int]]] = []
    for family in families:
        linked = np.abs(_correlations(family.q)) >= CORRELATED
        graph = sparse.csr_matrix(linked.astype(np.float64))
        count, of = connected_components(graph, directed=False)
        sets = [np.nonzero(of == k)[0].tolist() for k in range(count)]
        found += [(family, members) for members in sets if len(members) > 1]
    if not found:
        return ()
    alpha = sidak_alpha(settings.alpha, len(found))
    out = []
    for family, mine in found:
        z, q = family.z[mine], family.q[np.ix_(mine, mine)]
        labels = tuple(family.labels[k] for k in mine)
        out.append(
            SetTest(
                labels,
                variance.test(quadratic_form(z, q), len(mine), alpha),
                _components(sequential_components(z, q), labels, variance, settings),
                _components(principal_components(z, q), labels, variance, settings),
            )
        )
    return tuple(out)


def _components(
    parts: Sequence[Component],
    labels: tuple[Label, ...],
    variance: VarianceFactor,
    settings: HypothesisSettings,
) -> tuple[ComponentTest, ...]:
    alpha = sidak_alpha(settings.alpha, len(parts))
    return tuple(
        ComponentTest(
            labels[part.member],
            part.value,
            part.variance,
            tuple(part.loadings.tolist()),
            variance.test(part.value * part.value, 1, alpha),
        )
        for part in parts
    )
