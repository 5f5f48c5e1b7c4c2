"""Modules of others that SciPy takes with it, and nobody asks for: loaded when they are used.

The first import of SciPy copies every name of NumPy, and with that loads its compiler of Fortran,
its tests and its polynomials: a quarter of what NumPy and SciPy take together. Here each of these
names stands for its module, and imports it when something in it is looked up. Only the name waits:
the module itself is imported as every other one is, so threads, failures and children of a package
are Python's own.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Collection, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from importlib.abc import Loader

__all__ = ["UNASKED", "load_on_demand"]

UNASKED = frozenset(
    f"numpy.{name}"
    for name in ["char", "core", "ctypeslib", "f2py", "polynomial", "rec", "strings", "testing"]
)
"""Full names of the modules."""


class _Standing(ModuleType):
    """Stands in a package for a module of it, until that is imported, and answers from it."""

    def __getattr__(self, name: str) -> Any:
        try:
            module = importlib.import_module(self.__name__)
        except ImportError as error:
            # Python asks for such names by itself, and takes no other error for a no
            if name.startswith("__") and name.endswith("__"):
                raise AttributeError(f"{self.__name__} has no {name}: {error}") from error
            raise
        return getattr(module, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(importlib.import_module(self.__name__), name, value)

    def __delattr__(self, name: str) -> None:
        delattr(importlib.import_module(self.__name__), name)

    def __dir__(self) -> list[str]:
        return dir(importlib.import_module(self.__name__))

    def __repr__(self) -> str:
        return f"<module {self.__name__!r}, imported when it is used>"


class _WithNames:
    """Loads a package, and lets names in it stand for modules that it has not loaded itself.

    Parameters
    ----------
    loader
        Loads the package.
    names
        The modules' full names.
    """

    def __init__(self, loader: Loader, names: Collection[str]) -> None:
        self._loader = loader
        self._names = names

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Return what its own loader makes."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Run it; to all others its loader is its own one."""
        spec = module.__spec__
        assert spec is not None
        spec.loader = module.__loader__ = self._loader
        self._loader.exec_module(module)
        for name in self._names:
            vars(module).setdefault(name.rpartition(".")[2], _Standing(name))


class _OnDemand:
    """Finds packages before everybody else, where modules in them are to wait.

    Parameters
    ----------
    names
        The modules' full names.
    """

    def __init__(self, names: Collection[str]) -> None:
        self._names: dict[str, list[str]] = {}
        for name in sorted(names):
            self._names.setdefault(name.rpartition(".")[0], []).append(name)

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how one of them is loaded, None for any other."""
        if name not in self._names:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = cast("Loader", _WithNames(spec.loader, self._names[name]))
        return spec


def load_on_demand(names: Collection[str] = UNASKED) -> None:
    """Load them when they are used; for a process that is the program, before it loads others."""
    sys.meta_path.insert(0, _OnDemand(names))
