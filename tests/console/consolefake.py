"""A station made of dataclasses: 13 points, 5 of them ties, in the second model of a strip."""

from __future__ import annotations

import re
import threading
from dataclasses import astuple, replace

import numpy as np
from testedrows import made_of, observation

from anaplot.adjustment.tested import AppliedTest, Dense, Observation, Partner, Transfer
from anaplot.console.app import ConsoleApp
from anaplot.orientation.results import Diagnosis, ModelSolution
from anaplot.plotter.readings import Position
from anaplot.session.plates import ReadOut
from anaplot.simulation.stereo import StereoGround
from anaplot.station.pointing import Pointing
from anaplot.station.snapshot import LinkView, PointView, Snapshot

# point, role, x, y of the left photo [mm]
PATTERN = (
    ("102", "tie", 2.1, 98.3),
    ("103", "tie", 6.4, 101.7),
    ("104", "tie", -1.2, 1.8),
    ("105", "tie", 0.9, -99.2),
    ("106", "tie", 5.8, -102.4),
    ("107", "new", 45.2, 99.9),
    ("108", "new", 44.1, 0.4),
    ("109", "new", 46.6, -97.8),
    ("110", "new", 90.3, 98.8),
    ("111", "new", 94.9, 101.2),
    ("112", "new", 91.7, 2.6),
    ("113", "new", 89.4, -98.1),
    ("114", "new", 95.0, -101.5),
)

REDN_Y = (0.587, 0.602, 0.851, 0.574, 0.611, 0.702, 0.793, 0.688, 0.566, 0.559, 0.787, 0.571, 0.583)
PARX_Y = (3.1, 41.7, -2.2, 5.9, -4.4, -8.6, 1.3, 2.0, -3.7, 6.6, -0.4, 2.8, -5.1)
REDN_X = (0.577, 0.584, 0.803, 0.581, 0.579)
PARX_X = (-2.4, 7.9, 1.1, -0.2, 4.0)
SIGMA0 = 5.0
CRITICAL = 2.66
CHANCES = {("103", "y"): 0.84, ("102", "y"): 0.07}


def table(gross: bool) -> tuple[Observation, ...]:
    rows = []
    y = [(p[0], "y", r, v, 2.0) for p, r, v in zip(PATTERN, REDN_Y, PARX_Y, strict=True)]
    ties = [p for p in PATTERN if p[1] == "tie"]
    x = [(p[0], "x", r, v, 6.0) for p, r, v in zip(ties, REDN_X, PARX_X, strict=True)]
    for point, axis, r, parallax, q in y + x:
        if not gross and point == "103":
            parallax /= 9.0
        expected = SIGMA0 * float(np.sqrt(q * r))
        w = parallax / expected
        chance = CHANCES.get((point, axis), 0.02) if gross else 0.02
        mdb = 4.132 * 5.0 * float(np.sqrt(q / r))
        flagged = abs(w) > CRITICAL
        rows.append(
            observation(
                point, axis, parallax, r, expected, w, flagged=flagged, mdb=mdb, probability=chance
            )
        )
    return tuple(rows)


def solution(gross: bool = True) -> ModelSolution:
    rows = table(gross)
    n = len(rows)
    test = AppliedTest("tau", 0.001, CRITICAL)
    sigma0 = (9.31 if gross else 4.87) / 5.0
    tested = made_of(
        rows, test, n - 6, sigma0, 0.0004 if gross else 0.97, lambda: Dense(np.eye(n), np.eye(n))
    )
    return ModelSolution(
        left="102",
        right="103",
        base=(91.8734, 0.4121, -1.0932),
        rotation=(0.01234, -0.00871, 0.02345),
        centre=(91.8734, 0.4121, -1.0932),
        iterations=4,
        tested=tested,
        names=tuple(p for p, *_ in PATTERN),
        of_coordinates=lambda: np.array([(x, y, -152.0 + 0.01 * x) for _, _, x, y in PATTERN]).T,
        ties=tuple(p[0] for p in PATTERN if p[1] == "tie"),
        apriori_um=5.0,
        tie_variance="propagated",
        outliers=(),
        remarks=(),
        q_l=np.array([2.0] * 13 + [6.0] * 5),
        unknowns=("bx", "beta_y", "beta_z", "kappa", "phi", "omega"),
        of_design=lambda: 17.3,
        of_unknowns=lambda: np.eye(6),
        of_points=lambda: np.broadcast_to(np.diag([2.0, 3.0, 9.0]), (len(PATTERN), 3, 3)),
    )


