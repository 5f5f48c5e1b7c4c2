"""A bench whose camera has fiducials, and an operator who does inner orientations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stationbench import Bench, Watch, settled

from anaplot.photogrammetry.block import TestSettings
from anaplot.planning.synthetic import synthetic_strip
from anaplot.planning.syntheticcamera import with_calibration
from anaplot.station.snapshot import InnerView
from anaplot.station.station import Station

__all__ = ["inner_bench_in", "inner_of", "measure_fiducial", "measure_fiducials", "orient"]


def inner_bench_in(folder: Path) -> Bench:
    made = synthetic_strip(4, seed=11, image_um=3.0)
    # noise alone is never flagged: the tests know their mistakes
    test = TestSettings(kind="baarda", alpha=1e-7)
    cameras = tuple(with_calibration(camera) for camera in made.block.cameras)
    return Bench(folder, replace(made, block=replace(made.block, test=test, cameras=cameras)))


def inner_of(station: Station) -> InnerView:
    """The inner orientation in work."""
    inner = station.snapshot().inner
    assert inner is not None
    return inner


def times(station: Station, fiducial: str) -> int:
    return next(f.times for f in inner_of(station).fiducials if f.fiducial == fiducial)


def measure_fiducial(station: Station, watch: Watch, fiducial: str) -> None:
    """Drive to a fiducial and record it with the key, as the console does."""
    before = times(station, fiducial)
    if station.snapshot().target != fiducial:
        station.drive(fiducial)
    settled(watch)
    station.record()
    watch.until(lambda _: times(station, fiducial) > before)


def measure_fiducials(station: Station, watch: Watch) -> None:
    """Measure what is pending of the inner orientation in work."""
    for fiducial in [f.fiducial for f in inner_of(station).fiducials if f.status == "pending"]:
        measure_fiducial(station, watch, fiducial)


def orient(station: Station, watch: Watch) -> None:
    """Do the inner orientations of the current model."""
    while station.snapshot().inner is not None:
        measure_fiducials(station, watch)
        station.accept()
