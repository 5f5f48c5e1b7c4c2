"""The versions that programs ask for; light, everything may import it."""

from __future__ import annotations

__all__ = ["JSON_VERSION", "__version__"]

__version__ = "0.1.0"

JSON_VERSION = 1
"""Of the keys that `--json` and `to_dict()` give; docs/documents.md says when it changes."""
