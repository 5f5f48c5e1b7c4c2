"""OpenSfM: reconstruction.json with its tracks.csv, and gcp_list.txt where there is one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.formats.crs import DEGREES, local_system
from anaplot.exchange.formats.door import SOURCE, Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.gcplist import (
    GCP_LIST,
    GcpList,
    elsewhere_note,
    place_control,
    read_gcp_list,
)
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of, kept_names
from anaplot.exchange.formats.opensfmexport import SourceRays, write_cleaned
from anaplot.exchange.formats.opensfmmodel import (
    Reconstruction,
    Shot,
    TrackRow,
    camera_of,
    read_reconstructions,
    read_reference,
    shown_pixels,
    track_rows,
    unheld_model,
)
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.textfiles.inputfile import real_path
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import place

__all__ = ["OpensfmFiles", "files_of", "read", "read_files", "recognises", "write", "write_files"]

RECONSTRUCTION = "reconstruction.json"
TRACKS = "tracks.csv"
REFERENCE = "reference_lla.json"
_FILES = ("gcp",)
_EXAMPLES = 4


class OpensfmFiles(NamedTuple):
    """The files of a model.

    Attributes
    ----------
    reconstruction, tracks
        Must be there.
    reference, gcp
        Where there are such.
    notes
        What was chosen among them.
    """

    reconstruction: Path
    tracks: Path
    reference: Path | None
    gcp: Path | None
    notes: tuple[Note, ...] = ()


def recognises(source: Path) -> bool:
    """Return whether this is a folder with a reconstruction and its tracks, or the former."""
    folder = source.parent if source.name == RECONSTRUCTION else source
    return (folder / RECONSTRUCTION).is_file() and (folder / TRACKS).is_file()


def files_of(folder: Path, options: ImportOptions) -> OpensfmFiles:
    """Return the files of a folder; raises InputError for one that is given and unknown."""
    unknown = next((what for what in options.files if what not in _FILES), None)
    if unknown is not None:
        raise InputError(f"--with {unknown}=...: there is gcp=FILE")
    reference, gcp = folder / REFERENCE, folder / GCP_LIST
    return OpensfmFiles(
        folder / RECONSTRUCTION,
        folder / TRACKS,
        reference if reference.exists() else None,
        options.files.get("gcp", gcp if gcp.exists() else None),
    )


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a model; raises InputError that names file and line, or place in the file."""
    folder = source.parent if source.name == RECONSTRUCTION else source
    return read_files(files_of(folder, options), options, real_path(source).name or "opensfm")


def write(exporting: Exporting, target: Path) -> Exported:
    """Write what the block was imported from without what does not count, as a new folder."""
    return write_files(exporting, target, target)


def write_files(exporting: Exporting, model: Path, project: Path) -> Exported:
    """Write a model, and gcp_list.txt into its project; raises as `write`."""
    source = exporting.folder / SOURCE
    for name in (RECONSTRUCTION, TRACKS):
        if not (source / name).is_file():
            raise InputError(f"{place(source / name)}: not there: the block is not from OpenSfM")
    return write_cleaned(exporting, _source_rays(source), model, project)


def _source_rays(source: Path) -> SourceRays:
    """Return what import calls the rays of the files that a block keeps."""
    files = files_of(source, ImportOptions())
    found = _largest(read_reconstructions(files.reconstruction))
    _, camera_of_photo, _ = _cameras(found, None)
    rays, tracks, _ = _rays(files.tracks, found, camera_of_photo)
    count = len(rays)
    control: list[str] = []
    listed = None if files.gcp is None else read_gcp_list(files.gcp, camera_of_photo)
    if listed is not None and listed.rows:
        names, _ = _names_beside(listed, tracks)
        control = [names[name] for name in listed.names()]
        rays += _control_rays(listed, names)
    kept = kept_names(rays, camera_of_photo)
    return SourceRays(
        frozenset(camera_of_photo), found.points, rays[:count], kept[:count], control, kept[count:]
    )


def _largest(found: tuple[Reconstruction, ...]) -> Reconstruction:
    return max(found, key=lambda one: (len(one.shots), len(one.points)))


