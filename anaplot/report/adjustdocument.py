"""An adjusted block as a document (JSON: conventions, "What programs read")."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict

import numpy as np

from anaplot.adjustment.hypothesis import critical_f
from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.tested import Observation
from anaplot.bundle.errors.bychance import ALARM
from anaplot.bundle.errors.suspects import ImageCoordinate, Suspect, likeliest_suspects
from anaplot.bundle.errors.wrongray import SuspectRay, suspect_rays_of
from anaplot.bundle.solve.adjusted import AdjustedBlock, observation_in_words
from anaplot.bundle.solve.externalreliability import MOST_RAYS, external_reliability
from anaplot.bundle.solve.networkscale import scale_deviation
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.parametercorrelations import parameter_correlations, parameter_matrix
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.rulesofthumb import RulesOfThumb, rules_of_thumb
from anaplot.bundle.solve.uncheckedvalues import unchecked_values
from anaplot.photogrammetry.groundsystem import GroundSystem
from anaplot.report.adjusttables import (
    check_table,
    condition_table,
    control_table,
    is_fine,
    overlap_table,
    parameter_table,
    photo_correlation_table,
    photo_table,
    point_prior_table,
    point_table,
    prior_table,
    with_rejected_control,
    with_rejected_priors,
)
from anaplot.report.columns import counted
from anaplot.report.document import (
    BLANK,
    Answer,
    Block,
    Document,
    Line,
    Listed,
    Table,
    named,
    say,
)
from anaplot.report.parameters import given_json, held_line, reference_lengths, reference_lines
from anaplot.report.raytables import image_point_table, ray_table
from anaplot.report.rules import rules_json, rules_lines
from anaplot.report.switchedoff import switched_off_table

__all__ = [
    "DATUM",
    "adjust_document",
    "datum_words",
    "ground_lines",
    "others_flagged",
    "sigma0_limit",
]

_FEW = 3  # of flagged observations of other kinds
_MOST = 30  # of flagged rows, spurs and correlations in the summary; the tables hold them all

DATUM = {
    "control": "control and priors",
    "minimal": "minimal constraints",
    "free": "inner constraints over the points",
}


def adjust_document(
    block: AdjustedBlock, rejected: Iterable[tuple[ObservationName, float | None]] | None = None
) -> Document:
    """Return the document of an adjusted block.

    Parameters
    ----------
    block
        The adjusted block.
    rejected
        Names and estimated errors of the observations that a strategy rejected; None: there was no
        strategy. Rows of `image_points`, `control` and `priors` say then whether they are rejected;
        rejected control and priors, no observations any more, stand after the others.
    """
    external = external_reliability(block)
    photos, points, check = photo_table(block), point_table(block), check_table(block)
    control, priors = control_table(block, external), prior_table(block, external)
    expected = point_prior_table(block, external)
    conditions = condition_table(block, external)
    parameters, rays = parameter_table(block), ray_table(block, external)
    overlaps, related = overlap_table(block), photo_correlation_table(block)
    off = switched_off_table(block)
    all_control, all_priors, all_expected = control, priors, expected
    axes: dict[int, list[str]] | None = None
    if rejected is not None:
        gone = list(rejected)
        all_control = with_rejected_control(control, _rejected(gone, "control"))
        all_priors = with_rejected_priors(priors, _rejected(gone, "prior"))
        all_expected = with_rejected_control(expected, _rejected(gone, "point prior"))
        axes = {}
        for ray, axis in np.argwhere(block.problem.newly_rejected).tolist():
            axes.setdefault(int(block.problem.source[ray]), []).append("xy"[axis])
    image_points = image_point_table(block, external, axes)
    rules = rules_of_thumb(block)
    suspects, unchecked = likeliest_suspects(block), unchecked_values(block)
    accused = suspect_rays_of(block, (point for _, _, point, _ in block.suspects()))
    ground = block.problem.block.ground
    answer = {
        **_figures(block),
        "ground": None if ground is None else asdict(ground),
        "photos": photos,
        "overlaps": overlaps,
        "photo_correlations": related,
        "points": points,
        "image_points": image_points,
        "control": all_control,
        "check": check,
        "indicators": _indicators(block),
        "rules": rules_json(rules),
        "priors": all_priors,
        "point_priors": all_expected,
        "conditions": conditions,
        "spurs": [
            {"photo": photo, "point": point, "axis": axis} for photo, point, axis in block.spurs()
        ],
        "unchecked": [_unchecked(one) for one in unchecked],
        "suspects": [_suspect(one) for one in suspects],
        "accused": {point: [ray._asdict() for ray in rays] for point, rays in accused.items()},
        "off": off,
        "left_out": [one._asdict() for one in block.problem.left_out],
        "remarks": [*block.remarks, *_unobserved(block)],
    }
    additional = block.problem.additional
    if additional is not None:
        answer["additional"] = {
            "set": additional.set.name,
            "scope": additional.scope,
            "given": given_json(additional),
            "reference": [one._asdict() for one in reference_lengths(block.problem)],
            "parameters": parameters,
            "correlations": [
                {"first": first, "second": second, "correlation": rho}
                for first, second, rho in parameter_correlations(block)
            ],
            "matrix": _matrix_json(block),
        }
    page: list[Block] = [*_summary(block, answer, suspects, accused, rules), BLANK]
    page += [photos, BLANK]
    page += _if_any(control)
    page += _if_any(conditions)
    page += _if_any(check)
    page += _if_any(expected)
    page += _if_any(priors)
    if len(parameters):
        page += [parameters, *_parameters(answer["additional"])]
    if additional is not None:
        line = held_line(additional)
        page += [] if line is None else [line]
        page += [*reference_lines(block.problem), BLANK]
    page += [points, BLANK, rays, BLANK, *_legend(block)]
    tables = (points, photos, image_points, all_control, check, all_priors, overlaps, related)
    more = tuple(one for one in (parameters, conditions, all_expected, off) if len(one))
    return Document(answer, tuple(page), (*tables, *more))


def _matrix_json(block: AdjustedBlock) -> Answer | None:
    found = parameter_matrix(block)
    if found is None:
        return None
    names, rho = found
    return {"rows": [{"group": owner, "name": one} for owner, one in names], "values": rho}


def _rejected(
    gone: Iterable[tuple[ObservationName, float | None]], kind: str
) -> list[tuple[str, str, float | None]]:
    # adjusted minus observed: the estimated error with the other sign
    return [
        (str(one[1]), str(one[2]), None if error is None else -error)
        for one, error in gone
        if one[0] == kind
    ]


def _if_any(table: Table) -> tuple[Block, ...]:
    return (table, BLANK) if len(table) else ()


def _figures(block: AdjustedBlock) -> Answer:
    problem, sigma0 = block.problem, block.sigma0
    overall = block.global_test()
    return {
        "observations": problem.observations,
        "unknowns": problem.unknowns,
        "redundancy": block.redundancy,
        "sigma0": sigma0,
        "sigma0_um": None if sigma0 is None else sigma0 * problem.block.precision.image_um,
        "test": {
            "kind": problem.test.kind,
            "alpha": problem.test.alpha,
            "power": problem.test.power,
            "critical": block.critical,
            "flagged_by_chance": block.flagged_by_chance,
        },
        "global_test": None
        if overall is None or sigma0 is None
        else {"alpha": overall.alpha, "critical": overall.critical, "statistic": sigma0**2},
        "datum": {
            "kind": problem.datum,
            "defect": problem.defect,
            **_scale(block),
        },
        "iterations": block.convergence.iterations,
    }


def datum_words(problem: Problem) -> str:
    """Say from what the datum is."""
    if problem.gives_scale:
        return f"{DATUM[problem.datum]}, the scale by distances"
    if _of_own_scale(problem):
        return f"{DATUM[problem.datum]}, the scale by nothing stated"
    return DATUM[problem.datum]


def _of_own_scale(problem: Problem) -> bool:
    """Whether there are no two places, not even approximate ones, to lay a network onto."""
    if problem.datum == "control" or problem.gives_scale:
        return False
    places = np.concatenate((problem.near, problem.position))
    return bool((np.isfinite(places).sum(axis=0) < 2).all())


def _scale(block: AdjustedBlock) -> Answer:
    if block.problem.gives_scale:
        return {"scale": "distances", "scale_s": scale_deviation(block)}
    return {"scale": "open"} if _of_own_scale(block.problem) else {}


def _scale_line(block: AdjustedBlock) -> list[Line]:
    s = scale_deviation(block)
    if s is None:
        return []
    return [say("  standard deviation of the scale by distances: {:.3g} ppm", 1e6 * s)]


def _indicators(block: AdjustedBlock) -> Answer:
    found = block.indicators()
    return {
        "RI_x": found.ri_x,
        "RI_y": found.ri_y,
        "RI": found.ri,
        "AI_X": found.ai_x,
        "AI_Y": found.ai_y,
        "AI_Z": found.ai_z,
        "AI": found.ai,
    }


def _suspect(one: Suspect) -> Answer:
    return {
        "point": one.point,
        **one.where._asdict(),
        "w": one.w,
        "r": one.r,
        "partners": [other._asdict() for other in one.partners],
    }


def _summary(
    block: AdjustedBlock,
    answer: Answer,
    suspects: tuple[Suspect, ...],
    accused: Mapping[str, tuple[SuspectRay, ...]],
    rules: RulesOfThumb,
) -> list[Block]:
    problem = block.problem
    image_um = problem.block.precision.image_um
    sigma0 = say("none")
    if block.sigma0 is not None:
        sigma0 = say("{sigma0:.4f} ({sigma0_um:.2f} um)", **answer)
    defect = say(" (rank defect {defect} of the datum)", **answer["datum"])
    lines: list[Block] = [
        say("BLOCK {}", problem.block.name).of("heading"),
        say(
            "  {} photos, {} points, {} rays; datum: {}",
            len(problem.photos),
            len(problem.points),
            len(problem.photo),
            datum_words(problem),
        ),
        *_scale_line(block),
        *ground_lines(problem.block.ground),
        say("  observations {observations}, unknowns {unknowns}, redundancy {redundancy}", **answer)
        + (defect if problem.defect else ""),
        say(
            "  sigma0 {}, a priori 1 ({:g} um); {}, {} damped",
            sigma0,
            image_um,
            counted(block.convergence.iterations, "iteration"),
            block.convergence.damped,
        ),
        say(
            "  test {kind}, alpha {alpha:g}, critical value {critical:.2f||none}; of good "
            "observations about {flagged_by_chance:.1f} are flagged",
            **answer["test"],
        ).folded(4),
        *_global_test(block),
        say("  reliability  RI x {RI_x:.3f}  y {RI_y:.3f}  all {RI:.3f}", **answer["indicators"]),
        say(
            "  accuracy     AI X {AI_X:.4f}  Y {AI_Y:.4f}  Z {AI_Z:.4f}  all {AI:.4f} m"
            if not is_fine(block)
            else "  accuracy     AI X {AI_X:.6f}  Y {AI_Y:.6f}  Z {AI_Z:.6f}  all {AI:.6f} m",
            **answer["indicators"],
        ),
        *rules_lines(rules, "  "),
    ]
    lines += _coordinates_out(block)
    lines += [say("  note: {}", remark).of("remark") for remark in answer["remarks"]]
    if suspects:
        lines += _suspects(block, suspects, accused)
    elif block.critical is not None:
        lines.append(say("  no image coordinate is flagged"))
    return [*lines, *_others_flagged(block), *_spurs(block), *_unchecked_lines(answer["unchecked"])]


def _coordinates_out(block: AdjustedBlock) -> list[Line]:
    """Say how many coordinates of rays are no observations: rejected now, or off in the file."""
    rejected = int(block.problem.newly_rejected.sum())
    off = int(block.rejected.sum()) - rejected
    counts = ((rejected, "rejected"), (off, "switched off"))
    return [
        say(f"  {{}} image coordinate{' is' if count == 1 else 's are'} {what}", count)
        for count, what in counts
        if count
    ]


def others_flagged(block: AdjustedBlock) -> list[tuple[float, str, str]]:
    """Return w, words and kind of what is flagged beside image coordinates, the largest first."""
    return [one for one in block.flagged_observations() if one[2] != "image"]


def _unobserved(block: AdjustedBlock) -> list[str]:
    """Say how much of what photos state takes no part: without a datum of control nothing does."""
    if block.problem.datum == "control":
        return []
    stated = block.problem.block
    names = set(block.problem.photos)
    adjusted = [photo for photo in stated.photos if photo.id in names]
    counts = (
        ("position", sum(photo.position_sigma is not None for photo in adjusted)),
        ("rotation", sum(photo.rotation_sigma is not None for photo in adjusted)),
    )
    parts = [counted(count, f"stated {what}") for what, count in counts if count]
    if not parts:
        return []
    also = "" if stated.offsets is None else ", nor what [gnss] and [imu] say of them"
    return [f"not observed in this datum: {' and '.join(parts)}{also}"]


def _others_flagged(block: AdjustedBlock) -> list[Line]:
    """Say what is flagged beside image coordinates."""
    others = others_flagged(block)
    if not others:
        return []
    some = [say("{} (w {:.2f})", what, w) for w, what, _ in others[:_FEW]]
    head = f"  {counted(len(others), 'other observation')} {'is' if len(others) == 1 else 'are'}"
    return [say("{} flagged: {}", head, named(some)).folded(4).of("look")] + (
        [say("    and {} more in the tables", len(others) - _FEW)] if len(others) > _FEW else []
    )


def ground_lines(system: GroundSystem | None) -> list[Line]:
    """Say in which system the coordinates are."""
    if system is None:
        return []
    if system.frame == "offset":
        e, n, h = system.origin
        return [say("  coordinates: {} less {:.10g}, {:.10g}, {:.10g} m", system.crs, e, n, h)]
    lon, lat, h = system.origin
    return [
        say("  coordinates: east, north, up [m] at {:.8f}, {:.8f} deg and", lon, lat)
        + say(" {:.3f} m of {}", h, system.crs),
        say("    (`export` writes those of {})", system.crs),
    ]


def _global_test(block: AdjustedBlock) -> list[Line]:
    """Return Baarda's global test, consistent with the test of single observations."""
    found = block.global_test()
    limit = sigma0_limit(block)
    if found is None or block.sigma0 is None or limit is None:
        return []
    beyond = block.sigma0**2 > limit
    return [
        say(
            "  global test consistent with alpha {:g} and power {:g}: alpha {:.3f}, "
            "sigma0^2 {:.3f} against {:.3f}",
            block.problem.test.alpha,
            found.power,
            found.alpha,
            block.sigma0**2,
            found.critical,
        ).folded(4),
        say(
            "    ({}{:.0f} % of such blocks without any error exceed it; at {:g} the limit "
            "is {:.3f}{})",
            "" if beyond else "no alarm: ",
            100.0 * found.alpha,
            ALARM,
            limit,
            ", and this is beyond it" if beyond else "",
        ).folded(6),
    ]


