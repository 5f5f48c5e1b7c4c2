"""What tests need of the extras: skipped where it is missing, an error where it has to be there."""

from __future__ import annotations

import importlib
import os
from typing import Any

import pytest


def needed(module: str, extra: str) -> Any:
    """Import a module of an extra.

    Where the environment sets `ANAPLOT_EXTRAS`, as `.ci/run` does, its absence is an error.
    """
    if os.environ.get("ANAPLOT_EXTRAS"):
        return importlib.import_module(module)
    return pytest.importorskip(module, reason=f"the extra {extra} is not installed")
