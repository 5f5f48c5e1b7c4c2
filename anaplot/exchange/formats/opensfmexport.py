"""An OpenSfM model written again without the rays that do not count."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.boundedjson import read_json
from anaplot.exchange.formats.door import ControlResult, Exported, Exporting, Note
from anaplot.exchange.formats.gcplist import GCP_LIST, read_gcp_list
from anaplot.exchange.formats.measuredrays import TWICE
from anaplot.exchange.formats.opensfmmodel import TrackRow, track_rows
from anaplot.exchange.formats.sourcelines import source_lines
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wholefile import all_or_nothing, create_whole, make_folder
from anaplot.textfiles.wording import place

__all__ = ["write_cleaned"]

_RECONSTRUCTION, _TRACKS, _REFERENCE = "reconstruction.json", "tracks.csv", "reference_lla.json"
_MAX_BYTES = 500_000_000


def write_cleaned(exporting: Exporting, model: Path, project: Path) -> Exported:
    """Write a model from the block's `source/`.

    Parameters
    ----------
    exporting
        The block.
    model
        The new folder of reconstruction.json and tracks.csv.
    project
        That of gcp_list.txt.

    Raises
    ------
    InputError
        The block was not imported from OpenSfM, or something cannot be written: then nothing is.
    """
    source = exporting.folder / "source"
    for name in (_RECONSTRUCTION, _TRACKS):
        if not (source / name).is_file():
            raise InputError(f"{place(source / name)}: not there: the block is not from OpenSfM")
    block = exporting.block
    written: list[Path] = []
    notes: list[Note] = []
    with all_or_nothing():
        make_folder(model)
        make_folder(project)

        def put(path: Path, data: bytes | Iterator[bytes]) -> None:
            create_whole(path, data)
            written.append(path)

        rays = _Rays(block)
        put(model / _TRACKS, rays.lines(source / _TRACKS))
        gone = rays.lost()
        data = read_bytes(source / _RECONSTRUCTION, _MAX_BYTES)
        if gone:
            data = _without_points(source / _RECONSTRUCTION, block, gone)
        put(model / _RECONSTRUCTION, data)
        if (source / _REFERENCE).is_file():
            put(model / _REFERENCE, read_bytes(source / _REFERENCE, _MAX_BYTES))
        if rays.removed:
            notes.append(Note("dropped", rays.removed, "rays that do not count, from tracks.csv"))
        if gone:
            text = "points of reconstruction.json with less than two rays left"
            notes.append(Note("dropped", len(gone), text, tuple(sorted(gone))[:4]))
        halves = sum(row.use in ("x", "y") for row in block.image_points)
        if halves:
            text = "rays of which one coordinate counts: the whole ray is left out"
            notes.append(Note("not held", halves, text))
        if (source / GCP_LIST).is_file():
            results = () if exporting.adjusted is None else exporting.adjusted.control
            text, more = _gcp_text(source / GCP_LIST, block, results)
            put(project / GCP_LIST, text.encode())
            notes += more
        text = "poses and points are those of the source, not the adjusted ones"
        notes.append(Note("not held", None, text))
    return Exported(tuple(written), tuple(notes))


def _base(row: ImagePoint) -> str:
    """Return the track of a ray that stands a second time in its photo."""
    return row.point.rsplit("~", 1)[0] if row.reason == TWICE else row.point


class _Rays:
    """Goes through tracks.csv and leaves out what does not count."""

    def __init__(self, block: Block) -> None:
        off: Counter[tuple[str, str, float, float]] = Counter()
        counts: Counter[tuple[str, str, float, float]] = Counter()
        self._sizes = {}
        for photo in block.photos:
            width, height = block.camera_of(photo.id).pixels or (0, 0)
            self._sizes[photo.id] = (float(max(width, height)), 0.5 * width, 0.5 * height)
        for row in block.image_points:
            if row.measured is not None:
                key = (row.photo, _base(row), *row.measured)
                (counts if row.use == "xy" else off)[key] += 1
        self._off, self._counts = off, counts
        self._left: Counter[str] = Counter()
        self._touched: set[str] = set()
        self.removed = 0

    def lines(self, path: Path) -> Iterator[bytes]:
        """Yield the lines that stay."""
        for row in track_rows(path):
            if not isinstance(row, TrackRow):
                yield row.text.encode() + b"\n"
            elif self._stays(row):
                self._left[row.track] += row.image in self._sizes
                yield row.line.text.encode() + b"\n"
            else:
                self.removed += 1
                self._touched.add(row.track)

    def _stays(self, row: TrackRow) -> bool:
        size = self._sizes.get(row.image)
        if size is None:
            return True
        x, y = row.at()
        key = (row.image, row.track, x * size[0] + size[1], y * size[0] + size[2])
        if key not in self._off:
            return True
        # of equal ones the first are those that count
        self._counts[key] -= 1
        return self._counts[key] >= 0

    def lost(self) -> set[str]:
        """Return the tracks that were touched and have less than two rays left."""
        return {track for track in self._touched if self._left[track] < 2}


def _without_points(path: Path, block: Block, gone: set[str]) -> bytes:
    """Return the reconstructions, that of the block without some points."""
    found = read_json(path)
    photos = {photo.id for photo in block.photos}
    for one in found.elements():
        if photos <= {name for name, _ in one.get("shots").items()}:
            points = one.get("points").value
            for name in gone & points.keys():
                del points[name]
            break
    return json.dumps(found.value, ensure_ascii=False, indent=4).encode()


def _gcp_text(
    path: Path, block: Block, results: tuple[ControlResult, ...]
) -> tuple[str, tuple[Note, ...]]:
    """Return gcp_list.txt with the verdict behind each line; what does not count is a remark."""
    listed = read_gcp_list(path, {photo.id for photo in block.photos})
    by_line = {
        row.line.number: (row, name) for row, name in zip(listed.rows, listed.names(), strict=True)
    }
    known = {
        (row.photo, *row.measured): row for row in block.image_points if row.measured is not None
    }
    verdicts = {one.point: one for one in results}
    off = {row.point for row in block.control if row.use == "off"}
    lines, left_out = [], 0
    for line in source_lines(path):
        text = line.text
        if line.number in by_line:
            row, name = by_line[line.number]
            ray = known.get((row.image, *row.pixel))
            point = name if ray is None else _base(ray)
            if ray is None or ray.use != "xy" or point in off:
                left_out += 1
                lines.append(f"# off: {text}")
                continue
            named = "" if row.name is not None else f" {name}"
            text = f"{text.rstrip()}{named}{_verdict(verdicts.get(point))}"
        lines.append(text)
    notes = []
    if left_out:
        text = "measurements of control that do not count: behind # off: in gcp_list.txt"
        notes.append(Note("dropped", left_out, text))
    if results:
        text = "verdict, r in plan and r in height stand behind every line of gcp_list.txt"
        notes.append(Note("changed", None, text))
    return "\n".join(lines) + "\n", tuple(notes)


def _verdict(found: ControlResult | None) -> str:
    if found is None:
        return ""
    r = ["-" if value is None else f"{value:.2f}" for value in (found.r_plan, found.r_height)]
    return f" {found.verdict} r_plan={r[0]} r_height={r[1]}"
