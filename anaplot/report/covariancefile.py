"""A covariance in a file of numpy's: `adjust --covariance-to`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anaplot.bundle.solve.covariances import Covariance
from anaplot.report.npzfile import write_arrays

__all__ = ["write_covariance"]


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
    write_arrays(
        path,
        "--covariance-to",
        names=[name.text for name in covariance.names],
        units=covariance.units,
        x=covariance.values,
        covariance=covariance.matrix,
        factor=np.nan if covariance.sigma is None else covariance.sigma,
    )
