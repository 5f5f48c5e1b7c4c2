"""BlocksExchange of ContextCapture, iTwin and Metashape: XML with photos and measurements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from sys import intern
from typing import Final, NamedTuple, Self

import numpy as np

from anaplot.errors import InputError
from anaplot.exchange.formats.blocksexchangemodel import (
    Group,
    Place,
    group_of,
    position_of,
    rotation_of,
)
from anaplot.exchange.formats.blocksexchangewriter import written
from anaplot.exchange.formats.crs import (
    DEGREES,
    CoordinateSystem,
    GroundFrame,
    crs_text,
    frame_around,
)
from anaplot.exchange.formats.door import Exported, Exporting, Imported, ImportOptions, Note
from anaplot.exchange.formats.measuredrays import MeasuredRay, image_points_of, own_sigmas
from anaplot.exchange.formats.sourcelines import SourceLine
from anaplot.exchange.formats.xmlstream import Element, elements, first_tag
from anaplot.photogrammetry.block import Block, ControlPoint, Photo, Precision, TestSettings
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wholefile import create_whole
from anaplot.textfiles.wording import plain, quoted

__all__ = ["read", "recognises", "write"]

ROOT: Final = "BlocksExchange"
_BLOCK: Final = f"{ROOT}/Block"
_GROUP: Final = f"{_BLOCK}/Photogroups/Photogroup"
_WANTED: Final = {
    "srs": f"{ROOT}/SpatialReferenceSystems/SRS",
    "name": f"{_BLOCK}/Name",
    "of block": f"{_BLOCK}/SRSId",
    "photo": f"{_GROUP}/Photo",
    "group": _GROUP,
    "control": f"{_BLOCK}/ControlPoints/ControlPoint",
    "of control": f"{_BLOCK}/ControlPoints/SRSId",
    "tie": f"{_BLOCK}/TiePoints/TiePoint",
    "of ties": f"{_BLOCK}/TiePoints/SRSId",
}


_MOST_KEPT = 100_000  # photos, or control points: their elements are kept, some kB each


class _Measured(NamedTuple):
    """A tie or control point's measurements: a file has millions of them.

    Attributes
    ----------
    at
        Its line.
    name
        What the file calls it, or None.
    places
        Where it is, by Ids of photos.
    """

    at: SourceLine
    name: str | None
    places: tuple[tuple[str, Place], ...]

    @classmethod
    def of(cls, found: Element) -> Self:
        """Return what a TiePoint or ControlPoint says; raises InputError."""
        places = (
            (intern(child.needed("PhotoId")), Place.of(child))
            for child in found.children
            if child.name == "Measurement"
        )
        return cls(found.at, found.value("Name"), tuple(places))


@dataclass
class _Found:
    """What a file says, before it is a block.

    Attributes
    ----------
    systems
        Definitions of coordinate systems by their Ids.
    system
        Id of the block's, with where it stands.
    groups
        With their photos.
    control, ties
        Points with their measurements; of ties nothing but these.
    """

    name: str | None = None
    systems: dict[str, str] = field(default_factory=dict)
    system: str | None = None
    groups: list[tuple[Group, list[Element]]] = field(default_factory=list)
    control: list[Element] = field(default_factory=list)
    ties: list[_Measured] = field(default_factory=list)


def recognises(source: Path) -> bool:
    """Return whether a file is XML whose outermost element is BlocksExchange."""
    return source.is_file() and first_tag(source) == ROOT


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a BlocksExchange file.

    Parameters
    ----------
    source
        The XML.
    options
        `sigma_px`; `crs`: the coordinate system, where its definition is none that can be read.

    Raises
    ------
    InputError
        The XML is wrong, or says what cannot be read, with its line.
    """
    found = _gathered(source)
    notes: list[Note] = []
    photos, of_id, group_of_photo = _photos(found, notes)
    system, ground = _ground(found, options, photos)
    if system is not None:
        notes.append(_told(system))
    oriented, said = _oriented(photos, ground)
    notes += said
    control, names = _control(found.control, ground)
    rays, said = _rays(found, names, of_id, group_of_photo)
    notes += said
    cameras = {group.camera.id: group.camera for group, _ in found.groups}
    if sum(group.skewed for group, _ in found.groups):
        text = "cameras with a Skew: x = f u + skew v"
        notes.append(Note("assumed", sum(group.skewed for group, _ in found.groups), text))
    camera_of = {name: group.camera for name, group in group_of_photo.items()}
    sigma = options.sigma_px or 1.0
    image_um = sigma * (next(iter(cameras.values())).pixel_um or 1.0)
    own = own_sigmas(camera_of, sigma, image_um)
    points, lost = image_points_of(rays, camera_of, pixels=True, sigma_um=own)
    if options.sigma_px is None:
        notes.append(Note("assumed", None, "an image coordinate has a sigma of one pixel"))
    name = found.name or source.stem
    block = Block(
        name if name_fault(name) is None else "block",
        Precision(image_um, "exact"),
        TestSettings("tau"),
        tuple(cameras.values()),
        oriented,
        (),
        points,
        control,
        in_pixels=True,
        ground=system,
    )
    comments = (f"From the BlocksExchange file {source.name}.",)
    return Imported(block, (*notes, *lost), comments, {source.name: source})


