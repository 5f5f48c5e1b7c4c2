"""anaplot: on-line photogrammetric triangulation, every measurement with its redundancy number.

The library, each name loaded when it is first used (docs/library.md):

- `read_block`: a block folder as frozen dataclasses
- `bridge`, `adjust`, `find_gross_errors`, `compare`: what the commands compute, with their options
  as keywords; each returns a `Computed`
- `orient`: one model, from arrays
- `block_report`, `write_report`: what `adjust` has returned, as a page
- `plan.pattern`, `plan.block`, `plan.network`, `simulate`: the same for what is not yet measured
- `each`: one of these for many blocks, on processes, a cluster or any executor
- `replay`: a recorded session through the same code
- `load_profile`, `Decoder`: an instrument's profile, and the readings in its bytes

Lengths are in mm in the image, in m on the ground; angles in rad; residuals in um. What a person
can get wrong raises an `AnaplotError` of one line.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from anaplot.version import JSON_VERSION, __version__

if TYPE_CHECKING:
    from anaplot.errors import AnaplotError, InputError, LinkError, NotComputableError
    from anaplot.exchange.blockfolder import read_block
    from anaplot.photogrammetry.block import Block
    from anaplot.plotter.decoder import Decoder
    from anaplot.plotter.profile import load_profile
    from anaplot.report import plan
    from anaplot.report.adjustcommand import adjust
    from anaplot.report.bridgecommand import bridge, orient
    from anaplot.report.comparecommand import compare
    from anaplot.report.computed import Computed
    from anaplot.report.eachblock import each
    from anaplot.report.findcommand import find_gross_errors
    from anaplot.report.html.write import write_report
    from anaplot.report.replaycommand import replay
    from anaplot.report.reportcommand import block_report
    from anaplot.report.simulatecommand import simulate

__all__ = [
    "JSON_VERSION",
    "AnaplotError",
    "Block",
    "Computed",
    "Decoder",
    "InputError",
    "LinkError",
    "NotComputableError",
    "__version__",
    "adjust",
    "block_report",
    "bridge",
    "compare",
    "each",
    "find_gross_errors",
    "load_profile",
    "orient",
    "plan",
    "read_block",
    "replay",
    "simulate",
    "write_report",
]

# as TYPE_CHECKING imports them
_HOMES = {
    "anaplot.errors": ("AnaplotError", "InputError", "LinkError", "NotComputableError"),
    "anaplot.exchange.blockfolder": ("read_block",),
    "anaplot.photogrammetry.block": ("Block",),
    "anaplot.plotter.decoder": ("Decoder",),
    "anaplot.plotter.profile": ("load_profile",),
    "anaplot.report": ("plan",),
    "anaplot.report.adjustcommand": ("adjust",),
    "anaplot.report.bridgecommand": ("bridge", "orient"),
    "anaplot.report.comparecommand": ("compare",),
    "anaplot.report.computed": ("Computed",),
    "anaplot.report.eachblock": ("each",),
    "anaplot.report.findcommand": ("find_gross_errors",),
    "anaplot.report.html.write": ("write_report",),
    "anaplot.report.replaycommand": ("replay",),
    "anaplot.report.reportcommand": ("block_report",),
    "anaplot.report.simulatecommand": ("simulate",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'anaplot' has no attribute {name!r}")
    home = importlib.import_module(_HOME[name])
    module = not hasattr(home, name)
    value = importlib.import_module(f"{_HOME[name]}.{name}") if module else getattr(home, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
