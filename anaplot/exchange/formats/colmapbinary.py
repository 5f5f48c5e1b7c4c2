"""COLMAP's binary files: little endian, every count checked against what is left of the file."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from anaplot.aliases import Index
from anaplot.errors import InputError
from anaplot.exchange.formats.colmapcamera import MODELS, ColmapCamera
from anaplot.exchange.formats.colmapmodel import ColmapImage, ColmapModel, Complain, made_camera
from anaplot.exchange.formats.sourcelines import MAX_SOURCE_BYTES
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wording import place, quoted

__all__ = ["binary_model", "cleaned_images", "cleaned_points"]

_FEATURE = np.dtype([("xy", "<f8", 2), ("point", "<u8")])
_ELEMENT = np.dtype([("image", "<u4"), ("index", "<u4")])
_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_POINT = struct.Struct("<Q3d3BdQ")
_PAIR = struct.Struct("<2I")  # an _ELEMENT
_NONE = 2**64 - 1
_MOST = 2**63 - 1
_FEWEST = min(model.parameters for model in MODELS.values())
_MAX_NAME = 4096  # bytes


class _Cursor:
    """A place in a binary file, behind which is known how much there is."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path = path
        self._file = file
        self._left = os.fstat(file.fileno()).st_size

    def fail(self, message: str) -> InputError:
        """Return the error about this file."""
        return InputError(f"{place(self._path)}: {message}")

    def take(self, count: int, what: str) -> bytes:
        """Return the next bytes; raises InputError where the file has no more."""
        if count > self._left:
            raise self.fail(f"ends within {what}: {count} bytes wanted, {self._left} left")
        self._left -= count
        data = self._file.read(count)
        if len(data) != count:
            raise self.fail(f"ends within {what}")
        return data

    def count(self, least: int, what: str) -> int:
        """Return a count of things that take so many bytes at least; raises InputError."""
        (count,) = _COUNT.unpack(self.take(8, f"the number of {what}"))
        self.check(count, least, what)
        return int(count)

    def check(self, count: int, least: int, what: str) -> None:
        """Raise InputError for a count that the rest of the file cannot hold."""
        if count * least > self._left:
            raise self.fail(
                f"says it holds {count} {what}: what is left, {self._left} bytes, has room "
                f"for {self._left // least}"
            )

    def name(self, what: str) -> bytes:
        """Return a text up to its zero byte."""
        out = bytearray()
        while (byte := self.take(1, f"the name of {what}")) != b"\0":
            out += byte
            if len(out) > _MAX_NAME:
                raise self.fail(f"the name of {what} is longer than {_MAX_NAME} bytes")
        return bytes(out)

    def end(self) -> None:
        """Refuse what stands behind the last thing."""
        if self._left:
            raise self.fail(f"{self._left} bytes behind its end")


@contextmanager
def _opened(path: Path) -> Iterator[_Cursor]:
    with open_input(path, MAX_SOURCE_BYTES) as file:
        yield _Cursor(path, file)


