"""A COLMAP model from its source, without the rays that do not count; all else as it was."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anaplot.aliases import Bools
from anaplot.exchange.formats.colmapbinary import cleaned_images, cleaned_points
from anaplot.exchange.formats.colmapmodel import ColmapModel
from anaplot.exchange.formats.colmaprays import rays_of
from anaplot.exchange.formats.colmaptext import cleaned_image_lines, cleaned_point_lines
from anaplot.exchange.formats.door import Exported, Note
from anaplot.exchange.formats.filecopy import pieces
from anaplot.exchange.formats.measuredrays import TWICE, kept_names, measured_anew
from anaplot.photogrammetry.block import Block
from anaplot.textfiles.wholefile import create_folder

__all__ = ["write_cleaned"]

_FEWEST = 2  # rays of a point; COLMAP, too, takes a point out that keeps fewer
_SOME = 4


def write_cleaned(
    block: Block, model: ColmapModel, others: Sequence[Path], target: Path
) -> Exported:
    """Write a model whose tracks are without the rays that a block switches off.

    Parameters
    ----------
    block
        The block that was made of the model.
    model
        The model as it came in.
    others
        Further files of it, which are copied.
    target
        A new folder.

    Raises
    ------
    InputError
        A file is there already or cannot be written; then nothing of it is there.
    """
    state, notes = _rays_off(model, block)
    taken, gone = _removed(model, state)
    of_image = {
        image.id: image.index[mask]
        for image, mask in zip(model.images, taken, strict=True)
        if mask.any()
    }
    of_point: dict[int, set[tuple[int, int]]] = {}
    for image, mask in zip(model.images, taken, strict=True):
        for point, index in zip(
            image.point[mask].tolist(), image.index[mask].tolist(), strict=True
        ):
            of_point.setdefault(point, set()).add((image.id, index))
    images, points = model.file("images"), model.file("points3D")
    files = [model.file("cameras"), images, points, *others]
    made = {path.name: pieces(path) for path in files}
    if of_image:
        binary = model.ending == ".bin"
        anew = cleaned_images if binary else cleaned_image_lines
        shorter = cleaned_points if binary else cleaned_point_lines
        made[images.name] = anew(images, of_image)
        made[points.name] = shorter(points, of_point, gone)
    written = create_folder(target, made.items())
    if gone:
        some = tuple(map(str, sorted(gone)[:_SOME]))
        notes.append(Note("dropped", len(gone), "points that keep fewer than two rays", some))
    return Exported(written, tuple(notes))


_STAYS, _GOES, _TWICE = 0, 1, 2


def _rays_off(model: ColmapModel, block: Block) -> tuple[list[Bools], list[Note]]:
    """Return which of every image's rays go, and what is said of it.

    A block in which nothing is off but what import found twice goes out as it came in.
    """
    rows = {(row.photo, row.point): row for row in block.image_points}
    found = rays_of(model, block.cameras[0].pixel_um, 1.0)
    names = kept_names(found.rays, found.camera_of)
    calls = iter(zip(names, found.rays.xy.tolist(), strict=True))
    state = [np.zeros(len(image.point), dtype=np.int8) for image in model.images]
    half = unknown = anew = 0
    for image, mine in zip(model.images, state, strict=True):
        if image.name not in found.camera_of:
            unknown += len(mine)
            continue
        for k, point in enumerate(image.point.tolist()):
            name, (x, y) = next(calls)
            row = None if name is None else rows.get((image.name, name))
            if row is None:
                unknown += 1
            elif row.use == "off":
                again = name != str(point)
                mine[k] = _TWICE if again and row.reason == TWICE else _GOES
            elif row.use != "xy":
                half += 1
                mine[k] = _GOES
            elif measured_anew(row, x, y):
                anew += 1
    off = sum(int((mine == _GOES).sum()) for mine in state)
    twice = sum(int((mine == _TWICE).sum()) for mine in state)
    notes = []
    if off:
        notes.append(Note("dropped", off, "rays that do not count are in no track any more"))
    if half:
        text = "of them count in one coordinate: a track has no half rays"
        notes.append(Note("not held", half, text))
    if twice and off:
        notes.append(Note("dropped", twice, "rays of a point that its image has twice"))
    elif twice:
        text = "rays of a point that its image has twice stay: nothing else is switched off"
        notes.append(Note("doubled", twice, text))
        for mine in state:
            mine[:] = _STAYS
    if unknown:
        notes.append(Note("assumed", unknown, "rays that are not in the block stay as they were"))
    if anew:
        text = "rays measured anew: the model keeps the features' places"
        notes.append(Note("not held", anew, text))
    return [mine != _STAYS for mine in state], notes


def _removed(model: ColmapModel, taken: list[Bools]) -> tuple[list[Bools], set[int]]:
    """Return which rays go where points that keep fewer than two go as well, and these points."""
    if not any(mask.any() for mask in taken):
        return taken, set()
    point = np.concatenate([image.point for image in model.images])
    mask = np.concatenate(taken)
    touched = np.unique(point[mask])
    left, count = np.unique(point[~mask], return_counts=True)
    enough = left[count >= _FEWEST]
    gone = np.setdiff1d(touched, enough)
    whole = [
        mine | np.isin(image.point, gone) for image, mine in zip(model.images, taken, strict=True)
    ]
    return whole, set(gone.tolist())