def read_files(files: OpensfmFiles, options: ImportOptions, name: str) -> Imported:
    """Read the files of a model; raises as `read`."""
    reconstructions = read_reconstructions(files.reconstruction)
    largest = _largest(reconstructions)
    notes = list(files.notes)
    others = [one for one in reconstructions if one is not largest]
    if others:
        sizes = ", ".join(str(len(one.shots)) for one in others[:8])
        text = f"further reconstructions in the file, of {sizes} photos: the largest is taken"
        notes.append(Note("dropped", len(others), text))
    cameras, camera_by_photo, more = _cameras(largest, options.pixel_um)
    notes += more
    if not camera_by_photo:
        raise InputError(f"{place(files.reconstruction)}: no photo with a pose and a lens")
    shots = [shot for shot in largest.shots if shot.name in camera_by_photo]
    rays, tracks, more = _rays(files.tracks, largest, camera_by_photo)
    notes += more
    reference = largest.reference
    if reference is None and files.reference is not None:
        reference = read_reference(files.reference)
    control: tuple[ControlPoint, ...] = ()
    ground: GroundSystem | None = None
    listed = None if files.gcp is None else read_gcp_list(files.gcp, camera_by_photo)
    if listed is not None and listed.rows:
        centres = [shot.centre for shot in shots]
        placed = place_control(listed, reference, centres, options.order)
        ground = placed.ground
        if not placed.by_reference:
            reference = None
        notes += placed.notes
        names, more = _names_beside(listed, tracks)
        notes += more
        rays += _control_rays(listed, names)
        control = tuple(
            ControlPoint(names[one], (x, y, None if math.isnan(z) else z))
            for one, (x, y, z) in placed.xyz.items()
        )
    elif options.order is not None:
        raise InputError("--order is of the degrees of control, and there is none")
    if listed is not None and listed.elsewhere:
        notes.append(elsewhere_note(listed, camera_by_photo))
    if ground is None and reference is not None:
        ground = _ground(options.crs, listed, reference)
    elif ground is not None and options.crs is not None:
        raise InputError("--crs: the system is that of gcp_list.txt, in its first line")
    placed_there = reference is not None or not control
    points, said = image_points_of(rays, camera_by_photo, pixels=True)
    if not points:
        raise InputError(f"{place(files.tracks)}: no ray lies in its image")
    notes += said
    notes += _assumed(options, largest, control, reference, placed_there)
    block = Block(
        name if name_fault(name) is None else "opensfm",
        _precision(options),
        TestSettings(kind="tau"),
        cameras,
        tuple(
            _photo(shot, camera_by_photo[shot.name], options.position_m)
            if placed_there
            else Photo(shot.name, camera_by_photo[shot.name].id)
            for shot in shots
        ),
        (),
        points,
        control,
        in_pixels=True,
        ground=ground,
    )
    kept = {RECONSTRUCTION: files.reconstruction, TRACKS: files.tracks}
    kept |= {} if files.reference is None else {REFERENCE: files.reference}
    kept |= {} if files.gcp is None else {GCP_LIST: files.gcp}
    return Imported(block, tuple(notes), _comments(files, block), kept)


def _ground(
    crs: str | None, listed: GcpList | None, reference: tuple[float, float, float]
) -> GroundSystem:
    """Return the local frame without control: of the system asked for, or of its list."""
    if crs is not None or listed is None:
        return local_system(crs or DEGREES, reference)
    try:
        return local_system(listed.system.text, reference)
    except InputError as error:
        raise listed.system.fail(str(error)) from None


def _cameras(
    found: Reconstruction, pixel_um: float | None
) -> tuple[tuple[Camera, ...], dict[str, Camera], list[Note]]:
    """Return the cameras that are used, the one of every photo, and what is left out."""
    used = dict.fromkeys(shot.camera for shot in found.shots)
    made: dict[str, Camera] = {}
    taken: set[str] = set()
    unheld: dict[str, str] = {}
    for number, camera in enumerate(used, start=1):
        stated = found.cameras[camera]
        model = unheld_model(stated)
        if model is not None:
            unheld[camera] = model
            continue
        others = (f"camera {k}" for k in range(number, number + len(used) + 1))
        names = chain((camera.strip(),), others)
        name = next(one for one in names if name_fault(one) is None and one not in taken)
        taken.add(name)
        made[camera] = camera_of(name, stated, pixel_um)
    notes = []
    for model in dict.fromkeys(unheld.values()):
        gone = tuple(shot.name for shot in found.shots if unheld.get(shot.camera) == model)
        text = f"photos of a {model} camera, which no lens here holds"
        notes.append(Note("dropped", len(gone), text, gone[:_EXAMPLES]))
    by_photo = {shot.name: made[shot.camera] for shot in found.shots if shot.camera in made}
    return tuple(made.values()), by_photo, notes


