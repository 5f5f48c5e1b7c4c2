"""The power that smallest detectable deviations refer to, against an asked significance."""

from __future__ import annotations

from pathlib import Path

from anaplot.errors import InputError
from anaplot.photogrammetry.block import TestSettings
from anaplot.textfiles.wording import place

__all__ = ["check_power"]


def check_power(option: str, alpha: float, test: TestSettings, folder: Path) -> None:
    """Refuse a significance that the power of a block's [test] does not exceed.

    Parameters
    ----------
    option, alpha
        The option that asks for the significance, and its value.
    test, folder
        Settings of the block, and where they stand.

    Raises
    ------
    InputError
        Names the option and the file.
    """
    if not alpha < test.power:
        raise InputError(
            f"{option} {alpha:g}: must be less than power = {test.power:g} of [test] in "
            f"{place(folder / 'block.toml')}"
        )
