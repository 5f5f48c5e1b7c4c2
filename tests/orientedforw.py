"""Which models the log orients to say w."""

from __future__ import annotations

import pytest

from anaplot.session import changes
from anaplot.session.models import solve_behind

__all__ = ["models_of_w"]


def models_of_w(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list that gets the name of each model that is oriented for a w from now on."""
    asked: list[str] = []

    def counted(block, before, model):
        asked.append(model.name)
        return solve_behind(block, before, model)

    monkeypatch.setattr(changes, "solve_behind", counted)
    return asked
