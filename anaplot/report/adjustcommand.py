"""The command `anaplot adjust`: a block folder in, a report or JSON out."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TextIO

from anaplot.bundle.additional import additional_parameters
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses import block_hypotheses
from anaplot.bundle.problem import Datum
from anaplot.bundle.snooping import PAPER_TOLERANCE
from anaplot.bundle.verdict import HypothesisSettings
from anaplot.exchange.blockfolder import read_block
from anaplot.report.bundlecontract import adjust_json
from anaplot.report.bundletext import adjust_printout
from anaplot.report.correlations import (
    correlated_rays,
    correlations_json,
    correlations_printout,
)
from anaplot.report.hypothesestext import hypotheses_json, hypotheses_printout
from anaplot.report.progress import ProgressLine
from anaplot.report.snoopingreport import snoop_block, snooping_json, snooping_printout

__all__ = ["run_adjust"]


def run_adjust(
    folder: Path,
    *,
    as_json: bool = False,
    fail_on_flag: bool = False,
    datum: Datum = "control",
    additional: str | None = None,
    additional_sigma_um: float | None = None,
    snooping: bool = False,
    tolerance: float = PAPER_TOLERANCE,
    correlations: float | None = None,
    hypothesis_alpha: float = 0.05,
    out: TextIO | None = None,
    err: TextIO | None = None,
) -> int:
    """Adjust a block folder and print the result.

    Parameters
    ----------
    folder
        The block; it is only read.
    as_json
        Print the contract's JSON instead of the report.
    fail_on_flag
        Return 1 when an observation is flagged.
    datum
        "control", "minimal" or "free".
    additional
        "set" or "set:scope" of additional parameters: ebner, gruen, physical; block, strip,
        camera, photo.
    additional_sigma_um
        Their a-priori standard deviation as effect in the image [um]; None: free.
    snooping
        Add the modified data snooping of 1980 beside the exact test.
    tolerance
        Its k_q, a share.
    correlations
        Add the pairs of a point's rays whose residuals are correlated at or above this.
    hypothesis_alpha
        Significance of the tests of additional parameters, check points and control.
    out, err
        Standard output and standard error when None.

    Returns
    -------
    int
        Exit code 0, or 1 with `fail_on_flag`.

    Raises
    ------
    AnaplotError
        Bad input or a block that cannot be computed; nothing is printed then.
    """
    block = read_block(folder)
    chosen = None
    if additional is not None:
        chosen = additional_parameters(additional, additional_sigma_um)
    with ProgressLine(sys.stderr if err is None else err) as progress:
        adjusted = adjust_block(block, datum=datum, additional=chosen, progress=progress)
        progress("report", 0.0)
        snooped = snoop_block(adjusted, tolerance=tolerance) if snooping else None
        pairs = None if correlations is None else correlated_rays(adjusted, correlations)
        tested = block_hypotheses(adjusted, HypothesisSettings(hypothesis_alpha))
    if as_json:
        found = adjust_json(adjusted)
        found["hypotheses"] = hypotheses_json(tested)
        if snooping:
            found["snooping"] = snooping_json(snooped)
        if pairs is not None:
            found["correlations"] = correlations_json(pairs)
        text = json.dumps(found, indent=1, allow_nan=False)
    else:
        parts = [adjust_printout(adjusted)]
        if snooping:
            parts.append(snooping_printout(snooped))
        if pairs is not None and correlations is not None:
            parts.append(correlations_printout(pairs, correlations))
        parts.append(hypotheses_printout(tested))
        text = "\n\n".join(part for part in parts if part)
    print(text, file=sys.stdout if out is None else out)
    return 1 if fail_on_flag and adjusted.any_flagged else 0
