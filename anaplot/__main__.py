"""The program: `python -m anaplot` is the same as `anaplot`."""

import gc
import sys

from anaplot.ondemand import load_on_demand

_NEW_OBJECTS = 100_000  # that are there before Python looks for circles among them


def main() -> int:
    """Run the command line; an interrupt is one line also while the program is being loaded."""
    # a block is rows by the hundred thousand, none of them in a circle: looking through them again
    # and again took a tenth of adjust, and a fifth of import
    gc.set_threshold(_NEW_OBJECTS)
    load_on_demand()
    try:
        from anaplot.cli import main as command_line

        return command_line()
    except KeyboardInterrupt:
        print("anaplot: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
