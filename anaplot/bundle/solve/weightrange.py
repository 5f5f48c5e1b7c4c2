"""Standard deviations that have a weight: its square and that of its inverse are numbers."""

from __future__ import annotations

from anaplot.errors import InputError

__all__ = ["check_weighted"]

_SMALLEST, _LARGEST = 1e-150, 1e150


def check_weighted(what: str, sigma: float) -> None:
    """Refuse a standard deviation that weighs nothing, or more than any number.

    Parameters
    ----------
    what
        Whose it is, for the message.
    sigma
        In the unit in which it is observed.

    Raises
    ------
    InputError
        It lies outside 1e-150 to 1e+150: the observation would count in the redundancy and be none.
    """
    if not _SMALLEST <= sigma <= _LARGEST:
        size = "small" if sigma < _SMALLEST else "large"
        raise InputError(
            f"{what}: the sigma {sigma:g} is too {size} for a weight "
            f"({_SMALLEST:g} to {_LARGEST:g})"
        )
