"""Coordinates in the systems of surveyors - degrees, EPSG numbers, proj strings - and a block's.

pyproj does the projections; it is an extra, and asked without any network. What is between degrees
and the local frame is done here (`anaplot.photogrammetry.groundsystem`). Coordinates have
the east (longitude) first and the north (latitude) second, whatever order an authority writes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any, Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError
from anaplot.photogrammetry.ellipsoid import WGS84, Ellipsoid, LocalFrame, geocentric, geodetic
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.textfiles.wording import plain, quoted, reason

__all__ = ["DEGREES", "CoordinateSystem", "GroundFrame", "crs_text", "frame_around", "local_system"]

DEGREES = "EPSG:4326"

_MOST = 255  # characters of a system's text
_NUMBER = re.compile(r"(EPSG|ESRI)[: ] ?([0-9]{1,6}(?:\+[0-9]{1,6})?)", re.IGNORECASE)
_UTM = re.compile(r"WGS\s?84\s+UTM\s+([0-9]{1,2})\s?([NS])", re.IGNORECASE)
_TOKEN = re.compile(r"\+([a-z_0-9]+)(=[-+.,\w]+)?", re.ASCII)
_LENGTHS = {1.0: "m", 0.3048: "ft", 0.304800610: "us-ft"}
_ANGLES = {round(np.pi / 180.0, 9): "deg", round(np.pi / 200.0, 9): "gon"}
# what reads files, or is no coordinate system
_REFUSED = {"nadgrids", "geoidgrids", "grids", "init", "xy_grids", "z_grids", "step", "file"}


def crs_text(text: str) -> str:
    """Return a system as it is kept in block.toml: "EPSG:4326", or a proj string.

    Parameters
    ----------
    text
        "EPSG:25832", "WGS84", "WGS84 UTM 32N" or a proj string; grids are not loaded.

    Raises
    ------
    InputError
        It is none of them.
    """
    words = " ".join(text[: _MOST + 1].split())
    if len(text) > _MOST:
        raise InputError(f"a coordinate system of more than {_MOST} characters: {quoted(words)}")
    number = _NUMBER.fullmatch(words)
    if number is not None:
        return f"{number[1].upper()}:{number[2]}"
    if re.fullmatch(r"WGS\s?84", words, re.IGNORECASE):
        return DEGREES
    utm = _UTM.fullmatch(words)
    if utm is not None:
        zone = int(utm[1])
        if not 1 <= zone <= 60:
            raise InputError(f"coordinate system {quoted(words)}: there are UTM zones 1 to 60")
        return f"EPSG:{(32600 if utm[2].upper() == 'N' else 32700) + zone}"
    tokens = [_TOKEN.fullmatch(word) for word in words.split()]
    names = [token[1] for token in tokens if token is not None]
    if words.startswith("+") and "proj" in names and len(names) == len(tokens):
        wrong = next((name for name in names if name in _REFUSED), None)
        if wrong is not None:
            raise InputError(f"coordinate system {quoted(words)}: +{wrong} is not read")
        return words
    raise InputError(
        f"no coordinate system {quoted(words)}: EPSG:25832, WGS84, WGS84 UTM 32N, or a proj string"
    )


@dataclass(frozen=True, slots=True)
class CoordinateSystem:
    """A coordinate system as pyproj knows it.

    Attributes
    ----------
    text
        As block.toml has it.
    name
        For people.
    kind
        "geographic", "projected" or "geocentric".
    ellipsoid
        Of its datum.
    height_m
        Unit of its heights [m].
    stated_heights
        Whether the system says what its heights are; else they are taken as ellipsoidal, in metres.
    sea
        Name of the system of its heights where they are no ellipsoidal ones; "" else. They are
        kept as they are, the geoid in them.
    """

    text: str
    name: str
    kind: str
    ellipsoid: Ellipsoid
    height_m: float
    stated_heights: bool
    sea: str
    _horizontal: Any
    _base: Any
    _unit: float

    @classmethod
    def of(cls, text: str) -> CoordinateSystem:
        """Return a system; raises InputError where there is none, or no pyproj."""
        return _system(crs_text(text))

    def geocentric(self, xyz: Array) -> Array:
        """Return (n, 3) geocentric coordinates [m] of the system's own datum.

        Raises
        ------
        InputError
            Some of them are outside of what the system can hold.
        """
        if self.kind == "geocentric":
            return xyz
        places = np.array(xyz, dtype=float)
        if self.kind == "projected":
            places[:, 0], places[:, 1] = self._transformed(places, forward=True)
        places[:, :2] *= self._unit
        places[:, 2] *= self.height_m
        beyond = ~(np.isfinite(places).all(axis=1) & (np.abs(places[:, 1]) <= np.pi / 2.0))
        if beyond.any():
            x, y, _ = np.asarray(xyz)[np.argmax(beyond)].tolist()
            raise InputError(f"{x:.12g}, {y:.12g} is no place in {self.name}")
        return geocentric(places, self.ellipsoid)

    def coordinates(self, xyz: Array) -> Array:
        """Return (n, 3) coordinates in the system of (n, 3) geocentric ones: the way back."""
        if self.kind == "geocentric":
            return xyz
        places = geodetic(xyz, self.ellipsoid)
        places[:, 2] /= self.height_m
        places[:, :2] /= self._unit
        if self.kind == "projected":
            places[:, 0], places[:, 1] = self._transformed(places, forward=False)
        return places

    def degrees(self, xyz: Array) -> Array:
        """Return (n, 3) longitude, latitude [degrees] and height [m] in the system's datum."""
        out = geodetic(self.geocentric(xyz), self.ellipsoid)
        out[:, :2] = np.degrees(out[:, :2])
        return out

    def shifted(self, degrees: Array, *, to_wgs84: bool) -> Array:
        """Return (n, 3) degrees between the system's datum and WGS84, without grids.

        As good as the transformation that pyproj has without files: centimetres to some metres.
        """
        if self.text == DEGREES or self.kind == "geocentric":
            return degrees
        turn = _turn(self.text, "world" if to_wgs84 else "datum")
        if turn is None:
            return degrees
        unit = np.degrees(self._unit)  # of the system's own degrees
        into, out_of = (1.0 / unit, 1.0) if to_wgs84 else (1.0, unit)
        x, y = turn.transform(degrees[:, 0] * into, degrees[:, 1] * into)
        moved = np.stack((np.asarray(x) * out_of, np.asarray(y) * out_of, degrees[:, 2]), axis=1)
        return np.where(np.isfinite(moved), moved, degrees)

    def units(self) -> tuple[str, str]:
        """Return the units of coordinates and of heights; "" of a rare one."""
        up = _LENGTHS.get(round(self.height_m, 9), "")
        if self.kind == "geographic":
            return _ANGLES.get(round(self._unit, 9), ""), up
        if self.kind == "geocentric":
            return "m", "m"
        return _LENGTHS.get(round(self._horizontal.axis_info[0].unit_conversion_factor, 9), ""), up

    def as_map(self) -> None:
        """Refuse what cannot be taken as it is: an offset frame has metres, east, north and up."""
        axes = self._horizontal.axis_info[:2] if self.kind == "projected" else ()
        metres = bool(axes) and all(axis.unit_conversion_factor == 1.0 for axis in axes)
        if not metres or self.height_m != 1.0:
            raise InputError(f"{self.name}: no map in metres; the frame must be local")
        if {axis.direction.lower() for axis in axes} != {"east", "north"}:
            raise InputError(f"{self.name}: not east and north; the frame must be local")

    def _transformed(self, places: Array, *, forward: bool) -> tuple[Array, Array]:
        turn = _turn(self.text, "degrees" if forward else "map")
        x, y = turn.transform(places[:, 0], places[:, 1])
        return np.asarray(x, dtype=float), np.asarray(y, dtype=float)


