"""An OpenSfM model written again without the rays that do not count."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from anaplot.exchange.formats.boundedjson import read_json
from anaplot.exchange.formats.door import SOURCE, ControlResult, Exported, Exporting, Note, What
from anaplot.exchange.formats.gcplist import GCP_LIST, read_gcp_list
from anaplot.exchange.formats.measuredrays import MeasuredRay, measured_anew
from anaplot.exchange.formats.opensfmmodel import TrackRow, track_rows
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.photogrammetry.block import Block
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wholefile import all_or_nothing, create_whole, make_folder

__all__ = ["SourceRays", "write_cleaned"]

_RECONSTRUCTION, _TRACKS, _REFERENCE = "reconstruction.json", "tracks.csv", "reference_lla.json"
_MAX_BYTES = 500_000_000


class SourceRays(NamedTuple):
    """The rays of a model, and what import calls their points.

    Attributes
    ----------
    photos, points
        Of which rays are brought in.
    rays, names
        Those of tracks.csv in its order, and their points in the block; None of one that import
        leaves out.
    control, control_names
        The same of the measurements in gcp_list.txt: the point, and what a ray of it is called.
    """

    photos: frozenset[str]
    points: frozenset[str]
    rays: list[MeasuredRay]
    names: list[str | None]
    control: list[str]
    control_names: list[str | None]


def write_cleaned(exporting: Exporting, found: SourceRays, model: Path, project: Path) -> Exported:
    """Write a model from the block's `source/`.

    Parameters
    ----------
    exporting
        The block.
    found
        The rays of that model.
    model
        The new folder of reconstruction.json and tracks.csv.
    project
        That of gcp_list.txt.

    Raises
    ------
    InputError
        Something cannot be read or written: then nothing is.
    """
    source = exporting.folder / SOURCE
    block = exporting.block
    written: list[Path] = []
    notes: list[Note] = []
    with all_or_nothing():
        make_folder(model)
        make_folder(project)

        def put(path: Path, data: bytes | Iterator[bytes]) -> None:
            create_whole(path, data)
            written.append(path)

        rays = _Rays(block, found)
        put(model / _TRACKS, rays.lines(source / _TRACKS))
        gone = rays.lost()
        data = read_bytes(source / _RECONSTRUCTION, _MAX_BYTES)
        if gone:
            data = _without_points(source / _RECONSTRUCTION, block, gone)
        put(model / _RECONSTRUCTION, data)
        if (source / _REFERENCE).is_file():
            put(model / _REFERENCE, read_bytes(source / _REFERENCE, _MAX_BYTES))
        notes += rays.notes()
        if gone:
            text = "points of reconstruction.json with less than two rays left"
            notes.append(Note("dropped", len(gone), text, tuple(sorted(gone))[:4]))
        halves = sum(row.use in ("x", "y") for row in block.image_points)
        if halves:
            text = "rays of which one coordinate counts: the whole ray is left out"
            notes.append(Note("not held", halves, text))
        if (source / GCP_LIST).is_file():
            results = () if exporting.adjusted is None else exporting.adjusted.control
            text, more = _gcp_text(source / GCP_LIST, block, found, results)
            put(project / GCP_LIST, text.encode())
            notes += more
        text = "poses and points are those of the source, not the adjusted ones"
        notes.append(Note("not held", None, text))
    return Exported(tuple(written), tuple(notes))


class _Rays:
    """Goes through tracks.csv and leaves out what does not count."""

    def __init__(self, block: Block, found: SourceRays) -> None:
        self._rows = {(row.photo, row.point): row for row in block.image_points}
        self._photos = {photo.id for photo in block.photos}
        self._found = found
        self._next = 0
        self._left: Counter[str] = Counter()
        self._touched: set[str] = set()
        self._removed = self._unknown = self._anew = 0

    def lines(self, path: Path) -> Iterator[bytes]:
        """Yield the lines that stay."""
        for row, line in zip(track_rows(path), _as_they_stand(path), strict=True):
            if not isinstance(row, TrackRow):
                yield line.text.encode()
            elif self._stays(row):
                self._left[row.track] += row.image in self._photos
                yield line.text.encode()
            else:
                self._removed += 1
                self._touched.add(row.track)

    def _stays(self, row: TrackRow) -> bool:
        found = self._found
        if row.image not in found.photos or row.track not in found.points:
            return True
        ray, name = found.rays[self._next], found.names[self._next]
        self._next += 1
        if name is None:
            return True
        mine = self._rows.get((row.image, name))
        if mine is None:
            self._unknown += 1
            return True
        if mine.use == "xy":
            self._anew += measured_anew(mine, ray.x, ray.y)
        return mine.use == "xy"

    def lost(self) -> set[str]:
        """Return the tracks that were touched and have less than two rays left."""
        return {track for track in self._touched if self._left[track] < 2}

    def notes(self) -> list[Note]:
        """Return what became of the rays."""
        told: tuple[tuple[What, int, str], ...] = (
            ("dropped", self._removed, "rays that do not count, from tracks.csv"),
            ("assumed", self._unknown, "rays that are not in the block stay as they were"),
            ("not held", self._anew, "rays measured anew: tracks.csv keeps the feature's place"),
        )
        return [Note(what, count, text) for what, count, text in told if count]


def _as_they_stand(path: Path) -> Iterator[SourceLine]:
    """Yield the lines of a file with their ends, the first also with its byte order mark."""
    return source_lines(path, encoding="utf-8", ends=True)


def _without_points(path: Path, block: Block, gone: set[str]) -> bytes:
    """Return the reconstructions, that of the block without some points."""
    found = read_json(path)
    photos = {photo.id for photo in block.photos}
    for one in found.elements():
        if photos <= one.get("shots").names():
            points = one.get("points").value
            for name in gone & points.keys():
                del points[name]
            break
    return json.dumps(found.value, ensure_ascii=False, indent=4).encode()


def _gcp_text(
    path: Path, block: Block, found: SourceRays, results: tuple[ControlResult, ...]
) -> tuple[str, list[Note]]:
    """Return gcp_list.txt with the verdict behind each line; what does not count is a remark."""
    listed = read_gcp_list(path, found.photos)
    by_line = {
        one[0].line.number: one
        for one in zip(listed.rows, listed.names(), found.control, found.control_names, strict=True)
    }
    rays = {(row.photo, row.point): row for row in block.image_points}
    verdicts = {one.point: one for one in results}
    off = {row.point for row in block.control if row.use == "off"}
    lines, left_out, anew = [], 0, 0
    for line in _as_they_stand(path):
        text = line.text.rstrip("\r\n")
        end = line.text[len(text) :]
        if line.number in by_line:
            row, name, point, kept = by_line[line.number]
            ray = None if kept is None else rays.get((row.image, kept))
            if ray is None or ray.use != "xy" or point in off:
                left_out += 1
                lines.append(f"# off: {text}{end}")
                continue
            if ray.measured is not None and measured_anew(ray, *row.pixel):
                anew += 1
                words = text.split(maxsplit=5)
                text = " ".join((*words[:3], *map(repr, ray.measured), words[5]))
            named = "" if row.name is not None else f" {name}"
            text = f"{text.rstrip()}{named}{_verdict(verdicts.get(point))}"
        lines.append(text + end)
    notes = []
    if left_out:
        text = "measurements of control that do not count: behind # off: in gcp_list.txt"
        notes.append(Note("dropped", left_out, text))
    if anew:
        text = "measurements of control anew: gcp_list.txt has the new pixels"
        notes.append(Note("changed", anew, text))
    if results:
        text = "verdict, r in plan and r in height stand behind every line of gcp_list.txt"
        notes.append(Note("changed", None, text))
    return "".join(lines), notes


def _verdict(found: ControlResult | None) -> str:
    if found is None:
        return ""
    r = ["-" if value is None else f"{value:.2f}" for value in (found.r_plan, found.r_height)]
    return f" {found.verdict} r_plan={r[0]} r_height={r[1]}"
