"""What is imported when: starting is quick, and the core needs neither terminal nor ports."""

from __future__ import annotations

import importlib.util
import pkgutil
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from clibench import TIMEOUT, environment

import anaplot
from anaplot.exchange.blockfolder import write_control, write_image_points, write_new_block
from anaplot.exchange.journal import Journal
from anaplot.ondemand import UNASKED
from anaplot.planning.blockplan import BlockPlan, plan_block

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


@pytest.mark.parametrize(
    "words",
    [
        ("--version",),
        ("--help",),
        ("plan", "--help"),
        ("adjust", "--help"),
        ("completion", "bash"),
        ("new", "FOLDER/b", "--strip", "101-105", "--camera", "rmk15"),
        ("new", "FOLDER/c", "--strip", "1-3", "--strip", "4-6", "--pattern", "13/5"),
        ("status", "FOLDER/declared"),
        ("status", "FOLDER/declared", "--json"),
        ("status", "FOLDER/declared", "--all"),
        ("status", "FOLDER/opened"),
        ("status", "FOLDER/opened", "--json"),
    ],
)
def test_what_computes_nothing_loads_no_mathematics(tmp_path: Path, words: tuple[str, ...]) -> None:
    planned = plan_block(BlockPlan(1, 3, 0.60, 0.30, 3, control_m=0.05)).block
    for name in ("declared", "opened"):
        write_new_block(tmp_path / name, replace(planned, image_points=(), control=()))
        write_control(tmp_path / name, planned.control)
    # nothing is measured yet
    (tmp_path / "opened" / "image_points.csv").write_text("photo,point,x,y\n")
    Journal.open(tmp_path / "opened", {})[0].close()
    loaded = program(*(word.replace("FOLDER", str(tmp_path)) for word in words))
    rooms = {name.partition(".")[0] for name in loaded}
    assert "anaplot" in rooms
    assert not {"numpy", "scipy", "textual", "serial", "jinja2"} & rooms


def test_the_status_of_what_is_not_measured_looks_at_its_settings_alone(tmp_path: Path) -> None:
    assert "anaplot.exchange.blockfolder" in program("new", tmp_path / "b", "--strip", "1-5")
    loaded = program("status", tmp_path / "b")
    rooms = ("adjustment", "orientation", "bundle", "planning", "plotter", "simulation")
    assert not {name for name in loaded if name.startswith(tuple(f"anaplot.{r}." for r in rooms))}
    journal = {"exchange.journal", "session.events", "session.state", "station.edited"}
    assert not {f"anaplot.{name}" for name in journal} & loaded
    assert not {name for name in journal if importlib.util.find_spec(f"anaplot.{name}") is None}


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a block with measurements and control."""
    folder = tmp_path_factory.mktemp("hygiene") / "block"
    planned = plan_block(BlockPlan(2, 4, 0.60, 0.30, 3, control_m=0.05)).block
    write_new_block(folder, replace(planned, image_points=(), control=()))
    write_image_points(folder, planned.image_points)
    write_control(folder, planned.control)
    return folder


def program(*words: object) -> set[str]:
    """Return the modules that the program has loaded when a command has ended well."""
    arguments = ["anaplot", *map(str, words)]
    code = f"""
import contextlib, io, sys
from anaplot.__main__ import main
sys.argv = {arguments!r}
with contextlib.redirect_stdout(io.StringIO()):
    try:
        assert main() == 0
    except SystemExit as end:  # of a help
        assert not end.code
print(*sys.modules)"""
    return set(python(code).split())


# what the console's first screen has no use for: pages, and a simulated instrument
OF_PAGES = {
    *("adjustment.strategies", "adjustment.pooling", "orientation.accuracy"),
    *("orientation.grosserrors", "orientation.stripfit", "planning.synthetic"),
    *("simulation.automatic", "simulation.demo", "simulation.instrument", "station.pointing"),
    *("station.replay", "console.palette"),
}


def test_the_console_loads_what_its_first_screen_shows() -> None:
    code = "import sys, anaplot.console.app, anaplot.simulation.opening\nprint(*sys.modules)"
    loaded = set(python(code).split())
    assert {"anaplot.console.screen", "anaplot.station.station"} <= loaded
    assert "scipy.sparse" not in loaded
    assert not {f"anaplot.{name}" for name in OF_PAGES} & loaded
    assert not {name for name in OF_PAGES if importlib.util.find_spec(f"anaplot.{name}") is None}


# what an adjustment that was asked for nothing more has no use for
ASKED_FOR = {
    *("adjustment.strategies", "adjustment.variancecomponents"),
    *("bundle.errors.controllast", "bundle.errors.grosserrors", "bundle.errors.misfits"),
    *("bundle.hypotheses.chosenparameters", "bundle.hypotheses.components"),
    *("bundle.hypotheses.controlpages", "bundle.hypotheses.priorknowledge"),
    *("bundle.thinning.thinning", "photogrammetry.refinement"),
    *("report.adjusterrors", "report.pageoption", "report.snooping", "report.thinning"),
    *("session.blockaccidents", "session.modelstate", "session.state", "shares.work"),
}


def test_an_adjustment_loads_what_it_uses(block: Path) -> None:
    loaded = program("adjust", block)
    assert "scipy.sparse" in loaded
    assert not {"scipy.optimize", "scipy.spatial", "scipy.fft", "jinja2"} & loaded
    assert not {f"anaplot.{name}" for name in ASKED_FOR} & loaded
    assert not {name for name in ASKED_FOR if importlib.util.find_spec(f"anaplot.{name}") is None}


def test_the_program_loads_of_numpy_what_it_uses(block: Path) -> None:
    # what they load in turn, NumPy's compiler of Fortran and its tests
    assert not {"numpy.f2py.crackfortran", "numpy.testing._private", "unittest"} & program(
        "adjust", block
    )


def test_what_is_loaded_on_demand_is_what_it_is_without() -> None:
    code = f"""
import importlib, sys
from anaplot.ondemand import load_on_demand
load_on_demand()
import numpy, scipy.sparse
before = len(sys.modules)
for name in {sorted(UNASKED)!r}:
    assert importlib.import_module(name) is getattr(numpy, name.split(".")[1])
numpy.testing.assert_allclose([1.0], [1.0])
from numpy.testing import assert_equal
import numpy.ctypeslib as of
print(len(sys.modules) > before, assert_equal is numpy.testing.assert_equal)
print(of.as_ctypes_type(float).__name__, type(numpy.testing).__name__)"""
    assert python(code).split() == ["True", "True", "c_double", "module"]


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
