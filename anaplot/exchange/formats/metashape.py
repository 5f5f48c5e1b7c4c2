"""Metashape's camera XML with its markers: their measurements are the rays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.exchange.formats.colmapcamera import canvas
from anaplot.exchange.formats.crs import CoordinateSystem, GroundFrame, crs_text, frame_around
from anaplot.exchange.formats.door import (
    SOURCE,
    Exported,
    Exporting,
    Imported,
    ImportOptions,
    Note,
)
from anaplot.exchange.formats.gathered import head_of
from anaplot.exchange.formats.measuredrays import (
    MeasuredRay,
    enlarged,
    image_points_of,
    magnified,
    own_sigmas,
)
from anaplot.exchange.formats.metashapemodel import (
    Sensor,
    Similarity,
    matrix_of,
    sensor_of,
    similarity_of,
    system_of,
)
from anaplot.exchange.formats.metashapewriter import without_locations
from anaplot.exchange.formats.xmlstream import Element, elements, first_tag
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ControlUse,
    Photo,
    Precision,
    TestSettings,
    Use,
    in_pixels,
)
from anaplot.photogrammetry.ellipsoid import LocalFrame
from anaplot.photogrammetry.rotation import rotation_angles
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wholefile import create_whole
from anaplot.textfiles.wording import place, plain, quoted

__all__ = ["read", "recognises", "write"]

_ROOT: Final = "document"
_LOOK: Final = 1 << 16  # bytes that are looked at
_CHUNK: Final = "document/chunk"
_FRAME: Final = f"{_CHUNK}/frames/frame"
_KINDS: Final = {
    f"{_CHUNK}/sensors/sensor": "sensors",
    f"{_CHUNK}/components/component": "components",
    f"{_CHUNK}/cameras/camera": "cameras",
    f"{_CHUNK}/cameras/group/camera": "cameras",
    f"{_CHUNK}/transform": "transforms",
    f"{_CHUNK}/reference": "references",
    f"{_CHUNK}/settings/property": "settings",
    f"{_CHUNK}/markers/marker": "markers",
    f"{_CHUNK}/markers/group/marker": "markers",
    f"{_FRAME}/markers/marker": "measured",
    f"{_FRAME}/markers/group/marker": "measured",
}
_NOT_ENABLED: Final = "the camera is not enabled"
_NOT_VALID: Final = "not valid in Metashape"


@dataclass
class _Found:
    """The elements of a file, and names of photos and points by their ids."""

    sensors: list[Element] = field(default_factory=list)
    components: list[Element] = field(default_factory=list)
    cameras: list[Element] = field(default_factory=list)
    transforms: list[Element] = field(default_factory=list)
    references: list[Element] = field(default_factory=list)
    settings: list[Element] = field(default_factory=list)
    markers: list[Element] = field(default_factory=list)
    measured: list[Element] = field(default_factory=list)
    photos: dict[str, str] = field(default_factory=dict)
    points: dict[str, str] = field(default_factory=dict)


def recognises(source: Path) -> bool:
    """Return whether a file is XML of a Metashape document, which begins with a chunk."""
    if not (source.is_file() and source.suffix.lower() == ".xml" and first_tag(source) == _ROOT):
        return False
    return "<chunk" in head_of(source, _LOOK)  # DBAT calls its root so, too


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a camera file as Metashape exports it.

    Parameters
    ----------
    source
        The XML.
    options
        `sigma_px`; `crs`: the coordinate system, where the file's definition bears no number.

    Raises
    ------
    InputError
        The XML is wrong, or says what cannot be read, with its line.
    """
    found = _gathered(source)
    settings = _settings(found)
    sensors = _sensors(found)
    frame, ground_notes = _ground(found, options)
    used = {at.attribute("camera_id") for one in found.measured for at in _locations(one)}
    stray = next((one for one in used if one not in found.photos), None)
    if stray is not None:
        raise InputError(f"{place(source)}: camera_id {quoted(stray)}: no camera has that id")
    rays, sensor_of_photo, notes = _rays(found, sensors, used)
    sigma = options.sigma_px or settings.get("accuracy_projections") or 1.0
    cameras, rays, said = _pinholes(rays, sensor_of_photo, sigma)
    control = _control(found, frame)
    photos, told = _photos(found, sensor_of_photo, used, frame, grounded=bool(control))
    camera_of = {name: cameras[sensor.camera.id] for name, sensor in sensor_of_photo.items()}
    kinds = {camera.id: camera for camera in camera_of.values()}
    image_um = sigma * (next(iter(kinds.values())).pixel_um or 1.0)
    own = own_sigmas(camera_of, sigma, image_um)
    points, lost = image_points_of(rays, camera_of, pixels=True, sigma_um=own)
    control_m = settings.get("accuracy_markers") or Precision().control_m
    if options.sigma_px is None:
        text = f"an image coordinate has a sigma of {sigma:g} px"
        notes.append(Note("assumed", None, text))
    bare = tuple(row.point for row in control if None in row.sigma)
    if bare:
        text = f"control points without a sigma of every coordinate: {control_m:g} m"
        notes.append(Note("assumed", len(bare), text, bare[:4]))
    initial = tuple(one.camera.id for one in sensors.values() if one.initial)
    if initial:
        text = "sensors without an adjusted calibration: as it was stated at first"
        notes.append(Note("assumed", len(initial), text, initial[:4]))
    rolling = sum(sensor.rolling for sensor in sensors.values())
    if rolling:
        notes.append(Note("dropped", rolling, "sensors' rolling shutters"))
    block = Block(
        source.stem if name_fault(source.stem) is None else "block",
        Precision(image_um, "exact", control_m),
        TestSettings("tau"),
        tuple(kinds.values()),
        photos,
        (),
        points,
        control,
        in_pixels=True,
        ground=None if frame is None else frame.system,
    )
    comments = (f"Markers of the Metashape file {source.name}.",)
    every = (*ground_notes, *notes, *said, *told, *lost)
    return Imported(block, every, comments, {source.name: source})


