"""The library: its names, its keywords, what it gives, and the examples of its page."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import json
import os
import re
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from documentpages import not_printed

import anaplot
from anaplot.cli import main
from anaplot.exchange.blockfolder import write_image_points
from anaplot.report.adjustarguments import (
    add_adjust_arguments,
    add_bridge_arguments,
    add_compare_arguments,
)
from anaplot.report.keywords import declared_options
from anaplot.report.planarguments import (
    add_additional_arguments,
    add_block_arguments,
    add_network_arguments,
    add_pattern_arguments,
    add_simulate_arguments,
)

ROOT = Path(__file__).parents[1]
EXAMPLES = re.findall(
    r"^```python\n(.*?)^```",
    (ROOT / "docs" / "library.md").read_text(encoding="utf-8"),
    re.M | re.S,
)


def measured(folder: str, seed: int) -> None:
    """Measure a planned block with 5 um noise, and 01-02 in photo 101 wrongly where seed is 1."""
    assert main(["plan", "block", "--strips", "2", "--photos", "4", "--to", folder]) == 0
    rng = np.random.default_rng(seed)
    rows = []
    for row in anaplot.read_block(folder).image_points:
        x, y = rng.normal(size=2) * 0.005
        wrong = 0.08 if (seed, row.photo, row.point) == (1, "102", "01-02") else 0.0
        rows.append(replace(row, x=row.x + x, y=row.y + y + wrong))
    write_image_points(Path(folder), rows)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the blocks that the page speaks of."""
    path = tmp_path_factory.mktemp("library")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        for folder, seed in (("myblock", 1), ("spring", 2), ("autumn", 3), ("winter", 4)):
            measured(folder, seed)
    return path


