"""Arrays in a file of numpy's that a command was asked to write."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from anaplot.errors import InputError
from anaplot.textfiles.wholefile import replace_whole
from anaplot.textfiles.wording import place

__all__ = ["check_npz_path", "write_arrays"]


def write_arrays(path: Path, option: str, **arrays: ArrayLike) -> None:
    """Write arrays by their names, wholly or not at all.

    Parameters
    ----------
    path
        Of the file, `.npz`; one that exists is replaced.
    option
        Which asked for it.
    arrays
        What is written.

    Raises
    ------
    InputError
        The name ends otherwise, or the file cannot be written.
    """
    check_npz_path(path, option)
    data = io.BytesIO()
    named: dict[str, Any] = arrays  # numpy's stubs take each for its `allow_pickle`
    np.savez(data, **named)
    replace_whole(path, data.getvalue())


def check_npz_path(path: Path, option: str) -> None:
    """Refuse to write into a file that is called otherwise: it may be one of another kind."""
    if path.suffix != ".npz":
        raise InputError(f"{place(path)}: {option} writes a file that ends in .npz")
