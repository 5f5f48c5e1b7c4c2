"""Variance components of a block: how good the groups of its observations really are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.variancecomponents import (
    VarianceComponents,
    estimate_components,
)
from anaplot.aliases import Grouping, Progress
from anaplot.bundle.hypotheses.observationgroups import GroupedBlock, ObservationGroups
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Problem
from anaplot.errors import InputError

__all__ = ["GROUPINGS", "BlockComponents", "ComponentSigma", "block_components"]

GROUPINGS: tuple[Grouping, ...] = ("kinds", "axes", "strips", "operators")
"""How image coordinates are grouped: all in one, x and y, by strip, by operator."""


class ComponentSigma(NamedTuple):
    """A-priori and estimated standard deviation of a group that has a single one.

    Attributes
    ----------
    apriori, estimated
        [um] for image coordinates, [m] for control and positions.
    unit
        "um" or "m".
    """

    apriori: float
    estimated: float
    unit: Literal["um", "m"]


@dataclass(frozen=True, slots=True, eq=False)
class BlockComponents:
    """Variance components of a block.

    Attributes
    ----------
    grouping
        How the image coordinates were grouped.
    variances
        The components; groups are image coordinates, then "control", "priors of points", "prior
        positions", "prior rotations" and "prior parameters", as far as they are observed. (One
        factor for priors of different kinds would push the good ones aside for the bad ones.)
    sigmas
        Standard deviation of each group; None for rotations and parameters, and
        where a-priori sigmas differ inside.
    block
        The block adjusted with the estimated variances.
    """

    grouping: Grouping
    variances: VarianceComponents
    sigmas: tuple[ComponentSigma | None, ...]
    block: AdjustedBlock = field(repr=False)

    def remarks(self) -> list[str]:
        """Return sentences for a person."""
        return self.variances.remarks()


def block_components(
    block: AdjustedBlock,
    grouping: Grouping = "axes",
    *,
    operators: Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> BlockComponents:
    """Estimate variance components of an adjusted block.

    Parameters
    ----------
    block
        The adjusted block.
    grouping
        "kinds": image coordinates all in one; "axes": x and y apart; "strips": by strip;
        "operators": by who measured the photo.
    operators
        Photo to operator; needed for "operators". A photo that is not in it counts as measured by
        "(no operator)".
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        An unknown grouping, or operators without a mapping or of photos that do not exist.
    NotComputableError
        The block does not adjust with the variances found on the way.
    """
    groups = _groups(block.problem, grouping, operators)
    grouped = GroupedBlock(block, groups, progress)
    variances = estimate_components(
        groups.names,
        groups.counts(block.problem),
        grouped.readjust,
        redundancies=grouped.redundancies,
    )
    last = grouped.last(lambda problem: groups.told(problem, variances))
    return BlockComponents(grouping, variances, _sigmas(block.problem, groups, variances), last)


def _groups(
    problem: Problem, grouping: Grouping, operators: Mapping[str, str] | None
) -> ObservationGroups:
    m = len(problem.photo)
    names: list[str]
    if grouping == "kinds":
        names, image = ["image"], np.zeros((m, 2), dtype=np.intp)
    elif grouping == "axes":
        names = ["image x", "image y"]
        image = np.tile(np.array([0, 1], dtype=np.intp), (m, 1))
    elif grouping in ("strips", "operators"):
        labels = (
            _strip_labels(problem) if grouping == "strips" else _operator_labels(problem, operators)
        )
        names = list(dict.fromkeys(labels))
        of_photo = np.array([names.index(label) for label in labels], dtype=np.intp)
        image = np.repeat(of_photo[problem.photo][:, None], 2, axis=1)
    else:
        raise InputError(f"components {grouping}: one of {', '.join(GROUPINGS)}")
    rest: list[int | None] = []
    for name, sigma in (
        ("control", problem.known_sigma),
        ("priors of points", problem.expected_sigma),
        ("prior positions", problem.position_sigma),
        ("prior rotations", problem.rotation_sigma),
        ("prior parameters", problem.additional_sigma),
    ):
        observed = bool(np.isfinite(sigma).any())
        rest.append(len(names) if observed else None)
        if observed:
            names.append(name)
    return ObservationGroups(tuple(names), image, *rest)


def _strip_labels(problem: Problem) -> list[str]:
    strips: dict[str, str] = {}
    for strip in problem.block.strips:
        for photo in strip.photos:
            # a photo in two strips is of the first
            strips.setdefault(photo, f"strip {strip.id}")
    return [strips.get(photo, "(no strip)") for photo in problem.photos]


def _operator_labels(problem: Problem, operators: Mapping[str, str] | None) -> list[str]:
    if not operators:
        raise InputError("components by operator need to know who measured which photo")
    known = {photo.id for photo in problem.block.photos}
    stray = next((photo for photo in operators if photo not in known), None)
    if stray is not None:
        raise InputError(f"operator {operators[stray]}: unknown photo {stray}")
    return [
        f"operator {operators[photo]}" if photo in operators else "(no operator)"
        for photo in problem.photos
    ]


def _sigmas(
    problem: Problem, groups: ObservationGroups, variances: VarianceComponents
) -> tuple[ComponentSigma | None, ...]:
    out: list[ComponentSigma | None] = []
    for group, component in enumerate(variances.components):
        unit: Literal["um", "m"] = "um"
        if group in (groups.rotation, groups.additional):
            out.append(None)  # an angle, or a different unit for each parameter
            continue
        of_ground = {
            groups.control: problem.known_sigma,
            groups.expected: problem.expected_sigma,
            groups.position: problem.position_sigma,
        }
        if group in of_ground:
            values = of_ground[group]
            values, unit = values[np.isfinite(values)], "m"
        else:
            values = problem.sigma_xy[groups.image == group] * 1e3
        if values.size == 0 or float(values.max()) > (1.0 + 1e-9) * float(values.min()):
            out.append(None)
            continue
        sigma = float(values[0])
        out.append(ComponentSigma(sigma, sigma * component.sigma_factor, unit))
    return tuple(out)
