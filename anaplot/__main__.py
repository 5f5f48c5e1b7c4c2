"""The program: `python -m anaplot` is the same as `anaplot`."""

import sys


def main() -> int:
    """Run the command line; an interrupt is one line also while the program is being loaded."""
    try:
        from anaplot.cli import main as command_line

        return command_line()
    except KeyboardInterrupt:
        print("anaplot: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
