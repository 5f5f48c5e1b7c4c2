"""Additional parameters as a command's options name them, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.bundle.solve.additional import (
    AdditionalParameters,
    additional_parameters,
    automatic_sets,
)
from anaplot.bundle.solve.parameterpriors import ParameterPrior, parameter_priors
from anaplot.bundle.solve.problem import Problem
from anaplot.errors import InputError
from anaplot.exchange.parameterpriorscsv import read_parameter_priors
from anaplot.report.document import Line, named, say

__all__ = [
    "Known",
    "Reference",
    "automatic_choice",
    "given_json",
    "held_line",
    "parameters_of",
    "reference_lengths",
    "reference_lines",
]

_ORIGIN = {
    "stated": "as stated",
    "format": "half the format",
    "measured": "the largest coordinate measured",
}

Known = str | Path | Sequence[str | Path]
"""Priors as text, or files of them: one of these, or several."""


def parameters_of(
    name: str | None,
    sigma_um: float | None,
    priors: Known | None,
    reference_mm: float | None,
) -> AdditionalParameters | None:
    """Return the additional parameters that options ask for.

    Parameters
    ----------
    name, sigma_um, priors, reference_mm
        Values of --additional, --additional-sigma-um, --additional-prior and
        --additional-reference-mm.

    Raises
    ------
    InputError
        No such parameters, weights without any, or a prior that is none.
    """
    if name is None:
        if sigma_um is not None:
            raise InputError("--additional-sigma-um goes with --additional")
        if priors:
            raise InputError("--additional-prior goes with --additional")
        if reference_mm is not None:
            raise InputError("--additional-reference-mm goes with --additional")
        return None
    known: list[ParameterPrior] = []
    for one in [priors] if isinstance(priors, str | Path) else priors or ():
        # a file may have any name
        if isinstance(one, str) and "=" in one and not _is_file(one):
            known += parameter_priors(one)
        else:
            known += [ParameterPrior(*row) for row in read_parameter_priors(Path(one))]
    return additional_parameters(name, sigma_um, known, reference_mm)


def _is_file(text: str) -> bool:
    try:
        return Path(text).is_file()
    except OSError:  # longer than a name can be
        return False


def automatic_choice(
    name: str | None,
    sigma_um: float | None,
    priors: Known | None,
    reference_mm: float | None,
) -> tuple[AdditionalParameters, ...]:
    """Return the sets that `--additional auto` tries; none where it is not asked for.

    Raises
    ------
    InputError
        Something else after "auto", or what goes with a named set beside it.
    """
    sets = None if name is None else automatic_sets(name)
    if sets is None:
        return ()
    if sigma_um is not None or priors or reference_mm is not None:
        raise InputError(
            "--additional-sigma-um, --additional-prior and --additional-reference-mm go with a "
            "named set, not with auto"
        )
    return sets


def given_json(additional: AdditionalParameters) -> list[dict[str, object]]:
    """Return what is known beforehand, for programs; values in the units they were given in."""
    return [one._asdict() for one in additional.priors]


class Reference(NamedTuple):
    """The length b of a camera's parameters [mm]: "stated", of the "format" or "measured"."""

    camera: str
    b_mm: float
    origin: str


def reference_lengths(problem: Problem) -> list[Reference]:
    """Return the lengths of the terms x/b, y/b of the cameras that have parameters."""
    additional, lengths = problem.additional, problem.additional_reference
    if additional is None or lengths is None:
        return []
    out = []
    for k in np.unique(problem.cameras[problem.photo]).tolist():
        camera = problem.block.cameras[k]
        origin = "measured" if camera.format is None else "format"
        origin = origin if additional.reference_mm is None else "stated"
        out.append(Reference(camera.id, float(lengths[k]) or 1.0, origin))
    return out


def reference_lines(problem: Problem) -> list[Line]:
    """Return what length the values belong to, and where it comes from."""
    found = reference_lengths(problem)
    alone = len(found) == 1
    return [
        say(
            "  values{} belong to b {:.3f} mm: {}",
            *("" if alone else f" of {one.camera}", one.b_mm, _ORIGIN[one.origin]),
        )
        for one in found
    ]


def held_line(additional: AdditionalParameters) -> Line | None:
    """Return which parameters are held at given values; None: none is."""
    held = [one for one in additional.priors if one.sigma == 0.0]
    if not held:
        return None
    values = [
        say("{} = {:g}", one.parameter if one.group is None else f"{one.parameter} of {one.group}",
            one.value)
        for one in held
    ]  # fmt: skip
    return say("  held at given values: {}", named(values, 12, " ..."))
