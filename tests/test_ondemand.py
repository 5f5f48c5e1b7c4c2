"""Names that stand for modules: imported when they are used, and then as every other module."""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest
from processes import running

from anaplot.ondemand import load_on_demand

PACKAGE = "package_with_names"
NAME = f"{PACKAGE}.waits"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    (tmp_path / PACKAGE).mkdir()
    (tmp_path / PACKAGE / "__init__.py").write_text("times = []\n")
    yield tmp_path / PACKAGE
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


def package(folder: Path, text: str) -> ModuleType:
    (folder / "waits.py").write_text(f"from {PACKAGE} import times\ntimes.append(1)\n{text}")
    load_on_demand({NAME})
    return importlib.import_module(PACKAGE)


def test_it_is_imported_when_something_is_looked_up_and_only_once(folder: Path) -> None:
    found = package(folder, f"import sys\nown = sys.modules['{NAME}'].__name__\n")
    standing = found.waits
    assert NAME not in sys.modules
    assert not found.times
    assert (standing.__name__, repr(standing)) == (
        NAME,
        f"<module '{NAME}', imported when it is used>",
    )
    assert standing.own == NAME
    assert found.waits.own == standing.own
    assert found.times == [1]
    assert found.waits is sys.modules[NAME]
    assert type(found.waits) is ModuleType
    assert "own" in dir(standing)
    assert found.__loader__ is found.__spec__.loader  # type: ignore[union-attr]
    assert isinstance(found.__loader__, SourceFileLoader)


def test_what_the_package_has_itself_stays(folder: Path) -> None:
    (folder / "__init__.py").write_text("times = []\nwaits = 3\n")
    assert package(folder, "").waits == 3


def test_what_is_set_and_deleted_is_the_modules(folder: Path) -> None:
    standing = package(folder, "value = 1\nother = 2\n").waits
    standing.value = 3
    del standing.other
    assert sys.modules[NAME].value == 3
    assert standing.value == 3
    assert not hasattr(standing, "other")
    assert not hasattr(sys.modules[NAME], "other")


def test_one_that_fails_says_the_same_every_time(folder: Path) -> None:
    found = package(folder, "import there_is_no_such_module\n")
    for times in (1, 2):
        with pytest.raises(ModuleNotFoundError, match="there_is_no_such_module"):
            _ = found.waits.value
        assert found.times == [1] * times
    assert NAME not in sys.modules
    with pytest.raises(ModuleNotFoundError, match="there_is_no_such_module"):
        importlib.import_module(NAME)
    # Python, and what looks around in it, asks for these by itself
    assert not hasattr(found.waits, "__path__")
    assert not hasattr(found.waits, "__wrapped__")
    assert NAME in repr(found.waits)


def test_a_child_that_needs_its_package_has_it(folder: Path) -> None:
    (folder / "waits").mkdir()
    (folder / "waits" / "__init__.py").write_text("base = 1\nfrom .child import value\n")
    (folder / "waits" / "child.py").write_text("from . import base\nvalue = base + 1\n")
    load_on_demand({NAME})
    importlib.import_module(PACKAGE)
    child = importlib.import_module(f"{NAME}.child")
    assert child.value == 2
    assert sys.modules[NAME].child is child


def test_two_threads_that_want_a_package_and_its_child_do_not_wait_for_each_other(
    folder: Path,
) -> None:
    (folder / "waits").mkdir()
    (folder / "waits" / "__init__.py").write_text(
        "from package_with_names import begun, child_begun\n"
        "begun.set()\nchild_begun.wait(5.0)\nfrom .child import value\n"
    )
    (folder / "__init__.py").write_text(
        "from threading import Event\nbegun, child_begun = Event(), Event()\n"
    )
    (folder / "waits" / "child.py").write_text("value = 7\n")
    # the finder is asked for the child when its importer holds the child's lock of importlib
    code = f"""
import sys
from importlib.abc import MetaPathFinder
from threading import Thread
from anaplot.ondemand import load_on_demand
load_on_demand({{"{NAME}"}})
import {PACKAGE} as package

class Finder(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name == "{NAME}.child":
            package.child_begun.set()

sys.meta_path.insert(0, Finder())
found = []
def import_child():
    package.begun.wait(5.0)
    import {NAME}.child
    found.append(sys.modules["{NAME}.child"].value)
threads = [Thread(target=lambda: found.append(package.waits.value)), Thread(target=import_child)]
for thread in threads:
    thread.daemon = True
    thread.start()
for thread in threads:
    thread.join(8.0)
print(found, package.waits is sys.modules["{NAME}"], flush=True)
"""
    with running(
        [sys.executable, "-c", code], cwd=folder.parent, stderr=subprocess.PIPE
    ) as process:
        out, error = process.communicate(timeout=30.0)
    assert (out, error) == ("[7, 7] True\n", "")
