"""The table [refinement] of a block.toml: what of air and earth is taken off image coordinates.

[refinement]
refraction = true            # of near vertical photographs; false when left out
earth_curvature = false      # where ground coordinates are those of a map
flying_height = 1900.0       # m above sea level
ground_height = 200.0        # m above sea level, of the ground on the average

It acts where plates become image coordinates: in the console, and in `anaplot inner --apply`.
"""

from __future__ import annotations

from collections.abc import Iterable

from anaplot.photogrammetry.airandearth import HIGHEST, LOWEST, AirAndEarth
from anaplot.photogrammetry.block import Camera
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.textfiles.kinds import FLAG, Fields, Number
from anaplot.textfiles.tomltable import TomlTable
from anaplot.textfiles.tomltext import toml_number
from anaplot.textfiles.wording import quoted

__all__ = ["air_lines", "read_air"]

_HEIGHT = Number(LOWEST, HIGHEST)
_FLAGS: Fields = {"refraction": FLAG, "earth_curvature": FLAG}
_HEIGHTS: Fields = {"flying_height": _HEIGHT, "ground_height": _HEIGHT}


def read_air(
    table: TomlTable, cameras: Iterable[Camera], ground: GroundSystem | None
) -> AirAndEarth | None:
    """Return what a table [refinement], or an empty one, takes off; None where it is nothing.

    Parameters
    ----------
    table
        The table.
    cameras, ground
        Of the block.

    Raises
    ------
    InputError
        What is wrong, with file, line and key.
    """
    found = table.take({}, {**_FLAGS, **_HEIGHTS})
    asked = [flag for flag in _FLAGS if found.get(flag)]
    if asked:
        for height in _HEIGHTS:
            if height not in found:
                raise table.fail(f"{asked[0]} without {height} [m above sea level]", asked[0])
    if len(found.keys() & _HEIGHTS) == 2 and not found["flying_height"] > found["ground_height"]:
        raise table.fail("must be above ground_height", "flying_height")
    if not asked:
        return None
    without = next((camera for camera in cameras if camera.calibration is None), None)
    if without is not None:
        raise table.fail(
            f"camera {quoted(without.id)} has no file: its plates are taken for image coordinates"
        )
    if "earth_curvature" in asked and ground is not None and ground.frame == "local":
        raise table.fail(
            'the earth is curved in [ground] frame = "local" already', "earth_curvature"
        )
    return AirAndEarth(**found)


def air_lines(air: AirAndEarth | None) -> list[str]:
    """Return the lines of a table [refinement]; none where nothing is taken off."""
    if air is None:
        return []
    return [
        "",
        "[refinement]",
        f"refraction = {str(air.refraction).lower()}",
        f"earth_curvature = {str(air.earth_curvature).lower()}",
        f"flying_height = {toml_number(air.flying_height)}",
        f"ground_height = {toml_number(air.ground_height)}",
    ]