@pytest.fixture
def here(place: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(place)
    return place


# --- names ----------------------------------------------------------------------------------


def test_every_name_is_there_and_comes_from_where_its_types_do() -> None:
    assert sorted(anaplot.__all__) == sorted(set(anaplot.__all__))
    assert set(anaplot.__all__) <= set(dir(anaplot))
    tree = ast.parse((ROOT / "anaplot" / "__init__.py").read_text(encoding="utf-8"))
    [typed] = [node for node in tree.body if isinstance(node, ast.If)]
    imported = {
        alias.name: node.module
        for node in typed.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported == anaplot._HOME
    for name in anaplot.__all__:
        value = getattr(anaplot, name)
        if callable(value):
            assert inspect.getdoc(value), name
    with pytest.raises(AttributeError, match="no_such"):
        anaplot.no_such  # noqa: B018


@pytest.mark.slow
def test_nothing_is_loaded_before_it_is_used() -> None:
    code = (
        "import sys, anaplot\n"
        "dir(anaplot), anaplot.JSON_VERSION, anaplot.InputError\n"
        "print(*{'numpy', 'scipy', 'serial', 'textual', 'argparse'} & set(sys.modules))\n"
        "anaplot.adjust\n"
        "print(*{'serial', 'textual', 'pandas'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.stdout.split() == []


# --- keywords -------------------------------------------------------------------------------

SHOWN = {"json", "all", "csv", "tables", "report", "figures", "angles", "fail_on_flag", "list"}
RUN = {"time_limit"}  # a library call is ended by its `progress`
COMMANDS: dict[str, tuple[Callable[..., Any], Callable[[ArgumentParser], None], set[str]]] = {
    "bridge": (anaplot.bridge, add_bridge_arguments, SHOWN),
    "adjust": (anaplot.adjust, add_adjust_arguments, SHOWN | RUN),
    "compare": (anaplot.compare, add_compare_arguments, SHOWN),
    "plan pattern": (anaplot.plan.pattern, add_pattern_arguments, SHOWN),
    "plan additional": (anaplot.plan.additional, add_additional_arguments, SHOWN),
    "plan block": (anaplot.plan.block, add_block_arguments, SHOWN | {"to"}),
    "plan network": (anaplot.plan.network, add_network_arguments, SHOWN | {"to"}),
    "plan simulate": (anaplot.simulate, add_simulate_arguments, SHOWN),
}


def words(annotation: Any) -> set[str]:
    """Return the words that a type allows."""
    if get_origin(annotation) is Literal:
        return set(map(str, get_args(annotation)))
    return {word for part in get_args(annotation) for word in words(part)}


@pytest.mark.parametrize("command", COMMANDS)
def test_the_keywords_are_the_options(command: str) -> None:
    compute, declare, shown = COMMANDS[command]
    options = {name: o for name, o in declared_options(declare).items() if name not in shown}
    keywords = inspect.signature(compute).parameters
    assert set(keywords) - {"progress", "executor"} == set(options)
    types = get_type_hints(compute)
    for name, option in options.items():
        keyword = keywords[name]
        if not option.option_strings:
            assert keyword.default is inspect.Parameter.empty
            continue
        assert keyword.kind is inspect.Parameter.KEYWORD_ONLY
        assert keyword.default == option.default, name
        assert words(types[name]) == set(option.choices or ()), name


def test_gross_errors_are_searched_with_the_options_of_adjust() -> None:
    mine = inspect.signature(anaplot.find_gross_errors).parameters
    theirs = inspect.signature(anaplot.adjust).parameters
    for name, keyword in mine.items():
        assert keyword.annotation.removesuffix(" | None") in theirs[name].annotation
        assert name == "errors" or keyword.default == theirs[name].default


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"datum": "fre"}, "--datum: no 'fre' (did you mean 'free'?)"),
        ({"errors": "odd"}, "--errors: no 'odd' (did you mean 'odds'?)"),
        ({"partner": 2.0}, "--partner: '2.0' is no correlation: above 0, at most 1"),
        ({"partner": 0.9}, "--partner, --pairs, --as-given and --control-last go with --errors"),
        ({"pairs": 1}, "--pairs: neither True nor False"),
        ({"snooping_model": "5x5"}, "--snooping-bridging go with --snooping"),
        ({"snooping_model": "sampled"}, "--snooping-bridging go with --snooping"),
        ({"snooping_tolerance": 25.0}, "--snooping-bridging go with --snooping"),
        ({"snooping_tolerance": 100}, "--snooping-tolerance: '100' must lie below 100"),
        ({"hypothesis_alpha": float("nan")}, "--hypothesis-alpha: 'nan' is no positive number"),
        ({"components": "operators"}, "--components operators and --operators FILE go together"),
        ({"prior": "known", "components": "axes"}, "--prior and --components both estimate"),
    ],
)
def test_a_keyword_is_checked_as_the_option_is(keywords: dict[str, Any], words: str) -> None:
    with pytest.raises(anaplot.InputError, match=re.escape(words)) as caught:
        anaplot.adjust("nowhere", **keywords)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "found"),
    [
        ("function", "distance 02-02 02-03", "functions"),
        ("test_set", "point:02-02", "test_sets"),
        ("plant", "101:02-02:y:100", "planted"),
    ],
)
def test_what_may_stand_several_times_stands_once_as_a_text(
    key: str, value: str, found: str
) -> None:
    """One by one, its characters were asked for: "no 'd'", "p: file not found"."""
    block = anaplot.plan.block(strips=2, photos=3, control_m=0.02, sidelap=60).result.made.block
    once = anaplot.adjust(block, **{key: value}).to_dict()
    listed = anaplot.adjust(block, **{key: [value]}).to_dict()
    assert once[found]
    assert once[found] == listed[found]


def test_a_place_of_a_simulation_is_one_text_or_several() -> None:
    asked: dict[str, Any] = {"errors": [1], "strategy": "tau", "runs": 5, "processes": 1}
    once = anaplot.simulate("6/3", place="point:1", **asked).to_dict()
    assert once == anaplot.simulate("6/3", place=["point:1"], **asked).to_dict()


