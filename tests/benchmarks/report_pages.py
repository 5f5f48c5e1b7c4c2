"""Time and size of a report for 3, 49 and 2500 photos, beside the adjustment that it tells of.

    python tests/benchmarks/report_pages.py [sides of square blocks, default 7 50]

Blocks of 60/60 with 25 points a photo, before them a strip of three. Each is adjusted and its
report written in one run; the times are those of the processor: what counts is their ratio, and
that a page is small enough to be opened.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import process_time

from bundle_speed import regular_block

import anaplot
from anaplot.photogrammetry.block import Block
from anaplot.report.html.write import write_report
from anaplot.report.reportcommand import block_report

LARGEST = 15e6  # bytes of a page that still opens on an old machine


def strip_of_three() -> Block:
    """Three photos of a block, without control."""
    block = regular_block(3)[0].block
    photos = block.photos[:3]
    names = {photo.id for photo in photos}
    rows = tuple(row for row in block.image_points if row.photo in names)
    return replace(block, photos=photos, image_points=rows, control=())


def main(*sides: int) -> int:
    """Print a line for each block; 0 when every page is small enough."""
    print("photos    rays  adjust [s]  sections [s]  page [s]  of adjust    MB  cut tables")
    good = True
    for block in (strip_of_three(), *(regular_block(side)[0].block for side in sides)):
        start = process_time()
        adjusted = anaplot.adjust(block, datum="control" if block.control else "free")
        done = process_time()
        report = block_report(adjusted)
        told = process_time()
        with tempfile.TemporaryDirectory() as folder:
            written = write_report(report, Path(folder) / "report.html")
        end = process_time()
        print(
            f"{len(block.photos):6}{len(block.image_points):8}{done - start:12.1f}"
            f"{told - done:14.1f}{end - told:10.1f}{(end - done) / (done - start):11.2f}"
            f"{written.size / 1e6:6.1f}{len(written.cut):12}"
        )
        good &= written.size < LARGEST
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(*(map(int, sys.argv[1:]) if sys.argv[1:] else (7, 50))))
