"""What a journal's header says of a session."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from anaplot.exchange.blocktoml import camera_texts, format_block_toml
from anaplot.orientation.ownpattern import PointPattern
from anaplot.photogrammetry.block import Block
from anaplot.plotter.decoder import RULES
from anaplot.station.instrument import Instrument
from anaplot.station.pointpattern import pattern_points

__all__ = ["session_header"]

_LARGEST_DECLARATION = 200_000  # characters of block.toml that the journal's header repeats


def session_header(
    block: Block,
    operator: str,
    instrument: Instrument | None,
    story: str = "",
    point_pattern: PointPattern | None = None,
) -> dict[str, Any]:
    """Return the header: block as declared, operator, pattern, profile and line, what for."""
    header: dict[str, Any] = {"block": block.name, "operator": operator}
    if story:
        header["story"] = story
    declared = format_block_toml(block)
    cameras = camera_texts(block)
    if len(declared) + sum(map(len, cameras.values())) <= _LARGEST_DECLARATION:
        # the session can be replayed whatever becomes of the folder
        header["block_toml"] = declared
        if cameras:
            header["camera_files"] = cameras
    if point_pattern is not None:
        header["pattern"] = point_pattern.name
        points = pattern_points(point_pattern)
        if points is not None:
            # what was planned by it is understood whatever becomes of its file
            header["pattern_points"] = [list(point) for point in points]
    if instrument is not None:
        profile = instrument.profile
        header |= {
            "profile": profile.id,
            "profile_sha256": profile.sha256,
            # a replay needs the profile and the rules of the day, not those it meets
            "profile_text": profile.text,
            "rules": RULES,
            # where a simulated device is found says nothing, another time it is elsewhere
            "port": "simulated" if instrument.simulated else instrument.port,
            "links": {name: asdict(line) for name, line in profile.links.items()},
            "simulated": instrument.simulated,
        }
    return header
