"""Modules of others that SciPy has loaded with it, and nobody asks for: loaded when they are used.

The first import of SciPy copies every name of NumPy, and with that loads its compiler of Fortran
and its tests: a fifth of what NumPy and SciPy take together. Here each of them is a module that is
found at once, and runs when something in it is looked up. With `importlib.util.LazyLoader` a second
thread that looks sees the module half run, before Python 3.12.3; here it waits.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from threading import RLock
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from importlib.abc import Loader

__all__ = ["UNASKED", "load_on_demand"]

UNASKED = frozenset({"numpy.ctypeslib", "numpy.f2py", "numpy.testing"})
"""Full names of the modules."""


class _NotYetRun(ModuleType):
    """A module that runs when something in it is looked up."""

    def __getattribute__(self, name: str) -> Any:
        _run(self)
        return ModuleType.__getattribute__(self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        _run(self)
        ModuleType.__setattr__(self, name, value)

    def __delattr__(self, name: str) -> None:
        _run(self)
        ModuleType.__delattr__(self, name)


class _WhenUsed:
    """Loads a module later, once, in the first thread that looks; what it looks up itself is there.

    Parameters
    ----------
    loader
        Loads it then.
    """

    def __init__(self, loader: Loader) -> None:
        self._loader = loader
        self._turn = RLock()
        self._running = False

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Return what its own loader makes."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Let it wait; to all others its loader is its own one."""
        spec = module.__spec__
        assert spec is not None
        spec.loader = module.__loader__ = self._loader
        spec.loader_state = self
        module.__class__ = _NotYetRun

    def run(self, module: ModuleType) -> None:
        """Run it, where that is not done or being done by this thread; wait while another does."""
        with self._turn:
            if type(module) is not _NotYetRun or self._running:
                return
            self._running = True
            try:
                self._loader.exec_module(module)
                ModuleType.__setattr__(module, "__class__", ModuleType)
            finally:
                self._running = False


def _run(module: ModuleType) -> None:
    state = ModuleType.__getattribute__(module, "__spec__").loader_state
    state.run(module)


class _OnDemand:
    """Finds some modules before everybody else.

    Parameters
    ----------
    names
        Their full names.
    """

    def __init__(self, names: Collection[str]) -> None:
        self._names = names

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how one of them is loaded, None for any other."""
        if name not in self._names:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = cast("Loader", _WhenUsed(spec.loader))
        return spec


def load_on_demand(names: Collection[str] = UNASKED) -> None:
    """Load them from now on when they are used; for a process that is the program, no library."""
    sys.meta_path.insert(0, _OnDemand(names))
