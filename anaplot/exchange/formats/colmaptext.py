"""COLMAP's text files: cameras.txt, images.txt with two lines an image, points3D.txt."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.exchange.formats.colmapcamera import MODELS, ColmapCamera, model_number
from anaplot.exchange.formats.colmapmodel import NO_POINT, ColmapImage, ColmapModel, made_camera
from anaplot.exchange.formats.sourcelines import SourceLine, source_lines
from anaplot.textfiles.wording import hint, quoted

__all__ = ["cleaned_image_lines", "cleaned_point_lines", "text_model"]

_HEAD = 9  # values of an image before its name
_POINT = 8  # values of a point before its track
_NUMBER = 2**32 - 1
_DIGITS = 18  # a number of so many is below 2**63
_NONE = str(2**64 - 1)  # what a writer of unsigned numbers makes of "no point"


def text_model(folder: Path) -> ColmapModel:
    """Read a text model; raises InputError that names file and line."""
    paths = [folder / f"{part}.txt" for part in ("cameras", "images", "points3D")]
    cameras = _cameras(paths[0])
    images = tuple(_image(head, features) for head, features in _pairs(paths[1]))
    points: list[int] = []
    lengths: list[int] = []
    tracks = array("q")  # arrays by the million cost more than they hold
    for line in _meant(paths[2]):
        number, track = _point(line)
        points.append(number)
        lengths.append(len(track) // 2)
        tracks.extend(track)
    numbers = np.array(points, dtype=np.intp)
    joined = np.frombuffer(tracks, dtype=np.int64).astype(np.intp).reshape(-1, 2)
    of_point = np.repeat(numbers, np.array(lengths, dtype=np.intp))
    return ColmapModel(
        folder, ".txt", cameras, images, numbers, of_point, joined[:, 0], joined[:, 1]
    )


def _says_nothing(text: str) -> bool:
    return not text.strip() or text.lstrip().startswith("#")


def _meant(path: Path) -> Iterator[SourceLine]:
    return (line for line in source_lines(path) if not _says_nothing(line.text))


def _cameras(path: Path) -> dict[int, ColmapCamera]:
    out: dict[int, ColmapCamera] = {}
    for line in _meant(path):
        parts = line.text.split()
        if len(parts) < 4:
            raise line.fail("a camera is CAMERA_ID MODEL WIDTH HEIGHT PARAMS")
        number = line.whole_of(parts[0], "the camera's number", 0, _NUMBER)
        model = model_number(parts[1])
        if model is None:
            names = [one.name for one in MODELS.values()]
            raise line.fail(f"no camera model {quoted(parts[1])}{hint(parts[1], names)}")
        if number in out:
            raise line.fail(f"two cameras have the number {number}")
        wanted = MODELS[model].parameters
        if len(parts) != 4 + wanted:
            raise line.fail(f"{parts[1]} has {wanted} parameters, not {len(parts) - 4}")
        size = line.whole_of(parts[2], "the width"), line.whole_of(parts[3], "the height")
        params = line.numbers_of(parts[4:], "a parameter")
        out[number] = made_camera(number, model, size, params, line.fail)
    return out


def _pairs(path: Path) -> Iterator[tuple[SourceLine, SourceLine | None]]:
    """Yield the two lines of every image; the second may be blank, and missing at the end."""
    head: SourceLine | None = None
    for line in source_lines(path):
        if head is None:
            if not _says_nothing(line.text):
                head = line
        elif not line.text.startswith("#"):
            yield head, line
            head = None
    if head is not None:
        yield head, None


def _image(head: SourceLine, features: SourceLine | None) -> ColmapImage:
    parts = head.text.split(None, _HEAD)
    if len(parts) <= _HEAD:
        raise head.fail("an image is IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
    number = head.whole_of(parts[0], "the image's number", 0, _NUMBER)
    pose = tuple(_any_number(head, text) for text in parts[1:8])
    camera = head.whole_of(parts[8], "the camera's number", 0, _NUMBER)
    xy, point = np.empty((0, 2)), np.empty(0, dtype=np.intp)
    if features is not None:
        xy, point = _features(features)
    index = np.flatnonzero(point != NO_POINT)
    name = parts[_HEAD].rstrip()
    return ColmapImage(number, camera, name, pose, index, xy[index], point[index])


def _any_number(line: SourceLine, text: str) -> float:
    """Return a number of a pose, which may be none: then there is no pose."""
    if text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
        return float(text)
    return line.number_of(text, "a number of the pose")


def _features(line: SourceLine) -> tuple[Array, Index]:
    parts = line.text.split()
    if len(parts) % 3:
        raise line.fail("features are X Y POINT3D_ID, again and again")
    x, y = _column(line, parts[0::3]), _column(line, parts[1::3])
    points = _wholes(line, parts[2::3], "a point's number", NO_POINT)
    return np.stack((x, y), axis=1), np.array(points, dtype=np.intp)


def _column(line: SourceLine, texts: list[str]) -> Array:
    """Return numbers, all at once; raises InputError for the first that is none."""
    try:
        out = np.array(list(map(float, texts)))
    except ValueError:
        out = None
    # float() takes what no other program writes
    if out is None or "_" in line.text or not line.text.isascii():
        return np.array([line.number_of(text, "a coordinate") for text in texts])
    return out


def _wholes(line: SourceLine, texts: list[str], what: str, low: int) -> list[int]:
    """Return whole numbers; raises InputError for the first that is none."""
    mine = [text for text in texts if text != "-1"] if low < 0 else texts
    digits = "".join(mine)
    if digits.isascii() and digits.isdigit() and max(map(len, mine)) <= _DIGITS:
        return list(map(int, texts))
    return [
        NO_POINT if low < 0 and text == _NONE else line.whole_of(text, what, low, 2**63 - 1)
        for text in texts
    ]


def _point(line: SourceLine) -> tuple[int, list[int]]:
    """Return a point's number, and image, feature, image, feature, ... of its track."""
    parts = line.text.split()
    if len(parts) < _POINT or len(parts) % 2:
        raise line.fail("a point is POINT3D_ID X Y Z R G B ERROR, then IMAGE_ID POINT2D_IDX")
    number = line.whole_of(parts[0], "the point's number", 0, 2**63 - 1)
    return number, _wholes(line, parts[_POINT:], "a number of the track", 0)


