"""What an adjusted block leaves to the next one: coordinates and their full covariance."""

from __future__ import annotations

from collections.abc import Sequence

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.covariances import unknown_cofactors
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.unknownnames import unknowns_meant
from anaplot.bundle.solve.unknowns import unknown_values
from anaplot.errors import InputError
from anaplot.photogrammetry.posterior import MOST_COORDINATES, CoordinateName, Posterior

__all__ = ["coordinates_meant", "posterior_names", "posterior_of"]


def posterior_names(block: AdjustedBlock, wanted: Sequence[str]) -> tuple[CoordinateName, ...]:
    """Return the coordinates of an adjusted block that are meant, as `coordinates_meant` has it."""
    return coordinates_meant(block.problem, wanted)


def coordinates_meant(problem: Problem, wanted: Sequence[str]) -> tuple[CoordinateName, ...]:
    """Return the coordinates that are meant.

    Parameters
    ----------
    problem
        The bundle.
    wanted
        "points" and "photos" for all of them, or names of either; "point:NAME" and "photo:NAME"
        where a name is both, or one of these words. See `unknowns_meant`.

    Raises
    ------
    InputError
        A name that the block does not have, or two of a point and a photo; too many.
    """
    meant = unknowns_meant(problem, wanted, "--posterior-of")
    names = tuple(name for name in meant if isinstance(name, CoordinateName))
    if len(names) < len(meant):
        raise InputError("--posterior-of: points and photos; additional parameters are not carried")
    if len(names) > MOST_COORDINATES:
        raise InputError(
            f"--posterior: {len(names)} coordinates with each other: at most {MOST_COORDINATES}; "
            "choose with --posterior-of"
        )
    return names


def posterior_of(block: AdjustedBlock, wanted: Sequence[str] = ("points",)) -> Posterior:
    """Return coordinates and their covariance, the state X1, C1 of the Bayesian paper's Figure 1.

    Parameters
    ----------
    block
        The adjusted block; its datum is that of control and priors.
    wanted
        As `coordinates_meant` has it.

    Returns
    -------
    Posterior
        Metres and radians, C for the a-priori sigma0; zeros where a coordinate is free of error.

    Raises
    ------
    InputError
        The datum is another one: coordinates of a free network are known in it alone.
    """
    problem = block.problem
    if problem.datum != "control":
        raise InputError(
            "--posterior goes with the datum of control: in another one C is that of the datum"
        )
    names = posterior_names(block, wanted)
    return Posterior(
        names,
        unknown_values(block, names),
        unknown_cofactors(block, names),
        f"the posterior of {problem.block.name}",
    )
