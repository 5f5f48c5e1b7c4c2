"""From bytes to records: no files, no ports, no clock of its own."""

from __future__ import annotations

from anaplot.plotter.readings import Refused
from anaplot.plotter.schema import Framing

__all__ = ["Framer"]

_SYNC = 0x80


class Framer:
    """Cuts a stream of bytes into records, one framer per link.

    Parameters
    ----------
    framing
        How records begin and end.

    Notes
    -----
    Memory is bounded: nothing longer than the longest record is kept. Bytes that belong to no
    record come back as `Refused`; none disappear without a word.
    """

    def __init__(self, framing: Framing) -> None:
        self._framing = framing
        self.reset()

    def reset(self) -> None:
        """Forget what was begun, as after opening the line."""
        self._buffer = bytearray()
        self._last = 0.0
        # after an overlong or missed beginning, everything up to the next sure start is junk
        self._skipping = self._framing.joined == "middle"
        self._reason = "the start was missed"

    @property
    def between(self) -> bool:
        """Whether the line is between two records: nothing of the next one has come yet."""
        return not self._buffer and not self._skipping

    def feed(self, data: bytes, now: float) -> list[bytes | Refused]:
        """Take bytes and return the records that are complete.

        Parameters
        ----------
        data
            What arrived.
        now
            When [s], on any clock that does not go back.

        Returns
        -------
        list of bytes or Refused
            Records without terminator, and bytes that are none, in order.
        """
        if not data:
            return []
        found: list[bytes | Refused] = list(self.expire(now))
        self._last = now
        if self._framing.kind == "line":
            self._feed_lines(data, found)
        elif self._framing.kind == "fixed":
            self._feed_fixed(data, found)
        else:
            self._feed_sync(data, found)
        return found

    def expire(self, now: float) -> list[Refused]:
        """Refuse an incomplete record after a pause.

        Parameters
        ----------
        now
            The time [s].

        Returns
        -------
        list of Refused
            The incomplete record, if a pause has ended one.
        """
        gap = self._framing.gap
        if gap is None or now - self._last < gap:
            return []
        refused = self._take("a pause cut the record short") if self._buffer else []
        if self._framing.kind == "fixed" or self._framing.lines > 1:
            self._skipping = False
        return refused

    def lose_sync(self) -> None:
        """Skip to the next pause: a fixed record turned out to be none."""
        if self._framing.kind == "fixed":
            self._skipping = True
            self._reason = "out of step"

    def _take(self, reason: str) -> list[Refused]:
        raw = bytes(self._buffer)
        self._buffer.clear()
        return [Refused(raw, reason)] if raw else []

    def _feed_lines(self, data: bytes, found: list[bytes | Refused]) -> None:
        framing = self._framing
        terminator = framing.terminator
        search = max(0, len(self._buffer) - len(terminator) + 1)
        self._buffer += data
        while True:
            end = self._record_end(search)
            search = 0
            if end < 0:
                break
            body = bytes(self._buffer[:end])
            stop = end + len(terminator)
            if self._skipping:
                found.append(Refused(bytes(self._buffer[:stop]), self._reason))
                self._skipping = False
            elif len(body) > framing.max_bytes:
                found.append(Refused(bytes(self._buffer[:stop]), self._too_long()))
            elif body.strip(b"\r\n"):
                found.append(body)
            del self._buffer[:stop]
        if len(self._buffer) > framing.max_bytes + len(terminator):
            keep = len(terminator) - 1
            raw = bytes(self._buffer[: len(self._buffer) - keep])
            del self._buffer[: len(raw)]
            reason = self._reason if self._skipping else self._too_long()
            found.append(Refused(raw, reason))
            self._skipping = True
            self._reason = "the rest of a record that was too long"

    def _record_end(self, search: int) -> int:
        """Return where the terminator of the last line of the first record begins, or -1."""
        terminator = self._framing.terminator
        # a record that is junk anyway ends with its first line
        lines = 1 if self._skipping else self._framing.lines
        if lines > 1:
            search = 0
        end = -1
        for _ in range(lines):
            end = self._buffer.find(terminator, search)
            if end < 0:
                return -1
            search = end + len(terminator)
        return end

    def _too_long(self) -> str:
        return f"longer than {self._framing.max_bytes} bytes"

    def _feed_fixed(self, data: bytes, found: list[bytes | Refused]) -> None:
        if self._skipping:
            found.append(Refused(data, self._reason))
            return
        self._buffer += data
        length = self._framing.length
        while len(self._buffer) >= length:
            found.append(bytes(self._buffer[:length]))
            del self._buffer[:length]

    def _feed_sync(self, data: bytes, found: list[bytes | Refused]) -> None:
        length = self._framing.length
        stray = bytearray()
        for byte in data:
            if byte & _SYNC:
                if self._buffer:
                    found.extend(self._take("a new record began before its end"))
                if stray:
                    found.append(Refused(bytes(stray), "no start of a record"))
                    stray.clear()
                self._buffer.append(byte)
            elif self._buffer:
                self._buffer.append(byte)
            else:
                stray.append(byte)
            if len(self._buffer) == length:
                found.append(bytes(self._buffer))
                self._buffer.clear()
        if stray:
            found.append(Refused(bytes(stray), "no start of a record"))