def described() -> list[tuple[str, Any]]:
    """Return the names of docs/api.md, of classes each public method apart."""
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    names = re.findall(r"^\.\. auto(?:function|class|exception):: anaplot\.(\w+)$", page, re.M)
    found = [(name, getattr(anaplot, name)) for name in names]
    [members] = re.findall(r"automodule:: anaplot\.report\.plan\n +:members: (.*)$", page, re.M)
    found += [(name, getattr(anaplot.plan, name)) for name in members.split(", ")]
    for name, one in tuple(found):
        if inspect.isclass(one):
            of_class = ((key, getattr(value, "fget", value)) for key, value in vars(one).items())
            found += [
                (f"{name}.{key}", value)
                for key, value in of_class
                if inspect.isfunction(value) and (key == "__init__" or not key.startswith("_"))
            ]
    return found


def test_the_types_of_every_name_can_be_asked_for() -> None:
    asked = described()
    assert len(asked) > 50
    unknown: dict[str, set[str]] = {}
    for name, one in asked:
        try:
            get_type_hints(one)
            if inspect.isfunction(one):
                inspect.signature(one, eval_str=True)
        except NameError as error:
            unknown.setdefault(error.name, set()).add(name)
    # what need not be installed
    assert unknown == {"pandas": {"Computed.to_frame"}}


def test_what_cannot_be_searched_with_is_said_before_the_block_is_read() -> None:
    with pytest.raises(anaplot.InputError, match=r"--errors: no 'tua' \(did you mean 'tau'\?\)"):
        anaplot.find_gross_errors("nowhere", "tua")  # type: ignore[arg-type]


