"""Device profiles are found both ways: in a wheel, and beside the package in a source tree."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LIST = (
    "from anaplot.plotter.profile import find_profiles, load_profile\n"
    "for name, path in sorted(find_profiles().items()):\n"
    "    print(name, load_profile(name).sha256, path)\n"
)


def profiles_of(where: Path, cwd: Path) -> list[list[str]]:
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {str(where)!r})\n{LIST}"],
        check=True,
        capture_output=True,
        text=True,
        cwd=cwd,
    )
    return [line.split(maxsplit=2) for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_the_wheel_carries_the_profiles_of_the_source_tree(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)],
        check=True,
        capture_output=True,
        cwd=ROOT,
    )
    (wheel,) = tmp_path.glob("anaplot-*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")  # the same for every system
    with zipfile.ZipFile(wheel) as archive:
        carried = {Path(name) for name in archive.namelist()}
        archive.extractall(tmp_path / "site")
    # what is no module is carried, too: templates of the report, the mark of its types
    package = ROOT / "anaplot"
    others = [p for p in package.rglob("*") if p.suffix not in (".py", ".pyc") and p.is_file()]
    assert {p.relative_to(ROOT) for p in others} <= carried
    assert not any(name.suffix in (".so", ".pyd", ".dll") for name in carried)
    installed = profiles_of(tmp_path / "site", tmp_path)
    source = profiles_of(ROOT, tmp_path)
    assert [row[:2] for row in installed] == [row[:2] for row in source]
    assert {row[0] for row in source} >= {"anaplot-ascii", "simulated", "heidenhain-nd281b"}
    assert all(row[2].startswith(str(tmp_path / "site")) for row in installed)
    assert all(row[2].startswith(str(ROOT / "device_profiles")) for row in source)
