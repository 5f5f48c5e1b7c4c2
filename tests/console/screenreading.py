"""What stands on a console's screen, and waiting until it does."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from consolefake import FakeStation
from textual.app import App
from textual.pilot import Pilot

from anaplot.console.tableview import TableView


def lines(app: App[None]) -> list[str]:
    """The screen, line by line."""
    return [
        "".join(part.text for part in strip) for strip in app.screen._compositor.render_strips()
    ]


def text(app: App[None]) -> str:
    """The screen."""
    return "\n".join(lines(app))


def selected(app: App[None]):
    """What the table of the first screen has its cursor on."""
    return app.screen_stack[0].query_one(TableView).selected


async def until(pilot: Pilot[None], condition: Callable[[], object]) -> None:
    """Wait for what comes; it need not come soon."""
    async with asyncio.timeout(60):
        while not condition():
            await pilot.pause()


async def came(station: FakeStation, *call: object) -> None:
    """Wait for a call of the station."""
    await asyncio.to_thread(station.wait_for, *call)
