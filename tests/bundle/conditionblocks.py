"""Small blocks whose points meet conditions, and their dense adjustment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from bundleblocks import aerial
from denseblock import dense

from anaplot.bundle.adjust import adjust_bundle
from anaplot.bundle.solve.additional import additional_parameters
from anaplot.bundle.solve.problem import make_problem
from anaplot.photogrammetry.objectconditions import ObjectCondition


def true_value(scene, kind, points):
    """What a distance or an angle is in the scene."""
    at = [scene.points[name] for name in points]
    if kind == "distance":
        return float(np.linalg.norm(at[1] - at[0]))
    if kind == "angle":
        u, v = at[0] - at[1], at[2] - at[1]
        return float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))
    return None


def condition(scene, kind, points, sigma, *, off=0.0, use="control"):
    names = tuple(points.split())
    value = true_value(scene, kind, names)
    return ObjectCondition(kind, names, None if value is None else value + off, sigma, use)


def flat_scene(**options):
    """An aerial block on flat ground: p1 ... p16 on a 4 x 4 grid, control in six of them."""
    return aerial(2, 4, relief=0.0, **{"noise_um": 5.0, "control_sigma": 0.05, **options})


def every_kind(scene, firm=()):
    """Conditions of all kinds, free of error where their number is in `firm`."""
    wanted = [
        ("distance", "p2 p7", 0.02),
        ("line", "p5 p6 p7 p8", 0.05),
        ("plane", "p1 p6 p10 p11 p15", 0.08),
        ("angle", "p2 p6 p9", 1e-4),
        ("equal", "p5 p9 p6 p10 p10 p11", 0.05),
        ("distance", "p9 p14", 0.03),
    ]
    return tuple(
        condition(scene, kind, points, 0.0 if k in firm else sigma)
        for k, (kind, points, sigma) in enumerate(wanted)
    )


def with_conditions(scene, conditions, additional=None, datum="control"):
    block = replace(scene.block, conditions=tuple(conditions))
    chosen = None if additional is None else additional_parameters(*additional)
    problem = make_problem(block, datum=datum, additional=chosen)
    rng = np.random.default_rng(2)
    return adjust_bundle(problem, scene.start(problem, rng, 0.5, 0.0005))


def dense_conditions(block):
    """Own equations of the conditions: rows (n, u), shared parameters (n, k), sigmas, firm rows.

    Written down anew, with the parameters of lines, planes and lengths as unknowns.
    """
    problem, at = block.problem, block.state.points
    of = problem.conditions
    n, d = len(problem.photos), problem.per_photo
    u = n * d + 3 * len(problem.points) + problem.in_border
    rows, shared = [], []
    for one, points in zip(of.conditions, of.points, strict=True):
        places = at[points]
        own = []
        if one.kind in ("distance", "equal"):
            for k in range(0, len(points), 2):
                along = places[k + 1] - places[k]
                along = along / np.linalg.norm(along)
                own.append(({k: -along, k + 1: along}, [1.0] if one.kind == "equal" else []))
        elif one.kind == "angle":
            row = {}
            for k in range(3):
                row[k] = np.zeros(3)
                for axis in range(3):
                    # the angle from the cosine rule, by complex steps
                    moved = places.astype(complex)
                    moved[k, axis] += 1e-30j
                    a, b, c = (
                        np.sqrt(((moved[i] - moved[j]) ** 2).sum())
                        for i, j in ((0, 1), (1, 2), (0, 2))
                    )
                    cosine = (a * a + b * b - c * c) / (2 * a * b)
                    row[k][axis] = -cosine.imag / np.sqrt(1 - cosine.real**2) / 1e-30
            own.append((row, []))
        else:
            middle = places.mean(axis=0)
            values, axes = np.linalg.eigh(np.cov((places - middle).T))
            assert values[0] <= values[1] <= values[2]
            if one.kind == "plane":
                own = [
                    ({k: axes[:, 0]}, [1.0, *((p - middle) @ axes[:, 1:]).tolist()])
                    for k, p in enumerate(places)
                ]
            else:
                along = axes[:, 2]
                across = np.cross(along, (0.0, 0.0, 1.0))
                across /= np.linalg.norm(across)
                up = np.cross(across, along)
                for k, p in enumerate(places):
                    t = float((p - middle) @ along)
                    own += [({k: across}, [1.0, t, 0.0, 0.0]), ({k: up}, [0.0, 0.0, 1.0, t])]
        part = np.zeros((len(own), u))
        for row, (derivatives, _) in enumerate(own):
            for k, values in derivatives.items():
                start = n * d + 3 * points[k]
                part[row, start : start + 3] = np.where(problem.fixed[points[k]], 0.0, values)
        rows.append(part)
        shared.append(np.array([list(parameters) for _, parameters in own]))
    wide = np.zeros((sum(len(r) for r in rows), sum(s.shape[1] for s in shared)))
    row = column = 0
    for part in shared:
        wide[row : row + len(part), column : column + part.shape[1]] = part
        row, column = row + len(part), column + part.shape[1]
    sigma = np.array([one.sigma for one in of.conditions])[of.of_row]
    return np.vstack(rows), wide, sigma, sigma == 0.0


def dense_adjustment(block):
    """Design, cofactors of all unknowns (shared parameters last) and step, firm rows by KKT."""
    design, free = dense(block)
    rows, shared, sigma, firm = dense_conditions(block)
    u, k = design.shape[1], shared.shape[1]
    both = np.hstack((rows, shared))
    white = np.vstack((
        np.hstack((design, np.zeros((len(design), k)))),
        both[~firm] / sigma[~firm, None],
    ))  # fmt: skip
    kept = np.concatenate((free, np.ones(k, dtype=bool)))
    scale = np.linalg.norm(np.vstack((white, both[firm])), axis=0)[kept]
    normal = (white[:, kept] / scale).T @ (white[:, kept] / scale)
    held = both[firm][:, kept] / scale
    held = held / np.linalg.norm(held, axis=1, keepdims=True)
    m = len(held)
    big = np.block([[normal, held.T], [held, np.zeros((m, m))]])
    inverse = np.linalg.inv(big)[: len(scale), : len(scale)] / scale[:, None] / scale
    out = np.zeros((u + k, u + k))
    out[np.ix_(kept, kept)] = inverse
    return white, both, out
