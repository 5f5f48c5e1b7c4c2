"""Measured fiducials: what is read, and what is wrong and where."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.exchange.fiducialfile import (
    FiducialMeasurements,
    PhotoFiducials,
    read_fiducials,
)
from anaplot.photogrammetry.block import TestSettings

CAMERA = """\
format = 1
[camera]
id = "rmk"
c = 152.40
[fiducials]
upper = [0.0, 113.0]
lower = [0.0, -113.0]
right = [113.0, 0.0]
"""

FILE = """\
format = 1
camera = "rmk.toml"
sigma_um = 4.0
[test]
kind = "baarda"
alpha = 0.01
[photo.101]
upper = [120.015, 223.021]
lower = [119.987, -2.961]
[photo."10 2"]
right = [3, -4.5]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a camera file."""
    (tmp_path / "rmk.toml").write_text(CAMERA)
    return tmp_path


def test_everything_the_example_states_is_read(folder):
    path = folder / "fid.toml"
    path.write_text(FILE)
    file = read_fiducials(path)
    assert file == FiducialMeasurements(
        camera=file.camera,
        camera_file=folder / "rmk.toml",
        sigma_um=4.0,
        test=TestSettings("baarda", 0.01),
        photos=(
            PhotoFiducials("101", (("upper", 120.015, 223.021), ("lower", 119.987, -2.961))),
            PhotoFiducials("10 2", (("right", 3.0, -4.5),)),
        ),
    )
    assert file.camera.fiducial_names() == ("upper", "lower", "right")


def test_what_may_be_left_out_has_the_documented_defaults(folder):
    text = 'format = 1\ncamera = "rmk.toml"\n[photo.a]\nupper = [1, 2]\n'
    file = parsed(text, folder / "fid.toml")
    assert (file.sigma_um, file.test) == (5.0, TestSettings())


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("format = 1", "format = 9", 1, ["newer version"]),
        ('camera = "rmk.toml"\n', "", None, ["no key 'camera'"]),
        ('"rmk.toml"', "7", 2, ["camera: must be text"]),
        ('"rmk.toml"', '"../rmk.toml"', 2, ["leads out of the folder"]),
        ("sigma_um = 4.0", "sigma_um = -4.0", 3, ["greater than 0"]),
        ("sigma_um", "sigma", 3, ["sigma: unknown key", "did you mean 'sigma_um'"]),
        ("[test]", "[tset]", 4, ["did you mean 'test'"]),
        ('"baarda"', '"barda"', 5, ["did you mean 'baarda'"]),
        ("alpha", "alfa", 6, ["[test] alfa: unknown key", "did you mean 'alpha'"]),
        ("[photo.101]", "[photos.101]", 7, ["did you mean 'photo'"]),
        ("[photo.101]", "[[photo.101]]", 7, ["must be a table, not a list"]),
        ("[photo.101]", r'[photo."\u001b[1m"]', 7, [r"\x1b[1m"]),
        (
            "upper = [",
            "uper = [",
            8,
            ["[photo.101]", "unknown fiducial of camera 'rmk': 'uper'", "'upper'"],
        ),
        ("upper = [", "7 = [", 8, ["fiducial of camera 'rmk': '7'", "known: upper, lower, right"]),
        ("120.015", "nan", 8, ["upper: must be a finite number"]),
        ("120.015", "-inf", 8, ["finite"]),
        ("120.015", '"120.015"', 8, ["upper: must be a number, not text"]),
        ("120.015", "1e5", 8, ["upper: must lie between -10000 and 10000"]),
        ("[120.015, 223.021]", "[120.015]", 8, ["2 numbers, not 1"]),
        ("[120.015, 223.021]", "120.015", 8, ["list of 2 numbers"]),
        ("lower =", "upper =", 9, ["not valid TOML"]),
        ("right = [3, -4.5]\n", "", 10, ["[photo.10 2]: no fiducial is measured"]),
    ],
)
def test_what_is_wrong_is_named_with_its_line(folder, old, new, line, words):
    assert old in FILE
    path = folder / "fid.toml"
    with pytest.raises(InputError) as caught:
        parsed(FILE.replace(old, new, 1), path)
    message = str(caught.value)
    assert message.isprintable()
    assert message.startswith(f"{path}: " if line is None else f"{path} line {line}: ")
    for word in words:
        assert word in message


def test_no_photo_and_no_camera(folder):
    head = 'format = 1\ncamera = "rmk.toml"\n'
    with pytest.raises(InputError, match=r"no photo: tables \[photo\.NAME\]"):
        parsed(head, folder / "fid.toml")
    with pytest.raises(InputError, match="no photo"):
        parsed(head + "[photo]\n", folder / "fid.toml")
    with pytest.raises(InputError, match=r"none\.toml: file not found"):
        parsed(FILE.replace("rmk.toml", "none.toml"), folder / "fid.toml")
    (folder / "bare.toml").write_text('format = 1\n[camera]\nid = "bare"\nc = 50\n')
    with pytest.raises(InputError, match="camera 'bare' states no fiducials"):
        parsed(FILE.replace("rmk.toml", "bare.toml"), folder / "fid.toml")
    with pytest.raises(InputError, match="file not found"):
        read_fiducials(folder / "missing.toml")


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(st.integers(0, len(FILE)), st.integers(0, 8), st.text(max_size=6))
def test_damage_is_an_input_error_or_a_file(folder, at, length, put):
    text = FILE[:at] + put + FILE[at + length :]
    message, file = outcome(text, folder / "fid.toml")
    if file is None:
        assert message.isprintable()
        assert str(folder) in message
    else:
        names = set(file.camera.fiducial_names())
        assert file.photos
        for photo in file.photos:
            assert {fiducial for fiducial, _, _ in photo.measured} <= names
            assert all(abs(x) <= 1e4 and abs(y) <= 1e4 for _, x, y in photo.measured)


def outcome(text: str, path: Path) -> tuple[str, FiducialMeasurements | None]:
    try:
        return "", parsed(text, path)
    except InputError as error:
        return str(error), None


def parsed(text: str, path: Path) -> FiducialMeasurements:
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    return read_fiducials(path)
