"""The adjusted block as text for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import degrees, hypot

from anaplot.adjustment.hypothesis import critical_f
from anaplot.adjustment.reliability import SPUR
from anaplot.bundle.errors.suspects import ImageCoordinate, Suspect, likeliest_suspects
from anaplot.bundle.errors.wrongray import suspect_rays
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.externalreliability import (
    MOST_RAYS,
    ExternalReliability,
    UndetectedEffect,
    external_reliability,
)
from anaplot.report.columns import cell, column, counted
from anaplot.textfiles.wording import plain

__all__ = ["adjust_printout"]

_ALARM = 0.05  # significance of a test of sigma0 as an alarm
_MOST = 30  # of flagged rows, spurs and correlations in the summary; the tables hold them all


def _width(names: Iterator[str], least: int = 5) -> int:
    return max([least, *(len(plain(name)) for name in names)])


def adjust_printout(block: AdjustedBlock) -> str:
    """Return the report of an adjusted block.

    Angles in degrees, ground coordinates in metres, residuals in micrometres, effects on the
    ground in millimetres.
    """
    external = external_reliability(block)
    lines = _summary(block)
    lines += _photos(block) + _control(block, external) + _check(block)
    lines += _priors(block, external) + _parameters(block)
    lines += _points(block) + _rays(block, external) + _legend(block)
    return "\n".join(lines)


def _summary(block: AdjustedBlock) -> list[str]:
    problem, test = block.problem, block.problem.test
    sigma0 = "none" if block.sigma0 is None else f"{block.sigma0:.4f}"
    um = ""
    if block.sigma0 is not None:
        um = f" ({block.sigma0 * problem.block.precision.image_um:.2f} um)"
    critical = "none" if block.critical is None else f"{block.critical:.2f}"
    datum = {
        "control": "control and priors",
        "minimal": "minimal constraints",
        "free": "inner constraints over the points",
    }[problem.datum]
    i = block.indicators()
    lines = [
        f"BLOCK {plain(problem.block.name)}",
        f"  {len(problem.photos)} photos, {len(problem.points)} points, {len(problem.photo)} rays;"
        f" datum: {datum}",
        f"  observations {problem.observations}, unknowns {problem.unknowns}, "
        f"redundancy {block.redundancy}"
        + (f" (rank defect {problem.defect} of the datum)" if problem.defect else ""),
        f"  sigma0 {sigma0}{um}, a priori 1 ({problem.block.precision.image_um:g} um); "
        f"{counted(block.convergence.iterations, 'iteration')}, {block.convergence.damped} damped",
        f"  test {test.kind}, alpha {test.alpha:g}, critical value {critical}; of good observations"
        f" about {block.flagged_by_chance:.1f} are flagged",
        *_global_test(block),
        f"  reliability  RI x {i.ri_x:.3f}  y {i.ri_y:.3f}  all {i.ri:.3f}",
        f"  accuracy     AI X {i.ai_x:.4f}  Y {i.ai_y:.4f}  Z {i.ai_z:.4f}  all {i.ai:.4f} m",
    ]
    out = int(block.rejected.sum())
    if out:
        lines.append(f"  {out} image coordinate{'s are' if out > 1 else ' is'} rejected")
    lines += [f"  note: {plain(remark)}" for remark in block.remarks]
    suspects = likeliest_suspects(block)
    if suspects:
        first, flagged = suspects[0], int(block.flagged.sum())
        lines.append(
            f"  {counted(flagged, 'image coordinate')} flagged; remeasure {plain(first.point)} "
            f"in {_photo(first.where)} ({first.where.axis}) first:"
        )
        lines += [
            f"    {_photo(one.where)}  point {plain(one.point)}  {one.where.axis}  "
            f"w {one.w:.2f}  r {one.r:.3f}{_alike(one)}"
            for one in suspects[:_MOST]
        ]
        if len(suspects) > _MOST:
            lines.append(f"    and {len(suspects) - _MOST} more in the table")
        lines += _accusations(block, list(dict.fromkeys(one.point for one in suspects)))
    elif block.critical is not None:
        lines.append("  no image coordinate is flagged")
    spurs = block.spurs()
    if spurs:
        lines.append(
            f"  {counted(len(spurs), 'image coordinate')} (spurs, r below {SPUR:g}) "
            f"{'is' if len(spurs) == 1 else 'are'} checked by nothing:"
        )
        cells = [f"{plain(f)}:{plain(p)} {axis}" for f, p, axis in spurs[:_MOST]]
        lines.append("    " + ", ".join(cells) + (" ..." if len(spurs) > _MOST else ""))
    return [*lines, ""]


def _photo(where: ImageCoordinate) -> str:
    inside = f" in {plain(where.model)}" if where.model is not None else ""
    return f"photo {plain(where.photo)}{inside}"


def _alike(suspect: Suspect) -> str:
    """Name what is hard to tell apart from a suspect."""
    if not suspect.partners:
        return ""
    cells = [f"{other.axis} of {_photo(other)}" for other in suspect.partners[:_MOST]]
    return f"  (or {', '.join(cells)}: hard to tell apart)"


def _global_test(block: AdjustedBlock) -> list[str]:
    """Return Baarda's global test, consistent with the test of single observations."""
    found = block.global_test()
    if found is None or block.sigma0 is None:
        return []
    return [
        f"  global test consistent with alpha {block.problem.test.alpha:g} and power "
        f"{found.power:g}: alpha {found.alpha:.3f}, sigma0^2 {block.sigma0**2:.3f} against "
        f"{found.critical:.3f}",
        f"    (no alarm: {100.0 * found.alpha:.0f} % of such blocks without any error exceed it; "
        f"at {_ALARM:g} the limit is {critical_f(_ALARM, block.redundancy):.3f})",
    ]


