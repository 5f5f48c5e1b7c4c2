"""What is known of additional parameters beforehand: an a-priori calibration (Gruen 1978, eq. 1).

Every value with a standard deviation is an observation, e^Z = I dz - l^Z with the weight P_Z; a
value without one is what the parameter is tested against, H0: dz = dz' (eq. 34).
"""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from typing import NamedTuple

from anaplot.bundle.solve.weightrange import check_weighted
from anaplot.errors import InputError
from anaplot.textfiles.wording import quoted

__all__ = ["ParameterPrior", "checked_priors", "parameter_priors"]


class ParameterPrior(NamedTuple):
    """What is known of one additional parameter.

    Attributes
    ----------
    parameter
        Its name.
    value
        [um] of effect in the image, as the table of parameters has it; of a lens its coefficient,
        c, x0 and y0 in mm.
    sigma
        Standard deviation in the unit of the value; 0: held at the value, None: no weight, whatever
        is said of all, the value is only what the parameter is tested against.
    group
        Camera, strip or photo that it belongs to; None: all.
    """

    parameter: str
    value: float
    sigma: float | None
    group: str | None = None


def parameter_priors(text: str) -> tuple[ParameterPrior, ...]:
    """Return what "b1=12+-3,b2=0+-1.5,b3=4" says: value and sigma, or the value alone.

    Raises
    ------
    InputError
        Not of this form, or numbers that are none.
    """
    return tuple(_prior(part.strip()) for part in text.split(","))


def _prior(text: str) -> ParameterPrior:
    name, equals, known = text.partition("=")
    value, given, sigma = known.partition("+-")
    try:
        prior = ParameterPrior(name.strip(), float(value), float(sigma) if given else None)
    except ValueError:
        prior = None
    if prior is None or not equals or not prior.parameter or not _numbers(prior):
        raise InputError(
            f"a prior {quoted(text)}: written as b1=12+-3 (value and sigma, 0 or larger) or b1=12"
        )
    return prior


def _numbers(prior: ParameterPrior) -> bool:
    sigma = prior.sigma
    return isfinite(prior.value) and (sigma is None or 0.0 <= sigma < float("inf"))


def checked_priors(priors: Iterable[ParameterPrior]) -> tuple[ParameterPrior, ...]:
    """Return priors that name every parameter of a group once.

    Raises
    ------
    InputError
        A parameter of a group stands twice, numbers are none, or a sigma has no weight.
    """
    out = tuple(priors)
    seen = set()
    for prior in out:
        whose = "" if prior.group is None else f" of {quoted(prior.group)}"
        about = f"the prior of {quoted(prior.parameter)}{whose}"
        if not _numbers(prior):
            raise InputError(f"{about}: value and sigma must be finite, the sigma not negative")
        if prior.sigma:  # neither held nor without a weight
            check_weighted(about, prior.sigma)
        key = prior.parameter, prior.group
        if key in seen:
            raise InputError(f"{about} stands twice")
        seen.add(key)
    return out
