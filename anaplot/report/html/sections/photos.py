"""What checks each photo, and how it overlaps with its neighbours."""

from __future__ import annotations

from dataclasses import replace

from anaplot.bundle.solve.photochecks import MOST_NEIGHBOURS
from anaplot.report.document import Answer, Table, say
from anaplot.report.html.parts import Captioned, HtmlBlock, Section

__all__ = ["photos_section"]

_CHECKS = ("photo", "rays", "redundancy", "mean_r", "least_r", "rms_x_um", "rms_y_um", "flagged")


def photos_section(answer: Answer) -> Section:
    """Return the section of rays, redundancy, overlaps and correlations of the photos.

    Parameters
    ----------
    answer
        What `adjust --json` prints, its tables still tables.
    """
    checks = replace(answer["photos"], shown=_CHECKS)
    overlaps: Table = answer["overlaps"]
    blocks: list[HtmlBlock] = [
        Captioned(checks, say("Rays that count in every photo, and their redundancy numbers"))
    ]
    if len(overlaps):
        blocks += [
            say(
                "Overlap: which part of what a photo shows its neighbour shows too, in the plane "
                "through the middle of their common points across both axes; of every photo the "
                "{} neighbours with the most common points",
                MOST_NEIGHBOURS,
            ),
            Captioned(overlaps, say("Overlap of neighbouring photos")),
        ]
    else:
        blocks.append(say("No two photos have a point in common.").of("look"))
    related = Captioned(
        answer["photo_correlations"], say("Correlations within the orientation of every photo")
    )
    blocks.append(
        Section("photo-correlations", "Correlations of orientations", (related,), folded=True)
    )
    return Section("photo-checks", "Photos: rays, redundancy, overlap", tuple(blocks))
