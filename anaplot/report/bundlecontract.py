"""The adjusted block as the JSON that other programs read (conventions, "What programs read")."""

from __future__ import annotations

from typing import Any

from anaplot.bundle.errors.suspects import likeliest_suspects
from anaplot.bundle.errors.wrongray import suspect_rays
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.externalreliability import UndetectedEffect, external_reliability
from anaplot.bundle.solve.rows import RayRow

__all__ = ["adjust_json"]

Json = dict[str, Any]


def adjust_json(block: AdjustedBlock) -> Json:
    """Return an adjusted block; what does not exist is None.

    Lengths in metres, angles in radians, residuals and detectable errors in micrometres. Beyond
    the contract: the test, the datum, priors, additional parameters, what is left out, remarks.
    """
    problem = block.problem
    external = external_reliability(block)
    rays = {
        row.row: (row, effects)
        for row, effects in zip(block.ray_rows(), external.rays, strict=True)
    }
    indicators = block.indicators()
    sigma0 = block.sigma0
    out: Json = {
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
        "global_test": _global_test(block),
        "datum": {"kind": problem.datum, "defect": problem.defect},
        "iterations": block.convergence.iterations,
        "photos": [
            {
                "photo": row.photo,
                **dict(zip("XYZ", row.position, strict=True)),
                **dict(zip(("omega", "phi", "kappa"), row.angles, strict=True)),
                **dict(zip(("sX", "sY", "sZ"), row.s_position, strict=True)),
                **dict(zip(("somega", "sphi", "skappa"), row.s_angles, strict=True)),
            }
            for row in block.photo_rows()
        ],
        "points": [
            {
                "point": row.point,
                **dict(zip("XYZ", row.xyz, strict=True)),
                **dict(zip(("sX", "sY", "sZ"), row.s_xyz, strict=True)),
                "rays": row.rays,
            }
            for row in block.point_rows()
        ],
        "image_points": [
            _ray(rays.get(k), row.photo, row.point, row.model)
            for k, row in enumerate(problem.block.image_points)
        ],
        "control": [
            {
                "point": row.point,
                "axis": row.axis,
                "v": row.residual,
                "r": row.r,
                "w": row.w,
                "mdb": row.mdb,
                "effect": _list(row.effect_m),
                **_effect(effect),
                "flagged": row.flagged,
            }
            for row, effect in zip(block.control_rows(), external.control, strict=True)
        ],
        "check": [
            {"point": name, **dict(zip(("dX", "dY", "dZ"), difference, strict=True))}
            for name, difference in block.check_rows()
        ],
        "indicators": {
            "RI_x": indicators.ri_x,
            "RI_y": indicators.ri_y,
            "RI": indicators.ri,
            "AI_X": indicators.ai_x,
            "AI_Y": indicators.ai_y,
            "AI_Z": indicators.ai_z,
            "AI": indicators.ai,
        },
        "priors": [
            {
                "owner": row.owner,
                "unknown": row.unknown,
                "v": row.residual,
                "r": row.r,
                "w": row.w,
                "mdb": row.mdb,
                **_effect(effect),
                "flagged": row.flagged,
            }
            for row, effect in zip(block.prior_rows(), external.priors, strict=True)
        ],
        "spurs": [
            {"photo": photo, "point": point, "axis": axis} for photo, point, axis in block.spurs()
        ],
        "suspects": [
            {
                "point": one.point,
                **one.where._asdict(),
                "w": one.w,
                "r": one.r,
                "partners": [other._asdict() for other in one.partners],
            }
            for one in likeliest_suspects(block)
        ],
        "accused": {
            point: [ray._asdict() for ray in suspect_rays(block, point)]
            for point in dict.fromkeys(point for _, _, point, _ in block.suspects())
        },
        "left_out": [o._asdict() for o in problem.left_out],
        "remarks": list(block.remarks),
    }
    if problem.additional is not None:
        out["additional"] = {
            "set": problem.additional.set.name,
            "scope": problem.additional.scope,
            "parameters": [row._asdict() for row in block.parameter_rows()],
            "correlations": [
                {"first": first, "second": second, "correlation": rho}
                for first, second, rho in block.parameter_correlations()
            ],
        }
    return out


def _ray(
    found: tuple[RayRow, tuple[UndetectedEffect | None, UndetectedEffect | None]] | None,
    photo: str,
    point: str,
    model: str | None,
) -> Json:
    """Return one image point; a row that takes no part has no numbers."""
    out: Json = {"photo": photo, "point": point, "model": model}
    if found is None:
        names = ("vx_um", "vy_um", "rx", "ry", "wx", "wy", "mdb_x_um", "mdb_y_um")
        out |= dict.fromkeys((*names, "effect_x", "effect_y"))
        return out | _effect(None, "_x") | _effect(None, "_y") | {"flagged": False}
    row, effects = found
    return out | {
        "vx_um": row.residual[0],
        "vy_um": row.residual[1],
        "rx": None if row.rejected[0] else row.r[0],
        "ry": None if row.rejected[1] else row.r[1],
        "wx": row.w[0],
        "wy": row.w[1],
        "mdb_x_um": row.mdb[0],
        "mdb_y_um": row.mdb[1],
        "effect_x": _list(row.effect_m[0]),
        "effect_y": _list(row.effect_m[1]),
        **_effect(effects[0], "_x"),
        **_effect(effects[1], "_y"),
        "flagged": row.flagged,
    }


def _effect(found: UndetectedEffect | None, axis: str = "") -> Json:
    """Return the largest effect on a point [m], which point that is, and delta0 sqrt((1-r)/r)."""
    return {
        f"largest_effect{axis}": None if found is None else _list(found.effect_m),
        f"largest_effect_at{axis}": None if found is None else found.point,
        f"standardized_effect{axis}": None if found is None else found.standardized,
    }


def _list(values: tuple[float, float, float] | None) -> list[float] | None:
    return None if values is None else list(values)


def _global_test(block: AdjustedBlock) -> Json | None:
    found = block.global_test()
    if found is None or block.sigma0 is None:
        return None
    return {"alpha": found.alpha, "critical": found.critical, "statistic": block.sigma0**2}
