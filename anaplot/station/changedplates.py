"""That what makes image coordinates of plates was changed since some of them were measured."""

from __future__ import annotations

from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.blocktoml import parse_block_toml
from anaplot.exchange.journalbackwards import latest_records
from anaplot.exchange.recordline import OPENING
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.session.state import SessionState
from anaplot.station.payloads import opened_by
from anaplot.textfiles.wording import first_of, quoted

__all__ = ["told_changed_plates"]

_MOST = 6  # photos that are named


def told_changed_plates(folder: Path, block: Block, state: SessionState) -> str:
    """Return in a line what was changed since the block was open last, or "".

    Image coordinates that were measured stay as they are: people who type the certificate into the
    camera file after the first models would have two calibrations in one block, and not know it.

    Parameters
    ----------
    folder
        The block folder, whose journal is verified.
    block
        As its files declare it now.
    state
        To which the journal led.
    """
    current = () if state.current is None else (state.current,)
    photos = {p for model in (*state.models, *current) if model.measured for p in model.photos}
    before = _declared_before(folder) if photos else None
    if before is None:
        return ""
    known = {photo.id for photo in before.photos}
    changed: dict[str, list[str]] = {}
    for photo in sorted(photos & known):
        old, new = before.camera_of(photo), block.camera_of(photo)
        what = _differing(old.calibration, new.calibration)
        if what:
            changed.setdefault(f"{what} of camera {quoted(new.id)}", []).append(photo)
    if before.air != block.air:
        changed["refinement"] = sorted(photos)
    if not changed:
        return ""
    names = list(dict.fromkeys(photo for of in changed.values() for photo in of))
    those = first_of(names, _MOST) + (" photos" if len(names) > _MOST else "")
    return (
        f"{' and '.join(changed)}: changed since the block was open last; what was measured of "
        f"{those} stays as it is"
    )


def _declared_before(folder: Path) -> Block | None:
    """Return the block as its session was opened last; None where that cannot be told."""
    for record in latest_records(folder, OPENING):
        said = opened_by(record)
        if said.block_toml is None:
            continue
        try:
            path = Path(record.file).with_name("block.toml")
            return parse_block_toml(said.block_toml, path, said.camera_files)
        except InputError:
            return None
    return None


def _differing(old: CameraCalibration | None, new: CameraCalibration | None) -> str:
    """Return what of two calibrations makes other image coordinates of plates, or ""."""
    one, other = (c or CameraCalibration("", 1.0) for c in (old, new))
    parts = {
        "fiducials": ("fiducials", "distances"),
        "principal point": ("principal_point",),
        "distortion": ("radial", "decentring", "symmetry_point"),
    }
    differ = (
        words
        for words, keys in parts.items()
        if any(getattr(one, key) != getattr(other, key) for key in keys)
    )
    return ", ".join(differ)
