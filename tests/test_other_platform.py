"""What POSIX alone has is not needed: commands, console, a session with its lock and journal."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from clibench import TIMEOUT, environment

ROOT = Path(__file__).parents[1]
REFUSED = re.compile(
    r'[<>:"|?*\\\x00-\x1f]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.IGNORECASE
)
"""What Windows takes in no file's name."""


@pytest.mark.slow
@pytest.mark.long
def test_the_work_of_an_operator_without_posix(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "warn_default_encoding", "tests/otherplatform.py", str(tmp_path)],
        cwd=ROOT,
        env=environment(PYTHONWARNINGS="default"),
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert done.stdout.splitlines()[-1:] == ["as elsewhere"], done.stderr + done.stdout
    written = [path.name for path in tmp_path.rglob("*")]
    assert len(written) > 20
    assert [name for name in written if REFUSED.search(name)] == []


@pytest.mark.parametrize(
    "code",
    [
        "import fcntl",
        "import os; os.fork()",
        "import anaplot.textfiles.wording as w; open(w.__file__).close()",
    ],
)
def test_what_is_missing_there_is_missing(code: str) -> None:
    place = "exec(compile(CODE, 'x', 'exec'), {'__name__': 'anaplot.x'})".replace(
        "CODE", repr(code)
    )
    done = subprocess.run(
        [
            sys.executable,
            "-X",
            "warn_default_encoding",
            "-c",
            f"import otherplatform as o; o.BEFORE = (); o.become_another_platform(); {place}",
        ],
        env=environment(PYTHONPATH=f"{ROOT}:{ROOT / 'tests'}", PYTHONWARNINGS="default"),
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert done.returncode == 1
    assert re.search("ModuleNotFoundError|AttributeError|EncodingWarning", done.stderr)
