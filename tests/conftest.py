"""What every test process needs: one thread of linear algebra, steady examples, lanes, interrupts.

Several test processes share the processors, so that no example may be judged by its time. The same
examples are tried every time, forty where a test does not ask for more; others, and more of them,
with `pytest --hypothesis-profile explore`. A command started in the background is told to ignore
interrupts, and hands that on to every process it starts, also to those that a test interrupts.

The fast lane (`-m "not slow"`) has the mathematics, the session and the codecs. Rooms that wait for
terminals, lines and commands are slow as wholes, but for what is marked `smoke`.

What is marked `long` comes first, so that no process is left alone with it at the end.

Circles are searched for seldom: a million objects stay from the collection to the end.
"""

import atexit
import gc
import os
import shutil
import signal
import tempfile
from collections.abc import Generator
from itertools import islice
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# before anything imports numpy, which reads them once
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# no test, and no command that it starts, reads or writes the configuration of who runs it
_configuration = tempfile.mkdtemp(prefix="anaplot-tests-")
atexit.register(shutil.rmtree, _configuration, ignore_errors=True)
os.environ["XDG_CONFIG_HOME"] = _configuration

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

_patient = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("steady", _patient, derandomize=True, max_examples=40)
settings.register_profile("explore", _patient, print_blob=True, max_examples=200)
settings.load_profile("steady")

# by themselves the searches take five of a hundred seconds, and a fifth of the collection
gc.set_threshold(20_000, 20, 20)

_SLOW_ROOMS = {"console", "report", "station"}


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> Generator[None, None, None]:
    here = Path(__file__).parent
    for item in items:
        slow = item.path.relative_to(here).parts[0] in _SLOW_ROOMS
        if slow and item.get_closest_marker("smoke") is None:
            item.add_marker(pytest.mark.slow)
    yield  # pytest takes out what -m does not want
    _long_first(items, int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))


def _long_first(items: list[pytest.Item], processes: int) -> None:
    """Begin with the long ones the part of the list that each process is given (worksteal)."""
    long = [item for item in items if item.get_closest_marker("long") is not None]
    others = iter([item for item in items if item.get_closest_marker("long") is None])
    out: list[pytest.Item] = []
    for k in range(processes):
        own = long[k::processes]
        size = (len(items) - len(out)) // (processes - k)
        out += own + list(islice(others, max(0, size - len(own))))
    items[:] = [*out, *others]
