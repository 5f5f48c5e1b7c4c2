"""Device text made safe for a terminal and for one line."""

from __future__ import annotations

__all__ = ["safe_text"]


def safe_text(raw: bytes | str, limit: int = 120) -> str:
    r"""Show bytes or text of unknown origin as printable ASCII on one line.

    Every character that is not printable ASCII is written as an escape (``\x1b``), so that
    nothing a device sends reaches a terminal as a control sequence. Markup is the display's
    business: the text is plain and must be shown as plain text.

    Parameters
    ----------
    raw
        What the device or a file said.
    limit
        Longest result in characters; more is cut and marked with ``...``.

    Returns
    -------
    str
        Printable ASCII.
    """
    text = raw.decode("latin-1") if isinstance(raw, bytes) else raw
    pieces = [_shown(character) for character in text[: limit + 1]]
    if sum(map(len, pieces)) <= limit:
        return "".join(pieces)
    while sum(map(len, pieces)) > limit - 3:
        pieces.pop()
    return "".join(pieces) + "..."


def _shown(character: str) -> str:
    code = ord(character)
    if 0x20 <= code < 0x7F:
        return character
    return f"\\x{code:02x}" if code <= 0xFF else f"\\u{{{code:x}}}"