class GroundFrame(NamedTuple):
    """The way between a block's coordinates and those of its person's system.

    Attributes
    ----------
    system
        As block.toml states it.
    theirs
        The coordinate system.
    """

    system: GroundSystem
    theirs: CoordinateSystem

    @classmethod
    def of(cls, system: GroundSystem) -> GroundFrame:
        """Return it; raises InputError where the system is unknown, or pyproj is missing."""
        theirs = CoordinateSystem.of(system.crs)
        if system.frame == "offset":
            theirs.as_map()
        return cls(system, theirs)

    def into_block(self, xyz: Array) -> Array:
        """Return (n, 3) a block's coordinates of (n, 3) in the person's system."""
        if self.system.frame == "offset":
            return np.asarray(xyz - np.array(self.system.origin), dtype=np.float64)
        return self._local.local(self.theirs.geocentric(xyz))

    def out_of_block(self, xyz: Array) -> Array:
        """Return (n, 3) coordinates in the person's system of (n, 3) of the block."""
        if self.system.frame == "offset":
            return np.asarray(xyz + np.array(self.system.origin), dtype=np.float64)
        return self.theirs.coordinates(self._local.geocentric(xyz))

    def degrees(self, xyz: Array) -> Array:
        """Return (n, 3) longitude, latitude [degrees] and height [m] of WGS84."""
        if self.system.frame == "offset":
            there = self.theirs.degrees(self.out_of_block(xyz))
        else:
            there = geodetic(self._local.geocentric(xyz), self.theirs.ellipsoid)
            there[:, :2] = np.degrees(there[:, :2])
        return self.theirs.shifted(there, to_wgs84=True)

    @property
    def _local(self) -> LocalFrame:
        return LocalFrame.at(*self.system.origin, self.theirs.ellipsoid)


