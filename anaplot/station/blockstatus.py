"""Where a block stands: its strips and models, what the block says, and what is to be done next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

from anaplot.photogrammetry.block import Block, Strip
from anaplot.photogrammetry.imagepoints import names_of
from anaplot.photogrammetry.selection import measured_in_files, rows_by_photo
from anaplot.session.filedaccidents import NO_ACCIDENTS, BlockAccidents, FiledAccident
from anaplot.station.blockstep import NextStep, Untied, following
from anaplot.station.coverage import Coverage, coverage_of, is_held
from anaplot.station.waystoopen import ways_to_open

if TYPE_CHECKING:
    from anaplot.orientation.results import ModelSolution
    from anaplot.orientation.strip import BridgedStrip
    from anaplot.session.modelstate import ModelState
    from anaplot.session.recomputed import Recomputed
    from anaplot.session.state import SessionState
    from anaplot.session.workflow import Outlook
    from anaplot.station.blockview import BlockView, FlaggedObservation

__all__ = [
    "BlockStatus",
    "ModelStanding",
    "ModelStatus",
    "StripStatus",
    "WeakSpot",
    "first_open",
    "standing",
    "status_of",
    "suspected_models",
    "untied",
    "waiting",
    "with_table",
]

_FEW = 2  # points for a weak photo that go into one line

ModelStanding = Literal["open", "in work", "accepted", "recomputed", "look"]


@dataclass(frozen=True, slots=True)
class ModelStatus:
    """A model.

    Attributes
    ----------
    left, right
        Names of the photos.
    state
        "open": not measured; "in work"; "accepted"; "recomputed": accepted, and changed by what
        was done since in a model before it; "look": accepted, and flagged or suspected.
    sigma0_um, redundancy
        Of its table; None while there is none.
    flagged, off, ties
        How many rows are flagged, how many are switched off, and how many tie points it has.
    why
        Why it has no table although it was measured, or what is wrong with all of it; or "".
    """

    left: str
    right: str
    state: ModelStanding
    sigma0_um: float | None = None
    redundancy: int | None = None
    flagged: int = 0
    off: int = 0
    ties: int = 0
    why: str = ""

    @property
    def name(self) -> str:
        """'left/right'."""
        return f"{self.left}/{self.right}"

    @property
    def done(self) -> bool:
        """Whether it is accepted."""
        return self.state not in ("open", "in work")


@dataclass(frozen=True, slots=True)
class StripStatus:
    """A strip: its name and its models in order."""

    strip: str
    models: tuple[ModelStatus, ...]

    @property
    def done(self) -> int:
        """How many models are accepted."""
        return sum(model.done for model in self.models)

    @property
    def pooled_um(self) -> float | None:
        """Sigma0 [um] pooled over its accepted models; None without redundancy."""
        tables = [
            (model.redundancy, model.sigma0_um)
            for model in self.models
            if model.done and model.redundancy and model.sigma0_um is not None
        ]
        redundancy = sum(r for r, _ in tables)
        if not redundancy:
            return None
        return float((sum(r * s**2 for r, s in tables) / redundancy) ** 0.5)


class WeakSpot(NamedTuple):
    """Something that needs a look: where ("left/right", or "" where it is no model), and what."""

    model: str
    words: str


@dataclass(frozen=True, slots=True)
class BlockStatus:
    """Where a block stands.

    Attributes
    ----------
    strips
        In the order of block.toml.
    recomputed
        Models changed by what was done since in a model before them, and what has changed.
    block
        What the block as one bundle says; None where there is nothing to adjust.
    coverage
        Lateral ties and control.
    next
        What is to be done next.
    accidents
        Points that are numbered wrong, as far as they were looked for.
    ways
        With what the block is opened, for people.
    """

    strips: tuple[StripStatus, ...]
    recomputed: tuple[Recomputed, ...]
    block: BlockView | None
    coverage: Coverage
    next: NextStep
    accidents: BlockAccidents = NO_ACCIDENTS
    ways: str = ""

    @property
    def next_command(self) -> str:
        """The next command as a person is told it: `open` with what connects an instrument."""
        command = self.next.command
        return f"{command} {self.ways}".rstrip() if self.next.opens else command

    @property
    def models(self) -> Iterator[ModelStatus]:
        """All models, strip after strip."""
        return (model for strip in self.strips for model in strip.models)

    @property
    def weak_spots(self) -> tuple[WeakSpot, ...]:
        """What needs a look, the surest first."""
        of_block = tuple(_of_block(self.block))
        named = {spot.model for spot in of_block}
        sure, perhaps = (
            [
                WeakSpot(one.model, f"model {one.model}: {one.accident.text}")
                for one in self.accidents.found
                if one.accident.certain == certain
            ]
            for certain in (True, False)
        )
        spots = [*sure, *of_block, *perhaps]
        for one in self.recomputed:
            spots.append(WeakSpot(one.name, f"model {one.name}: computed anew: {one.in_words()}"))
        for model in self.models:
            if model.why:
                named_there = f"model {model.name}" in model.why
                words = model.why if named_there else f"model {model.name}: {model.why}"
                spots.append(WeakSpot(model.name, words))
            elif model.state == "look" and model.name not in named:
                rows = "1 row" if model.flagged == 1 else f"{model.flagged} rows"
                spots.append(WeakSpot(model.name, f"model {model.name}: {rows} flagged"))
            elif model.done and model.redundancy == 0:
                words = f"model {model.name}: no redundancy, nothing checks it"
                spots.append(WeakSpot(model.name, words))
        measured = sum(any(model.done for model in strip.models) for strip in self.strips)
        if measured > 1 and not self.coverage.lateral_ties:
            spots.append(WeakSpot("", "no point ties the strips together yet"))
        return tuple(spots)

    @property
    def weak_photos(self) -> tuple[str, ...]:
        """What would help the weakest photos, in words: the best two points, or the best one."""
        if self.block is None:
            return ()
        few = {one.photo: one for one in self.block.stabilizing if len(one.points) <= _FEW}
        return tuple(
            f"photo {one.photo}: mean r {one.before:.2f}, {one.after:.2f} with "
            + " and ".join(f"({point.x:.0f}, {point.y:.0f})" for point in one.points)
            for one in few.values()
        )


def _other(one: FlaggedObservation) -> WeakSpot:
    return WeakSpot("", f"{one.what}: w {one.w:.2f}")


def _of_block(view: BlockView | None) -> Iterator[WeakSpot]:
    if view is None:
        return
    from anaplot.station.blockview import percent, unless_wrong

    others = list(view.others)
    for point in view.suspects:
        # wrong control bends the rays about it, and stands before them
        while others and others[0].w > point.size:
            yield _other(others.pop(0))
        accused = point.accused
        where = "" if accused.model is None else f" (model {accused.model})"
        chance = percent(accused.probability) + unless_wrong(view.unless(point))
        words = f"point {point.point} in photo {accused.photo}{where}: {chance}"
        yield WeakSpot(accused.model or "", words)
    yield from map(_other, others)
    if view.aside:
        shown = ", ".join(view.aside[:8]) + (", ..." if len(view.aside) > 8 else "")
        yield WeakSpot("", f"not connected yet: photos {shown}")


def status_of(
    block: Block,
    state: SessionState | None,
    view: BlockView | None,
    folder: str,
    accidents: BlockAccidents = NO_ACCIDENTS,
    bridged: Iterable[BridgedStrip] = (),
) -> BlockStatus:
    """Return where a block stands, from its files.

    Parameters
    ----------
    block
        As its files say, with image points and control.
    state
        Where the journal says that the session stands, or None without one.
    view
        What the block as one bundle says, or None.
    folder
        How the command line names the block.
    accidents
        Points that are numbered wrong.
    bridged
        Strips of the block as `bridge` has them; those that are missing are bridged here.
    """
    named = _with_models(view, block)
    suspected = suspected_models(named)
    ahead, recomputed = _of_session(state)
    there = measured_in_files(block)
    known = _bridged(block, there, bridged)
    anew = {one.name for one in recomputed}
    strips = tuple(
        _strip(
            known.get(strip.id),
            strip,
            state,
            ahead,
            there,
            suspected,
            anew,
        )
        for strip in block.strips
    )
    opened = first_open(strips)
    measured = bool(block.image_points)
    coverage = coverage_of(block)
    if state is not None and ahead is not None:
        step = following(opened, measured, named, folder, state, ahead, held=is_held(block))
    elif (photo := _wrong_photo(block, accidents)) is not None:
        step = NextStep("return", f"anaplot open {folder}", *photo)
    elif (wrong := _surest(accidents, () if state is None else state.models)) is not None:
        step = NextStep("return", f"anaplot open {folder}", wrong.model, point=wrong.accident.point)
    else:
        apart = None if state is None else untied(strips, coverage, view)
        step = following(opened, measured, named, folder, state, held=is_held(block), untied=apart)
    return BlockStatus(strips, recomputed, view, coverage, step, accidents, ways_to_open(block))


def first_open(strips: Iterable[StripStatus]) -> str:
    """Return the name of the first model that is not measured, or ""."""
    return next((m.name for strip in strips for m in strip.models if m.state == "open"), "")


def _surest(accidents: BlockAccidents, models: Sequence[ModelState]) -> FiledAccident | None:
    """Return the first of which it is certain, and that measuring again may mend; or None."""
    if not accidents.certain:
        return None
    from anaplot.station.returnadvice import may_help

    of = {model.name: model for model in models}
    for one in accidents.certain:
        if one.model not in of or may_help(of[one.model], one.accident.point):
            return one
    return None


def untied(
    strips: Iterable[StripStatus], coverage: Coverage, view: BlockView | None = None
) -> Untied | None:
    """Return the first strip that hangs together with no other, where a model of it can be opened.

    Parameters
    ----------
    strips
        In the order of block.toml.
    coverage
        What ties them together.
    view
        What the block as one bundle says: strips that too few points join wait aside there.
    """
    aside = frozenset(() if view is None else view.aside)
    for strip in strips:
        photos = {p for model in strip.models if model.done for p in (model.left, model.right)}
        if strip.strip in coverage.apart or (photos and photos <= aside):
            for model in strip.models:
                if model.done:
                    return Untied(strip.strip, model.name)
    return None


def _of_session(state: SessionState | None) -> tuple[Outlook | None, tuple[Recomputed, ...]]:
    """Return what follows from the model in work, and the models that are computed anew."""
    ahead: Outlook | None = None
    recomputed: tuple[Recomputed, ...] = ()
    # what computes is loaded where there is something to compute
    if state is not None and state.current is not None:
        from anaplot.session.workflow import outlook

        ahead = outlook(state)
    if state is not None and state.recomputed:
        from anaplot.session.recomputed import recomputed_models

        recomputed = recomputed_models(state)
    return ahead, recomputed


def _bridged(
    block: Block, there: Set[tuple[str, str]], bridged: Iterable[BridgedStrip]
) -> dict[str, BridgedStrip]:
    """Return the strips that have measured models, by name; those that are missing anew."""
    known = {one.strip: one for one in bridged}
    missing = [
        strip
        for strip in block.strips
        if strip.id not in known and not there.isdisjoint(strip.models())
    ]
    if missing:
        from anaplot.orientation.strip import bridge_strip

        rows = rows_by_photo(block.image_points)
        known |= {strip.id: bridge_strip(block, strip, rows=rows) for strip in missing}
    return known


def _with_models(view: BlockView | None, block: Block) -> BlockView | None:
    """Return a view in which accused rays of rows that name no model have the first they are in."""
    if view is None or all(suspect.accused.model is not None for suspect in view.suspects):
        return view
    measured = set(names_of(block.image_points))
    suspects = []
    for suspect in view.suspects:
        accused, *others = suspect.rays
        if accused.model is None:
            models = (model for strip in block.strips for model in strip.models())
            there = (
                "/".join(model)
                for model in models
                if accused.photo in model
                and all((photo, suspect.point) in measured for photo in model)
            )
            accused = accused._replace(model=next(there, None))
        suspects.append(replace(suspect, rays=(accused, *others)))
    return replace(view, suspects=tuple(suspects))


def _wrong_photo(block: Block, accidents: BlockAccidents) -> tuple[str, str] | None:
    """Return the first wrong photograph's first model, and its name; None where none is wrong.

    Until it is put right, what follows from its points is of little use.
    """
    for one in accidents.photos:
        for left, right in (model for strip in block.strips for model in strip.models()):
            for photo in one.photos:
                if photo in (left, right):
                    return f"{left}/{right}", photo
    return None


def waiting(state: SessionState) -> tuple[str, str] | None:
    """Return the photos of the model that waits while the operator is back in another, or None."""
    parked = None if state.returned is None else state.returned.parked
    return None if parked is None else parked.photos


def suspected_models(view: BlockView | None) -> frozenset[str]:
    """Return the models that surely hold a wrong point."""
    if view is None:
        return frozenset()
    from anaplot.station.blockview import SURE

    return frozenset(
        point.accused.model
        for point in view.suspects
        if point.accused.model is not None
        and point.accused.probability > SURE
        and view.unless(point) is None
    )


def standing(
    solution: ModelSolution | None, *, suspected: bool, recomputed: bool = False
) -> ModelStanding:
    """Return how an accepted model stands; without a solution it needs a look."""
    if suspected or solution is None or solution.flagged or solution.unexplained:
        return "look"
    return "recomputed" if recomputed else "accepted"


def _strip(
    bridged: BridgedStrip | None,
    strip: Strip,
    state: SessionState | None,
    ahead: Outlook | None,
    there: frozenset[tuple[str, str]],
    suspected: frozenset[str],
    anew: Set[str],
) -> StripStatus:
    solved = {(model.left, model.right): model for model in bridged.models} if bridged else {}
    models = []
    for left, right in strip.models():
        current = state.current if state is not None else None
        if ahead is not None and current is not None and current.photos == (left, right):
            models.append(
                with_table((left, right), "in work", ahead.solution, current, ahead.alarm)
            )
            continue
        if (left, right) not in there:
            waits = state is not None and waiting(state) == (left, right)
            models.append(ModelStatus(left, right, "in work" if waits else "open"))
            continue
        name = f"{left}/{right}"
        solution = solved.get((left, right))
        accepted = None if state is None else state.accepted(left, right)
        why = (bridged.error or "") if bridged and solution is None else ""
        stands = standing(solution, suspected=name in suspected, recomputed=name in anew)
        models.append(with_table((left, right), stands, solution, accepted, why))
    return StripStatus(strip.id, tuple(models))


def with_table(
    photos: tuple[str, str],
    stands: ModelStanding,
    solution: ModelSolution | None,
    measured: ModelState | None,
    why: str,
) -> ModelStatus:
    """Return a measured model's status, with the figures of its solution where it has one."""
    if solution is None:
        # what was left out without a measurement has no row that is off
        points = () if measured is None else {point.point for point in measured.measured}
        switched = () if measured is None else measured.off
        off = sum(point in points for point, _ in switched)
        return ModelStatus(*photos, stands, off=off, why=why)
    return ModelStatus(
        *photos,
        stands,
        solution.sigma0_um,
        solution.redundancy,
        len(solution.flagged),
        len(solution.off_rows),
        len(solution.ties),
        solution.unexplained if stands == "look" else "",
    )