# --- what it gives --------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "call"),
    [
        (["adjust", "myblock"], lambda: anaplot.adjust("myblock")),
        pytest.param(
            ["adjust", "myblock", "--errors", "search", "--snooping", "--snooping-tolerance", "10",
             "--components", "kinds", "--correlations", "0.5"],
            lambda: anaplot.adjust(
                Path("myblock"), errors="search", snooping=True, snooping_tolerance=10.0,
                components="kinds", correlations=0.5,
            ),
            marks=pytest.mark.slow,
        ),
        (["bridge", "myblock"], lambda: anaplot.bridge("myblock")),
        (
            ["bridge", "spring", "--errors", "tau", "--pairs", "--partner", "0.8"],
            lambda: anaplot.bridge("spring", errors="tau", pairs=True, partner=0.8),
        ),
        (
            ["compare", "spring", "autumn", "--separate", "--points", "02-02,02-03"],
            lambda: anaplot.compare(
                anaplot.read_block("spring"), "autumn", separate=True, points=["02-02", "02-03"]
            ),
        ),
        (
            ["plan", "pattern", "6", "--ties", "3", "--base", "92"],
            lambda: anaplot.plan.pattern("6", ties=3, base=92),
        ),
        (
            ["plan", "block", "--strips", "2", "--photos", "3", "--twin", "--points", "5x5"],
            lambda: anaplot.plan.block(strips=2, photos=3, twin=True, points="5x5"),
        ),
        (
            ["plan", "network", "cube", "--case", "C", "--point", "2"],
            lambda: anaplot.plan.network("cube", case="C", point="2"),
        ),
        pytest.param(
            ["plan", "simulate", "6/3", "--errors", "0,1", "--size", "8", "--place", "point:2",
             "--strategy", "tau,odds", "--runs", "5", "--seed", "5", "--processes", "1"],
            lambda: anaplot.simulate(
                "6/3", errors=[0, 1], size=[8], place=["point:2"], strategy=["tau", "odds"],
                runs=5, seed=5, processes=1,
            ),
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_a_call_gives_what_the_command_prints(
    here: Path,
    words: list[str],
    call: Callable[[], anaplot.Computed[Any]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = call()
    assert capsys.readouterr().out == ""
    assert main([*words, "--json"]) == 0
    assert found.to_dict() == json.loads(capsys.readouterr().out)
    assert main(words) == 0
    assert f"{found}\n" == capsys.readouterr().out
    shown = ["--all"] if words[0] == "plan" else ["--all", "--fail-on-flag"]
    assert main([*words, *shown]) == int(found.flagged)
    assert found.text(everything=True) + "\n" == capsys.readouterr().out
    assert len(repr(found)) <= 100
    assert "\n" not in repr(found)


def test_columns_are_arrays_with_the_keys_of_json(here: Path) -> None:
    found = anaplot.adjust("myblock")
    answer = found.to_dict()
    assert found.tables[0] == "points"
    assert all(
        np.array_equal(found.to_columns()[key], [row[key] for row in answer["points"]])
        for key in answer["points"][0]
    )
    rays = found.to_columns("image_points")
    assert rays["rx"].dtype == rays["wx"].dtype == float
    assert rays["flagged"].dtype == bool
    assert rays["rx"].sum() + rays["ry"].sum() == pytest.approx(answer["redundancy"])
    wx = [row["wx"] for row in answer["image_points"]]
    np.testing.assert_array_equal(rays["wx"], np.array(wx, dtype=float))
    with pytest.raises(anaplot.InputError, match=r"no table 'point' \(did you mean 'points'\?\)"):
        found.to_columns("point")


@pytest.mark.slow
def test_a_search_is_the_part_of_the_adjustment(here: Path) -> None:
    found = anaplot.find_gross_errors("myblock", "search", pairs=True)
    whole = anaplot.adjust("myblock", errors="search", pairs=True)
    assert found.to_dict() == whole.to_dict()["errors"]
    assert str(found) in str(whole)
    assert found.result.rejected == whole.result.rejected
    assert found.flagged


def test_a_search_ends_when_its_watch_is_stopped(here: Path) -> None:
    from anaplot.adjustment.watch import Watch

    told = []
    watch = Watch(lambda what, fraction: told.append(what))
    watch.stop()
    found = anaplot.find_gross_errors("myblock", "search", progress=watch)
    assert told
    assert [remark for remark in found.result.remarks if "interrupt" in remark]


def test_a_model_from_arrays_is_that_of_the_bridge(here: Path) -> None:
    block = anaplot.read_block("spring")
    bridged = anaplot.bridge(block)
    models = bridged.result.strips[0].models
    assert bridged.result.cleaned is None
    preceding = None
    for k, model in enumerate(models):
        left, right = (
            {row.point: (row.x, row.y) for row in block.image_points
             if (row.photo, row.model) == (photo, model.name)}
            for photo in (model.left, model.right)
        )  # fmt: skip
        names = [name for name in left if name in right]
        found = anaplot.orient(
            np.array([left[name] for name in names]),
            [right[name] for name in names],
            c=150.0,
            names=names,
            photos=(model.left, model.right),
            base=block.strips[0].base,
            preceding=preceding,
            test="baarda",
        )
        preceding = found.result
        np.testing.assert_allclose(preceding.base, model.base, rtol=1e-9)
        expected = bridged.to_dict()["strips"][0]["models"][k]
        assert found.to_dict().keys() == expected.keys()
        for key in ("redn", "parx_um", "expd_um", "sigf"):
            wanted = np.array([row[key] for row in expected["table"]], dtype=float)
            np.testing.assert_allclose(found.to_columns()[key], wanted, rtol=1e-6, atol=1e-9)
    assert len(models) == 3
    assert preceding is not None
    assert preceding.ties


POINTS = [[x, y] for x in (0.0, 90.0) for y in (-90.0, 0.0, 90.0)]


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"right": [[0.0, 0.0]]}, "left and right: shapes (6, 2) and (1, 2), not (n, 2)"),
        ({"left": [1.0, 2.0]}, "shapes (2,) and (6, 2)"),
        ({"left": 1.0}, "shapes () and (6, 2)"),
        ({"names": ["1"]}, "names: 1 (1 different) of 6 points"),
        ({"names": ["1"] * 6}, "names: 6 (1 different) of 6 points"),
        ({"left": [["one", 2.0], [1.0, 2.0]]}, "left: not an array of numbers"),
        ({"right": [[0.0, 0.0], [1.0]]}, "right: not an array of numbers"),
        ({"right": np.array(POINTS) + 1j}, "right: complex numbers"),
        ({"left": [[1e300, 0.0]] * 6}, "left: a number beyond 1e+07 mm"),
        ({"c": "wide"}, "c: not an array of numbers"),
        ({"c": [150.0] * 3}, "c: neither a number nor one for each of the two photos"),
        ({"c": [[150.0], [150.0]]}, "c: neither a number nor one for each of the two photos"),
        ({"c": -150.0}, "c: -150 is no positive number"),
        ({"c": (150.0, float("nan"))}, "c: nan is no positive number"),
        ({"image_um": 0.0}, "image_um: 0 is no positive number"),
        ({"base": 0.0}, "base: 0 is no positive number"),
        ({"base": float("nan")}, "base: nan is no positive number"),
        ({"test": "bardaa"}, "test: no 'bardaa' (did you mean 'baarda'?)"),
        ({"alpha": 0.9}, "alpha 0.9, power 0.8"),
    ],
)
def test_arrays_that_are_no_model_are_refused(keywords: dict[str, Any], words: str) -> None:
    given = {"left": POINTS, "right": POINTS, "c": 150.0, **keywords}
    with pytest.raises(anaplot.InputError, match=re.escape(words)):
        anaplot.orient(**given)


