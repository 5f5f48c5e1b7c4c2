"""Blocks whose positions and angles are measured in flight, and their adjustment without us."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from bundleblocks import Scene, aerial

from anaplot.photogrammetry.prioroffsets import PriorOffsets
from anaplot.photogrammetry.rotation import rotation_angles, rotation_matrix

LEVER = (0.35, -0.6, 1.8)
BORESIGHT = (0.01, -0.015, 0.02)
_HIGHER = np.array([1.0, 1.0, 1.5])  # heights are worse than the plan
_ROUND = np.array([1.0, 1.0, 2.0])  # and headings than the rest


@dataclass
class Flown:
    """A scene with the offsets it was made with: (kind, group, axis) to value."""

    scene: Scene
    offsets: dict


def flown(
    offsets: PriorOffsets,
    *,
    seed=0,
    noise=1.0,
    position=0.05,
    rotation=2e-4,
    lever=LEVER,
    timed=True,
    far=(0.0, 0.0, 0.0),
    angles=True,
    drift=((0.01, -0.02, 0.015), (0.01, -0.01, 0.015)),
    **options,
) -> Flown:
    """Fly a block there and back, with GNSS (and IMU) errors of `noise` standard deviations."""
    rng = np.random.default_rng(seed + 77)
    scene = aerial(
        turned=True, tilt=0.05, control_sigma=0.02, noise_um=5.0 * noise, seed=seed, **options
    )
    block = scene.block
    strip_of = {name: strip.id for strip in block.strips for name in strip.photos}
    time = {}
    for k, strip in enumerate(block.strips):
        for i, name in enumerate(strip.photos):
            time[name] = 345_600.0 + 400.0 * k + 9.0 * i + 0.3 * (i % 2)
    truth = {}
    groups = [strip.id for strip in block.strips]
    for k, name in enumerate(groups if offsets.shift == "strip" else ["block"]):
        if offsets.shift:
            for axis, value in zip("XYZ", (0.4 - k, -0.7 + 0.5 * k, 1.1), strict=True):
                truth["shift", name, axis] = value
    for k, name in enumerate(groups if offsets.drift == "strip" else ["block"]):
        if offsets.drift:
            for axis, value in zip("XYZ", drift[k], strict=True):
                truth["drift", name, axis] = value
    boresight = np.array(BORESIGHT) if offsets.boresight else np.zeros(3)
    if offsets.boresight:
        group = "block" if offsets.boresight == "block" else "cam"
        for axis, value in zip(("omega", "phi", "kappa"), boresight.tolist(), strict=True):
            truth["boresight", group, axis] = value
    middle = {
        group: np.mean([t for name, t in time.items() if group in ("block", strip_of[name])])
        for group in (*groups, "block")
    }
    photos = []
    for photo in block.photos:
        turned = scene.rotations[photo.id]
        at = scene.centres[photo.id] + turned @ np.array(lever) + np.array(far)
        for (kind, group, axis), value in truth.items():
            if kind == "boresight" or group not in ("block", strip_of[photo.id]):
                continue
            since = time[photo.id] - middle[group] if kind == "drift" else 1.0
            at["XYZ".index(axis)] += value * since
        at = at + rng.normal(size=3) * (position * _HIGHER) * noise
        seen = rotation_angles(turned @ rotation_matrix(*boresight))
        seen = np.array(seen) + rng.normal(size=3) * (rotation * _ROUND) * noise
        photos.append(
            replace(
                photo,
                position=tuple(at.tolist()),
                position_sigma=tuple((position * _HIGHER).tolist()),
                rotation=tuple(seen.tolist()) if angles else None,
                rotation_sigma=tuple((rotation * _ROUND).tolist()) if angles else None,
                time=time[photo.id] if timed else None,
            )
        )
    control = tuple(
        replace(
            row,
            xyz=tuple(
                v + f + rng.normal() * s * noise
                for v, f, s in zip(row.xyz, far, row.sigma, strict=True)
            ),
        )
        for row in block.control
    )
    scene.block = replace(
        block,
        photos=tuple(photos),
        control=control,
        cameras=tuple(replace(c, lever_arm=tuple(lever)) for c in block.cameras),
        offsets=offsets,
    )
    scene.centres = {k: v + np.array(far) for k, v in scene.centres.items()}
    scene.points = {k: v + np.array(far) for k, v in scene.points.items()}
    return Flown(scene, truth)


def _turn(angles):
    """R1(omega) R2(phi) R3(kappa), also of complex angles."""
    (so, sp, sk), (co, cp, ck) = np.sin(angles), np.cos(angles)
    one, nil = 1.0 + 0.0 * so, 0.0 * so
    r1 = np.array([[one, nil, nil], [nil, co, -so], [nil, so, co]])
    r2 = np.array([[cp, nil, sp], [nil, one, nil], [-sp, nil, cp]])
    r3 = np.array([[ck, -sk, nil], [sk, ck, nil], [nil, nil, one]])
    return r1 @ r2 @ r3


class Dense:
    """All observations of a block against all its unknowns, with no part of the program in it.

    Unknowns: centres and angles of the photos, points, offsets; derivatives by complex steps.
    """

    def __init__(self, block, names, origin):
        """Names: photos, points and offsets (kind, group, axis) in the order of the unknowns."""
        self.block, (self.photos, self.points, self.offsets) = block, names
        self.origin = np.asarray(origin)
        self.n, self.p = len(self.photos), len(self.points)
        strip_of = {name: strip.id for strip in block.strips for name in strip.photos}
        declared = {photo.id: photo for photo in block.photos}
        self.stated = [declared[name] for name in self.photos]
        self.groups = [{"block", strip_of.get(photo.id), photo.camera} for photo in self.stated]
        order = [name for strip in block.strips for name in strip.photos]
        clock = [
            order.index(photo.id) if photo.time is None else photo.time for photo in self.stated
        ]
        self.since = {}
        for _, group, _ in self.offsets:
            mine = [t for t, g in zip(clock, self.groups, strict=True) if group in g]
            self.since[group] = [t - np.mean(mine) for t in clock]
        self.known = {row.point: row for row in block.control if row.use == "control"}
        self.prior = {
            "shift": block.offsets.shift_sigma,
            "drift": block.offsets.drift_sigma,
            "boresight": block.offsets.boresight_sigma,
        }

    def of(self, kind, photo, y):
        out = np.zeros(3, dtype=complex)
        axes = ("omega", "phi", "kappa") if kind == "boresight" else ("X", "Y", "Z")
        for (name, group, axis), value in zip(self.offsets, y, strict=True):
            if name == kind and group in self.groups[photo]:
                size = self.since[group][photo] if kind == "drift" else 1.0
                out[axes.index(axis)] += value * size
        return out

    def residuals(self, x):
        """Computed minus observed in a-priori sigmas: rays, control, photos, offsets."""
        n, p, block = self.n, self.p, self.block
        centres, angles = x[: 3 * n].reshape(n, 3), x[3 * n : 6 * n].reshape(n, 3)
        points, y = x[6 * n : 6 * n + 3 * p].reshape(p, 3), x[6 * n + 3 * p :]
        turns = [_turn(a) for a in angles]
        photo = {name: k for k, name in enumerate(self.photos)}
        point = {name: k for k, name in enumerate(self.points)}
        sigma = block.precision.image_um * 1e-3
        out = []
        for row in block.image_points:
            k = photo[row.photo]
            u, v, w = turns[k].T @ (points[point[row.point]] - centres[k])
            c = block.cameras[0].c
            out += [(-c * u / w - row.x) / sigma, (-c * v / w - row.y) / sigma]
        for name in self.points:
            if name in self.known:
                row = self.known[name]
                given = np.array(row.xyz) - self.origin
                out += ((points[point[name]] - given) / np.array(row.sigma)).tolist()
        for k, one in enumerate(self.stated):
            arm = np.array(block.cameras[0].lever_arm)
            at = centres[k] + turns[k] @ arm + self.of("shift", k, y) + self.of("drift", k, y)
            given = np.array(one.position) - self.origin
            out += ((at - given) / np.array(one.position_sigma)).tolist()
            if one.rotation is None:
                continue
            seen = turns[k] @ _turn(self.of("boresight", k, y))
            off = []
            for top, bottom, is_ in (
                (-seen[1, 2], seen[2, 2], one.rotation[0]),
                (-seen[0, 1], seen[0, 0], one.rotation[2]),
            ):
                co, si = np.cos(is_), np.sin(is_)
                off.append(np.arctan((top * co - bottom * si) / (bottom * co + top * si)))
            off.insert(1, np.arcsin(seen[0, 2]) - one.rotation[1])
            out += (np.array(off) / np.array(one.rotation_sigma)).tolist()
        for (kind, _, axis), value in zip(self.offsets, y, strict=True):
            if self.prior[kind] is not None:
                axes = ("omega", "phi", "kappa") if kind == "boresight" else ("X", "Y", "Z")
                out.append(value / self.prior[kind][axes.index(axis)])
        return np.array(out)

    def jacobian(self, x):
        """Derivatives of `residuals`, exact to rounding."""
        columns = []
        for k in range(len(x)):
            step = x.astype(complex)
            step[k] += 1e-30j
            columns.append(self.residuals(step).imag / 1e-30)
        return np.array(columns).T

    def solve(self, x):
        """Return the minimum near x, its residuals and the Jacobian there."""
        for _ in range(12):
            e, j = self.residuals(x.astype(complex)).real, self.jacobian(x)
            size = np.linalg.norm(j, axis=0)
            step = np.linalg.lstsq(j / size, -e, rcond=None)[0] / size
            x = x + step
            if np.abs(step * size).max() < 1e-9:
                break
        return x, self.residuals(x.astype(complex)).real, self.jacobian(x)