def _gathered(source: Path) -> _Found:
    """Return a file's elements; raises InputError for ids twice, or nothing to be read."""
    found = _Found()
    for one in elements(source, _ROOT, _KINDS):
        # a marker stands in the chunk, and with its measurements in a frame
        kind = {"marker": "measured" if "marker_id" in one.attributes else "markers"}.get(one.name)
        kind = kind or next(k for path, k in _KINDS.items() if path.endswith(f"/{one.name}"))
        getattr(found, kind).append(one)
    if not found.cameras:
        raise InputError(f"{place(source)}: no camera in the chunk")
    if not any(_locations(one) for one in found.measured):
        raise InputError(
            f"{place(source)}: no measurement of a marker: a camera file has no tie points,"
            " BlocksExchange and COLMAP have them"
        )
    for kind, ones, names in (
        ("camera", found.cameras, found.photos),
        ("marker", found.markers, found.points),
    ):
        taken: set[str] = set()
        for one in ones:
            number = one.attribute("id")
            if number in names:
                raise one.at.fail(f"a second {kind} of id {quoted(number)}")
            name = one.at.name_of(one.attributes.get("label") or f"{kind} {number}", kind)
            if name in taken:
                name = one.at.name_of(f"{name} ({number})", kind)
            if name in taken:
                raise one.at.fail(f"{kind} {quoted(name)} stands twice")
            taken.add(name)
            names[number] = name
    return found


def _locations(one: Element) -> list[Element]:
    return [child for child in one.children if child.name == "location"]


def _settings(found: _Found) -> dict[str, float]:
    """Return the accuracies of the chunk's settings that are positive numbers."""
    out = {}
    for one in found.settings:
        name = one.attributes.get("name", "")
        if name in ("accuracy_projections", "accuracy_markers"):
            value = one.at.number_of(one.attribute("value"), name)
            if value > 1e6:
                raise one.at.fail(f"{name} of {value:g}")
            if value > 0.0:
                out[name] = value
    return out


