"""Independent shares of work, done by whoever there is; a lost worker's share is done again.

What a share gives must depend on the work and the share alone (random numbers: a seed of its own),
so that neither the number of workers nor their order nor a repetition changes it.
"""

from __future__ import annotations

import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager
from threading import Lock
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from anaplot.errors import InputError, NotComputableError
from anaplot.textfiles.wording import plain
from anaplot.version import __version__

__all__ = [
    "REPEATS",
    "Failed",
    "Place",
    "Sent",
    "SharesLostError",
    "Work",
    "Workers",
    "carry_out",
    "forget",
    "in_order",
    "versions_here",
]

S_contra = TypeVar("S_contra", contravariant=True)
D_co = TypeVar("D_co", covariant=True)
S = TypeVar("S")
D = TypeVar("D")

REPEATS = 3
"""How often a share whose worker was lost is done again."""

_LOOK = 0.5  # seconds after which who waits looks round


class SharesLostError(NotComputableError):
    """Workers were lost, and could not be replaced; what was taken before is good."""


class Work(Protocol[S_contra, D_co]):
    """What is done; sent to every worker once, and small enough for that."""

    def prepare(self) -> Callable[[S_contra], D_co]:
        """Return what does a share; called once in every worker, its answer in many threads."""
        ...


class Workers(Protocol):
    """Who does the shares."""

    @property
    def ahead(self) -> int:
        """How many shares are handed out at a time."""
        ...

    def hand_out(self, share: Any) -> Future[Any]:
        """Let somebody do a share; BrokenExecutor: nobody can, until they are renewed.

        Its answer may be `Failed`, which raises that error.
        """
        ...

    def was_lost(self, error: BaseException) -> bool:
        """Tell whether a share failed because its worker was lost; False: by itself.

        Raises
        ------
        AnaplotError
            It is no use to do it again.
        """
        ...

    @property
    def lost_together(self) -> bool:
        """Whether all who work are gone with one."""
        ...

    def look(self) -> None:
        """Look round while nothing happens; raises SharesLostError when nobody is left."""
        ...

    def renew(self) -> None:
        """Replace those that were lost; raises SharesLostError where that cannot be."""
        ...


class Place(Protocol):
    """Where shares are done."""

    def workers(self, sent: Sent[Any, Any], shares: int) -> AbstractContextManager[Workers]:
        """Have workers for so many shares. At the end they are left; after an error at once."""
        ...


class Sent(Generic[S, D]):
    """Work as it is sent: whoever receives it again has it ready already.

    Parameters
    ----------
    work
        What is done.
    token, versions
        Of the sender; None: this process is it.
    """

    _received: ClassVar[Sent[Any, Any] | None] = None

    def __init__(
        self, work: Work[S, D], token: str | None = None, versions: dict[str, str] | None = None
    ) -> None:
        self.work = work
        self.token = token or uuid.uuid4().hex
        self.versions = versions or versions_here()
        self._ready: Callable[[S], D] | None = None
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return _receive, (self.work, self.token, self.versions)

    def do(self, share: S) -> D:
        """Do a share here.

        Raises
        ------
        InputError
            Other versions than the sender's are installed here: figures could differ.
        """
        with self._lock:
            if self._ready is None:
                here = versions_here()
                for package, version in self.versions.items():
                    if here[package] != version:
                        raise InputError(
                            f"a worker has {package} {plain(here[package])}, here is {version}: "
                            "figures could differ"
                        )
                self._ready = self.work.prepare()
        return self._ready(share)


class Failed(NamedTuple):
    """What a share failed with by itself, as its answer: no worker was lost."""

    error: Exception


def _receive(work: Work[S, D], token: str, versions: dict[str, str]) -> Sent[S, D]:
    """Return what was received before, if it is the same: it comes with every share."""
    last = Sent._received
    if last is None or last.token != token:
        last = Sent._received = Sent(work, token, versions)
    return last


def forget() -> None:
    """Keep nothing of what was received."""
    Sent._received = None


