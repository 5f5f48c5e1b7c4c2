"""`anaplot pack` and `anaplot unpack`: a whole block as one file, and back."""

from __future__ import annotations

import argparse

from anaplot.exchange.blockpack import pack_block, unpack_block
from anaplot.report.columns import counted
from anaplot.report.progress import working
from anaplot.textfiles.wording import place

__all__ = ["run_pack", "run_unpack"]


def run_pack(options: argparse.Namespace) -> int:
    """Pack a block into a new file; raises InputError."""
    with working("packing"):
        names = pack_block(options.block, options.output)
    print(f"{place(options.output)}: {counted(len(names), 'file')} of {place(options.block)}")
    return 0


def run_unpack(options: argparse.Namespace) -> int:
    """Unpack a block into a new folder; raises InputError."""
    with working("unpacking"):
        names = unpack_block(options.pack, options.output)
    print(f"{place(options.output)}: {counted(len(names), 'file')}, checked")
    return 0