def _gathered(source: Path) -> _Found:
    found = _Found()
    photos: list[Element] = []
    taken: dict[str, int] = {}
    ids: list[tuple[Element, str]] = []
    many = 0
    for one in elements(source, ROOT, _WANTED.values()):
        if one.name == "SRS":
            found.systems[one.needed("Id")] = one.value("Definition") or ""
        elif one.name == "Name":
            found.name = one.text.strip()
        elif one.name == "SRSId":
            ids.append((one, one.text.strip()))
        elif one.name == "Photo":
            many += 1
            if many > _MOST_KEPT:
                raise one.at.fail(f"more than {_MOST_KEPT} Photos")
            photos.append(one)
        elif one.name == "Photogroup":
            name = _camera_name(one, f"group {len(found.groups) + 1}", taken)
            found.groups.append((group_of(one, name), photos))
            ids += _own_system(one)
            photos = []
        elif one.name == "ControlPoint":
            if len(found.control) >= _MOST_KEPT:
                raise one.at.fail(f"more than {_MOST_KEPT} ControlPoints")
            found.control.append(one)
            ids += _own_system(one)
        else:
            found.ties.append(_Measured.of(one))
            ids += _own_system(one)
    if not any(mine for _, mine in found.groups):
        raise InputError(f"{plain(str(source), 400)}: no Photo in any Photogroup")
    for at, text in ids:
        if found.system is not None and text != found.system:
            raise at.at.fail("more than one coordinate system is used: only one is read")
        found.system = text
    return found


def _own_system(one: Element) -> list[tuple[Element, str]]:
    text = one.value("SRSId")
    return [] if text is None else [(one, text)]


def _camera_name(group: Element, otherwise: str, taken: dict[str, int]) -> str:
    """Return a name that no other group has, and note it with the number that it got last."""
    name = group.at.name_of(group.value("Name") or otherwise, "Photogroup")
    number, made = taken.get(name, 1), name
    while made in taken:
        number += 1
        made = f"{name} {number}"
    taken[name] = number
    taken.setdefault(made, 1)
    return group.at.name_of(made, "Photogroup")


def _photos(
    found: _Found, notes: list[Note]
) -> tuple[list[tuple[str, Group, Element]], dict[str, str], dict[str, Group]]:
    """Return photos, their names by Ids, and the group of each name."""
    photos: list[tuple[str, Group, Element]] = []
    of_id: dict[str, str] = {}
    groups: dict[str, Group] = {}
    again = []
    for group, mine in found.groups:
        for one in mine:
            number = one.needed("Id")
            if number in of_id:
                raise one.at.fail(f"a second Photo of Id {quoted(number)}")
            path = one.value("ImagePath") or f"photo {number}"
            name = one.at.name_of(path, "image")
            if name in groups:
                again.append(path)
                name = one.at.name_of(f"{path} ({number})", "image")
                if name in groups:
                    raise one.at.fail(f"ImagePath {quoted(path)} stands for several photos")
            of_id[number] = name
            groups[name] = group
            photos.append((name, group, one))
    if again:
        text = "photos of an ImagePath that another one has: their Id is in the name"
        notes.append(Note("changed", len(again), text, tuple(again[:4])))
    return photos, of_id, groups


