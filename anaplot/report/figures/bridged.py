"""The figures of the models of a block's strips."""

from __future__ import annotations

from collections.abc import Callable

from anaplot.drawing.drawing import Drawing
from anaplot.orientation.diagnosis import diagnose
from anaplot.report.bridgecommand import BridgedBlock
from anaplot.report.figures.modelfigure import model_figure

__all__ = ["figures_of_models"]


def figures_of_models(
    found: BridgedBlock, unit: str = "µm"
) -> Callable[[str, int], Drawing | None]:
    """Return what draws a model by its strip and which of its models it is (from 0).

    Each drawing has a key of its own, "model-" with the numbers of the strip and of the model, from
    1.

    Parameters
    ----------
    found
        What `bridge` has returned.
    unit
        Of sigma0, as `image_units` has it.
    """
    strips = {strip.strip: (k, strip.models) for k, strip in enumerate(found.strips, 1)}

    def figure(strip: str, model: int) -> Drawing | None:
        number, models = strips[strip]
        one = models[model]
        key = f"model-{number}-{model + 1}"
        return model_figure(one, diagnose(one).transfers, key=key, unit=unit)

    return figure
