from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from processes import nothing_stays
from stationbench import Bench

from anaplot.photogrammetry.block import TestSettings
from anaplot.planning.synthetic import synthetic_strip
from anaplot.station.blockwatch import BlockWatch


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """No descriptor and no thread may be left when a test is over."""
    with nothing_stays():
        yield


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = synthetic_strip(4, seed=11, image_um=3.0, test=TestSettings(kind="baarda"))
    # significance so small that pure noise is never flagged: the tests below know their mistakes
    block = replace(made.block, test=TestSettings(kind="baarda", alpha=1e-7))
    bench = Bench(tmp_path / "block", replace(made, block=block))
    with bench.stack:
        yield bench


@pytest.fixture
def without_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """The block is not adjusted beside: the automatic operator does not look at it."""
    monkeypatch.setattr(BlockWatch, "tell", lambda *_, **__: None)
