"""What passes through the door between a block and other programs' files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

from anaplot.photogrammetry.block import Block

__all__ = [
    "SOURCE",
    "AdjustedResult",
    "ControlResult",
    "ExportOptions",
    "Exported",
    "Exporting",
    "ImportOptions",
    "Imported",
    "Note",
    "PhotoResult",
    "PointResult",
    "ResultColumn",
    "ResultTable",
    "What",
]

SOURCE = "source"
"""Folder within a block's, of the files that it was imported from."""

What = Literal["assumed", "dropped", "joined", "doubled", "changed", "not held"]


@dataclass(frozen=True, slots=True)
class Note:
    """What was done on the way, told to the person.

    Attributes
    ----------
    what
        "assumed": nothing said so; "dropped": left out; "joined": several became one; "doubled": a
        point twice in a photo; "changed": numbers are not those of the file; "not held": the
        target has no place for it.
    count
        How many it concerns, or None where that is no number.
    text
        In words, without the number: "images without a pose". Names from files are made safe by
        whoever shows it.
    examples
        Names of some of them.
    """

    what: What
    count: int | None
    text: str
    examples: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """What a person states of a source; a format refuses what it has no use for.

    Attributes
    ----------
    sigma_px, sigma_um
        A-priori standard deviation of a measured coordinate [px] or [um].
    sigma_classes
        The same [um] by a class of the source's: the name of a group.
    unit
        Of image coordinates: "px", "mm" or "um".
    columns
        Names of columns in the source by ours.
    camera
        A camera file.
    c
        Camera constant [mm], or in pixels where there is no pixel size.
    pixels, pixel_um
        Width and height of the images [px], and the size of a pixel [um].
    crs
        Coordinate system of the ground, "EPSG:25832".
    control_m
        A-priori standard deviation of control that states none [m].
    position_m
        That of positions measured in flight [m], which become priors.
    order
        How something is ordered or turned that the source does not say; the format's own words.
    files
        Further files by what is in them: "control", "camera", "images" and the like.
    """

    sigma_px: float | None = None
    sigma_um: float | None = None
    sigma_classes: Mapping[str, float] = field(default_factory=dict)
    unit: Literal["px", "mm", "um"] | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    camera: Path | None = None
    c: float | None = None
    pixels: tuple[int, int] | None = None
    pixel_um: float | None = None
    crs: str | None = None
    control_m: float | None = None
    position_m: float | None = None
    order: str | None = None
    files: Mapping[str, Path] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Imported:
    """A block that was brought in.

    Attributes
    ----------
    block
        The block. What is measured in pixels has `ImagePoint.measured` and `Block.in_pixels`.
    notes
        What was assumed, dropped, joined, doubled or changed.
    comments
        Lines for people, without a mark, at the beginning of block.toml: what the block is and
        where it comes from.
    source
        Files to be kept beside the block, by their names under `source/`.
    """

    block: Block
    notes: tuple[Note, ...] = ()
    comments: tuple[str, ...] = ()
    source: Mapping[str, Path] = field(default_factory=dict)


class PhotoResult(NamedTuple):
    """A photo's adjusted exterior orientation [m, rad] and its standard deviations.

    Attributes
    ----------
    photo
        Name.
    position, position_sigma
        (3,) [m].
    rotation, rotation_sigma
        omega, phi, kappa [rad].
    rays
        How many of its rays count.
    redundancy
        Mean redundancy number of their coordinates; None without any.
    flagged
        How many of them the test flags.
    """

    photo: str
    position: tuple[float, float, float]
    position_sigma: tuple[float | None, float | None, float | None]
    rotation: tuple[float, float, float]
    rotation_sigma: tuple[float | None, float | None, float | None]
    rays: int
    redundancy: float | None
    flagged: int


class PointResult(NamedTuple):
    """An adjusted point.

    Attributes
    ----------
    point
        Name.
    xyz
        (3,) [m].
    covariance
        (3, 3) [m^2], rows of rows, with the sigma that the test says.
    rays
        How many of its rays count.
    redundancy
        Mean redundancy number of their coordinates; None without any.
    flagged
        How many of them the test flags.
    use
        "control", "check" or "tie".
    """

    point: str
    xyz: tuple[float, float, float]
    covariance: tuple[tuple[float, ...], ...]
    rays: int
    redundancy: float | None
    flagged: int
    use: str


class ControlResult(NamedTuple):
    """What an adjustment says of a control or check point.

    Attributes
    ----------
    point
        Name.
    use
        "control" or "check".
    r_plan, r_height
        Mean redundancy number of X, Y, and that of Z; None where there is none.
    verdict
        One word: "good", "look" (something is flagged), "weak" or "unchecked".
    """

    point: str
    use: str
    r_plan: float | None
    r_height: float | None
    verdict: str


class ResultColumn(NamedTuple):
    """A column of a table of results.

    Attributes
    ----------
    name
        As `--json` has it.
    unit
        Of its values, or empty.
    values
        Numbers, names, true and false, lists of names; None where there is none.
    """

    name: str
    unit: str
    values: tuple[Any, ...]


class ResultTable(NamedTuple):
    """A table of results.

    Attributes
    ----------
    name
        "photos", "points", "image_points", "control" or "check".
    columns
        In order, of one length.
    """

    name: str
    columns: tuple[ResultColumn, ...]


def _no_tables() -> tuple[ResultTable, ...]:
    return ()


@dataclass(frozen=True, slots=True)
class AdjustedResult:
    """What an adjustment says of a block, for formats that have a place for it.

    Attributes
    ----------
    photos, points
        In the order of the block's files.
    sigma0
        Estimated factor of the a-priori sigmas; None without redundancy.
    control
        Control and check points.
    tables
        Makes the tables of `adjust`, photos, points and image_points always among them.
    """

    photos: tuple[PhotoResult, ...]
    points: tuple[PointResult, ...]
    sigma0: float | None
    control: tuple[ControlResult, ...] = ()
    tables: Callable[[], tuple[ResultTable, ...]] = field(
        default=_no_tables, repr=False, compare=False
    )


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What a person asks of a target; a format refuses what it has no use for.

    Attributes
    ----------
    unit
        Of image coordinates: "px", "mm" or "um".
    order
        How something is ordered or turned; the format's own words.
    ellipses
        How many times as large as they are standard ellipses are drawn; None: not at all.
    """

    unit: Literal["px", "mm", "um"] | None = None
    order: str | None = None
    ellipses: float | None = None


@dataclass(frozen=True, slots=True)
class Exporting:
    """A block on its way out.

    Attributes
    ----------
    block
        The block.
    folder
        Its folder; `source/` in it holds what it was imported from.
    options
        What was asked for.
    adjusted
        The adjusted block, where the format needs it and has no source to start from.
    """

    block: Block
    folder: Path
    options: ExportOptions = ExportOptions()
    adjusted: AdjustedResult | None = None


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written.

    Attributes
    ----------
    files
        Paths.
    notes
        What the format cannot hold, and what was left out.
    """

    files: tuple[Path, ...]
    notes: tuple[Note, ...] = ()