def diagnosis(gross: bool = True) -> Diagnosis:
    if not gross:
        return Diagnosis((), (), ("nothing is flagged: accept the model",), ())
    return Diagnosis(
        transfers=(
            Transfer(("103", "y"), ("107", "y"), -0.71, 0.62),
            Transfer(("113", "y"), ("109", "y"), 0.62, 0.62),
        ),
        partners=(Partner(("102", "y"), ("103", "y"), 0.93),),
        advice=(
            "remeasure 103 (y): 12 to 1 over 102",
            "103 y and 102 y are hard to tell apart (correlation 0.93)",
        ),
        suspects=(("103", "y"),),
    )


def picture(
    *, gross: bool = True, measured: int = 13, serial: int = 1, **changes: object
) -> Snapshot:
    """A snapshot with the first `measured` points measured."""
    solved = measured >= 13
    points = tuple(
        PointView(
            p,
            role,
            x,
            y,
            "pending"
            if i >= measured
            else ("flagged" if solved and gross and p == "103" else "measured"),
            1 if i < measured else 0,
        )
        for i, (p, role, x, y) in enumerate(PATTERN)
    )
    following = PATTERN[measured][0] if measured < 13 else ("103" if gross else None)
    snapshot = Snapshot(
        serial=serial,
        block="demo",
        strip="1",
        left="102",
        right="103",
        model_number=2,
        model_count=4,
        accepted=(("101", "102"),),
        points=points,
        target=following,
        next_point=following,
        solution=solution(gross) if solved else None,
        diagnosis=diagnosis(gross) if solved else None,
        problem="" if solved else "six points are needed, four of them ties or well spread",
        expected=f"measure point {following}" if following else "accept the model",
        may_accept=solved,
        may_undo=measured > 0,
        suspended=False,
        finished=False,
        link=LinkView("live", "anaplot-ascii", "/dev/pts/7", True, ""),
        tie_variance="propagated",
        test="tau 0.001",
    )
    return replace(snapshot, **changes)


def console(station: FakeStation, keymap: dict[str, str] | None = None, **options) -> ConsoleApp:
    """The console over a fake, which has controls where its instrument is simulated."""
    controls = station if station.current.link.simulated else None
    return ConsoleApp(station, keymap, controls=controls, **options)


class FakeStation:
    """Keeps what it was told; `fault` is raised by the next command."""

    def __init__(self, snapshot: Snapshot | None = None) -> None:
        self.current = snapshot or picture()
        self.calls: list[tuple] = []
        self.changed = threading.Condition()
        self.fault: Exception | None = None
        self.read: ReadOut | None = ReadOut(-12.3456, 98.7654, -104.25, 99.125)
        self.automatic = False
        self.hand = True
        self.ground: StereoGround | None = None
        self.at = Position(-12.3456, 98.7654, -104.25, 99.125)
        self.closed = 0
        self.fitted = None
        self.pointed = None
        self.changes = []
        self.listeners: list = []
        self.notice_listeners: list = []

    # what the console asks

    def snapshot(self) -> Snapshot:
        return self.current

    def readout(self) -> ReadOut | None:
        return self.read

    def subscribe(self, callback):
        self.listeners.append(callback)
        return lambda: self.listeners.remove(callback)

    def subscribe_notices(self, callback):
        self.notice_listeners.append(callback)
        return lambda: self.notice_listeners.remove(callback)

    def _did(self, *call) -> None:
        with self.changed:
            self.calls.append(call)
            self.changed.notify_all()
        fault, self.fault = self.fault, None
        if fault is not None:
            raise fault

    def give(self, command):
        name = re.sub(r"(?<!^)(?=[A-Z])", "_", type(command).__name__).lower()
        self._did(name, *astuple(command))

    def set_automatic(self, on):
        self.automatic = on
        self._did("set_automatic", on)

    def stereo(self, columns, rows, field_mm):
        return None if self.ground is None else self.ground.look(self.at, columns, rows, field_mm)

    def turn(self, dx=0.0, dy=0.0, dpx=0.0, dpy=0.0):
        self._did("turn", dx, dy, dpx, dpy)

    def set_hand(self, on):
        self.hand = on
        self._did("set_hand", on)

    def strips_on_control(self, degree, without):
        self._did("strips_on_control", degree, without)
        return () if self.fitted is None else self.fitted(degree, without)

    def pointing(self):
        self._did("pointing")
        return Pointing(5.0) if self.pointed is None else self.pointed()

    def log(self):
        self._did("log")
        return tuple(self.changes)

    def close(self):
        self.closed += 1

    # what tests do

    def wait_for(self, *call) -> None:
        """Wait, in a thread, until a command has come."""
        with self.changed:
            assert self.changed.wait_for(lambda: call in self.calls, timeout=60), self.calls

    def tell(self, snapshot: Snapshot) -> None:
        self.current = snapshot
        for callback in list(self.listeners):
            callback(snapshot)

    def notice(self, severity: str, text: str) -> None:
        for callback in list(self.notice_listeners):
            callback(severity, text)