def sigma0_limit(block: AdjustedBlock) -> float | None:
    """Return what sigma0^2 exceeds in one of twenty good blocks; None without redundancy."""
    return critical_f(ALARM, block.redundancy) if block.redundancy > 0 else None


def _suspects(
    block: AdjustedBlock,
    suspects: tuple[Suspect, ...],
    accused: Mapping[str, tuple[SuspectRay, ...]],
) -> list[Block]:
    """Say what is flagged, what to remeasure first, and which ray of a point is the wrong one."""
    first = suspects[0]
    # wrong control bends the rays about it
    worst = next(((what, w) for w, what, kind in others_flagged(block) if w > abs(first.w)), None)
    lines = [
        (say("    {}  point {}  {}  w {:.2f}  r {:.3f}", _photo(one.where), one.point,
             one.where.axis, one.w, one.r)
         + _alike(one)).folded(6)
        for one in suspects
    ]  # fmt: skip
    points = list(dict.fromkeys(one.point for one in suspects))
    return [
        say(
            "  {} flagged; "
            + (
                "remeasure {} in {} ({}) first:"
                if worst is None
                else "look at {} (w {:.2f}) first, then at {} in {} ({}):"
            ),
            counted(int(block.flagged.sum()), "image coordinate"),
            *(worst or ()),
            first.point,
            _photo(first.where),
            first.where.axis,
        )
        .folded(4)
        .of("look"),
        Listed(tuple(lines), _MOST, "    and {} more in the table"),
        say("  which ray of the point is wrong, if one is:"),
        Listed(tuple(_accused(point, accused[point]) for point in points), _MOST, ""),
    ]


