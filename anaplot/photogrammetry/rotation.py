"""Rotations R = R1(omega) R2(phi) R3(kappa), right-handed, image to object (conventions)."""

from __future__ import annotations

from math import asin, atan2, cos, hypot, pi, sin

import numpy as np

from anaplot.aliases import Array

__all__ = [
    "angle_derivatives",
    "axis_angle",
    "is_rotation",
    "rotation_angles",
    "rotation_axes",
    "rotation_matrix",
    "turn",
    "wrapped",
]


def rotation_matrix(omega: float, phi: float, kappa: float) -> Array:
    """Return the (3, 3) rotation from image to object system.

    Parameters
    ----------
    omega, phi, kappa
        Angles [rad].
    """
    so, co = sin(omega), cos(omega)
    sp, cp = sin(phi), cos(phi)
    sk, ck = sin(kappa), cos(kappa)
    return np.array(
        [
            [cp * ck, -cp * sk, sp],
            [co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp],
            [so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp],
        ]
    )


def rotation_angles(rotation: Array) -> tuple[float, float, float]:
    """Return omega, phi, kappa [rad] of a (3, 3) rotation; omega and kappa in (-pi, pi].

    At phi = +-90 degrees, where omega and kappa cannot be told apart, omega is 0.
    """
    (r00, r01, r02), (r10, r11, r12), (_, _, r22) = rotation.tolist()
    cos_phi = hypot(r00, r01)
    phi = atan2(r02, cos_phi) if abs(r02) < 1.0 else asin(max(-1.0, min(1.0, r02)))
    if cos_phi < 1e-12:
        return 0.0, phi, _wrapped(atan2(r10, r11))
    return _wrapped(atan2(-r12, r22)), phi, _wrapped(atan2(-r01, r00))


def is_rotation(matrix: Array, within: float = 1e-3) -> bool:
    """Return whether a (3, 3) matrix of any numbers is a rotation.

    Parameters
    ----------
    matrix
        The matrix.
    within
        What elements of its product with its transpose may be off.
    """
    with np.errstate(all="ignore"):
        off = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
        return off <= within and bool(np.linalg.det(matrix) > 0.0)


def _wrapped(angle: float) -> float:
    return pi if angle == -pi else angle


def rotation_axes(omega: float, phi: float) -> Array:
    """Return (3, 3): columns are the object-space axes of d omega, d phi and d kappa.

    dR = [axis x] R d angle for each of the three angles.
    """
    so, co = sin(omega), cos(omega)
    sp, cp = sin(phi), cos(phi)
    return np.array((1.0, 0.0, sp, 0.0, co, -so * cp, 0.0, so, co * cp)).reshape(3, 3)


def angle_derivatives(rotation: Array) -> Array:
    """Return (3, 3): derivatives of omega, phi, kappa (rows) by small rotations about X, Y, Z.

    The inverse of `rotation_axes`; at phi = +-90 degrees that of what is left of it.
    """
    omega, phi, _ = rotation_angles(rotation)
    return np.asarray(np.linalg.pinv(rotation_axes(omega, phi), rcond=1e-9), dtype=np.float64)


def wrapped(angles: Array) -> Array:
    """Return angles [rad] in [-pi, pi): how far they are apart where they are differences."""
    return (angles + pi) % (2.0 * pi) - pi


def turn(x: float, y: float, z: float) -> Array:
    """Return the (3, 3) rotation about the vector (x, y, z) by its length [rad] (Rodrigues)."""
    angle = hypot(x, y, z)
    if angle < 1e-6:
        # second order: the angle is so small that sin(t)/t = 1 - t^2/6 to the last digit
        s, k = 1.0 - angle * angle / 6.0, 0.5
    else:
        s, k = sin(angle) / angle, (1.0 - cos(angle)) / (angle * angle)
    c = 1.0 - k * angle * angle
    kx, ky, sx, sy, sz = k * x, k * y, s * x, s * y, s * z
    xy, xz, yz = kx * y, kx * z, ky * z
    xx, yy, zz = c + kx * x, c + ky * y, c + k * z * z
    # of nine numbers rather than of three lists of three, which takes half as long again
    nine = (xx, xy - sz, xz + sy, xy + sz, yy, yz - sx, xz - sy, yz + sx, zz)
    return np.array(nine).reshape(3, 3)


def axis_angle(rotation: Array) -> tuple[float, float, float]:
    """Return the vector of which `turn` makes a (3, 3) rotation; its length is at most pi."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    # four times the products of the quaternion (w, x, y, z): the largest row is well determined
    rows = np.array(
        [
            [1.0 + a + e + i, h - f, c - g, d - b],
            [h - f, 1.0 + a - e - i, b + d, c + g],
            [c - g, b + d, 1.0 - a + e - i, f + h],
            [d - b, c + g, f + h, 1.0 - a - e + i],
        ]
    )
    row = rows[int(np.argmax(np.diag(rows)))]
    w, x, y, z = (row / np.linalg.norm(row) * (-1.0 if row[0] < 0.0 else 1.0)).tolist()
    sine = hypot(x, y, z)
    scale = 2.0 if sine < 1e-12 else 2.0 * atan2(sine, w) / sine
    return scale * x, scale * y, scale * z
