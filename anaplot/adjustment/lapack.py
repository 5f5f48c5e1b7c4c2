"""LAPACK's routines as SciPy has them, loaded with the first that is used.

For systems of a model's size: NumPy's wrappers cost more than what they call, and an import in a
function as much as the routine itself. scipy.linalg costs more than the rest of a start.
"""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(name)
    import scipy.linalg.lapack

    routine = globals()[name] = getattr(scipy.linalg.lapack, name)
    return routine
