"""Coordinates with their covariance in a file of numpy's: `adjust --posterior` and `--given`.

A zip archive of three arrays: `names` ("point:7:X", "photo:101:omega"), `x` [m, rad] and `C`, full,
for the a-priori sigma0. What stands in an archive is looked at before it is unpacked, and an array
before room is made for it; objects (pickles) are never read.
"""

from __future__ import annotations

import io
import math
import os
import sys
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anaplot.bundle.solve.problem import Datum
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.posterior import (
    MOST_COORDINATES,
    CoordinateName,
    Posterior,
    coordinate_name,
)
from anaplot.report.npzfile import check_npz_path, write_arrays
from anaplot.textfiles.inputfile import read_bytes, real_path
from anaplot.textfiles.names import name_fault
from anaplot.textfiles.wholefile import check_place
from anaplot.textfiles.wording import place, quoted

__all__ = [
    "check_carried",
    "read_posterior",
    "with_given",
    "write_posterior",
]


_HEADER = 16_384  # bytes of an array's header, at most
_NAME = 4 * 320  # bytes of a name
_LARGEST = {
    "names": MOST_COORDINATES * _NAME + _HEADER,
    "x": 16 * MOST_COORDINATES + _HEADER,
    "C": 16 * MOST_COORDINATES**2 + _HEADER,
}
_UNREADABLE = (
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
    EOFError,
    MemoryError,
    OSError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)
"""What archives and headers of arrays fail with; encrypted ones and unknown methods too."""
_MAX_BYTES = sum(_LARGEST.values()) + 1_000_000


def write_posterior(path: Path, posterior: Posterior) -> None:
    """Write coordinates and their covariance, wholly or not at all.

    Parameters
    ----------
    path
        Of the file, `.npz`; one that exists is replaced.
    posterior
        What is written.

    Raises
    ------
    InputError
        The name ends otherwise, or the file cannot be written.
    """
    names = [name.text for name in posterior.names]
    write_arrays(path, "--posterior", names=names, x=posterior.x, C=posterior.covariance)


def read_posterior(path: Path) -> Posterior:
    """Read what `write_posterior`, or numpy.savez, has written.

    Raises
    ------
    InputError
        The file is missing, too large, no such archive, or says something that cannot be.
    """
    data = read_bytes(path, _MAX_BYTES)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names, x, covariance = (_array(path, archive, key) for key in ("names", "x", "C"))
    except InputError:
        raise
    except _UNREADABLE as error:
        raise InputError(f"{place(path)}: no archive of names, x and C that can be read") from error
    return Posterior(_names(path, names), _numbers(path, "x", x), _numbers(path, "C", covariance),
                     place(path))  # fmt: skip


def check_carried(
    given: object,
    given_without: object,
    posterior: object,
    posterior_of: object,
    datum: Datum,
    prior: object,
) -> None:
    """Refuse what does not go with coordinates that are carried on, before anything is read."""
    if posterior_of is not None and posterior is None:
        raise InputError("--posterior-of goes with --posterior")
    if given_without is not None and given is None:
        raise InputError("--given-without goes with --given")
    for option, value in (("--given", given), ("--posterior", posterior)):
        if value is None:
            continue
        if datum != "control":
            raise InputError(
                f"{option} goes with the datum of control: in another one coordinates and their "
                "covariance are those of the datum"
            )
        if prior is not None:
            raise InputError(
                f"{option} and --prior: C is for the a-priori sigma0, of which --prior makes "
                "something else; one of them"
            )
    if isinstance(posterior, str | os.PathLike):
        check_npz_path(Path(posterior), "--posterior")
        check_place(Path(posterior))
        if isinstance(given, str | os.PathLike) and real_path(Path(posterior)) == real_path(
            Path(given)
        ):
            raise InputError(
                f"--posterior {place(Path(posterior))}: --given is read from it, and would be "
                "counted twice with the next adjustment; name another file"
            )


def with_given(
    block: Block,
    given: str | os.PathLike[str] | Posterior | None,
    without: Sequence[str] = (),
) -> Block:
    """Return a block with what an earlier adjustment left.

    Parameters
    ----------
    block
        The block.
    given
        A file, or what was read of one; None: nothing.
    without
        Names of points and photos that are left out.
    """
    if given is None:
        return block
    found = given if isinstance(given, Posterior) else read_posterior(Path(given))
    return replace(block, given=found.without(without) if without else found)


def _array(path: Path, archive: zipfile.ZipFile, key: str) -> NDArray[Any]:
    """Return one array, whose header is believed only as far as its bytes go."""
    members = [one for one in archive.infolist() if one.filename == f"{key}.npy"]
    if len(members) != 1:
        raise InputError(
            f"{place(path)}: {quoted(key)} is missing"
            if not members
            else f"{place(path)}: {quoted(key)} stands twice"
        )
    if members[0].file_size > _LARGEST[key]:
        raise InputError(
            f"{place(path)}: {quoted(key)} says that it has {members[0].file_size} bytes: at most "
            f"{MOST_COORDINATES} coordinates"
        )
    if members[0].compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        # other methods fail in ways of their own, and numpy uses none of them
        raise InputError(f"{place(path)}: {quoted(key)} is compressed by a method not known here")
    with archive.open(members[0]) as member:
        data = member.read(_LARGEST[key] + 1)
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise InputError(f"{place(path)}: {quoted(key)} is an array of a version not known here")
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    with warnings.catch_warnings():
        # of a header as Python 2 wrote it
        warnings.simplefilter("ignore")
        shape, fortran, dtype = read(stream)
    if dtype.hasobject:
        raise InputError(f"{place(path)}: {quoted(key)} holds pickled objects, which are not read")
    rest = data[stream.tell() :]
    if any(n < 0 for n in shape) or math.prod(shape) * dtype.itemsize != len(rest):
        raise InputError(f"{place(path)}: {quoted(key)} is not as long as its shape {shape} says")
    if not rest:
        # one of no bytes says what it likes of its shape
        return np.empty(shape if math.prod(shape) == 0 else (0,), dtype)
    return np.frombuffer(rest, dtype).reshape(shape, order="F" if fortran else "C")


def _names(path: Path, array: NDArray[Any]) -> tuple[CoordinateName, ...]:
    if array.ndim != 1 or array.dtype.kind not in "US":
        raise InputError(f"{place(path)}: 'names' is no list of names")
    if len(array) > MOST_COORDINATES:
        raise InputError(f"{place(path)}: {len(array)} coordinates: at most {MOST_COORDINATES}")
    if array.dtype.kind == "U" and array.size:
        # numpy makes text of any number, which Python then stumbles over
        codes = np.frombuffer(array.tobytes(), f"{array.dtype.byteorder}u4")
        if int(codes.max(initial=0)) > sys.maxunicode:
            raise InputError(f"{place(path)}: 'names' holds what is no text")
    try:
        texts = [
            one.decode("utf-8") if isinstance(one, bytes) else str(one) for one in array.tolist()
        ]
    except ValueError:
        raise InputError(f"{place(path)}: 'names' holds what is no text") from None
    try:
        found = tuple(coordinate_name(text) for text in texts)
    except InputError as error:
        raise InputError(f"{place(path)}: {error}") from None
    for name in found:
        fault = name_fault(name.owner)
        if fault is not None:
            raise InputError(f"{place(path)}: the name {quoted(name.owner)} {fault}")
    return found


def _numbers(path: Path, key: str, array: NDArray[Any]) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiu":
        raise InputError(f"{place(path)}: {quoted(key)} holds no numbers")
    with np.errstate(over="ignore"):
        return array.astype(np.float64)
