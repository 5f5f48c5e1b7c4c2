"""The automatic operator's job as a process of its own, to be killed: tells all it is told."""

from __future__ import annotations

import sys
from pathlib import Path

from anaplot.station.automatic import AutomaticOperator
from anaplot.station.demo import Demo


def main() -> None:
    folder, models, seed = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    demo = Demo.make(models, seed, fiducials=sys.argv[4:] == ["fiducials"])
    if not (folder / "block.toml").exists():
        demo.write(folder)
    with demo.open(folder, time_scale=2000.0) as station:
        station.subscribe_notices(lambda severity, text: print(severity, text, flush=True))
        AutomaticOperator(station).run()
    print("finished", flush=True)


if __name__ == "__main__":
    main()