def cleaned_image_lines(path: Path, taken: Mapping[int, Index]) -> Iterator[bytes]:
    """Yield an images.txt anew, in which features have no point any more; all else as it was.

    Parameters
    ----------
    path
        The file.
    taken
        Which features, by the images' numbers.
    """
    number: int | None = None
    for text, end in _whole_lines(path):
        if number is None:
            if not _says_nothing(text):
                number = int(text.split(None, 1)[0])
        elif not text.startswith("#"):
            if number in taken:
                parts = text.split()
                for k in taken[number].tolist():
                    parts[3 * k + 2] = str(NO_POINT)
                text = " ".join(parts)
            number = None
        yield (text + end).encode()


def cleaned_point_lines(
    path: Path, taken: Mapping[int, set[tuple[int, int]]], gone: set[int]
) -> Iterator[bytes]:
    """Yield a points3D.txt anew, with shorter tracks and without some points.

    Parameters
    ----------
    path
        The file.
    taken
        Elements that go, (image, index), by the points' numbers.
    gone
        Points that go.
    """
    for text, end in _whole_lines(path):
        if not _says_nothing(text):
            number = int(text.split(None, 1)[0])
            if number in gone:
                continue
            if number in taken:
                parts = text.split()
                track = zip(parts[_POINT::2], parts[_POINT + 1 :: 2], strict=True)
                left = [pair for pair in track if (int(pair[0]), int(pair[1])) not in taken[number]]
                text = " ".join([*parts[:_POINT], *(one for pair in left for one in pair)])
        yield (text + end).encode()


def _whole_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Yield lines and their ends; a byte order mark is left out."""
    for line in source_lines(path, ends=True):
        text = line.text.rstrip("\r\n")
        yield text, line.text[len(text) :]