def _accusations(block: AdjustedBlock, points: list[str]) -> list[str]:
    """Say which ray of a flagged point is probably the wrong one."""
    lines = ["  which ray of the point is wrong, if one is:"]
    for point in points[:_MOST]:
        rays = suspect_rays(block, point)
        cells = [
            f"photo {plain(ray.photo)}"
            + (f" in {plain(ray.model)}" if ray.model is not None else "")
            + f" {100.0 * ray.probability:.0f} %"
            for ray in rays[:4]
        ]
        lines.append(f"    point {plain(point)}: {', '.join(cells)}")
    return lines


def _photos(block: AdjustedBlock) -> list[str]:
    rows = block.photo_rows()
    width = _width(row.photo for row in rows)
    lines = [
        f"  {'PHOTO':<{width}}{'X':>15}{'Y':>15}{'Z':>12}{'sX':>8}{'sY':>8}{'sZ':>8}"
        f"{'omega':>11}{'phi':>11}{'kappa':>12}{'somega':>9}{'sphi':>9}{'skappa':>9}"
    ]
    for row in rows:
        x, y, z = row.position
        angles = [degrees(angle) for angle in row.angles]
        spread = [None if s is None else degrees(s) for s in row.s_angles]
        lines.append(
            f"  {plain(row.photo):<{width}}{cell(x, 3, 15)}{cell(y, 3, 15)}{cell(z, 3, 12)}"
            + "".join(cell(s, 3, 8) for s in row.s_position)
            + "".join(cell(a, 5, size) for a, size in zip(angles, (11, 11, 12), strict=True))
            + "".join(cell(s, 5, 9) for s in spread)
        )
    return [*lines, ""]


def _control(block: AdjustedBlock, external: ExternalReliability) -> list[str]:
    rows = block.control_rows()
    if not rows:
        return []
    width = _width((row.point for row in rows), 7)
    at = _width_at(external.control)
    lines = [f"  {'CONTROL':<{width}}       v [m]     r       w   MDB [m]{_effect_head(at)}"]
    lines += [
        (
            f"  {plain(row.point):<{width}} {row.axis}{cell(row.residual, 4, 10)}"
            f"{cell(row.r, 3, 6)}{cell(row.w, 2, 8)}{cell(row.mdb, 4, 10)}"
            + _effect_cells(effect, at)
            + ("  << CHECK" if row.flagged else "")
        ).rstrip()
        for row, effect in zip(rows, external.control, strict=True)
    ]
    return [*lines, ""]


def _check(block: AdjustedBlock) -> list[str]:
    rows = block.check_rows()
    if not rows:
        return []
    width = _width(name for name, _ in rows)
    lines = [f"  {'CHECK':<{width}}    dX [m]    dY [m]    dZ [m]   (adjusted minus given)"]
    lines += [
        f"  {plain(name):<{width}}" + "".join(cell(value, 4, 10) for value in difference)
        for name, difference in rows
    ]
    return [*lines, ""]


def _priors(block: AdjustedBlock, external: ExternalReliability) -> list[str]:
    rows = block.prior_rows()
    if not rows:
        return []
    width = _width(row.owner for row in rows)
    unit = {"X": "m", "Y": "m", "Z": "m", "omega": "rad", "phi": "rad", "kappa": "rad"}
    at = _width_at(external.priors)
    lines = [
        f"  {'PRIOR':<{width}}                      v     r       w         MDB{_effect_head(at)}"
    ]
    lines += [
        (
            f"  {plain(row.owner):<{width}} {row.unknown:<8} {unit.get(row.unknown, 'mm'):<3}"
            f"{cell(row.residual, 6, 12)}{cell(row.r, 3, 6)}{cell(row.w, 2, 8)}"
            + cell(row.mdb, 6, 12)
            + _effect_cells(effect, at)
            + ("  << CHECK" if row.flagged else "")
        ).rstrip()
        for row, effect in zip(rows, external.priors, strict=True)
    ]
    return [*lines, ""]


