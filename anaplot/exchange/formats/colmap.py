"""COLMAP models, binary and text: in as a block in pixels, out as the model that came in, cleaned.

A model without a source, of a block that came from elsewhere, is made of its adjusted orientations
(`anaplot/exchange/formats/colmapnew.py`).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.errors import InputError
from anaplot.exchange.formats.colmapbinary import binary_model
from anaplot.exchange.formats.colmapexport import write_cleaned
from anaplot.exchange.formats.colmapmodel import (
    PARTS,
    ColmapImage,
    ColmapModel,
    Complain,
    checked,
)
from anaplot.exchange.formats.colmapnew import write_new
from anaplot.exchange.formats.colmaprays import rays_of
from anaplot.exchange.formats.colmaptext import text_model
from anaplot.exchange.formats.door import (
    SOURCE,
    Exported,
    Exporting,
    Imported,
    ImportOptions,
    Note,
)
from anaplot.exchange.formats.measuredrays import image_points_of
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.photogrammetry.rotation import rotation_angles
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wording import place, quoted

__all__ = ["model_folder", "pose_of", "read", "read_model", "recognises", "write"]

_UNREAD = ("rigs", "frames")  # every image has its pose in images.bin
_UP = np.array([1.0, -1.0, -1.0])  # from our camera axes to x right, y down, z forward
_SOME = 4


def recognises(source: Path) -> bool:
    """Return whether a folder holds a model, or a project whose sparse/0 does."""
    return _found(source) is not None


def _found(source: Path) -> tuple[Path, str] | None:
    for folder in (source, source / "sparse" / "0", source / "sparse", source / "0"):
        for ending in (".bin", ".txt"):
            try:
                if all((folder / f"{part}{ending}").is_file() for part in PARTS):
                    return folder, ending
            except (OSError, ValueError):
                continue
    return None


def model_folder(source: Path) -> tuple[Path, str]:
    """Return the folder of a model and the ending of its files.

    Raises
    ------
    InputError
        There is none.
    """
    found = _found(source)
    if found is None:
        wanted = ", ".join(f"{part}.bin" for part in PARTS)
        raise InputError(f"{place(source)}: no COLMAP model: {wanted} (or .txt), all three")
    return found


def read_model(folder: Path, ending: str) -> ColmapModel:
    """Read a model; raises InputError that names the file and what is wrong there."""
    model = binary_model(folder) if ending == ".bin" else text_model(folder)

    def where(part: str) -> Complain:
        return lambda message: InputError(f"{place(model.file(part))}: {message}")

    return checked(model, where)


def pose_of(image: ColmapImage) -> tuple[Array, Array]:
    """Return an image's projection centre (3,) and our rotation (3, 3), image to object."""
    w, x, y, z = np.array(image.pose[:4]) / np.abs(image.pose[:4]).max()
    w, x, y, z = np.array([w, x, y, z]) / math.sqrt(w * w + x * x + y * y + z * z)
    to_camera = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return -to_camera.T @ np.array(image.pose[4:]), to_camera.T * _UP


def read(source: Path, options: ImportOptions) -> Imported:
    """Read a model as a block in pixels.

    Raises
    ------
    InputError
        A file is missing or damaged, or its parts do not fit each other.
    """
    folder, ending = model_folder(source)
    model = read_model(folder, ending)
    notes = _assumed(source, model, options)
    oriented = [image for image in model.images if image.oriented]
    used = [image for image in oriented if len(image.point)]
    for what, left_out in (
        ("images without a pose", [one for one in model.images if not one.oriented]),
        ("images that see no point", [one for one in oriented if not len(one.point)]),
    ):
        if left_out:
            names = tuple(one.name for one in left_out[:_SOME])
            notes.append(Note("dropped", len(left_out), what, names))
    sigma_um = _pixel_um(options) * (1.0 if options.sigma_px is None else options.sigma_px)
    cameras, camera_of, rays, told = rays_of(model, options.pixel_um, sigma_um)
    notes += told
    if not len(rays):
        raise InputError(f"{place(model.file('images'))}: no image with a pose sees a point")
    points, told_of_rays = image_points_of(rays, camera_of, pixels=True)
    notes += told_of_rays
    if not points:
        raise InputError(f"{place(model.file('images'))}: no ray lies in its image")
    block = Block(
        _name(folder),
        Precision(sigma_um, "exact"),
        TestSettings("tau"),
        cameras,
        tuple(_photo(image, camera_of[image.name], model) for image in used),
        (),
        points,
        in_pixels=True,
    )
    files = [*PARTS, *(part for part in _UNREAD if model.file(part).is_file())]
    kept = {f"{part}{ending}": model.file(part) for part in files}
    return Imported(block, tuple(notes), _comments(source, model, block), kept)


