"""Work for tests; a module of its own, as other processes have to import it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple


class Squares(NamedTuple):
    """Squares of numbers. The worker dies with the share `deadly`, once, or whenever it comes."""

    flag: str
    deadly: int = -1
    always: bool = False

    def prepare(self) -> Callable[[int], tuple[int, int]]:
        with Path(f"{self.flag}-prepared-{os.getpid()}").open("a") as file:
            file.write("x")
        return self.square

    def square(self, k: int) -> tuple[int, int]:
        if k == self.deadly and (self.always or not Path(self.flag).exists()):
            Path(self.flag).touch()
            os._exit(9)
        return k, k * k


class Failing(NamedTuple):
    """Work of which a share fails by itself."""

    at: int
    error: Exception | None = None

    def prepare(self) -> Callable[[int], int]:
        return self.do

    def do(self, k: int) -> int:
        if k == self.at:
            raise self.error or ArithmeticError(f"share {k}")
        return k
