"""The demonstration: a simulated strip with planted mistakes, and what became of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import write_new_block
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import TestSettings
from anaplot.planning.modelplan import Candidates
from anaplot.planning.synthetic import SyntheticStrip, synthetic_strip
from anaplot.planning.syntheticcamera import with_calibration
from anaplot.simulation.automatic import AutomaticOperator, ModelRecord
from anaplot.simulation.instrument import SimulationSetup
from anaplot.simulation.laidplates import Placements, random_placements
from anaplot.simulation.mistakes import Planted, Plot, plant_mistakes
from anaplot.simulation.stages import Handled, Stage, stage_found
from anaplot.simulation.wrongfiducial import plant_wrong_fiducial
from anaplot.station.station import DEFAULT_PATTERN, Station

__all__ = ["DEFAULT_MODELS", "DEFAULT_SEED", "Demo", "Outcome", "judge", "rough", "run_demo"]

DEFAULT_MODELS = 4
DEFAULT_SEED = 1
TIME_SCALE = 1000.0


def rough(truth: Candidates) -> Candidates:
    """Return truth rounded to 0.1 mm: where marked points lie, as a person reads it off."""
    return {
        photo: {point: (round(x, 1), round(y, 1)) for point, (x, y) in points.items()}
        for photo, points in truth.items()
    }


@dataclass(frozen=True, slots=True)
class Demo:
    """A simulated strip, the mistakes to come, and the station's setup for it.

    Attributes
    ----------
    seed
        Of everything that is drawn.
    strip
        The strip and its truth.
    plot
        The mistakes.
    candidates
        Approximate positions of the marked points.
    placements
        How the photographs lie in the carriages; none without fiducials.
    """

    seed: int
    strip: SyntheticStrip
    plot: Plot
    candidates: Candidates
    placements: Placements = field(default_factory=dict)

    @classmethod
    def make(
        cls, models: int = DEFAULT_MODELS, seed: int = DEFAULT_SEED, *, fiducials: bool = False
    ) -> Demo:
        """Make a strip of so many models, with its mistakes.

        Parameters
        ----------
        models, seed
            Length of the strip, and seed of everything that is drawn.
        fiducials
            Whether the camera has fiducials and distortion, the photographs lie shifted, turned
            and shrunk in their carriages, and one fiducial is missed. All else stays the same.
        """
        # the simulated operator's precision is known, so the a-priori sigma0 tests
        strip = synthetic_strip(models + 1, seed=seed, test=TestSettings(kind="baarda"))
        candidates = rough(strip.truth)
        plot = plant_mistakes(strip.block, strip.truth, candidates, pattern(DEFAULT_PATTERN), seed)
        if not fiducials:
            return cls(seed, strip, plot, candidates)
        cameras = tuple(with_calibration(camera) for camera in strip.block.cameras)
        block = replace(strip.block, cameras=cameras)
        wrong, offsets = plant_wrong_fiducial(block, seed)
        # before the points of its model, as it is made
        order = [f"{left}/{right}" for left, right in block.strips[0].models()]
        planted = sorted((wrong, *plot.planted), key=lambda p: order.index(p.model))
        plot = Plot(tuple(planted), {**plot.offsets, **offsets})
        placements = random_placements(block, seed)
        return cls(seed, replace(strip, block=block), plot, candidates, placements)

    def write(self, folder: Path) -> None:
        """Write the block folder: block.toml and its camera file, nothing measured."""
        write_new_block(folder, self.strip.block)

    def simulation(self, time_scale: float = 1.0) -> SimulationSetup:
        """Return the setup of the simulated plotter."""
        return SimulationSetup(
            self.strip.truth,
            seed=self.seed,
            noise_um=self.strip.block.precision.image_um,
            mistakes=self.plot.offsets,
            time_scale=time_scale,
            placements=self.placements,
        )

    def open(self, folder: Path, time_scale: float = 1.0) -> Station:
        """Open a station on the folder, with the simulated plotter."""
        return Station(
            folder,
            plotter=self.simulation(time_scale),
            operator="simulated",
            candidates=self.candidates,
        )


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of the mistakes.

    Attributes
    ----------
    planted
        All of them.
    found
        Those whose point was taken for wrong: in their own model, or where they were to show.
    repaired
        Those of them that were measured again in their own model.
    missed
        Detectable ones that were not found.
    false_flags
        Rows taken for wrong that were not: entries like the planted ones, of size 0.
    models
        Tables before and after, and what was done, model by model.
    stages
        Of those found: at which stage.
    """

    planted: tuple[Planted, ...]
    found: tuple[Planted, ...]
    repaired: tuple[Planted, ...]
    missed: tuple[Planted, ...]
    false_flags: tuple[Planted, ...]
    models: tuple[ModelRecord, ...]
    stages: Mapping[Planted, Stage] = field(default_factory=dict)


def judge(planted: tuple[Planted, ...], operator: AutomaticOperator) -> Outcome:
    """Compare what was planted with what the operator did."""
    handled, models = operator.handled, operator.records
    stages = {p: stage for p in planted if (stage := stage_found(p, handled)) is not None}
    touched = {(h.model, h.point, h.photo) for h in handled}
    again = {(h.model, h.point, h.photo) for h in handled if h.action == "measured again"}
    own = tuple(p for p in planted if (p.model, *_what(p)) in touched)
    later = tuple(p for p in planted if p not in own and (p.shows_in, *_what(p)) in touched)
    guilty = {(where, *_what(p)) for p in planted for where in (p.model, p.shows_in)}
    false_flags = dict.fromkeys(
        _innocent(h) for h in handled if (h.model, h.point, h.photo) not in guilty
    )
    return Outcome(
        planted=planted,
        found=tuple(p for p in planted if p in own or p in later),
        repaired=tuple(p for p in own if (p.model, *_what(p)) in again),
        missed=tuple(p for p in planted if p.detectable and p not in own),
        false_flags=tuple(false_flags),
        models=models,
        stages=stages,
    )


def _what(planted: Planted) -> tuple[str, str]:
    """Return the point, and the photo where it is a fiducial: as `Handled` names them."""
    return planted.point, planted.photo if planted.kind == "wrong fiducial" else ""


def _innocent(h: Handled) -> Planted:
    photo = h.photo or h.model.split("/")[1]
    return Planted(h.model, h.point, photo, h.axis or "y", 0.0, "none", False, None)


def run_demo(
    demo: Demo,
    folder: Path,
    time_scale: float = TIME_SCALE,
    on_accepted: Callable[[ModelRecord], None] | None = None,
) -> Outcome:
    """Have the automatic operator measure the whole strip.

    Parameters
    ----------
    demo
        The strip and its mistakes.
    folder
        The block folder, already written.
    time_scale
        Simulated seconds per second.
    on_accepted
        Called with each model when it is accepted.

    Raises
    ------
    LinkError, InputError, NotComputableError
        The job could not be finished.
    """
    with demo.open(folder, time_scale) as station:
        operator = AutomaticOperator(station, on_accepted)
        operator.run()
        if not station.points_written:
            raise InputError(
                f"{folder}: image_points.csv could not be written; the measurements are safe in "
                "the journal"
            )
        return judge(demo.plot.planted, operator)
