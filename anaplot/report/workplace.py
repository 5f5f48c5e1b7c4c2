"""Where a command computes: `--on`, and what a program gives in its place."""

from __future__ import annotations

import os
from concurrent.futures import Executor
from pathlib import Path

from anaplot.errors import InputError
from anaplot.shares.address import cluster_address
from anaplot.shares.cluster import Cluster
from anaplot.shares.local import GivenExecutor, LocalProcesses
from anaplot.shares.work import Place, SharesLostError
from anaplot.textfiles.wording import place, plain

__all__ = ["place_of", "said_how_to_go_on"]

_MOST = 256  # processes
_AT_A_TIME = 32  # shares that an executor is given of which nobody says what it can do


def place_of(on: str, processes: int | None, executor: Executor | None) -> Place:
    """Return where shares of work are done.

    Parameters
    ----------
    on
        As `cluster_address` reads it.
    processes
        Of this machine, None: as many as it has processors; of an executor as many at a time.
    executor
        None: there is none.

    Raises
    ------
    InputError
        What does not go together.
    """
    if processes is not None and (type(processes) is not int or not 1 <= processes <= _MOST):
        said = plain(repr(processes), 60)
        raise InputError(f"--processes: {said} is no whole number from 1 to {_MOST}")
    address = cluster_address(on)
    if executor is not None:
        if address is not None:
            raise InputError("--on does not go with an executor")
        return GivenExecutor(executor, 2 * (processes or _AT_A_TIME))
    if address is None:
        return LocalProcesses(processes or max(os.cpu_count() or 1, 1))
    if processes is not None:
        raise InputError("--processes goes with --on local: a cluster has workers of its own")
    return Cluster(address)


def said_how_to_go_on(error: SharesLostError, to: str | os.PathLike[str] | None) -> SharesLostError:
    """Return that workers were lost, and what of the work is kept; `to`: the file, if any."""
    if to is None:
        kept = "nothing is kept: --to FILE keeps what is done, and goes on from there"
    else:
        kept = f"{place(Path(to))} has what is done: the same call goes on from there"
    return SharesLostError(f"{error}; {kept}")
