"""The console's connection with its station: news and commands, apart from the screen's thread."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from anaplot.console.commands import CommandThread
from anaplot.console.mailbox import Mailbox
from anaplot.console.stationlike import StationLike
from anaplot.session.commands import Command

__all__ = ["StationConnection"]


class StationConnection:
    """What comes from a station is kept until it is fetched; commands go one after the other.

    Parameters
    ----------
    station
        What is shown and commanded.
    wake
        Called in whatever thread has news.
    """

    def __init__(self, station: StationLike, wake: Callable[[], None]) -> None:
        self._station = station
        self._mailbox = Mailbox(wake)
        self._commands = CommandThread(self._mailbox.put_notice)
        self._unsubscribe: list[Callable[[], None]] = []
        self.take = self._mailbox.take
        self.submit = self._commands.submit

    def open(self) -> None:
        """Listen to the station."""
        self._commands.start()
        self._unsubscribe = [
            self._station.subscribe(self._mailbox.put_snapshot),
            self._station.subscribe_notices(self._mailbox.put_notice),
        ]

    def close(self) -> None:
        """Let the station go; commands given so far are carried out."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        self._unsubscribe = []
        self._commands.close()

    def give(self, command: Command) -> None:
        """Give a command after those given before it."""
        self.submit(partial(self._station.give, command))