def _accused(point: str, rays: tuple[SuspectRay, ...]) -> Line:
    some = [say("{} {:.0f} %", _photo(ray), 100.0 * ray.probability) for ray in rays[:4]]
    return say("    point {}: {}", point, named(some)).folded(6)


def _photo(where: ImageCoordinate | SuspectRay) -> Line:
    inside = "" if where.model is None else say(" in {}", where.model)
    return say("photo {}", where.photo) + inside


def _alike(suspect: Suspect) -> Line:
    """Name what is hard to tell apart from a suspect."""
    if not suspect.partners:
        return say("")
    others = [say("{} of {}", other.axis, _photo(other)) for other in suspect.partners]
    return say("  (or {}: hard to tell apart)", named(others, _MOST, ""))


def _spurs(block: AdjustedBlock) -> list[Block]:
    spurs = block.spurs()
    if not spurs:
        return []
    return [
        say(
            "  {} (spurs, r below {:g}) {} checked by nothing:",
            counted(len(spurs), "image coordinate"),
            SPUR,
            "is" if len(spurs) == 1 else "are",
        ),
        say("    {}", named([say("{}:{} {}", *spur) for spur in spurs], _MOST, " ...")).folded(4),
    ]


def _unchecked(value: Observation[ObservationName]) -> Answer:
    what, kind = observation_in_words(value.key)
    return {"what": what, "kind": kind, "mdb": value.mdb}


