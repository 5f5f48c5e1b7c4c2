from __future__ import annotations

import pytest
from sessionscene import Scene


@pytest.fixture(scope="session")
def scene() -> Scene:
    return Scene()