def _rays(
    path: Path, found: Reconstruction, cameras: Mapping[str, Camera]
) -> tuple[list[MeasuredRay], frozenset[str], list[Note]]:
    """Return the rays of points that are in the reconstruction, and the names of these."""
    places: dict[str, list[tuple[int, str, float, float]]] = {}
    count = other = 0
    seen: set[str] = set()
    for row in track_rows(path):
        if not isinstance(row, TrackRow):
            continue
        if row.image not in cameras or row.track not in found.points:
            other += 1
            continue
        if row.track not in seen:
            seen.add(row.line.name_of(row.track, "track"))
        places.setdefault(row.image, []).append((count, row.track, *row.at()))
        count += 1
    rays: list[MeasuredRay | None] = [None] * count
    for image, mine in places.items():
        normalized = np.array([(x, y) for _, _, x, y in mine])
        pixels = shown_pixels(cameras[image], normalized).tolist()
        for (k, track, _, _), (x, y) in zip(mine, pixels, strict=True):
            rays[k] = MeasuredRay(image, track, x, y)
    notes = []
    if other:
        text = "features of tracks or images that are not in the reconstruction"
        notes.append(Note("dropped", other, text))
    unseen = len(found.points) - len(seen)
    if unseen:
        notes.append(Note("dropped", unseen, "points without a ray in tracks.csv"))
    return [ray for ray in rays if ray is not None], frozenset(seen), notes


def _control_rays(listed: GcpList, names: Mapping[str, str]) -> list[MeasuredRay]:
    return [
        MeasuredRay(row.image, names[name], *row.pixel)
        for row, name in zip(listed.rows, listed.names(), strict=True)
    ]


def _names_beside(listed: GcpList, tracks: frozenset[str]) -> tuple[dict[str, str], list[Note]]:
    """Return names of control that no track has, by those of the list."""
    names = {}
    points = listed.points()
    taken = set(tracks)
    for name in points:
        free = name
        while free in taken or (free != name and free in points):
            free = f"gcp-{free}"
        taken.add(free)
        names[name] = free
    changed = tuple(name for name, new in names.items() if name != new)
    notes = []
    if changed:
        text = "control points that have a track's name: gcp- before it"
        notes.append(Note("changed", len(changed), text, changed[:_EXAMPLES]))
    unnamed = len(set(listed.names()) - {row.name for row in listed.rows})
    if unnamed:
        text = "control points without a name: called gcp1, gcp2, ... in the order of the list"
        notes.append(Note("joined", unnamed, text))
    return names, notes


def _photo(shot: Shot, camera: Camera, position_m: float | None) -> Photo:
    """Return a photo with its pose; where it was measured and that is asked for, with a prior."""
    if position_m is None or shot.measured is None:
        return Photo(shot.name, camera.id, shot.centre, shot.rotation)
    sigma = (position_m, position_m, position_m)
    return Photo(shot.name, camera.id, shot.measured, shot.rotation, sigma)


def _precision(options: ImportOptions) -> Precision:
    pixel = 1.0 if options.pixel_um is None else options.pixel_um
    sigma = (1.0 if options.sigma_px is None else options.sigma_px) * pixel
    made = Precision(image_um=sigma, tie_variance="exact")
    return made if options.control_m is None else replace(made, control_m=options.control_m)


def _assumed(
    options: ImportOptions,
    found: Reconstruction,
    control: tuple[ControlPoint, ...],
    reference: tuple[float, float, float] | None,
    placed_there: bool,
) -> list[Note]:
    notes = []
    if options.sigma_px is None:
        notes.append(Note("assumed", None, "image coordinates have a sigma of one pixel"))
    if control:
        if options.control_m is None:
            sigma = Precision().control_m
            text = f"control has a sigma of {sigma:g} m (--control-m, or sX,sY,sZ in control.csv)"
            notes.append(Note("assumed", None, text))
        text = "pixels of control count from the upper left corner of the image"
        notes.append(Note("assumed", None, text))
    if not placed_there:
        text = "photos without a position: where their frame lies is not known"
        notes.append(Note("dropped", len(found.shots), text))
    measured = sum(shot.measured is not None for shot in found.shots)
    if options.position_m is not None and not (measured and placed_there):
        raise InputError("--position-m: no photo has a position measured in flight, in this frame")
    if options.position_m is not None:
        text = f"positions measured in flight are priors, with a sigma of {options.position_m:g} m"
        notes.append(Note("assumed", measured, text))
    elif measured:
        text = "positions measured in flight: no priors without --position-m, their sigma"
        notes.append(Note("dropped", measured, text))
    if reference is None and not control:
        notes.append(Note("assumed", None, "the frame is the model's own: no place on earth"))
    return notes


def _comments(files: OpensfmFiles, block: Block) -> tuple[str, ...]:
    lines = [f"from OpenSfM: {files.reconstruction.name}, {files.tracks.name}"]
    if files.gcp is not None:
        lines[0] += f", {files.gcp.name}"
    lines.append("positions and rotations are those of the source: approximate, no observations")
    if block.ground is not None:
        lines.append("coordinates are east, north, up [m] at the origin of [ground]")
    return tuple(lines)