def _ground(
    found: _Found, options: ImportOptions, photos: Iterable[tuple[str, Group, Element]]
) -> tuple[GroundSystem | None, GroundFrame | None]:
    """Return the block's system, and the way there from the file's coordinates.

    None where nothing is known of the system, and where coordinates are the block's as they stand.
    """
    definition = options.crs
    if definition is None and found.system is not None:
        if found.system not in found.systems:
            raise InputError(f"SRSId {quoted(found.system)}: no SRS has that Id")
        definition = found.systems[found.system]
    words = (definition or "").strip()
    if not words or words.upper().startswith(("LOCAL", "LOCAL_CS")):
        return None, None
    if words.upper().startswith("ENU:"):
        return _east_north_up(words), None
    try:
        text = crs_text(words)
    except InputError as error:
        raise InputError(f"{error}; --crs EPSG:25832 says what it is") from None
    theirs = CoordinateSystem.of(text)
    places = [
        place
        for of in (*(one.child("Position") for one in found.control), *_centres(photos))
        if of is not None and of.child("z") is not None
        if (place := position_of(of)) is not None
    ]
    if not places:
        raise InputError(f"coordinate system {quoted(text)}, and no position in it")
    frame = frame_around(theirs, np.array(places))
    return frame.system, frame


def _centres(photos: Iterable[tuple[str, Group, Element]]) -> Iterable[Element | None]:
    return (one.find("Pose", "Center") for _, _, one in photos)


def _east_north_up(words: str) -> GroundSystem:
    """Return the system of ENU:latitude,longitude, whose heights begin at the ellipsoid."""
    parts = words[4:].split(",")
    try:
        latitude, longitude = (float(part) for part in parts[:2])
        if not (abs(latitude) < 90.0 and abs(longitude) <= 180.0):
            raise ValueError
    except ValueError:
        raise InputError(f"coordinate system {quoted(words)}: not ENU:latitude,longitude") from None
    return GroundSystem(DEGREES, "local", (longitude, latitude, 0.0))


def _told(system: GroundSystem) -> Note:
    east, north, up = system.origin
    text = f"coordinates are east, north, up at {east:.10g}, {north:.10g}, {up:g} ({system.crs})"
    return Note("changed", None, text)


def _into(ground: GroundFrame | None, place: tuple[float, float, float]) -> tuple[float, ...]:
    if ground is None:
        return place
    return tuple(ground.into_block(np.array([place]))[0].tolist())


def _oriented(
    photos: Iterable[tuple[str, Group, Element]], ground: GroundFrame | None
) -> tuple[tuple[Photo, ...], list[Note]]:
    """Return photos with their approximate orientations, and priors where metadata have sigmas."""
    made = []
    unposed = angles = priors = loose = 0
    for name, group, one in photos:
        pose = one.child("Pose")
        photo = Photo(name, group.camera.id)
        if pose is None:
            unposed += 1
            made.append(photo)
            continue
        place = position_of(pose.child("Center"))
        rotation = rotation_of(pose, group.axes)
        angles += rotation is None and pose.child("Rotation") is not None
        if place is not None:
            x, y, z = _into(ground, place)
            photo = replace(photo, position=(x, y, z))
        stated = pose.find("Metadata", "Center") or one.find("Metadata", "Center")
        around = pose.child("Metadata") or one.child("Metadata")
        sigma = None if around is None or stated is None else _sigmas(around, stated)
        if sigma is not None:
            x, y, z = _into(ground, position_of(stated) or (0.0, 0.0, 0.0))
            photo = replace(photo, position=(x, y, z), position_sigma=sigma)
            priors += 1
        elif stated is not None:
            loose += 1
        made.append(replace(photo, rotation=rotation))
    notes = (
        Note("dropped", unposed, "photos without a Pose: their orientation is not known"),
        Note("dropped", angles, "rotations other than a matrix or Omega, Phi, Kappa"),
        Note("assumed", priors, "positions of metadata with accuracies are priors"),
        Note("dropped", loose, "positions of metadata without accuracies"),
    )
    return tuple(made), [note for note in notes if note.count]


