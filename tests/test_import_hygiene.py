"""What is imported when: starting is quick, and the core needs neither terminal nor ports."""

from __future__ import annotations

import ast
import importlib.util
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest
from clibench import TIMEOUT, environment

import anaplot

pytestmark = pytest.mark.slow


def python(code: str) -> str:
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=environment(),
        timeout=TIMEOUT,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


LOADED = "print(*sorted({name.split('.')[0] for name in sys.modules}))"


@pytest.mark.parametrize(
    "code",
    [
        "import anaplot.cli",
        "import anaplot.cli, contextlib, io\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "    anaplot.cli.main(['--help'])",
        # an error with its nearest name, and none at all
        "import anaplot.cli\nassert anaplot.cli.main(['adjust', 'b', '--jsn']) == 2",
        "import anaplot.cli\nassert anaplot.cli.main([]) == 2",
        "import anaplot.cli, contextlib, io\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        "    assert anaplot.cli.main(['manual']) == 0",
    ],
)
def test_the_command_line_starts_with_nothing(code: str) -> None:
    loaded = python(f"import sys\n{code}\n{LOADED}").split()
    assert not {"numpy", "scipy", "textual", "serial", "jinja2", "shtab"} & set(loaded)


def test_what_computes_nothing_loads_no_mathematics(tmp_path: Path) -> None:
    block, quiet = str(tmp_path / "b"), "contextlib.redirect_stdout(io.StringIO())"
    code = f"""
import anaplot.cli, contextlib, io, sys
with {quiet}:
    assert anaplot.cli.main(['new', {block!r}, '--strip', '101-105', '--camera', 'rmk15']) == 0
    assert anaplot.cli.main(['status', {block!r}]) == 0
{LOADED}"""
    assert not {"scipy", "textual", "serial", "jinja2"} & set(python(code).split())


def test_an_adjustment_loads_of_scipy_what_it_uses() -> None:
    code = "import sys, anaplot.report.applyerrors\nprint(*sys.modules)"
    loaded = set(python(code).split())
    assert "scipy.sparse" in loaded
    assert not {"scipy.optimize", "scipy.spatial", "scipy.fft", "jinja2"} & loaded


ROOMS = (
    "textfiles",
    "drawing",
    "adjustment",
    "photogrammetry",
    "orientation",
    "planning",
    "session",
    "exchange",
)


@pytest.mark.parametrize("room", ROOMS)
def test_the_core_needs_neither_terminal_nor_ports(room: str) -> None:
    code = f"""
import importlib, pkgutil, sys
for name in ("textual", "serial"):
    sys.modules[name] = None
package = importlib.import_module("anaplot.{room}")
for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
    importlib.import_module(found.name)
print(len([n for n in sys.modules if n.startswith("anaplot.{room}.")]))
"""
    assert int(python(code)) >= 2


def test_files_of_other_programs_need_no_network() -> None:
    modules = [name for name in every_module() if name.startswith("anaplot.exchange.formats.")]
    assert len(modules) > 30
    loaded = python(f"import sys, {', '.join(modules)}\n{LOADED}").split()
    assert not {"http", "ssl", "socket"} & set(loaded)


def test_the_station_needs_no_terminal() -> None:
    code = "import sys; sys.modules['textual'] = None; import anaplot.simulation.demo"
    python(code)


def every_module() -> list[str]:
    return [
        found.name
        for found in pkgutil.walk_packages(anaplot.__path__, "anaplot.")
        if not found.name.endswith("__main__")
    ]


def test_what_others_import_is_public() -> None:
    trees = {}
    for name in every_module():
        spec = importlib.util.find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        trees[name] = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    public = {
        name: {
            word
            for node in tree.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
            for word in ast.literal_eval(node.value)
        }
        for name, tree in trees.items()
    }
    hidden = {
        f"{node.module}.{each.name}"
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module in trees
        for each in node.names
        if f"{node.module}.{each.name}" not in trees and each.name not in public[node.module]
    }
    assert len(trees) > 40
    assert not hidden


def test_nothing_imports_scipy_stats() -> None:
    names = every_module()
    assert len(names) > 40
    code = (
        "import importlib, sys\n"
        f"for name in {names!r}: importlib.import_module(name)\n"
        "print('scipy.stats' in sys.modules)"
    )
    assert python(code).strip() == "False"
    for path in Path(anaplot.__path__[0]).rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"^\s*(import|from) scipy\.stats", text, re.MULTILINE), path
        assert not re.search(r"^\s*from scipy import .*\bstats\b", text, re.MULTILINE), path


def test_bridging_and_a_demo_stay_off_scipy_stats(tmp_path: Path) -> None:
    folder = str(tmp_path / "d")
    code = f"""
import sys, anaplot.cli, io, contextlib
with contextlib.redirect_stdout(io.StringIO()):
    assert anaplot.cli.main(["demo", "--auto", "--models", "1", "--keep", {folder!r}]) == 0
    assert anaplot.cli.main(["bridge", {folder!r}]) == 0
print("scipy.stats" in sys.modules, "textual" in sys.modules, "jinja2" in sys.modules)
"""
    assert python(code).split() == ["False", "False", "False"]
