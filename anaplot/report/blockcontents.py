"""What there is in a block, before anything is computed: photos, rays, points, control, cameras."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from anaplot.photogrammetry.block import Block, Camera
from anaplot.photogrammetry.imagepoints import columns_of
from anaplot.report.columns import counted
from anaplot.report.document import Answer, Line, named, say
from anaplot.textfiles.wording import plain

__all__ = ["BlockContents", "contents_answer", "contents_lines", "contents_of"]

_MOST_CAMERAS = 4
_TERMS = ("k1", "k2", "k3", "p1", "p2", "b1", "b2")


class CameraContents(NamedTuple):
    """A camera, and how many photos it took.

    Attributes
    ----------
    camera
        The camera.
    photos
        Their number.
    """

    camera: Camera
    photos: int

    @property
    def terms(self) -> list[str]:
        """Names of what its lens has."""
        lens = self.camera.lens
        values = () if lens is None else lens.coefficients
        return [name for name, value in zip(_TERMS, values, strict=False) if value]


class BlockContents(NamedTuple):
    """What there is in a block.

    Attributes
    ----------
    photos, oriented
        How many, and for how many of them approximate orientations are given.
    rays, off
        Rows of image_points.csv, and how many of them do not count at all.
    points, single
        Points with a ray that counts, and how many of them have one only.
    control, check, conditions
        How many there are.
    positions, angles
        Photos with a prior of their position, or of their angles.
    cameras
        Cameras that took a photo.
    in_pixels
        Whether coordinates are pixels.
    """

    photos: int
    oriented: int
    rays: int
    off: int
    points: int
    single: int
    control: int
    check: int
    conditions: int
    positions: int
    angles: int
    cameras: tuple[CameraContents, ...]
    in_pixels: bool

    @property
    def mean_rays(self) -> float | None:
        """Rays that count for each point; None without any."""
        return (self.rays - self.off) / self.points if self.points else None


def contents_of(block: Block) -> BlockContents:
    """Return what there is in a block."""
    rays = len(block.image_points)
    rays_of = columns_of(block.image_points).rays_of_points() if rays else []
    photos_of = Counter(photo.camera for photo in block.photos)
    return BlockContents(
        len(block.photos),
        sum(photo.position is not None and photo.rotation is not None for photo in block.photos),
        rays,
        rays - sum(rays_of),
        len(rays_of) - rays_of.count(0),
        rays_of.count(1),
        sum(row.use == "control" for row in block.control),
        sum(row.use == "check" for row in block.control),
        sum(row.use == "control" for row in block.conditions),
        sum(photo.position_sigma is not None for photo in block.photos),
        sum(photo.rotation_sigma is not None for photo in block.photos),
        tuple(CameraContents(c, photos_of[c.id]) for c in block.cameras if photos_of[c.id]),
        block.in_pixels,
    )


def contents_answer(found: BlockContents) -> Answer:
    """Return it for programs."""
    return {
        "photos": found.photos,
        "oriented": found.oriented,
        "rays": found.rays,
        "off": found.off,
        "points": found.points,
        "points_of_one_ray": found.single,
        "mean_rays": found.mean_rays,
        "control": found.control,
        "check": found.check,
        "conditions": found.conditions,
        "position_priors": found.positions,
        "rotation_priors": found.angles,
        "in_pixels": found.in_pixels,
        "cameras": [
            {
                "camera": one.camera.id,
                "photos": one.photos,
                "c": one.camera.c,
                "pixels": None if one.camera.pixels is None else list(one.camera.pixels),
                "pixel_um": one.camera.pixel_um,
                "lens": one.terms,
            }
            for one in found.cameras
        ],
    }


def contents_lines(found: BlockContents) -> list[Line]:
    """Return it for people."""
    lines = [
        say(
            "{}, {}, {} with {:.1f||no} rays each",
            counted(found.photos, "photo"),
            counted(found.rays, "ray"),
            counted(found.points, "point"),
            found.mean_rays,
        )
    ]
    if found.off:
        lines.append(say("  {} rays do not count (use = off)", found.off))
    if found.single:
        lines.append(say("  {} points have one ray: nothing comes of them", found.single))
    control = [
        counted(found.control, "control point") if found.control else "no control",
        *([counted(found.check, "check point")] if found.check else []),
        *([counted(found.conditions, "condition")] if found.conditions else []),
        *([f"priors of {counted(found.positions, 'position')}"] if found.positions else []),
        *([f"priors of the angles of {counted(found.angles, 'photo')}"] if found.angles else []),
    ]
    lines.append(say("{}", ", ".join(control)))
    lines.append(
        say(
            "measured in {}; approximate orientations of {} photos",
            "pixels" if found.in_pixels else "mm",
            "all" if found.oriented == found.photos else found.oriented,
        )
    )
    cameras = [_camera(one) for one in found.cameras]
    lines.append(say("cameras: {}", named(cameras, _MOST_CAMERAS, separator="; ")))
    return lines


def _camera(one: CameraContents) -> str:
    camera = one.camera
    parts = [
        f"{plain(camera.id, 40)}, {counted(one.photos, 'photo')}",
        f"c {camera.c / camera.pixel_mm:.1f} px" if camera.pixels else f"c {camera.c:g} mm",
    ]
    if camera.pixels:
        parts.append(f"{camera.pixels[0]} x {camera.pixels[1]} px")
    if camera.pixel_um is not None:
        parts.append(f"a pixel {camera.pixel_um:g} um")
    if one.terms:
        parts.append(f"lens {' '.join(one.terms)}")
    return ", ".join(parts)
