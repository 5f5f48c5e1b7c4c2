"""When a device is asked, and which request an answer belongs to: no threads, no clock, no port.

An answer carries nothing that tells its request. All that is known is their order: a device
answers first what was asked first. Answers are therefore matched to requests first in, first out,
and a request keeps its place until its answer has come or cannot come any more. A lost answer
makes those after it look older than they are, which costs a moment; none ever looks younger.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from anaplot.plotter.schema import Poll

__all__ = ["Poller", "Request"]

_QUIET = 0.02  # s after an answer before the next request: what comes twice comes at once
_LAG = 3  # answers still owed when one has come, from which on a pause is worth its time
_MOST = 8  # owed at most, when somebody waits for an answer
_CHATTER = 4.0  # timeouts after which a line that is never quiet is asked all the same


@dataclass(frozen=True, slots=True)
class Request:
    """A request whose answer is still owed: its cycle, counted from 1, and when it left [s]."""

    cycle: int
    when: float


class Poller:
    """The polling policy of one device on one or several links.

    A cycle is one request on each of the polled links; the one on the first of them begins it and
    counts for all.

    Parameters
    ----------
    poll
        How the device is asked.

    Notes
    -----
    Everything depends on the calls and their times alone. As long as no answer comes later than
    `Poll.latency` after its request, and none comes twice, `answered` never returns a younger
    request than the one that was answered: each answer takes the oldest request still owed, its
    own one is not forgotten before `latency`, and is taken by no answer before its own.
    """

    def __init__(self, poll: Poll) -> None:
        self._poll = poll
        self._cycle = 0
        self._owed: dict[str, deque[Request]] = {name: deque() for name in poll.links}
        self._asked: float | None = None
        self._unheard: set[str] = set()
        self._urgent = False
        self._settling = False
        self._last_byte = self._last_answer = float("-inf")

    @property
    def cycle(self) -> int:
        """The number of the latest cycle, 0 before the first."""
        return self._cycle

    @property
    def settling(self) -> bool:
        """Whether nothing is asked until what is owed has come or cannot come any more.

        Not while somebody waits for an answer (`urge`): to go on behind is quicker for him, as
        long as it is not too many answers behind.
        """
        behind = max(map(len, self._owed.values()))
        return self._settling and (not self._urgent or behind > _MOST)

    def owed(self, link: str) -> int:
        """Return how many answers are owed on a link."""
        return len(self._owed[link])

    def urge(self) -> None:
        """Have the next request follow as soon as the answer under way has come."""
        self._urgent = True

    def bytes_came(self, now: float) -> None:
        """Take notice of bytes on any link, whatever they mean."""
        self._last_byte = now

    def records_came(self, *, unasked: bool) -> None:
        """Take notice of what the bytes that came were, as soon as records of them are complete.

        Parameters
        ----------
        unasked
            The last of them was a whole record with a position, which answers nothing, nothing more
            is begun, and no answer among them had come before. The next request need not wait for
            the line to be quiet: an answer that comes twice comes at once, and so before what was
            said after it on its line. Of several lines the others may still have one. After a bare
            press the line must be quiet all the same: there the next answer is the measurement, and
            not what it is compared with.
        """
        if unasked:
            self._last_byte = self._last_answer if len(self._owed) > 1 else float("-inf")
        else:
            self._last_answer = self._last_byte

    def begin(self, now: float) -> None:
        """Take notice that a cycle's requests are about to leave."""
        self._asked = now
        self._unheard = set(self._owed)
        self._urgent = False

    def sent(self, link: str, now: float) -> None:
        """Take notice of a request: on the first of the polled links it begins a cycle.

        Parameters
        ----------
        link
            Where it was sent.
        now
            When it left [s].
        """
        if link != self._poll.links[0]:
            return
        self._expire(now)
        self._cycle += 1
        for owed in self._owed.values():
            owed.append(Request(self._cycle, now))

    def answered(self, link: str, now: float) -> Request | None:
        """Match an answer.

        Parameters
        ----------
        link
            Where it came.
        now
            When [s].

        Returns
        -------
        Request or None
            The oldest request that is owed there; None when the device was not asked.
        """
        self._expire(now)
        self._unheard.discard(link)
        owed = self._owed[link]
        if not owed:
            return None
        request = owed.popleft()
        # answers are late, or several were lost: only a pause tells which
        self._settling = self._settling or len(owed) >= _LAG
        return request

    def wait(self, now: float) -> float:
        """Return in how many seconds the next cycle may begin, 0 for now."""
        self._expire(now)
        if self._asked is None:
            return 0.0
        youngest = max((owed[-1].when for owed in self._owed.values() if owed), default=None)
        if youngest is None:
            self._settling = False
        elif self.settling:
            return max(0.0, youngest + self._poll.latency - now)
        poll = self._poll
        if self._unheard:
            pause = max(poll.timeout, poll.period)
        else:
            pause = 0.0 if self._urgent else poll.period
        quiet = min(self._last_byte + _QUIET, self._asked + _CHATTER * poll.timeout)
        return max(0.0, self._asked + pause - now, quiet - now)

    def restart(self) -> None:
        """Ask again at once, after a line was opened anew; what is owed may still come over it."""
        self._asked = None
        self._settling = False

    def _expire(self, now: float) -> None:
        for owed in self._owed.values():
            while owed and now - owed[0].when > self._poll.latency:
                owed.popleft()
