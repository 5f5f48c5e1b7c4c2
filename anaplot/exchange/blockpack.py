"""A whole block as one file, and back: a plain zip of its files with a list of their checksums."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import secrets
import shutil
import zipfile
import zlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path, PurePosixPath

from anaplot.errors import InputError
from anaplot.exchange.blockfolder import MORE_FILES, block_files, read_block
from anaplot.exchange.formats.door import SOURCE
from anaplot.exchange.journalread import numbered_files
from anaplot.exchange.patternfile import is_pattern_file
from anaplot.exchange.recordline import SESSIONS
from anaplot.photogrammetry.block import Block
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wholefile import create_whole, make_folder, sync_folder
from anaplot.textfiles.wording import place, plain, quoted, reason
from anaplot.version import __version__

__all__ = ["MANIFEST", "block_paths", "pack_block", "unpack_block"]

MANIFEST = "anaplot-block.json"
"""The list of files in a pack."""

_FORMAT = 1
_MOST_BYTES = 500_000_000  # of all files together
_MOST_FILE = 256_000_000
_MOST_FILES = 10_000
_MOST_MANIFEST = 4_000_000
_NAME = re.compile(r"[^/\\:\x00-\x1f]{1,255}")
_CHUNK = 1 << 20


def pack_block(folder: Path, target: Path) -> tuple[str, ...]:
    """Write a block as one new file: all its files, its journal, and what it was imported from.

    Parameters
    ----------
    folder
        The block folder.
    target
        The file.

    Returns
    -------
    tuple of str
        The names of the files in it.

    Raises
    ------
    InputError
        The block cannot be read, a camera or pattern file stands outside of its folder or has a
        name that some systems do not take, or the file exists or cannot be written.
    """
    if os.path.lexists(target):
        raise InputError(f"{place(target)}: exists already and is not overwritten")
    names = _names(folder, read_block(folder))
    wrong = next((name for name in names if not _harmless(name)), None)
    if wrong is not None:
        raise InputError(
            f"{place(folder)}: {quoted(wrong)} is no file name on every system: rename it"
        )
    if len(names) > _MOST_FILES:
        raise InputError(f"{place(folder)}: more than {_MOST_FILES} files")
    packed = io.BytesIO()
    total, listed = 0, {}
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as pack:
        for name in names:
            data = read_bytes(folder / name, _MOST_FILE)
            total += len(data)
            if total > _MOST_BYTES:
                raise InputError(f"{place(folder)}: more than {_MOST_BYTES / 1e6:g} MB in all")
            listed[name] = {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            pack.writestr(_entry(name), data, zipfile.ZIP_DEFLATED)
        manifest = {"format": _FORMAT, "program": f"anaplot {__version__}", "files": listed}
        pack.writestr(_entry(MANIFEST), json.dumps(manifest, indent=1), zipfile.ZIP_DEFLATED)
    create_whole(target, packed.getvalue())
    return names


def _entry(name: str) -> zipfile.ZipInfo:
    """Return a file's entry, without the time: one before 1980 or after 2107 has no place in it."""
    return zipfile.ZipInfo(name)


def block_paths(folder: Path) -> tuple[Path, ...]:
    """Return the files of a block that exist, also those that stand outside of its folder.

    Raises
    ------
    InputError
        The block cannot be read.
    """
    block = read_block(folder)
    named = [camera.file for camera in block.cameras if camera.file is not None]
    pattern = block.measuring.pattern
    if pattern is not None and is_pattern_file(pattern):
        named.append(pattern)
    paths = [*block_files(folder), *(folder / name for name in (*MORE_FILES, *named))]
    if os.path.lexists(folder / SESSIONS):
        numbered, _ = numbered_files(folder / SESSIONS)
        paths += [folder / SESSIONS / numbered[number].name for number in sorted(numbered)]
    return tuple(path for path in dict.fromkeys(paths) if os.path.lexists(path))


def _names(folder: Path, block: Block) -> tuple[str, ...]:
    """Return the names of a block's files, relative to its folder, with slashes."""
    names = [path.name for path in block_files(folder) if os.path.lexists(path)]
    names += [name for name in MORE_FILES if os.path.lexists(folder / name)]
    for camera in block.cameras:
        if camera.file is not None:
            names += _beside(folder, "camera file", camera.file, names)
    pattern = block.measuring.pattern
    if pattern is not None and is_pattern_file(pattern):
        names += _beside(folder, "pattern file", pattern, names)
    if os.path.lexists(folder / SESSIONS):
        numbered, _ = numbered_files(folder / SESSIONS)
        names += [f"{SESSIONS}/{numbered[number].name}" for number in sorted(numbered)]
    names += sorted(path.relative_to(folder).as_posix() for path in _of_source(folder))
    return tuple(names)


