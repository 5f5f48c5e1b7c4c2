"""The automatic operator's jobs, to be killed: each tells all it is told.

One process does a job for every line that it reads, the first by itself; all others are done by
forks of it, which have loaded everything already. Says the number of the process that does the job,
then what the operator is told, and at last how the process ended.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path

from anaplot.simulation.automatic import AutomaticOperator
from anaplot.simulation.demo import Demo


def say(*words: object) -> None:
    """Write a line whole or not at all: several threads speak, and the process may be killed."""
    os.write(1, (" ".join(map(str, words)) + "\n").encode())


def work(folder: Path, models: int, seed: int, fiducials: bool) -> None:
    demo = Demo.make(models, seed, fiducials=fiducials)
    if not (folder / "block.toml").exists():
        demo.write(folder)
    with demo.open(folder, time_scale=2000.0) as station:
        station.subscribe_notices(say)
        AutomaticOperator(station).run()
    say("finished")


def forked(folder: Path, models: int, seed: int, fiducials: bool) -> int:
    """Do the job in a fork; returns how it ended, as os.waitpid says it."""
    assert threading.active_count() == 1  # a fork has no other threads
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1]
    code = 1
    try:
        say("process", os.getpid())
        work(folder, models, seed, fiducials)
        code = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        os._exit(code)


def main() -> None:
    loaded = False
    for line in sys.stdin:
        name, *job = json.loads(line)
        ended = 0
        if loaded:
            ended = forked(Path(name), *job)
        else:
            say("process", os.getpid())
            work(Path(name), *job)
            loaded = True
        say("ended", ended)


if __name__ == "__main__":
    main()