def local_system(text: str, degrees: tuple[float, float, float]) -> GroundSystem:
    """Return the local frame of a system at a place in WGS84 [degrees, m].

    Raises
    ------
    InputError
        No such system, or pyproj is missing.
    """
    theirs = CoordinateSystem.of(text)
    x, y, z = theirs.shifted(np.array([degrees], dtype=float), to_wgs84=False)[0].tolist()
    return GroundSystem(theirs.text, "local", (x, y, z))


def frame_around(theirs: CoordinateSystem, xyz: Array) -> GroundFrame:
    """Return the local frame in the middle of (n, 3) coordinates in a system, at round numbers.

    Raises
    ------
    InputError
        They are no places in it.
    """
    east, north, up = theirs.degrees(np.median(xyz, axis=0)[None])[0].tolist()
    origin = round(east, 5), round(north, 5), float(round(up))
    return GroundFrame(GroundSystem(theirs.text, "local", origin), theirs)


@lru_cache(maxsize=16)
def _system(text: str) -> CoordinateSystem:
    if text == DEGREES:  # what needs no pyproj
        return CoordinateSystem(
            text,
            "WGS 84",
            "geographic",
            WGS84,
            1.0,
            False,
            "",
            None,
            None,
            np.pi / 180.0,
        )
    pyproj = _pyproj()
    try:
        whole = pyproj.CRS.from_user_input(text)
        flat = whole.source_crs if whole.is_bound else whole
        parts = list(flat.sub_crs_list) if flat.is_compound else [flat]
        horizontal = parts[0].source_crs if parts[0].is_bound else parts[0]
        kinds = ("geographic", "projected", "geocentric")
        kind = next((kind for kind in kinds if getattr(horizontal, f"is_{kind}")), None)
        base, ellipsoid = horizontal.geodetic_crs, horizontal.ellipsoid
        if kind is None or ellipsoid is None or base is None:
            raise InputError(f"{quoted(text)}: neither degrees, nor a map, nor geocentric")
        # degrees, or grads: of the axes of what the map is made from
        unit = 1.0 if kind == "geocentric" else base.axis_info[0].unit_conversion_factor
        heights = parts[1].axis_info if len(parts) > 1 else horizontal.axis_info[2:3]
        height_m = heights[0].unit_conversion_factor if heights else 1.0
        inverse = ellipsoid.inverse_flattening
        flattening = 0.0 if not inverse else 1.0 / inverse
        return CoordinateSystem(
            text,
            plain(whole.name, 80),
            kind,
            Ellipsoid(float(ellipsoid.semi_major_metre), flattening),
            float(height_m),
            bool(heights),
            plain(parts[1].name, 80) if len(parts) > 1 else "",
            horizontal,
            base if kind == "projected" else None,
            float(unit),
        )
    except pyproj.exceptions.ProjError as error:
        raise InputError(f"no coordinate system {quoted(text)}: {reason(error)}") from None


@lru_cache(maxsize=32)
def _turn(text: str, to: Literal["degrees", "map", "world", "datum"]) -> Any:
    """Return pyproj's way from a map to its degrees or back, or from a datum to WGS84 or back.

    None where the datum is WGS84. It costs more to make than to walk, by the thousand.
    """
    pyproj, system = _pyproj(), _system(text)
    own = system._horizontal if system._base is None else system._base
    ends = (system._horizontal, own)
    if to in ("world", "datum"):
        ends = (own, pyproj.CRS.from_epsg(4326))
        if own.equals(ends[1]):
            return None
    if to in ("map", "datum"):
        ends = (ends[1], ends[0])
    return pyproj.Transformer.from_crs(*ends, always_xy=True)


def _pyproj() -> Any:
    """Return pyproj, kept from any network; raises InputError where it is not installed."""
    try:
        pyproj: Any = import_module("pyproj")
        network: Any = import_module("pyproj.network")
        import_module("pyproj.exceptions")
    except ImportError:
        raise InputError("coordinate systems need pyproj: pip install 'anaplot[crs]'") from None
    network.set_network_enabled(False)
    return pyproj