def _sensors(found: _Found) -> dict[str, Sensor]:
    """Return sensors by their ids, those that a camera names."""
    used = {one.attribute("sensor_id") for one in found.cameras}
    out: dict[str, Sensor] = {}
    taken: set[str] = set()
    for one in found.sensors:
        number = one.attribute("id")
        if number in out:
            raise one.at.fail(f"a second sensor of id {quoted(number)}")
        if number not in used:
            continue
        name = one.at.name_of(one.attributes.get("label") or f"sensor {number}", "sensor")
        if name in taken:
            name = one.at.name_of(f"{name} ({number})", "sensor")
        if name in taken:
            raise one.at.fail(f"sensor {quoted(name)} stands twice")
        taken.add(name)
        out[number] = sensor_of(one, name)
    return out


def _ground(found: _Found, options: ImportOptions) -> tuple[GroundFrame | None, list[Note]]:
    """Return the way to the block's system; None where coordinates are local."""
    places = [xyz for one in found.markers if (xyz := _reference(one)) is not None]
    places = places or [xyz for one in found.cameras if (xyz := _reference(one)) is not None]
    stated = options.crs
    if stated is None:
        text = " ".join(one.text for one in found.references)
        stated = system_of(text)
        if stated is None and places:
            raise found.references[0].at.fail(
                f"coordinate system {quoted(text.strip())}: --crs EPSG:25832 says what it is"
            )
    if not stated or not places:
        return None, []
    theirs = CoordinateSystem.of(crs_text(stated))
    frame = frame_around(theirs, np.array(places))
    east, north, up = frame.system.origin
    text = f"coordinates of {theirs.text} are east, north, up at {east:.10g}, {north:.10g}, {up:g}"
    notes = [Note("changed", None, text)]
    if theirs.sea:
        text = f"heights of {theirs.sea} are kept as they are: the geoid stays in Z"
        notes.append(Note("assumed", None, text))
    return frame, notes


def _reference(one: Element) -> tuple[float, float, float] | None:
    """Return the coordinates of an element's reference; None where it has none."""
    found = one.child("reference")
    if found is None or not all(key in found.attributes for key in "xyz"):
        return None
    x, y, z = found.at.ground_of([found.attribute(key) for key in "xyz"], "a coordinate")
    return x, y, z


def _sigma(one: Element) -> tuple[float | None, float | None, float | None]:
    """Return the standard deviations of an element's reference."""
    found = one.child("reference")
    if found is None:
        return None, None, None
    out = []
    for key in ("sx", "sy", "sz"):
        text = found.attributes.get(key) or found.attributes.get("sxyz")
        value = None if text is None else found.at.number_of(text, key)
        if value is not None and value < 0.0:
            raise found.at.fail(f"{key} must not be negative")
        out.append(value)
    return out[0], out[1], out[2]


def _enabled(one: Element | None) -> bool:
    return one is None or one.attributes.get("enabled", "true").lower() not in ("false", "0")


def _control(found: _Found, frame: GroundFrame | None) -> tuple[ControlPoint, ...]:
    """Return markers with references: control where they are enabled, else check points."""
    made = []
    for one in found.markers:
        xyz = _reference(one)
        if xyz is None:
            continue
        if frame is not None:
            x, y, z = frame.into_block(np.array([xyz]))[0].tolist()
            xyz = x, y, z
        use: ControlUse = "control" if _enabled(one.child("reference")) else "check"
        made.append(ControlPoint(found.points[one.attribute("id")], xyz, _sigma(one), use))
    return tuple(made)


