"""Points in the command palette: type a name, drive there."""

from __future__ import annotations

from functools import partial

from rich.text import Text
from textual.command import Hit, Hits, Provider

from anaplot.console.screen import OrientationScreen
from anaplot.textfiles.wording import plain

__all__ = ["PointProvider"]


class PointProvider(Provider):
    """Offers the points of the current model."""

    async def search(self, query: str) -> Hits:
        """Yield the points whose name matches."""
        if not isinstance(self.screen, OrientationScreen):
            return
        matcher = self.matcher(query)
        for point in self.screen.points():
            name = f"Drive to {plain(point)}"
            if (score := matcher.match(name)) > 0:
                # Text, not a string: a point's name is never markup.
                yield Hit(score, Text(name), partial(self.screen.drive_to, point), text=name)