def _unchecked_lines(unchecked: Sequence[Answer]) -> list[Block]:
    """Say which given lengths next to nothing checks."""
    if not unchecked:
        return []
    shown = [
        say("{what} ({mdb:.5g|m|none})", what=one["what"], mdb=one["mdb"]) for one in unchecked
    ]
    return [
        say(
            "  {} {} checked by next to nothing (smallest detectable errors):",
            counted(len(unchecked), "given value"),
            "is" if len(unchecked) == 1 else "are",
        ),
        say("    {}", named(shown, _MOST, " ...")).folded(4),
    ]


def _parameters(additional: Answer) -> list[Block]:
    """Return what stands under the table of additional parameters."""
    lines: list[Block] = []
    if additional["parameters"].shown is None:
        lines += [
            say(
                "  c, x0, y0: corrections of the camera's; c > 0 makes it longer; "
                "k1 to b2: the value"
            ),
            say("  is the effect at the image's edge, the coefficient that of Brown's formula"),
        ]
    pairs = additional["correlations"]
    if pairs:
        found = tuple(say("    {first} with {second}: {correlation:.3f}", **pair) for pair in pairs)
        lines += [say("  correlated beyond 0.9:"), Listed(found, _MOST, "")]
    return lines


def _legend(block: AdjustedBlock) -> list[Block]:
    """Say what the columns of undetected errors mean."""
    lines: list[Block] = [
        say(
            "  an error as large as MDB moves the ray's own point by EFFECT, "
            "no point farther than AT"
        ),
        say("  by LARGEST, and no function of the unknowns by more than LENGTH of its deviations"),
    ]
    if len(block.problem.photo) > MOST_RAYS:
        lines.append(say("  (LARGEST is not looked for in blocks of more than {} rays)", MOST_RAYS))
    return lines