def _rays(
    found: _Found, sensors: Mapping[str, Sensor], used: set[str]
) -> tuple[list[MeasuredRay], dict[str, Sensor], list[Note]]:
    """Return rays, the sensor of every photo that has some, and what was done."""
    cameras = {one.attribute("id"): one for one in found.cameras if one.attribute("id") in used}
    sensor_of_photo = {}
    for number, one in cameras.items():
        sensor = sensors.get(one.attribute("sensor_id"))
        if sensor is None:
            raise one.at.fail(f"sensor_id {quoted(one.attribute('sensor_id'))}: no such sensor")
        sensor_of_photo[found.photos[number]] = sensor
    rays = []
    off: dict[str, int] = {}
    for one in found.measured:
        name = found.points.get(one.attribute("marker_id"))
        if name is None:
            raise one.at.fail(f"marker_id {quoted(one.attribute('marker_id'))}: no such marker")
        for at in _locations(one):
            number = at.attribute("camera_id")
            x, y = (at.at.number_of(at.attribute(key), key) for key in "xy")
            why = None if _enabled(cameras[number]) else _NOT_ENABLED
            if at.attributes.get("valid", "true").lower() in ("false", "0"):
                why = _NOT_VALID
            if why is not None:
                off[why] = off.get(why, 0) + 1
            use: Use = "xy" if why is None else "off"
            rays.append(MeasuredRay(found.photos[number], name, x, y, None, use, why))
    notes = [Note("changed", count, f"rays do not count: {why}") for why, count in off.items()]
    return rays, sensor_of_photo, notes


def _pinholes(
    rays: list[MeasuredRay], sensor_of_photo: Mapping[str, Sensor], sigma_px: float
) -> tuple[dict[str, Camera], list[MeasuredRay], list[Note]]:
    """Return cameras by their ids, and rays, corrected where our lens does not hold a sensor's."""
    cameras = {sensor.camera.id: sensor.camera for sensor in sensor_of_photo.values()}
    out = list(rays)
    notes = []
    by_sensor: dict[str, list[int]] = {}
    for k, ray in enumerate(rays):
        by_sensor.setdefault(sensor_of_photo[ray.photo].camera.id, []).append(k)
    for sensor in {one.camera.id: one for one in sensor_of_photo.values()}.values():
        if not sensor.radial:
            continue
        camera = sensor.camera
        mine = by_sensor[camera.id]
        assert camera.pixels is not None
        assert camera.principal_px is not None
        seen, larger = sensor.pinhole(np.array([(rays[k].x, rays[k].y) for k in mine]))
        seen, size, principal = canvas(seen, camera.pixels, camera.principal_px)
        cameras[camera.id] = in_pixels(camera, size, camera.pixel_um, principal)
        good = np.isfinite(seen).all(axis=1)
        sigma_um = 1e3 * camera.pixel_mm * sigma_px
        for k, (x, y), more in zip(mine, seen.tolist(), larger.tolist(), strict=True):
            out[k] = rays[k]._replace(x=x, y=y, sigma_um=enlarged(sigma_um, more))
        text = (
            f"rays of sensor {quoted(camera.id)}, with a K4: corrected to pixels of a pinhole "
            f"camera of {size[0]} x {size[1]} px"
        )
        notes.append(Note("changed", int(good.sum()), text))
        notes += magnified(larger, f"sensor {quoted(camera.id)}")
    lost = [ray for ray in out if not np.isfinite((ray.x, ray.y)).all()]
    if lost:
        text = "rays where their lens images nothing within 80 degrees"
        some = tuple(f"{ray.photo}: {ray.point}" for ray in lost[:4])
        notes.append(Note("dropped", len(lost), text, some))
        out = [ray for ray in out if np.isfinite((ray.x, ray.y)).all()]
    return cameras, out, notes


