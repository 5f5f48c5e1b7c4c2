"""What the console keeps from one start to the next: the theme, and that it was started before."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from anaplot.errors import InputError
from anaplot.textfiles.kinds import Text
from anaplot.textfiles.tomltable import read_toml
from anaplot.textfiles.tomltext import toml_text
from anaplot.textfiles.wholefile import make_folder, replace_whole

__all__ = ["Kept"]

_LARGEST = 64 * 1024


@dataclass(frozen=True, slots=True)
class Kept:
    """The file console.toml beside the keymap.

    What cannot be read is as nothing, what cannot be written is not kept: it is no fault.

    Attributes
    ----------
    path
        The file.
    """

    path: Path

    @property
    def first(self) -> bool:
        """Whether the console was not started before."""
        return not self.path.exists()

    def theme(self) -> str:
        """Return the name of the theme chosen last, or ""."""
        try:
            table = read_toml(self.path, _LARGEST)
            return str(table.take({}, {"theme": Text()}).get("theme", ""))
        except (InputError, OSError):
            return ""

    def keep(self, theme: str) -> None:
        """Keep a theme."""
        with contextlib.suppress(InputError, OSError):
            make_folder(self.path.parent)
            replace_whole(self.path, f"theme = {toml_text(theme)}\n".encode())
