"""A covariance in a file of numpy's: `adjust --covariance-to`."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from anaplot.bundle.solve.covariances import Covariance
from anaplot.errors import InputError
from anaplot.textfiles.wholefile import replace_whole
from anaplot.textfiles.wording import place

__all__ = ["check_covariance_path", "write_covariance"]


def write_covariance(path: Path, covariance: Covariance) -> None:
    """Write names, units, x, covariance and factor, wholly or not at all.

    Parameters
    ----------
    path
        Of the file, `.npz`; one that exists is replaced.
    covariance
        What is written: its `matrix`, with the factor (sigma) in it; NaN where there is none.

    Raises
    ------
    InputError
        The name ends otherwise, or the file cannot be written.
    """
    check_covariance_path(path)
    data = io.BytesIO()
    np.savez(
        data,
        names=np.array([name.text for name in covariance.names]),
        units=np.array(covariance.units),
        x=covariance.values,
        covariance=covariance.matrix,
        factor=np.nan if covariance.sigma is None else covariance.sigma,
    )
    replace_whole(path, data.getvalue())


def check_covariance_path(path: Path) -> None:
    """Refuse to write into a file that is called otherwise: it may be one of another kind."""
    if path.suffix != ".npz":
        raise InputError(f"{place(path)}: --covariance-to writes a file that ends in .npz")