def _photos(
    found: _Found,
    sensor_of_photo: Mapping[str, Sensor],
    used: set[str],
    frame: GroundFrame | None,
    *,
    grounded: bool,
) -> tuple[tuple[Photo, ...], list[Note]]:
    """Return photos with markers, with approximate orientations in the block's system."""
    components = {one.attribute("id"): one.child("transform") for one in found.components}
    chunk = similarity_of(found.transforms[0]) if found.transforms else None
    photos = []
    unused = unposed = adrift = priors = loose = 0
    for one in found.cameras:
        number = one.attribute("id")
        if number not in used:
            unused += 1
            continue
        name = found.photos[number]
        photo = Photo(name, sensor_of_photo[name].camera.id)
        component = components.get(one.attributes.get("component_id", ""))
        into = similarity_of(component) or chunk
        pose = one.child("transform")
        if pose is None or not pose.text.strip():
            unposed += 1
        elif into is None and grounded:
            adrift += 1
        else:
            centre, rotation = _world(matrix_of(pose), into, frame)
            x, y, z = centre.tolist()
            photo = replace(photo, position=(x, y, z), rotation=rotation_angles(rotation))
        stated, sigma = _reference(one), _sigma(one)
        if stated is not None and _enabled(one.child("reference")):
            sx, sy, sz = sigma
            if sx and sy and sz:
                inside = np.array([stated])
                x, y, z = (inside if frame is None else frame.into_block(inside))[0].tolist()
                photo = replace(photo, position=(x, y, z), position_sigma=(sx, sy, sz))
                priors += 1
            else:
                loose += 1
        photos.append(photo)
    notes = (
        Note("dropped", unused, "cameras without a marker"),
        Note("dropped", unposed, "cameras that are not aligned: their orientation is not known"),
        Note("dropped", adrift, "orientations of a chunk without a transform to the ground"),
        Note("assumed", priors, "positions of cameras with accuracies are priors"),
        Note("dropped", loose, "positions of cameras without accuracies of their own"),
    )
    return tuple(photos), [note for note in notes if note.count]


def _world(
    pose: tuple[Array, Array],
    into: Similarity | None,
    frame: GroundFrame | None,
) -> tuple[Array, Array]:
    """Return a projection centre and rotation in the block's system."""
    rotation, centre = pose
    if into is not None:
        rotation = into.rotation @ rotation
        centre = into.scale * into.rotation @ centre + into.translation
    if frame is None:
        return centre, rotation
    local = LocalFrame.at(*frame.system.origin, frame.theirs.ellipsoid)
    return local.local(centre[None])[0], local.axes @ rotation


def write(exporting: Exporting, target: Path) -> Exported:
    """Write the file that a block came from, without the measurements that do not count.

    Raises
    ------
    InputError
        The block came from no such file, or it cannot be written.
    """
    folder = exporting.folder / SOURCE
    there = sorted(folder.iterdir()) if folder.is_dir() else []
    sources = [path for path in there if recognises(path)]
    if len(sources) != 1:
        raise InputError(
            f"{place(folder)}: no Metashape file that the block came from; blocksexchange is"
            " written of any block in pixels"
        )
    found = _gathered(sources[0])
    rows = {(row.photo, row.point): row for row in exporting.block.image_points}
    leave = set()
    unknown = 0
    for one in found.measured:
        name = found.points.get(one.attribute("marker_id"), "")
        for at in _locations(one):
            number = at.attribute("camera_id")
            row = rows.get((found.photos.get(number, ""), name))
            unknown += row is None
            if row is not None and row.use == "off":
                leave.add((one.attribute("marker_id"), number))
    data, count = without_locations(sources[0], leave)
    create_whole(target, data)
    notes = [Note("dropped", count, "measurements with use = off")] if count else []
    if unknown:
        text = "measurements that are not in the block stay as they were"
        notes.append(Note("assumed", unknown, text))
    half = sum(row.use in ("x", "y") for row in exporting.block.image_points)
    if half:
        notes.append(Note("not held", half, "rays of which one coordinate counts: kept"))
    text = f"everything else is as in {plain(sources[0].name, 100)}"
    notes.append(Note("not held", None, text))
    return Exported((target,), tuple(notes))