def binary_model(folder: Path) -> ColmapModel:
    """Read a binary model; raises InputError that names file and thing."""
    paths = [folder / f"{part}.bin" for part in ("cameras", "images", "points3D")]
    with _opened(paths[0]) as cursor:
        cameras = _cameras(cursor)
    with _opened(paths[1]) as cursor:
        images = tuple(_made(*found, cursor.fail) for found in _images(cursor))
    points, lengths, tracks = [], [], bytearray()
    with _opened(paths[2]) as cursor:
        for number, _, track in _points(cursor):
            points.append(number)
            lengths.append(len(track) // _ELEMENT.itemsize)
            tracks += track
    joined = np.frombuffer(tracks, dtype=_ELEMENT)
    numbers = np.array(points, dtype=np.intp)
    return ColmapModel(
        folder,
        ".bin",
        cameras,
        images,
        numbers,
        np.repeat(numbers, np.array(lengths, dtype=np.intp)),
        joined["image"].astype(np.intp),
        joined["index"].astype(np.intp),
    )


def _cameras(cursor: _Cursor) -> dict[int, ColmapCamera]:
    out: dict[int, ColmapCamera] = {}
    for _ in range(cursor.count(_CAMERA.size + 8 * _FEWEST, "cameras")):
        number, model, width, height = _CAMERA.unpack(cursor.take(_CAMERA.size, "a camera"))
        if model not in MODELS:
            raise cursor.fail(f"camera {number}: no camera model has the number {model}")
        if number in out:
            raise cursor.fail(f"two cameras have the number {number}")
        wanted = MODELS[model].parameters
        params = struct.unpack(f"<{wanted}d", cursor.take(8 * wanted, f"camera {number}"))
        out[number] = made_camera(number, model, (width, height), params, cursor.fail)
    cursor.end()
    return out


class _Raw(NamedTuple):
    head: bytes
    name: bytes
    features: np.ndarray  # of _FEATURE


def _images(cursor: _Cursor) -> Iterator[_Raw]:
    total = cursor.count(_IMAGE.size + 9, "images")
    for k in range(total):
        what = f"image {k + 1} of {total}"
        head = cursor.take(_IMAGE.size, what)
        name = cursor.name(what)
        count = cursor.count(_FEATURE.itemsize, f"features of {what}")
        data = cursor.take(count * _FEATURE.itemsize, what)
        yield _Raw(head, name, np.frombuffer(data, dtype=_FEATURE))
    cursor.end()


def _made(head: bytes, raw_name: bytes, features: np.ndarray, fail: Complain) -> ColmapImage:
    number, *pose, camera = _IMAGE.unpack(head)
    try:
        name = raw_name.decode()
    except UnicodeDecodeError:
        raise fail(f"image {number}: its name is not UTF-8 text") from None
    index = np.flatnonzero(features["point"] != _NONE)
    mine = features[index]
    if (mine["point"] > _MOST).any():
        raise fail(f"image {quoted(name)}: a point's number beyond {_MOST}")
    point = mine["point"].astype(np.intp)
    return ColmapImage(number, camera, name, tuple(pose), index, mine["xy"].copy(), point)


def _points(cursor: _Cursor) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield number, head and track of every point; arrays by the million cost more than they hold.

    A track's elements are as `_ELEMENT` says.
    """
    total = cursor.count(_POINT.size, "points")
    for k in range(total):
        what = f"point {k + 1} of {total}"
        head = cursor.take(_POINT.size, what)
        number, *_, length = _POINT.unpack(head)
        if number > _MOST:
            raise cursor.fail(f"{what}: its number is beyond {_MOST}")
        cursor.check(length, _ELEMENT.itemsize, f"images of {what}")
        yield number, head, cursor.take(length * _ELEMENT.itemsize, what)
    cursor.end()


def cleaned_images(path: Path, taken: Mapping[int, Index]) -> Iterator[bytes]:
    """Yield an images.bin anew, in which features have no point any more.

    Parameters
    ----------
    path
        The file.
    taken
        Which features, by the images' numbers.
    """
    with _opened(path) as cursor:
        raws = _images(cursor)
        # the count is that of the file: no image goes
        yield _COUNT.pack(_total(path))
        for raw in raws:
            features = raw.features
            (number,) = struct.unpack_from("<I", raw.head)
            if number in taken:
                features = features.copy()
                features["point"][taken[number]] = _NONE
            yield raw.head + raw.name + b"\0" + _COUNT.pack(len(features)) + features.tobytes()


def cleaned_points(
    path: Path, taken: Mapping[int, set[tuple[int, int]]], gone: set[int]
) -> Iterator[bytes]:
    """Yield a points3D.bin anew, with shorter tracks and without some points.

    Parameters
    ----------
    path
        The file.
    taken
        Elements that go, (image, index), by the points' numbers.
    gone
        Points that go.
    """
    yield _COUNT.pack(_total(path) - len(gone))
    with _opened(path) as cursor:
        for number, head, track in _points(cursor):
            if number in gone:
                continue
            if number in taken:
                out = taken[number]
                left = [pair for pair in _PAIR.iter_unpack(track) if pair not in out]
                track = b"".join(_PAIR.pack(*pair) for pair in left)
                head = head[:-8] + _COUNT.pack(len(left))
            yield head + track


def _total(path: Path) -> int:
    with _opened(path) as cursor:
        return cursor.count(1, "things")