def write(exporting: Exporting, target: Path) -> Exported:
    """Write a model into a new folder: the source's, cleaned, or a new one; all of it or nothing.

    Raises
    ------
    InputError
        The source cannot be read, or the block cannot be held.
    """
    source = exporting.folder / SOURCE
    found = _found(source)
    if found is None:
        _refuse_half(source)
        return write_new(exporting, target)
    model = read_model(*found)
    others = [model.file(part) for part in _UNREAD if model.file(part).is_file()]
    return write_cleaned(exporting.block, model, others, target)


def _refuse_half(source: Path) -> None:
    for ending in (".bin", ".txt"):
        missing = [
            f"{part}{ending}" for part in PARTS if not (source / f"{part}{ending}").is_file()
        ]
        if len(missing) < len(PARTS):
            raise InputError(
                f"{place(source)}: the COLMAP model that the block came from has lost "
                f"{' and '.join(missing)}; without this folder the block is adjusted and a new "
                "model written"
            )


def _pixel_um(options: ImportOptions) -> float:
    return 1.0 if options.pixel_um is None else options.pixel_um


def _name(folder: Path) -> str:
    """Return a block's name from where the model lies: its project's."""
    for part in reversed(folder.absolute().parts[1:]):
        if part != "sparse" and not part.isdigit() and name_fault(part) is None:
            return part
    return "colmap"


def _assumed(source: Path, model: ColmapModel, options: ImportOptions) -> list[Note]:
    out = []
    other = ".txt" if model.ending == ".bin" else ".bin"
    if all((model.folder / f"{part}{other}").is_file() for part in PARTS):
        out.append(Note("assumed", None, f"*{model.ending} is meant, *{other} is not read"))
    if model.folder == source / "sparse" / "0" and (source / "sparse" / "1").is_dir():
        out.append(Note("assumed", None, "sparse/0 is meant, other models in sparse are not read"))
    if options.sigma_px is None:
        out.append(Note("assumed", None, "one pixel as a-priori sigma (--sigma-px)"))
    out.append(Note("assumed", None, "COLMAP's unit of length as 1 m, its poses as approximate"))
    told = _ordered(model.track_images, model.track_index, model.track_points)
    none = np.empty(0, np.intp)
    seen = _ordered(
        np.concatenate([none, *(np.full(len(one.index), one.id) for one in model.images)]),
        np.concatenate([none, *(one.index for one in model.images)]),
        np.concatenate([none, *(one.point for one in model.images)]),
    )
    if told.shape != seen.shape or (told != seen).any():
        differ = set(map(tuple, told.tolist())) ^ set(map(tuple, seen.tolist()))
        text = "rays that tracks and images tell differently: the images count"
        out.append(Note("assumed", len(differ), text))
    return out


def _ordered(images: Index, index: Index, points: Index) -> Index:
    """Return (n, 3) rays, sorted."""
    rays = np.stack((images, index, points), axis=1)
    return rays[np.lexsort(rays.T)]


def _photo(image: ColmapImage, camera: Camera, model: ColmapModel) -> Photo:
    centre, rotation = pose_of(image)
    if not np.isfinite(centre).all():
        raise InputError(f"{place(model.file('images'))}: image {quoted(image.name)}: lies nowhere")
    x, y, z = centre.tolist()
    return Photo(image.name, camera.id, (x, y, z), rotation_angles(rotation))


def _comments(source: Path, model: ColmapModel, block: Block) -> tuple[str, ...]:
    off = len(columns_of(block.image_points).with_use("off"))
    return (
        f"{block.name}: a COLMAP model, brought in from {source}",
        f"{len(block.photos)} of {len(model.images)} images, {len(model.points)} points, "
        f"{len(block.image_points)} rays, of which {off} do not count",
        "Points have COLMAP's numbers, cameras too; coordinates are pixels. source/ holds its",
        "files: anaplot export colmap takes out of them what use = off switches off here.",
        "There is no control: anaplot adjust BLOCK --datum free",
    )
