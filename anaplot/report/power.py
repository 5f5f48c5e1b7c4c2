"""The power that smallest detectable deviations refer to, against an asked significance."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.photogrammetry.block import TestSettings

__all__ = ["check_power"]


def check_power(option: str, alpha: float, test: TestSettings, where: str) -> None:
    """Refuse a significance that the power of a block's [test] does not exceed.

    Parameters
    ----------
    option, alpha
        The option that asks for the significance, and its value.
    test, where
        Settings of the block, and how messages name where they stand.

    Raises
    ------
    InputError
        Names the option and the place.
    """
    if not alpha < test.power:
        raise InputError(
            f"{option} {alpha:g}: must be less than power = {test.power:g} of [test] in {where}"
        )