def test_a_masked_coordinate_is_none() -> None:
    left = np.ma.masked_array(POINTS, mask=np.array(POINTS) == 0.0)
    with pytest.raises(anaplot.NotComputableError, match="point 1 has a coordinate that is not"):
        anaplot.orient(left, np.add(POINTS, (90.0, 0.1)), c=(150.0, 150.0))


@pytest.mark.parametrize("compute", [anaplot.adjust, anaplot.bridge])
@pytest.mark.parametrize(("x", "said"), [(np.nan, "nan"), (-np.inf, "-inf"), (1e200, r"1e\+200")])
def test_a_block_in_memory_whose_coordinates_are_none(
    here: Path, compute: Callable[..., object], x: float, said: str
) -> None:
    block = anaplot.read_block("spring")
    rows = list(block.image_points)
    rows[3] = replace(rows[3], x=x)
    place = f"image point {rows[3].point} of photo {rows[3].photo}: {said}, .* are no coordinates"
    with pytest.raises(anaplot.InputError, match=place):
        compute(replace(block, image_points=rows))


def test_a_strip_that_ends_early_says_why(here: Path) -> None:
    block = anaplot.read_block("spring")
    few = [row for row in block.image_points if row.model != "102/103" or row.point < "02"]
    found = anaplot.bridge(replace(block, image_points=tuple(few)))
    first, second = found.result.strips
    assert first.error is not None
    assert "102/103" in first.error
    assert len(first.models) == 1
    assert second.error is None


@pytest.mark.slow
def test_a_replay_gives_the_models_of_the_session(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--auto", "--models", "1", "--keep", "session"]) == 0
    capsys.readouterr()
    found = anaplot.replay("session")
    assert not found.flagged
    assert found.result.measurements > 0
    assert main(["replay", "session", "--json"]) == 0
    assert found.to_dict() == json.loads(capsys.readouterr().out)


# --- the page -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_the_examples_of_the_page(
    number: int, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = EXAMPLES[number]
    if "to_frame" in code and importlib.util.find_spec("pandas") is None:
        pytest.skip("pandas is not installed")
    exec(compile(code, f"docs/library.md example {number + 1}", "exec"), {})
    assert not_printed(code, capsys.readouterr().out) == []


def test_the_page_shows_every_name() -> None:
    code = "\n".join(EXAMPLES)
    functions = {n for n in anaplot.__all__ if n[0].islower()}
    assert {n for n in functions if not re.search(rf"anaplot\.{n}[(.]", code)} == set()
    assert len(EXAMPLES) >= 4
