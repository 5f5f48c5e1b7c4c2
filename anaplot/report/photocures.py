"""What putting exchanged photographs right would give: the models of their strips."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from anaplot.errors import InputError, NotComputableError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.selection import rows_by_photo

if TYPE_CHECKING:
    from anaplot.session.photoaccidents import PhotoAccident, PhotoAccidentKind

__all__ = ["PhotoCures", "StripsPutRight", "cure_words", "naming_wrong_photos", "photo_cures"]


class StripsPutRight(NamedTuple):
    """What the strips of two exchanged photographs give with the two put right.

    Attributes
    ----------
    models
        How many are computed.
    of
        How many there are.
    sigma0_um
        Pooled over them [um]; None without redundancy.
    """

    models: int
    of: int
    sigma0_um: float | None


PhotoCures: TypeAlias = Mapping[tuple[str, str], StripsPutRight]


def photo_cures(block: Block, accidents: Iterable[PhotoAccident]) -> PhotoCures:
    """Return what every pair that may be exchanged would give, put right.

    Parameters
    ----------
    block
        As it is.
    accidents
        Of its photographs; what is found before a pair is put right with it.
    """
    from anaplot.session.photoaccidents import with_photos_exchanged

    found = {}
    for one in accidents:
        for pair in one.pairs:
            right = _put_right(with_photos_exchanged(block, *pair), one.strips)
            if right is not None:
                found[pair] = right
        if one.pairs:
            block = with_photos_exchanged(block, *one.pairs[0])
    return found


def _put_right(block: Block, names: Iterable[str]) -> StripsPutRight | None:
    """Return what strips of a block give; None where they cannot even be begun."""
    from anaplot.orientation.strip import bridge_strip, pooled_sigma_um

    strips = [strip for strip in block.strips if strip.id in names]
    try:
        rows = rows_by_photo(block.image_points)
        bridged = [bridge_strip(block, strip, rows=rows) for strip in strips]
    except InputError:
        return None
    models = tuple(model for strip in bridged for model in strip.models)
    wanted = sum(len(strip.models()) for strip in strips)
    return StripsPutRight(len(models), wanted, pooled_sigma_um(models))


def cure_words(accident: PhotoAccident, cures: PhotoCures) -> str:
    """Return an accident's sentence, and what putting it right would give where that is known."""
    words = []
    for pair in accident.pairs:
        if pair in cures:
            models, of, sigma0 = cures[pair]
            two = " and ".join(pair) if accident.alternatives else "the two"
            fit = "" if sigma0 is None else f", sigma0 {sigma0:.2f} um"
            words.append(f"with {two} exchanged {models} of {of} models are computed{fit}")
    return accident.text + (f": {'; '.join(words)}" if words else "")


@contextmanager
def naming_wrong_photos(block: Block, without: Iterable[PhotoAccidentKind] = ()) -> Iterator[None]:
    """Add what is wrong with photographs of a block to what cannot be done with it.

    Parameters
    ----------
    block
        With image points and strips.
    without
        Kinds that are no accident for what is done.

    Raises
    ------
    InputError, NotComputableError
        As within, with the sentences.
    """
    try:
        yield
    except (InputError, NotComputableError) as error:
        from anaplot.session.photoaccidents import photo_accidents

        accidents = [one for one in photo_accidents(block) if one.kind not in without]
        if not accidents:
            raise
        cures = photo_cures(block, accidents)
        words = "; ".join(cure_words(one, cures) for one in accidents)
        error.args = (f"{error}; {words}",)
        raise
