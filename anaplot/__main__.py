"""`python -m anaplot` is the same as `anaplot`."""

import sys

from anaplot.cli import main

sys.exit(main())
