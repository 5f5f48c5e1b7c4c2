"""Where the model values of a modified data snooping come from: the block, the paper, or a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, cast

from anaplot.aliases import Axis
from anaplot.bundle.errors.papermodels import PaperModel, paper_models, regular_block
from anaplot.bundle.errors.snooping import ObservationClass, estimate_models
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.errors import InputError
from anaplot.exchange.modelvaluesfile import read_model_values
from anaplot.report.columns import counted

__all__ = ["SAMPLED", "ModelValues", "snooping_models"]

SAMPLED = "sampled"
_BEFORE = "block"  # its former name
_PAPER = {
    "3x3": PaperModel(3),
    "3x3-twin": PaperModel(3, twin=True),
    "5x5": PaperModel(5),
    "5x5-twin": PaperModel(5, twin=True),
}


class ModelValues(NamedTuple):
    """Model values and where they come from.

    Attributes
    ----------
    source
        "sampled", one of the paper's blocks, or "file".
    words
        The same, for people.
    roots
        Model value of sqrt(q_vv) by class.
    """

    source: str
    words: str
    roots: Mapping[ObservationClass, float]


def snooping_models(
    block: AdjustedBlock, source: str | os.PathLike[str], bridging: float | None = None
) -> ModelValues:
    """Return the model values that are asked for.

    Parameters
    ----------
    block
        The adjusted block.
    source
        "sampled": a few exact ones of each of its classes; "paper": those of Table 2 of Gruen
        (1980) for the regular block that is most like it; "3x3", "3x3-twin", "5x5" or "5x5-twin":
        for that one; else a CSV file, as `plan block --csv` writes it.
    bridging
        Bases from control to control: of control the paper's curves instead of their means.

    Raises
    ------
    InputError
        The file is not good, or a bridging distance stands beside other values than the paper's.
    """
    paper = regular_block(block) if source == "paper" else _PAPER.get(os.fspath(source))
    if paper is not None:
        name = next(name for name, model in _PAPER.items() if model == paper)
        return ModelValues(
            name, _described(paper, bridging), paper_models(paper._replace(bridging=bridging))
        )
    if bridging is not None:
        raise InputError("--snooping-bridging goes with the paper's values: --snooping-model paper")
    if source in (SAMPLED, _BEFORE):
        roots = estimate_models(block.cofactors.normal, block.cofactors.factor)
        return ModelValues(SAMPLED, "estimated for this block", roots)
    path = Path(source)
    read = {
        ObservationClass(row.rays, row.inner, row.control, cast(Axis, row.axis)): row.root
        for row in read_model_values(path)
    }
    return ModelValues("file", f"of {path.name}", read)


def _described(paper: PaperModel, bridging: float | None) -> str:
    pairs = " and control in pairs" if paper.twin else ""
    curves = "" if bridging is None else f", control every {counted(bridging, 'base')}"
    return f"of regular 60/60 blocks with {paper.side} x {paper.side} points a photo{pairs}{curves}"