def _of_source(folder: Path) -> Iterator[Path]:
    """Yield the files from which a block was imported; its exports begin with them."""
    for path in (folder / SOURCE).rglob("*"):
        if path.is_file() and not path.is_symlink():
            yield path


def _beside(folder: Path, what: str, file: str, names: Collection[str]) -> list[str]:
    """Return the name of a file that block.toml names, unless it is among the names already."""
    if Path(file).is_absolute():
        raise InputError(
            f"{place(folder / 'block.toml')}: {what} {quoted(file)} stands outside"
            " of the block: copy it into the folder"
        )
    name = Path(file).as_posix()
    return [] if name in names else [name]


def unpack_block(pack: Path, folder: Path) -> tuple[str, ...]:
    """Bring a packed block back into a new folder; every file is checked, or nothing is written.

    Parameters
    ----------
    pack
        The file.
    folder
        The new block folder.

    Returns
    -------
    tuple of str
        The names of its files.

    Raises
    ------
    InputError
        The file is no packed block, or damaged, or says more than it may; the folder exists; or
        it cannot be written.
    """
    if os.path.lexists(folder):
        raise InputError(f"{place(folder)}: exists already and is not overwritten")
    data = io.BytesIO(read_bytes(pack, _MOST_BYTES))
    try:
        with zipfile.ZipFile(data) as opened:
            return _unpacked(pack, opened, folder)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{place(pack)}: not a sound zip file: {plain(str(error), 120)}") from None


def _unpacked(pack: Path, opened: zipfile.ZipFile, folder: Path) -> tuple[str, ...]:
    listed = _listed(pack, opened)
    make_folder(folder.parent)
    aside = folder.with_name(f".{folder.name}.{secrets.token_hex(6)}.tmp")
    try:
        aside.mkdir()
        for name, (size, digest) in listed.items():
            target = aside.joinpath(*name.split("/"))
            make_folder(target.parent)
            create_whole(target, _content(pack, opened, name, size, digest))
        read_block(aside)
        aside.rename(folder)
        sync_folder(folder.parent)
    except OSError as error:
        raise InputError(f"{place(folder)}: cannot be written: {reason(error)}") from error
    finally:
        with contextlib.suppress(OSError):
            if aside.exists():
                shutil.rmtree(aside)
    return tuple(listed)


def _listed(pack: Path, opened: zipfile.ZipFile) -> Mapping[str, tuple[int, str]]:
    """Return length and checksum of each file, as the manifest lists them."""

    def wrong(why: str) -> InputError:
        return InputError(f"{place(pack)}: {why}")

    infos = {info.filename: info for info in opened.infolist()}
    if MANIFEST not in infos:
        raise wrong(f"no packed block: it holds no {MANIFEST}")
    if infos[MANIFEST].file_size > _MOST_MANIFEST:
        raise wrong(f"{MANIFEST} is too large")
    try:
        said = json.loads(_read(opened, MANIFEST, _MOST_MANIFEST))
        if said["format"] > _FORMAT:
            raise wrong("written by a newer version of anaplot")
        files = {
            str(name): (int(one["bytes"]), str(one["sha256"]))
            for name, one in said["files"].items()
        }
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise wrong(f"{MANIFEST} is not what anaplot writes") from None
    if len(files) > _MOST_FILES or len(infos) != len(opened.infolist()):
        raise wrong("more files than a block has, or one twice")
    for name, (size, _) in files.items():
        if not _harmless(name):
            raise wrong(f"{quoted(name)} is no name of a block's file")
        if name not in infos:
            raise wrong(f"{quoted(name)} is listed and not there")
        if not 0 <= size <= _MOST_FILE:
            raise wrong(f"{quoted(name)} is larger than what is read")
    unlisted = next((name for name in infos if name not in files and name != MANIFEST), None)
    if unlisted is not None:
        raise wrong(f"{quoted(unlisted)} is there and not listed")
    if sum(size for size, _ in files.values()) > _MOST_BYTES:
        raise wrong(f"more than {_MOST_BYTES / 1e6:g} MB in all")
    return files


def _harmless(name: str) -> bool:
    """Whether a name stays within the folder, on every system."""
    parts = name.split("/")
    return (
        len(parts) <= 8
        and all(_NAME.fullmatch(part) and part.strip(". ") for part in parts)
        and not PurePosixPath(name).is_absolute()
    )


def _content(pack: Path, opened: zipfile.ZipFile, name: str, size: int, digest: str) -> bytes:
    data = _read(opened, name, size)
    if len(data) != size or hashlib.sha256(data).hexdigest() != digest:
        raise InputError(f"{place(pack)}: {quoted(name)} is not what was packed")
    return data


def _read(opened: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Return a file of the zip, no longer than `most` + 1 bytes whatever it claims."""
    with opened.open(name) as file:
        parts, left = [], most + 1
        while left > 0 and (part := file.read(min(left, _CHUNK))):
            parts.append(part)
            left -= len(part)
    return b"".join(parts)
