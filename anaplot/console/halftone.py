"""A grey picture as a halftone of braille dots: readable without any colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["TONES", "halftone", "tones"]

TONES = 12
# Bayer's index matrix (1973), 4 x 4: the coarsest pattern that a braille cell shows twice a row
_BAYER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
_THRESHOLDS = (_BAYER + 0.5) / 16.0
_STEEPER = 1.5  # dots show fewer greys than there are: the middle ones are drawn apart


def halftone(grey: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which dots are set, shape as `grey` (0 black to 1 white): a bright dot for white.

    The pattern stands still while the picture moves beneath it.
    """
    rows, columns = grey.shape
    pattern = np.tile(_THRESHOLDS, (-(-rows // 4), -(-columns // 4)))[:rows, :columns]
    return np.asarray(0.5 + _STEEPER * (grey - 0.5) > pattern)


def tones(grey: NDArray[np.float64]) -> NDArray[np.int16]:
    """Return the tone of every braille cell, 0 dark to TONES - 1 light.

    Parameters
    ----------
    grey
        (4 rows, 2 columns), 0 black to 1 white.

    Returns
    -------
    array
        (rows, columns).
    """
    rows, columns = grey.shape[0] // 4, grey.shape[1] // 2
    mean = grey.reshape(rows, 4, columns, 2).mean(axis=(1, 3))
    return np.asarray(np.clip(mean * TONES, 0, TONES - 1), dtype=np.int16)