def _parameters(block: AdjustedBlock) -> list[str]:
    rows = block.parameter_rows()
    if not rows:
        return []
    width = _width((row.group for row in rows), 6)
    lens = rows[0].coefficient is not None
    more = "   coefficient          s" if lens else ""
    lines = [f"  {'GROUP':<{width}} PARAMETER  value [um]    s [um]{more}"]
    for row in rows:
        spread = None if row.s is None else row.s * 1e3
        lines.append(
            f"  {plain(row.group):<{width}} {row.name:<9}{cell(row.value * 1e3, 3, 12)}"
            f"{cell(spread, 3, 10)}"
        )
        if row.coefficient is not None:
            unit = " mm" if row.name in ("c", "x0", "y0") else ""
            s = "-" if row.s_coefficient is None else f"{row.s_coefficient:.2g}"
            lines[-1] += f"{row.coefficient:>14.5g}{s:>11}{unit}"
    if lens:
        lines += [
            "  c, x0, y0: corrections of the camera's; c > 0 makes it longer; k1 to b2: the value",
            "  is the effect at the image's edge, the coefficient that of Brown's formula",
        ]
    found = block.parameter_correlations()
    if found:
        lines.append("  correlated beyond 0.9:")
        lines += [
            f"    {plain(first)} with {plain(second)}: {rho:.3f}"
            for first, second, rho in found[:_MOST]
        ]
    return [*lines, ""]


def _points(block: AdjustedBlock) -> list[str]:
    rows = block.point_rows()
    width = _width(row.point for row in rows)
    lines = [f"  {'POINT':<{width}}{'X':>15}{'Y':>15}{'Z':>12}{'sX':>9}{'sY':>9}{'sZ':>9}  RAYS"]
    for row in rows:
        x, y, z = row.xyz
        lines.append(
            f"  {plain(row.point):<{width}}{cell(x, 4, 15)}{cell(y, 4, 15)}{cell(z, 4, 12)}"
            + "".join(cell(s, 4, 9) for s in row.s_xyz)
            + column(row.rays, 6)
        )
    return [*lines, ""]


def _rays(block: AdjustedBlock, external: ExternalReliability) -> list[str]:
    rows = list(block.ray_rows())
    photos = _width(row.photo for row in rows)
    points = _width(row.point for row in rows)
    at = _width_at([effect for effects in external.rays for effect in effects])
    lines = [
        f"  {'PHOTO':<{photos}} {'POINT':<{points}}      v [um]   RED-N       w  MDB [um]"
        f"  EFFECT [mm]{_effect_head(at)}"
    ]
    for row, effects in zip(rows, external.rays, strict=True):
        for axis in (0, 1):
            effect = row.effect_m[axis]
            size = None if effect is None else hypot(*effect) * 1e3
            w = row.w[axis]
            flag = w is not None and block.critical is not None and abs(w) > block.critical
            verdict = "<< REMEASURE" if flag else ("not testable" if effect is None else "")
            r: float | None = row.r[axis]
            if row.rejected[axis]:
                verdict, r = "rejected", None
            lines.append(
                (
                    f"  {plain(row.photo):<{photos}} {plain(row.point):<{points}}  "
                    f"{'xy'[axis]}{cell(row.residual[axis], 1, 9)}{cell(r, 3, 8)}{cell(w, 2, 8)}"
                    f"{cell(row.mdb[axis], 1, 10)}{cell(size, 2, 13)}"
                    f"{_effect_cells(effects[axis], at)}  {verdict}"
                ).rstrip()
            )
    return lines


def _legend(block: AdjustedBlock) -> list[str]:
    """Say what the columns of undetected errors mean."""
    lines = [
        "  an error as large as MDB moves the ray's own point by EFFECT, no point farther than AT",
        "  by LARGEST, and no function of the unknowns by more than LENGTH of its deviations",
    ]
    if len(block.problem.photo) > MOST_RAYS:
        lines.append(f"  (LARGEST is not looked for in blocks of more than {MOST_RAYS} rays)")
    return ["", *lines]


def _width_at(effects: Sequence[UndetectedEffect | None]) -> int:
    names = [each.point for each in effects if each is not None and each.point is not None]
    return _width((name for name in names), 2)


def _effect_head(at: int) -> str:
    return f"  LARGEST [mm]  {'AT':<{at}}  LENGTH"


def _effect_cells(found: UndetectedEffect | None, at: int) -> str:
    """Return what an undetected error does: the farthest point, and the standardized length."""
    size = None if found is None or found.effect_m is None else hypot(*found.effect_m) * 1e3
    point = "-" if found is None or found.point is None else plain(found.point)
    length = None if found is None else found.standardized
    return f"{cell(size, 2, 14)}  {point:<{at}}{cell(length, 2, 8)}"
