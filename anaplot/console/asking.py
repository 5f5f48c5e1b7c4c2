"""A question or prompt of the intents as a screen, and what follows from its answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from anaplot.console.dialogs import AskWhether
from anaplot.console.intent import Intent, Leave, OtherPointName, Question
from anaplot.console.keybar import show_key
from anaplot.console.keymap import canonical_key
from anaplot.console.namedialog import AskOtherName
from anaplot.session import commands
from anaplot.session.othernames import OtherName

__all__ = ["asking", "asking_name"]


def asking(
    question: Question, keys: Mapping[str, tuple[str, ...]], do: Callable[[Intent], None]
) -> tuple[AskWhether, Callable[[str | None], None]]:
    """Return the screen that asks, and what is to be called with the answer.

    Parameters
    ----------
    question
        What is asked.
    keys
        The keys in force, by action.
    do
        Carries out what the answer means.
    """
    again = tuple((canonical_key(key), show_key(key)) for key in keys.get(question.again, ()))
    third, other = ("", None) if question.other is None else question.other
    screen = AskWhether(
        question.text,
        yes=question.yes,
        no=question.no,
        again=again,
        other=third,
        id="leave" if question.then == Leave() else None,
    )

    def answered(answer: str | None) -> None:
        if answer == "yes":
            do(question.then)
        elif answer == "other" and other is not None:
            do(other)

    return screen, answered


def asking_name(
    asked: OtherPointName, do: Callable[[Intent], None]
) -> tuple[AskOtherName, Callable[[OtherName | None], None]]:
    """Return the screen that asks what a point is in truth, and what is to be called then.

    Parameters
    ----------
    asked
        What is asked.
    do
        Carries out what the answer means.
    """

    def answered(answer: OtherName | None) -> None:
        if answer is not None:
            do(commands.Rename(*answer))

    return AskOtherName(asked), answered
