"""Modules of others that SciPy has loaded with it, and nobody asks for: loaded when they are used.

The first import of SciPy copies every name of NumPy, and with that loads its compiler of Fortran
and its tests: a fifth of what NumPy and SciPy take together. Here each of them is a module that is
found at once, and runs when something in it is looked up (`importlib.util.LazyLoader`).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

__all__ = ["UNASKED", "load_on_demand"]

UNASKED = frozenset({"numpy.ctypeslib", "numpy.f2py", "numpy.testing"})
"""Full names of the modules."""


class _OnDemand:
    """Finds these modules before everybody else."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name not in UNASKED:
            return None
        from importlib.util import LazyLoader

        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def load_on_demand() -> None:
    """Load them from now on when they are used; for a process that is the program, no library."""
    sys.meta_path.insert(0, _OnDemand)
