"""Variance components of a block: how good the groups of its observations really are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from anaplot.adjustment.variancecomponents import (
    GroupSums,
    VarianceComponents,
    estimate_components,
)
from anaplot.aliases import Array, Index, Progress
from anaplot.bundle.adjust import evaluate
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.gaussnewton import Minimum, equations_at, find_minimum
from anaplot.bundle.solve.normal import Linearised
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.errors import InputError

__all__ = ["GROUPINGS", "BlockComponents", "ComponentSigma", "Grouping", "block_components"]

Grouping = Literal["kinds", "axes", "strips", "operators"]

GROUPINGS: tuple[Grouping, ...] = ("kinds", "axes", "strips", "operators")
"""How image coordinates are grouped: all in one, x and y, by strip, by operator."""


class ComponentSigma(NamedTuple):
    """A-priori and estimated standard deviation of a group, where one number says it.

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
        The components; groups are image coordinates, then "control", "prior positions", "prior
        rotations" and "prior parameters", as far as they are observed. (One factor for priors of
        different kinds would push the good ones aside for the bad ones.)
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


class _Layout(NamedTuple):
    """Groups by name; (m, 2) group of every image coordinate, those of the rest or None."""

    names: tuple[str, ...]
    image: Index
    control: int | None
    position: int | None
    rotation: int | None
    additional: int | None


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
    problem = block.problem
    layout = _layout(problem, grouping, operators)
    structure = block.cofactors.normal.structure
    last: tuple[Problem, Minimum] | None = None
    state = block.state
    runs = 0

    def readjust(factors: Array) -> GroupSums:
        nonlocal last, state, runs
        weighted = _weighted(problem, layout, np.sqrt(factors))
        found = find_minimum(weighted, state, structure)
        last, state = (weighted, found), found.state
        runs += 1
        if progress is not None:
            progress(f"variance components, adjustment {runs}", 1.0 - 0.7**runs)
        # redundancy numbers are the same in every datum
        cofactors = compute_cofactors(found.normal, found.factor, None)
        return GroupSums(_squares(found.normal.linear, layout), _redundancies(cofactors, layout))

    def redundancies(factors: Array) -> Array:
        """Return what next to the solution changes by the weights, not by the residuals."""
        weighted = _weighted(problem, layout, np.sqrt(factors))
        normal, factor, _ = equations_at(weighted, structure, state)
        if progress is not None:
            progress("variance components, standard deviations", 0.0)
        return _redundancies(compute_cofactors(normal, factor, None), layout)

    counts = _counts(problem, layout)
    variances = estimate_components(layout.names, counts, readjust, redundancies=redundancies)
    assert last is not None  # every estimate adjusts at least once
    return BlockComponents(
        grouping,
        variances,
        _sigmas(problem, layout, variances),
        evaluate(*last, progress=progress),
    )


def _layout(problem: Problem, grouping: Grouping, operators: Mapping[str, str] | None) -> _Layout:
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
        ("prior positions", problem.position_sigma),
        ("prior rotations", problem.rotation_sigma),
        ("prior parameters", problem.additional_sigma),
    ):
        observed = bool(np.isfinite(sigma).any())
        rest.append(len(names) if observed else None)
        if observed:
            names.append(name)
    return _Layout(tuple(names), image, *rest)


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


def _weighted(problem: Problem, layout: _Layout, scale: Array) -> Problem:
    """Return the problem with the standard deviations of every group scaled."""
    factor = scale[layout.image]
    if problem.axis_factor is not None:
        factor = factor * problem.axis_factor
    control, position, rotation, additional = (
        1.0 if group is None else float(scale[group]) for group in layout[2:]
    )
    return replace(
        problem,
        axis_factor=factor,
        known_sigma=problem.known_sigma * control,
        position_sigma=problem.position_sigma * position,
        rotation_sigma=problem.rotation_sigma * rotation,
        additional_sigma=problem.additional_sigma * additional,
    )


def _summed(layout: _Layout, image: Array, *rest: tuple[Array, ...]) -> Array:
    """Return sums per group of images, control, positions, rotations and parameters."""
    out = np.bincount(layout.image.ravel(), weights=image.ravel(), minlength=len(layout.names))
    for group, parts in zip(layout[2:], rest, strict=True):
        if group is not None:
            out[group] = sum(float(np.nansum(part)) for part in parts)
    return np.asarray(out, dtype=float)


def _squares(linear: Linearised, layout: _Layout) -> Array:
    photos = linear.photo_e**2
    return _summed(
        layout,
        linear.e**2,
        (linear.point_e**2,),
        (photos[:, :3],),
        (photos[:, 3:],),
        (linear.own_e**2, linear.shared_e**2),
    )


def _redundancies(cofactors: Cofactors, layout: _Layout) -> Array:
    r_photo = cofactors.r_photo
    return _summed(
        layout,
        cofactors.r,
        (cofactors.r_control,),
        (r_photo[:, :3],),
        (r_photo[:, 3:],),
        (cofactors.r_own, cofactors.r_shared),
    )


def _counts(problem: Problem, layout: _Layout) -> list[int]:
    used = np.ones(layout.image.shape) if problem.rejected is None else ~problem.rejected * 1.0
    counts = np.bincount(layout.image.ravel(), weights=used.ravel(), minlength=len(layout.names))
    for group, sigma in (
        (layout.control, problem.known_sigma),
        (layout.position, problem.position_sigma),
        (layout.rotation, problem.rotation_sigma),
    ):
        if group is not None:
            counts[group] = int(np.isfinite(sigma).sum())
    if layout.additional is not None:
        counts[layout.additional] = len(problem.additional_groups) * len(problem.additional_sigma)
    return [int(count) for count in counts.tolist()]


def _sigmas(
    problem: Problem, layout: _Layout, variances: VarianceComponents
) -> tuple[ComponentSigma | None, ...]:
    out: list[ComponentSigma | None] = []
    for group, component in enumerate(variances.components):
        unit: Literal["um", "m"] = "um"
        if group in (layout.rotation, layout.additional):
            out.append(None)  # an angle, or a different unit for each parameter
            continue
        if group in (layout.control, layout.position):
            values = problem.known_sigma if group == layout.control else problem.position_sigma
            values, unit = values[np.isfinite(values)], "m"
        else:
            values = problem.sigma_xy[layout.image == group] * 1e3
        if values.size == 0 or float(values.max()) > (1.0 + 1e-9) * float(values.min()):
            out.append(None)
            continue
        sigma = float(values[0])
        out.append(ComponentSigma(sigma, sigma * component.sigma_factor, unit))
    return tuple(out)
