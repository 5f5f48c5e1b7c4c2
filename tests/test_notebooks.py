"""The notebooks of the documents: kept without outputs, and every cell does what it says."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

import pytest
from extras import needed
from processes import ROOT, running

FOLDER = ROOT / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
EXECUTE = """
import sys
from nbclient import NotebookClient
import nbformat
with open(sys.argv[1], encoding="utf-8") as file:
    book = nbformat.read(file, as_version=4)
NotebookClient(book, timeout=240, resources={"metadata": {"path": "work"}}).execute()
print(sum(cell.cell_type == "code" for cell in book.cells), "cells")
"""


def cells(path: Path) -> list[dict]:
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


def source(cell: dict) -> str:
    return "".join(cell["source"])


def test_the_three_are_there() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["colmap", "model", "planning"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_in_one_form(path: Path) -> None:
    """No output, no count, no name of a cell that chance gave: a change shows what was changed."""
    text = path.read_text(encoding="utf-8")
    book = json.loads(text)
    assert text == json.dumps(book, indent=1, ensure_ascii=False, sort_keys=True) + "\n"
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    assert set(book["metadata"]) == {"kernelspec", "language_info"}
    assert book["metadata"]["language_info"] == {"name": "python"}
    names = [cell["id"] for cell in book["cells"]]
    assert names == [f"{path.stem}-{k:02d}" for k in range(1, len(names) + 1)]
    for cell in book["cells"]:
        assert cell["metadata"] == {}
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_teaches_by_what_it_asserts(path: Path) -> None:
    code = [source(cell) for cell in cells(path) if cell["cell_type"] == "code"]
    prose = [source(cell) for cell in cells(path) if cell["cell_type"] == "markdown"]
    assert sum(len(re.findall(r"^assert ", text, re.MULTILINE)) for text in code) >= 6
    assert any("plt.show()" in text for text in code)
    assert prose[0].startswith("# ")
    for target in re.findall(r"\]\(([^)#]+)", "".join(prose)):
        assert (path.parent / target).is_file(), target


def test_a_notebook_is_valid() -> None:
    nbformat = needed("nbformat", "notebooks")
    for path in NOTEBOOKS:
        nbformat.validate(nbformat.read(path, as_version=4))


def executed(path: Path, folder: Path) -> tuple[int, str]:
    """Run a notebook by a kernel whose files all lie in a folder; returns code and what is said."""
    (folder / "work").mkdir()
    own = ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR", "MPLCONFIGDIR")
    places = {name: str(folder / name.lower()) for name in own}
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", **places}
    with running(
        [sys.executable, "-c", EXECUTE, path], cwd=folder, env=environment, stderr=-2
    ) as process:
        said, _ = process.communicate(timeout=280)
    return process.returncode, said


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_does_what_it_says(path: Path, tmp_path: Path) -> None:
    for module in ("nbclient", "nbformat", "ipykernel", "matplotlib"):
        needed(module, "notebooks")
    before = path.read_bytes(), sorted(FOLDER.iterdir())
    code, said = executed(path, tmp_path)
    assert code == 0, said[-3000:]
    count = sum(cell["cell_type"] == "code" for cell in cells(path))
    assert said.splitlines()[-1] == f"{count} cells"
    assert (path.read_bytes(), sorted(FOLDER.iterdir())) == before
    # the kernel is gone, with the file by which it was spoken to
    assert list(tmp_path.glob("jupyter_runtime_dir/*.json")) == []


@pytest.mark.slow
def test_a_cell_that_is_wrong_is_told(tmp_path: Path) -> None:
    for module in ("nbclient", "nbformat", "ipykernel"):
        needed(module, "notebooks")
    book = json.loads(NOTEBOOKS[0].read_text(encoding="utf-8"))
    book["cells"] = [book["cells"][1] | {"source": ["assert 1 + 1 == 3"]}]
    wrong = tmp_path / "wrong.ipynb"
    wrong.write_text(json.dumps(book), encoding="utf-8")
    code, said = executed(wrong, tmp_path)
    assert code != 0
    assert "AssertionError" in said
