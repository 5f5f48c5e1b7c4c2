"""Files of coordinates with their covariance: what is written is read, and nothing else is."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from anaplot.errors import InputError
from anaplot.photogrammetry.posterior import CoordinateName, Posterior, coordinate_name
from anaplot.report.posteriorfile import read_posterior, write_posterior

NAMES = ["point:7:X", "point:a:b:Y", "photo:101:omega"]
C = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.1], [0.0, 0.1, 1e-2]])
X = np.array([1.0, 2.0, 0.3])


def saved(path: Path, **changed) -> Path:
    arrays = {"names": np.array(NAMES), "x": X, "C": C, **changed}
    with path.open("wb") as file:
        np.savez(file, **{key: value for key, value in arrays.items() if value is not None})
    return path


def npy(array, **options) -> bytes:
    out = io.BytesIO()
    np.lib.format.write_array(out, array, **options)
    return out.getvalue()


def archive(path: Path, *members: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as out:
        for name, data in members:
            out.writestr(name, data)
    return path


WHOLE = (("names.npy", npy(np.array(NAMES))), ("x.npy", npy(X)), ("C.npy", npy(C)))


def claimed(shape: str, descr: str = "<f8", rest: bytes = b"") -> bytes:
    """Return an array that says what it has not."""
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text = text.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + rest


def test_what_is_written_is_read(tmp_path):
    names = tuple(coordinate_name(text) for text in NAMES)
    assert names[1] == CoordinateName("point", "a:b", "Y")
    assert [name.unit for name in names] == ["m", "m", "rad"]
    path = tmp_path / "left.npz"
    write_posterior(path, Posterior(names, X, C))
    found = read_posterior(path)
    assert found.names == names
    assert (found.x == X).all()
    assert (found.covariance == C).all()
    assert found.source.endswith("left.npz")
    with np.load(path, allow_pickle=False) as arrays:
        assert arrays["names"].tolist() == NAMES
        assert arrays["C"].tolist() == C.tolist()


def test_other_layouts_of_the_same_are_read(tmp_path):
    path = saved(
        tmp_path / "f.npz",
        names=np.array([name.encode() for name in NAMES]),
        x=X.astype(np.float32),
        C=np.asfortranarray(C.astype(">f8")),
    )
    assert read_posterior(path).covariance == pytest.approx(C)
    assert read_posterior(path).names[2].unknown == "omega"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"x": None}, "'x' is missing"),
        ({"names": None}, "'names' is missing"),
        ({"names": np.array(["point:7:X", "point:7:X", "photo:1:phi"])}, "7:X' stands twice"),
        ({"names": np.array(["point:7:X", "point:7:phi", "photo:1:phi"])}, "names no coordinate"),
        ({"names": np.array(["point:7:X", "7", "photo:1:phi"])}, "'7' names no coordinate"),
        ({"names": np.array(["point:7:X", "point:\x1b[2J:Y", "photo:1:phi"])}, "cannot be printed"),
        ({"names": np.array(NAMES, dtype=object)}, "'names' holds pickled objects"),
        ({"names": np.array([1.0, 2.0, 3.0])}, "'names' is no list of names"),
        ({"names": np.array([b"point:\xff:X", b"a", b"b"])}, "'names' holds what is no text"),
        ({"x": X[:2]}, "3 names with x of shape (2,) and C of shape (3, 3)"),
        ({"C": C[:2]}, "C of shape (2, 3)"),
        ({"C": C.ravel()}, "C of shape (9,)"),
        ({"x": np.array([1.0, np.nan, 0.0])}, "a number in x or C is not finite"),
        ({"x": np.array([1.0, 2.0, 1e155])}, "'photo:101:omega' lies farther than 1e+12 m"),
        ({"C": np.full((3, 3), np.inf)}, "a number in x or C is not finite"),
        ({"C": C + np.triu(np.ones((3, 3)), 1)}, "C is not symmetric"),
        ({"C": np.diag([1.0, -1.0, 1.0])}, "the variance of 'point:a:b:Y' is negative"),
        ({"C": np.ones((3, 3)) + np.diag([0.0, -0.5, 0.0])}, "a correlation beyond one"),
        ({"C": C.astype(complex)}, "'C' holds no numbers"),
        ({"names": np.array([], dtype="U9"), "x": np.empty(0), "C": np.empty((0, 0))},
         "there are no coordinates in it"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_in_one_line(tmp_path, changed, words):
    path = saved(tmp_path / "bad.npz", **changed)
    with pytest.raises(InputError) as caught:
        read_posterior(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "\x1b" not in str(caught.value)
    assert "bad.npz" in str(caught.value)


def test_hostile_archives(tmp_path):
    path = tmp_path / "bad.npz"

    def refused(words):
        with pytest.raises(InputError) as caught:
            read_posterior(path)
        assert words in str(caught.value)
        assert len(str(caught.value).splitlines()) == 1

    path.write_bytes(b"names,x\n1,2\n")
    refused("no archive of names, x and C that can be read")
    path.write_bytes(npy(C))
    refused("no archive")
    path.write_bytes(archive(path, *WHOLE).read_bytes()[:-60])
    refused("no archive")
    # a flipped bit within an array
    data = bytearray(archive(path, *WHOLE).read_bytes())
    data[data.index(b"C.npy") + 40] ^= 0xFF
    path.write_bytes(bytes(data))
    refused("no archive")
    with pytest.warns(UserWarning, match="Duplicate"):
        archive(path, *WHOLE, WHOLE[2])
    refused("'C' stands twice")
    # a hundred thousand coordinates said in a few bytes
    archive(path, *WHOLE[:2], ("C.npy", claimed("(100000, 100000)")))
    refused("'C' is not as long as its shape (100000, 100000) says")
    archive(path, *WHOLE[:2], ("C.npy", claimed("(-3, -3)", rest=bytes(72))))
    refused("'C' is not as long as its shape")
    archive(path, *WHOLE[:2], ("C.npy", claimed("(3, 3)", "|O", bytes(72))))
    refused("'C' holds pickled objects")
    archive(path, *WHOLE[:2], ("C.npy", claimed("__import__('os')")))
    refused("no archive")
    archive(path, *WHOLE[:2], ("C.npy", b"\x93NUMPY\x09\x00" + bytes(80)))
    refused("'C' is an array of a version not known here")
    archive(path, *WHOLE[:2], ("C.npy", claimed("(" * 60 + "3" + ")" * 60)))
    refused("no archive")
    archive(path, *WHOLE[:2], ("C.npy", claimed("(3, 3")))
    refused("no archive")
    archive(path, ("names.npy", claimed("(10**12,)", "<U0")), *WHOLE[1:])
    refused("no archive")
    archive(path, ("names.npy", claimed("(1000000000000,)", "<U0")), *WHOLE[1:])
    refused("0 names with x")
    archive(path, ("names.npy", claimed("(3,)", "<U2", b"\xff" * 24)), *WHOLE[1:])
    refused("'names' holds what is no text")


@pytest.mark.parametrize("method", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_methods_that_numpy_does_not_use(tmp_path, method):
    """What is damaged in them is told by errors of their own."""
    path = archive(tmp_path / "bad.npz", *WHOLE, method=method)
    data = bytearray(path.read_bytes())
    for whole in (True, False):
        if not whole:
            at = data.index(b"names.npy") + 9
            data[at + 4 : at + 24] = bytes(20)
            path.write_bytes(bytes(data))
        with pytest.raises(InputError, match="'names' is compressed by a method not known here"):
            read_posterior(path)


def test_an_archive_that_unpacks_to_much_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("anaplot.report.posteriorfile._LARGEST", {"names": 900, "x": 900, "C": 900})
    path = archive(tmp_path / "bomb.npz", *WHOLE[:2], ("C.npy", bytes(1_000_000)))
    assert path.stat().st_size < 5000
    with pytest.raises(InputError, match="'C' says that it has 1000000 bytes: at most 6000 coord"):
        read_posterior(path)


def test_it_is_written_into_no_file_of_another_kind(tmp_path):
    path = tmp_path / "control.csv"
    path.write_text("point\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"control\.csv: --posterior writes a file that ends in"):
        write_posterior(path, Posterior((coordinate_name("point:7:X"),), X[:1], C[:1, :1]))
    assert path.read_text(encoding="utf-8") == "point\n"
    with pytest.raises(InputError, match="file not found"):
        read_posterior(tmp_path / "none.npz")