def _sigmas(*places: Element) -> tuple[float, float, float] | None:
    """Return HorizontalAccuracy twice and VerticalAccuracy, from the first that has both."""
    for at in places:
        plan, height = at.number("HorizontalAccuracy"), at.number("VerticalAccuracy")
        if plan is not None and height is not None:
            if not (plan > 0.0 and height > 0.0):
                raise at.at.fail("an accuracy of a prior must be positive")
            return plan, plan, height
    return None


def _control(
    found: Iterable[Element], ground: GroundFrame | None
) -> tuple[tuple[ControlPoint, ...], list[str]]:
    """Return control points, and the name of each in the file's order."""
    made: dict[str, ControlPoint] = {}
    names = []
    for number, one in enumerate(found, 1):
        name = one.value("Name") or one.value("Id") or f"control {number}"
        name = one.at.name_of(name, "control point")
        if name in made:
            raise one.at.fail(f"a second control point {quoted(name)}")
        names.append(name)
        kind = one.value("Category") or "Full"
        if kind not in ("Full", "Horizontal", "Vertical"):
            raise one.at.fail(f"Category {quoted(kind)}: none of Full, Horizontal, Vertical")
        at = one.child("Position") or one
        place = [at.number(key) for key in "xyz"]
        known = [kind != "Vertical", kind != "Vertical", kind != "Horizontal"]
        for key, value, is_known in zip("xyz", place, known, strict=True):
            if value is None and is_known:
                raise one.at.fail(f"control point {quoted(name)} has no {key}")
        if ground is not None and None in place:
            if None in place[:2]:
                raise one.at.fail(f"control point {quoted(name)} needs x and y in this system")
            place[2] = ground.system.origin[2]
        x, y, z = (0.0 if value is None else value for value in place)
        inside = _into(ground, (x, y, z))
        plan, height = one.number("HorizontalAccuracy"), one.number("VerticalAccuracy")
        if (plan or 0.0) < 0.0 or (height or 0.0) < 0.0:
            raise one.at.fail("an accuracy must not be negative")
        ex, ey, ez = (v if is_known else None for v, is_known in zip(inside, known, strict=True))
        check = (one.value("CheckPoint") or "false").lower() in ("true", "1")
        made[name] = ControlPoint(
            name, (ex, ey, ez), (plan, plan, height), "check" if check else "control"
        )
    return tuple(made.values()), names


def _rays(
    found: _Found,
    names: list[str],
    of_id: Mapping[str, str],
    group_of_photo: Mapping[str, Group],
) -> tuple[list[MeasuredRay], list[Note]]:
    rays: list[MeasuredRay] = []
    taken = set(names)
    for one, name in zip(found.control, names, strict=True):
        rays += _measured(_Measured.of(one), name, of_id, group_of_photo)
    changed = 0
    for number, tie in enumerate(found.ties, 1):
        stated = tie.name
        name = str(number) if stated is None else tie.at.name_of(stated, "tie point")
        first, count = name, 1
        while name in taken:
            count += 1
            name = f"{first} tie" if count == 2 else f"{first} tie {count}"
        changed += name != first and stated is not None
        taken.add(name)
        rays += _measured(tie, name, of_id, group_of_photo)
    notes = []
    if changed:
        notes.append(Note("changed", changed, "tie points have a name that was taken: with ' tie'"))
    return rays, notes


def _measured(
    one: _Measured, name: str, of_id: Mapping[str, str], group_of_photo: Mapping[str, Group]
) -> list[MeasuredRay]:
    rays = []
    for number, place in one.places:
        photo = of_id.get(number)
        if photo is None:
            raise place.at.fail(f"PhotoId {quoted(number)}: no Photo has that Id")
        rays.append(MeasuredRay(photo, name, *group_of_photo[photo].pixel(place)))
    return rays


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a BlocksExchange file of version 3.2.

    Raises
    ------
    InputError
        A camera has no pixels, or the file cannot be written.
    """
    pieces, notes = written(exporting)
    create_whole(target, pieces)
    return Exported((target,), notes)
