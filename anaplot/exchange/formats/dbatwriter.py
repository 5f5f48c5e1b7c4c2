"""A block as DBAT's tables, with the script that reads them."""

from __future__ import annotations

from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.formats.door import Exported, Exporting, Note
from anaplot.exchange.formats.gathered import not_held, rays_that_count
from anaplot.exchange.formats.pixeltables import CONTROL_COLUMNS, IMAGE_COLUMNS, NAME_COLUMNS
from anaplot.exchange.formats.xmlstream import xml_text
from anaplot.photogrammetry.block import Block, Camera
from anaplot.photogrammetry.measuredimage import measured_places
from anaplot.textfiles.wholefile import create_folder
from anaplot.textfiles.wording import quoted

__all__ = ["write_dbat"]

_MIDDLE = 0.5  # 1, 1 is the middle of the upper left pixel


def write_dbat(exporting: Exporting, target: Path) -> Exported:
    """Write a block; all of it, or nothing.

    Raises
    ------
    InputError
        The block is not in pixels, has several cameras or a lens, a point or a control coordinate
        that the tables have no place for, or a file cannot be written.
    """
    block = exporting.block
    camera = _camera(block)
    rays, notes = rays_that_count(block)
    holds = ("check", "image sigmas", "control sigmas", "lens", "image_um", "control_m")
    notes += not_held(block, holds=holds)
    if any(photo.rotation is not None for photo in block.photos):
        notes.append(Note("not held", None, "approximate orientations"))
    numbers = {photo.id: k for k, photo in enumerate(block.photos, 1)}
    um = 1000.0 * camera.pixel_mm
    lines = ["# id, image, x, y, sxy"]
    places = measured_places(block, rays, pixels=True)
    for row, (x, y) in zip(rays, places.tolist(), strict=True):
        sigma = (row.sigma_um or block.precision.image_um) / um
        at = f"{x + _MIDDLE!r}, {y + _MIDDLE!r}, {sigma!r}"
        lines.append(f"{_number(row.point)}, {numbers[row.photo]}, {at}")
    made = {
        "images.txt": ["# id, path", *(f"{k}, {_path(name)}" for name, k in numbers.items())],
        "imagepts.txt": lines,
    }
    for use in ("control", "check"):
        rows = _control(block, use)
        if rows:
            made[f"{use}.txt"] = [f"# {', '.join(CONTROL_COLUMNS)}", *rows]
    made[f"{target.name}.xml"] = _script(block, camera, list(made))
    files = ((name, ("\n".join(content) + "\n").encode()) for name, content in made.items())
    return Exported(create_folder(target, files), tuple(notes))


def _camera(block: Block) -> Camera:
    camera = block.cameras[0]
    if len(block.cameras) > 1:
        raise InputError(f"{len(block.cameras)} cameras: these tables have one")
    if camera.pixels is None:
        raise InputError(f"camera {quoted(camera.id)} has no pixels, which these tables need")
    if camera.lens is not None and any(camera.lens.coefficients):
        raise InputError(f"camera {quoted(camera.id)} has a lens, which is not written")
    return camera


def _number(point: str) -> str:
    if not (point.isascii() and point.isdecimal()):
        raise InputError(f"point {quoted(point)}: points of DBAT are whole numbers")
    return point


def _path(name: str) -> str:
    if "," in name or name.startswith("#"):
        raise InputError(f"photo {quoted(name)} holds a comma or begins with #")
    return name


def _control(block: Block, use: str) -> list[str]:
    rows = []
    for row in block.control:
        if row.use != use:
            continue
        if any(value is None for value in row.xyz):
            raise InputError(
                f"control point {quoted(row.point)}: DBAT knows X, Y and Z, or nothing"
            )
        values = [*row.xyz, *block.sigma_of(row)]
        rows.append(f"{_number(row.point)}, , {', '.join(repr(value) for value in values)}")
    return rows


def _script(block: Block, camera: Camera, files: list[str]) -> list[str]:
    width, height = camera.pixels or (0, 0)
    mm = camera.pixel_mm
    px, py = camera.principal_px or (width / 2.0, height / 2.0)

    def table(element: str, file: str, columns: tuple[str, ...]) -> list[str]:
        if file not in files:
            return []
        return [f'    <{element}><file format="{",".join(columns)}">{file}</file></{element}>']

    return [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<document dbat_script_version="1.0">',
        f"  <meta><name>{xml_text(block.name)}</name></meta>",
        '  <input base_dir="$HERE">',
        *table("ctrl_pts", "control.txt", CONTROL_COLUMNS),
        *table("check_pts", "check.txt", CONTROL_COLUMNS),
        *table("images", "images.txt", NAME_COLUMNS),
        *table("image_pts", "imagepts.txt", IMAGE_COLUMNS),
        "    <cameras>",
        "      <camera>",
        f"        <name>{xml_text(camera.id)}</name>",
        "        <unit>mm</unit>",
        f"        <sensor>{width * mm!r},{height * mm!r}</sensor>",
        f"        <image>{width},{height}</image>",
        f"        <cc>{camera.c!r}</cc>",
        f"        <pp>{(px + _MIDDLE) * mm!r},{(py + _MIDDLE) * mm!r}</pp>",
        "        <K>0,0,0</K>",
        "        <P>0,0</P>",
        "        <model>3</model>",
        "        <skew>0</skew>",
        "        <aspect>1</aspect>",
        "      </camera>",
        "    </cameras>",
        "  </input>",
        "  <operations>",
        "    <operation>spatial_resection</operation>",
        "    <operation>forward_intersection</operation>",
        "    <operation>bundle_adjustment</operation>",
        "  </operations>",
        "</document>",
    ]