def versions_here() -> dict[str, str]:
    """Return the versions of what figures depend on."""
    # here: commands that hand out nothing import this module, too
    import numpy
    import scipy

    return {"anaplot": __version__, "numpy": numpy.__version__, "scipy": scipy.__version__}


def carry_out(
    work: Work[S, D],
    shares: Iterable[S],
    number: int,
    place: Place,
    take: Callable[[D], None],
    called: Callable[[S], str] | None = None,
) -> None:
    """Have shares done.

    Parameters
    ----------
    work
        What is done.
    shares
        Made one after the other, when somebody is there to do them: there may be millions.
    number
        How many there are.
    place
        Where.
    take
        Given what is done, in any order. An interrupt ends the work at once, after what is finished
        was given.
    called
        What messages call a share; None: by its number among these.

    Raises
    ------
    SharesLostError
        Workers were lost and could not be replaced, or a share lost them too often.
    """
    running: dict[Future[D], tuple[int, S]] = {}
    to_do, again = enumerate(shares), deque[tuple[int, S]]()
    losses: Counter[int] = Counter()
    with place.workers(Sent(work), number) as there:
        try:
            while True:
                while len(running) < there.ahead:
                    one = again.popleft() if again else next(to_do, None)
                    if one is None:
                        break
                    running[there.hand_out(one[1])] = one
                if not running:
                    return
                # never one endless wait: an interrupt just before it would be seen after it
                done = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED).done
                if not done:
                    there.look()
                lost = _take(done, running, there, take)
                if lost:
                    if there.lost_together:
                        lost += _take(wait(running).done, running, there, take)
                    _count(lost, losses, called)
                    there.renew()
                    again.extend(lost)
        except (KeyboardInterrupt, SystemExit):
            _take([future for future in running if _good(future)], running, there, take)
            raise
        finally:
            for future in running:
                future.cancel()


class _Each(NamedTuple):
    """A function of one thing as `Work`; the things are numbered."""

    do: Callable[[Any], Any]

    def prepare(self) -> Callable[[tuple[int, Any]], tuple[int, Any]]:
        return self.one

    def one(self, share: tuple[int, Any]) -> tuple[int, Any]:
        number, thing = share
        return number, self.do(thing)


def in_order(
    do: Callable[[S], D], things: Sequence[S], place: Place, progress: Callable[[float], None]
) -> list[D]:
    """Return what a function makes of every thing, in their order.

    Parameters
    ----------
    do
        A function of a module, or such a one in part.
    things
        What it takes, one each.
    place
        Where it is done.
    progress
        Called with the fraction of it that is done.

    Raises
    ------
    SharesLostError
        See `carry_out`.
    """
    found: dict[int, D] = {}

    def take(done: tuple[int, D]) -> None:
        found[done[0]] = done[1]
        progress(len(found) / len(things))

    carry_out(_Each(do), enumerate(things), len(things), place, take)
    return [found[number] for number in range(len(things))]


def _good(future: Future[Any]) -> bool:
    return (
        future.done()
        and not future.cancelled()
        and future.exception() is None
        and not isinstance(future.result(), Failed)
    )


def _take(
    done: Iterable[Future[D]],
    running: dict[Future[D], tuple[int, S]],
    there: Workers,
    take: Callable[[D], None],
) -> list[tuple[int, S]]:
    """Take what is done; return the shares whose workers were lost."""
    lost = []
    for future in sorted(done, key=_good, reverse=True):  # what is good first: it is not lost
        share = running.pop(future)  # before: an interrupt must not have it taken twice
        try:
            found = future.result()
        except Exception as error:
            if not there.was_lost(error):
                raise
            lost.append(share)
            continue
        if isinstance(found, Failed):
            raise found.error
        take(found)
    return lost


def _count(
    lost: Iterable[tuple[int, S]], losses: Counter[int], called: Callable[[S], str] | None
) -> None:
    for number, share in lost:
        losses[number] += 1
        if losses[number] > REPEATS:
            name = f"share {number + 1}" if called is None else called(share)
            raise SharesLostError(f"{name} lost its worker {losses[number]} times (out of memory?)")
