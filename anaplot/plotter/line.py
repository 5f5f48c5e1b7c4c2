"""One port of a link and the thread that reads it: silence, loss and reopening, modem switches."""

from __future__ import annotations

import threading
from typing import Literal, Protocol

from anaplot.errors import LinkError
from anaplot.plotter.conversation import Conversation
from anaplot.plotter.readings import AWAY
from anaplot.plotter.schema import Footswitch, Profile
from anaplot.plotter.serialport import SerialPort, find_port, identity_of
from anaplot.textfiles.wording import plain

__all__ = ["TICK", "LineOwner", "LinkState", "PortLine"]

LinkState = Literal["closed", "opening", "live", "silent", "lost", "reconnecting"]

TICK = 0.1
"""s that a thread waits at most before it looks around."""
_MODEM_TICK = 0.01


class LineOwner(Protocol):
    """What a line asks of its link, from its thread."""

    @property
    def stopping(self) -> threading.Event:
        """Set when the reader threads are to end."""

    @property
    def back_off(self) -> tuple[float, ...]:
        """Waits before the attempts to reopen [s]."""

    def poll_if_due(self) -> float:
        """Send the next request when its time has come; returns seconds until the next may be."""

    def wait_for_room(self) -> None:
        """Wait until whoever listens has room for more, or the link is closed."""

    def change(self, line: PortLine, state: LinkState, detail: str = "") -> None:
        """Set a line's state and tell."""


class PortLine:
    """One port of a link and the thread that reads it.

    Parameters
    ----------
    link
        Whose line it is.
    conversation
        Where what comes in is decoded.
    profile, name
        The instrument, and which of its links this is.
    address, port
        Of the opened port.
    """

    def __init__(
        self,
        link: LineOwner,
        conversation: Conversation,
        profile: Profile,
        name: str,
        address: str,
        port: SerialPort,
    ) -> None:
        self._link = link
        self._stopping = link.stopping
        self._conversation = conversation
        self._profile = profile
        self.name = name
        self.address = address
        self.port = port
        self.identity = identity_of(address)
        self._settings = profile.links[name]
        self.detail = ""
        self._heard = 0.0
        self._answered = False
        self.state: LinkState = "live" if self._limit() is None else "opening"
        self.thread = threading.Thread(target=self._run, name=f"plotter link {name}", daemon=True)
        self._switches = [
            switch
            for switch in profile.footswitches.values()
            if switch.source == "modem" and switch.link == name
        ]
        self._levels: dict[str, tuple[bool, float]] = {}

    def _limit(self) -> float | None:
        """Return after how many seconds the port counts as silent, or None."""
        if self._settings.silence is not None:
            return self._settings.silence
        poll = self._profile.poll
        if poll is not None and self.name in poll.links:
            return max(2.0, 4 * poll.timeout)
        return None

    def opened(self, now: float) -> None:
        """Begin to wait for the first record."""
        self._heard = now
        self._answered = False

    @property
    def usable(self) -> bool:
        """Whether bytes can be sent."""
        return self.state not in AWAY

    def send(self, data: bytes) -> None:
        """Send bytes; what is sent is told before."""
        self._conversation.sent(self.name, data)
        self.port.write(data)

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    self._read_until_lost()
                except LinkError as error:
                    if self._stopping.is_set():
                        return
                    self.port.close()
                    self._link.change(self, "lost", str(error))
                    self._reopen()
        finally:
            # an error in a callback ends this thread: the link must not look alive then
            if not self._stopping.is_set():
                self._link.change(self, "lost", "the reader has failed")

    def _read_until_lost(self) -> None:
        while not self._stopping.is_set():
            wait = self._link.poll_if_due()
            if self._switches:
                wait = min(wait, _MODEM_TICK)
            self._link.wait_for_room()
            data = self.port.read(min(wait, TICK))
            if self._stopping.is_set():
                return
            if data:
                understood = self._conversation.received(self.name, data)
                if understood is not None:
                    self._heard, self._answered = understood, True
            else:
                self._conversation.tick()
            self._check_silence()
            for switch in self._switches:
                self._check_modem(switch)

    def _check_silence(self) -> None:
        limit = self._limit()
        if limit is None:
            return
        if self._conversation.settling:
            # it is not asked, so that it need not answer
            self._heard = self._conversation.now()
        quiet = self._conversation.now() - self._heard
        if quiet >= limit:
            where = plain(self.address, 60)
            self._link.change(self, "silent", f"nothing understood from {where} for {limit:g} s")
        elif self._answered:
            self._link.change(self, "live")

    def _check_modem(self, switch: Footswitch) -> None:
        level = self.port.modem(switch.line) == switch.active
        before, when = self._levels.get(switch.name, (level, 0.0))
        now = self._conversation.now()
        if level != before and now - when < switch.debounce:
            return
        if switch.name not in self._levels or level != before:
            self._levels[switch.name] = (level, now)
        if level and not before:
            self._conversation.pressed(switch.name)

    def _reopen(self) -> None:
        attempt = 0
        waits = self._link.back_off
        while not self._stopping.wait(waits[min(attempt, len(waits) - 1)]):
            attempt += 1
            self._link.change(self, "reconnecting", self.detail)
            address = find_port(self.identity) or self.address
            try:
                port = SerialPort(address, self._settings)
            except LinkError as error:
                self._link.change(self, "lost", str(error))
                continue
            self.port = port
            self.address = address
            if self._stopping.is_set():
                port.close()
                return
            self._conversation.reopened(self.name)
            self._levels.clear()
            self.opened(self._conversation.now())
            self._link.change(self, "live" if self._limit() is None else "opening")
            return
