"""Where work is done, as a command line says it; light, `--help` reads it."""

from __future__ import annotations

import re

__all__ = ["LOCAL", "cluster_address"]

LOCAL = "local"
_LABEL = r"[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?"
_ADDRESS = re.compile(
    rf"dask://((?=[^:]{{1,253}}:){_LABEL}(?:\.{_LABEL})*\.?|\[[0-9A-Fa-f:.]{{2,45}}\]):([0-9]{{1,5}})"
)
_PORTS = range(1, 2**16)


def cluster_address(text: str) -> str | None:
    """Return HOST:PORT of a cluster's scheduler; None: this machine.

    Parameters
    ----------
    text
        "local", or "dask://HOST:PORT"; an IPv6 address stands in brackets.

    Raises
    ------
    ValueError
        It is neither; says how it is written.
    """
    if text == LOCAL:
        return None
    found = _ADDRESS.fullmatch(text)
    if found is None or int(found[2]) not in _PORTS:
        raise ValueError(f"must be {LOCAL}, or dask://HOST:PORT")
    return f"{found[1]}:{int(found[2])}"
