"""The settings of a search for gross errors that a block's test and a command's options make."""

from __future__ import annotations

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.adjustment.strategies import sigma_of
from anaplot.photogrammetry.block import TestSettings

__all__ = ["search_settings", "sigma0_in_words"]

_SIGMA0 = {"tau": "estimated", "baarda": "a-priori"}


def sigma0_in_words(strategy: str) -> str:
    """Return by which sigma0 a strategy tests and weighs its odds."""
    return _SIGMA0[sigma_of(strategy)]


def search_settings(
    test: TestSettings, partner: float | None = None, *, pairs: bool = False
) -> SearchSettings:
    """Return settings with the alpha and power of a block's test.

    Parameters
    ----------
    test
        Settings of the block.
    partner
        Residual correlation from which two rows are hard to tell apart; None: the default.
    pairs
        Whether the odds over pairs of gross errors are computed.
    """
    return SearchSettings(
        alpha=test.alpha,
        power=test.power,
        partner=HARD_TO_TELL if partner is None else partner,
        pairs=pairs,
    )
