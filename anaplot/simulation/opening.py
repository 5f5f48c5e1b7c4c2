"""Opening a station as the operator asks for it: with an instrument, simulated, or to look on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block
from anaplot.exchange.patternfile import is_pattern_file, read_pattern
from anaplot.orientation.ownpattern import PointPattern
from anaplot.orientation.patterns import pattern
from anaplot.photogrammetry.block import Block
from anaplot.plotter.profile import load_profile
from anaplot.station.instrument import InstrumentSetup
from anaplot.station.pointpattern import pattern_of_block, point_pattern_of
from anaplot.station.pointsfile import BlockRead
from anaplot.station.station import DEFAULT_PATTERN, Station
from anaplot.textfiles.wording import place

# what simulates is loaded where a plotter is simulated
if TYPE_CHECKING:
    from anaplot.planning.synthetic import Truth
    from anaplot.plotter.device.hand import Photographs

__all__ = ["check_options", "open_station", "plates_in", "truth_of"]


def _at_once() -> None:
    """Wait for nothing."""


def check_options(
    *,
    profile: str | None = None,
    port: str | None = None,
    simulate: bool = False,
    truth: Path | None = None,
    point_pattern: str | None = None,
) -> None:
    """Refuse options that no block makes right; `open_station` says what they are.

    Raises
    ------
    InputError
        Options that contradict each other, a profile or point pattern that does not exist.
    """
    if simulate and port is not None:
        raise InputError("--simulate and an instrument's --port exclude each other")
    if truth is not None and not simulate:
        raise InputError("--truth goes with --simulate")
    if profile is not None:
        if port is None and not simulate:
            raise InputError("an instrument needs both --profile and --port")
        load_profile(profile)
    if point_pattern is not None:
        if is_pattern_file(point_pattern):
            read_pattern(Path(point_pattern))
        else:
            pattern(point_pattern)


def open_station(
    folder: Path,
    *,
    profile: str | None = None,
    port: str | None = None,
    simulate: bool = False,
    truth: Path | None = None,
    seed: int = 0,
    point_pattern: str | None = None,
    operator: str = "",
    story: str = "",
    time_scale: float = 1.0,
    ready: Callable[[], None] = _at_once,
) -> Station:
    """Open a station on a block folder.

    Parameters
    ----------
    folder
        The block folder.
    profile, port
        Of an instrument; both or neither.
    simulate
        Connect a simulated plotter instead, one that speaks `profile` where that is given. It is
        never chosen silently.
    truth
        Folder of the block whose image points lie in the simulated plates; without it a
        synthetic flight over the block's strips. Where the cameras have fiducials, the plates
        lie shifted, turned and shrunk.
    seed
        Of the simulation.
    point_pattern
        The point pattern of new models, its name or its file; None for the block's, or the usual
        one.
    operator, story
        Name for the journal, and what the session is about.
    time_scale
        Simulated seconds per second.
    ready
        Called when options and block are found right, before an instrument or the journal is
        touched; what it raises leaves everything as it is.

    Raises
    ------
    InputError
        Options that contradict each other, a wrong block, truth that lacks a photo.
    LinkError
        The plotter cannot be reached.
    """
    check_options(
        profile=profile, port=port, simulate=simulate, truth=truth, point_pattern=point_pattern
    )
    read = BlockRead.of(folder)
    block = read.block
    if not block.strips:
        raise InputError(
            f"{place(folder / 'block.toml')}: no strip: at least one [[strip]] is needed to measure"
        )
    if point_pattern is None:
        chosen = pattern_of_block(folder, block, DEFAULT_PATTERN)
    else:
        chosen = point_pattern_of(point_pattern, folder, block)
    if port is not None and profile is None:
        profile = block.measuring.profile
    if not simulate and (profile is None) != (port is None):
        raise InputError("an instrument needs both --profile and --port")
    if not simulate:
        plotter = InstrumentSetup(profile, port) if profile and port else None
        ready()
        return Station(
            folder,
            plotter=plotter,
            point_pattern=chosen,
            operator=operator,
            story=story,
            read=read,
        )
    from anaplot.simulation.demo import rough
    from anaplot.simulation.instrument import PROFILE_OF_SIMULATION, SimulationSetup
    from anaplot.simulation.laidplates import random_placements

    points = _synthetic(block, seed, chosen) if truth is None else _measured(block, truth)
    ready()
    return Station(
        folder,
        plotter=SimulationSetup(
            points,
            seed=seed,
            noise_um=block.precision.image_um,
            time_scale=time_scale,
            placements=random_placements(block, seed),
            profile=PROFILE_OF_SIMULATION if profile is None else profile,
        ),
        point_pattern=chosen,
        operator=operator,
        story=story,
        candidates=rough(points),
        read=read,
    )


def truth_of(folder: Path) -> Truth:
    """Return a block's image points as the truth of simulated plates: the first row of each.

    Raises
    ------
    InputError
        The block is wrong or has no image points.
    """
    points: dict[str, dict[str, tuple[float, float]]] = {}
    for row in read_block(folder).image_points:
        points.setdefault(row.photo, {}).setdefault(row.point, (row.x, row.y))
    if not points:
        raise InputError(f"{folder}: image_points.csv has no points")
    return points


def plates_in(folder: Path, seed: int) -> tuple[Photographs, Photographs]:
    """Return a block's photographs as they lie in a left and in a right carriage.

    Where the cameras have fiducials, the photographs hold them and lie shifted, turned and shrunk.

    Raises
    ------
    InputError
        As `truth_of`, or fiducials whose place is not known.
    """
    from anaplot.simulation.laidplates import laid_photographs, random_placements

    block = read_block(folder)
    return laid_photographs(block, truth_of(folder), random_placements(block, seed))


def _measured(block: Block, truth: Path) -> Truth:
    points = truth_of(truth)
    for strip in block.strips:
        for photo in strip.photos:
            if photo not in points:
                raise InputError(
                    f"{truth}: image_points.csv has no point of photo {photo} (strip {strip.id})"
                )
    return points


def _synthetic(block: Block, seed: int, chosen: PointPattern) -> Truth:
    """Return a strip's photographs, or those of strips side by side with points in common.

    They hold what the point pattern asks for, beside the standard points.
    Strips of different cameras are flown each alone.
    """
    from anaplot.planning.synthetic import synthetic_truth
    from anaplot.planning.syntheticblock import synthetic_plates
    from anaplot.planning.syntheticcamera import usual_format

    first = block.strips[0]
    camera = block.camera_of(first.photos[0])
    photos = [photo for strip in block.strips for photo in strip.photos]
    alike = all(block.camera_of(photo) == camera for photo in photos)
    if len(block.strips) > 1 and alike and len(set(photos)) == len(photos):
        base = first.base or 0.4 * usual_format(camera)[0]
        return synthetic_plates(
            [s.photos for s in block.strips], camera, seed=seed, base=base, wanted=chosen
        )
    points: dict[str, dict[str, tuple[float, float]]] = {}
    for k, strip in enumerate(block.strips):
        camera = block.camera_of(strip.photos[0])
        made, _, _ = synthetic_truth(
            strip.photos,
            camera,
            seed=seed + k,
            base=strip.base or 0.4 * usual_format(camera)[0],
            wanted=chosen,
        )
        for photo, xy in made.items():
            points.setdefault(photo, {}).update(xy)
    return points
