"""A tilted block as the files of other programs, written by their documents."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from tiltedblock import CX, CY, FX, FY, HEIGHT, K1, K2, P1, P2, WIDTH, TiltedBlock

AXES = {"Right": (1, 0), "Left": (-1, 0), "Down": (0, 1), "Up": (0, -1)}
ORIENTATIONS = [
    f"X{x}Y{y}" for x, y in itertools.permutations(AXES, 2) if np.dot(AXES[x], AXES[y]) == 0
]


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return w, x, y, z by the eigenvector of a symmetric matrix (Bar-Itzhack)."""
    r = rotation
    matrix = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    values, vectors = np.linalg.eigh((matrix + np.tril(matrix, -1).T) / 3)
    x, y, z, w = vectors[:, np.argmax(values)]
    return np.array([w, x, y, z])


def colmap_model(scene: TiltedBlock, folder: Path) -> Path:
    """Write a text model; a blank in a name, as COLMAP cannot hold one, becomes a line below."""
    folder.mkdir()
    (folder / "cameras.txt").write_text(
        f"# cameras\n1 OPENCV {WIDTH} {HEIGHT} {FX} {FY} {CX} {CY} {K1} {K2} {P1} {P2}\n"
    )
    images = []
    tracks: dict[int, list[str]] = {}
    for k, name in enumerate(scene.names):
        rotation, centre = scene.rotations[k], scene.centres[k]
        mine = [row for row in scene.pixels if row[0] == k]
        pose = [*quaternion(rotation), *(-rotation @ centre)]
        numbers = " ".join(repr(float(v)) for v in pose)
        images.append(f"{k + 1} {numbers} 1 {name.replace(' ', '_')}")
        images.append(" ".join(f"{x!r} {y!r} {j + 1}" for _, j, x, y in mine))
        for at, (_, j, _, _) in enumerate(mine):
            tracks.setdefault(j, []).append(f"{k + 1} {at}")
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    points = [
        f"{j + 1} {' '.join(repr(float(v)) for v in scene.points[j])} 1 2 3 0.5 {' '.join(track)}"
        for j, track in tracks.items()
    ]
    (folder / "points3D.txt").write_text("\n".join(points) + "\n")
    return folder


def pixel_table(scene: TiltedBlock, file: Path) -> Path:
    """Write a table with other titles, counted from the lower left."""
    rows = [f"{scene.names[k]}\t{j + 1}\t{x!r}\t{HEIGHT - y!r}" for k, j, x, y in scene.pixels]
    file.write_text("Image\tTarget\tu\tv\n" + "\n".join(rows) + "\n")
    return file


def blocks_exchange(
    scene: TiltedBlock,
    file: Path,
    *,
    orientation: str = "XRightYDown",
    angles: bool = False,
    mm: bool = False,
    system: str = "",
    control: str = "",
    poses: bool = True,
) -> Path:
    """Write BlocksExchange; the pixel is 2.5 um where `mm` says so.

    In mm everything counts from the principal point, along the axes of the orientation.
    """
    x_word, y_word = orientation[1:].split("Y")
    axes = np.array([AXES[x_word], AXES[y_word]]).T.astype(float)  # in x right, y down
    turn = np.eye(3)
    turn[:2, :2] = axes
    turn[2, 2] = np.linalg.det(axes)
    pixel = 0.0025
    if mm:
        off = (axes.T @ (CX - WIDTH / 2, CY - HEIGHT / 2) * pixel).tolist()
        principal = f"<xmm>{off[0]!r}</xmm><ymm>{off[1]!r}</ymm>"
        focal = (
            f"<FocalLength>{FX * pixel!r}</FocalLength><SensorSize>{WIDTH * pixel!r}</SensorSize>"
        )
    else:
        principal = f"<x>{CX - 0.5!r}</x><y>{CY - 0.5!r}</y>"
        focal = f"<FocalLengthPixels>{FX!r}</FocalLengthPixels>"

    def place(x: float, y: float) -> str:
        if not mm:
            return f"<x>{x - 0.5!r}</x><y>{y - 0.5!r}</y>"
        a, b = axes.T @ (x - CX, y - CY) * pixel
        return f"<xmm>{float(a)!r}</xmm><ymm>{float(b)!r}</ymm>"

    photos = []
    for k, name in enumerate(scene.names):
        # the axes of the orientation, seen in the world
        matrix = turn.T @ scene.rotations[k]
        if angles:
            turned = matrix.T
            phi = np.arcsin(turned[0, 2])
            omega = np.arctan2(-turned[1, 2], turned[2, 2])
            kappa = np.arctan2(-turned[0, 1], turned[0, 0])
            rotation = "".join(
                f"<{key}>{float(np.degrees(v))!r}</{key}>"
                for key, v in (("Omega", omega), ("Phi", phi), ("Kappa", kappa))
            )
        else:
            rotation = "".join(
                f"<M_{i}{j}>{float(matrix[i, j])!r}</M_{i}{j}>" for i in range(3) for j in range(3)
            )
        x, y, z = scene.centres[k].tolist()
        pose = (
            f"<Pose><Rotation>{rotation}<Accurate>true</Accurate></Rotation>"
            f"<Center><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></Center></Pose>"
        )
        photos.append(
            f"<Photo><Id>{10 * k + 3}</Id><ImagePath>{name}</ImagePath>{pose * poses}</Photo>\n"
        )
    ties = []
    for j in range(len(scene.points)):
        rows = "".join(
            f"<Measurement><PhotoId>{10 * k + 3}</PhotoId>{place(x, y)}</Measurement>"
            for k, i, x, y in scene.pixels
            if i == j
        )
        ties.append(f"<TiePoint>{rows}</TiePoint>\n")
    srs = (
        f"<SpatialReferenceSystems><SRS><Id>4</Id><Name>s</Name><Definition>{system}</Definition>"
        "</SRS></SpatialReferenceSystems>"
    )
    file.write_text(
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f'<BlocksExchange version="3.2">{srs if system else ""}<Block><Name>A &amp; B</Name>'
        f"{'<SRSId>4</SRSId>' if system else ''}<Photogroups><Photogroup><Name>fc</Name>"
        f"<ImageDimensions><Width>{WIDTH}</Width><Height>{HEIGHT}</Height></ImageDimensions>"
        f"<CameraModelType>Perspective</CameraModelType>{focal}"
        f"<CameraOrientation>{orientation}</CameraOrientation>"
        f"<PrincipalPoint>{principal}</PrincipalPoint>\n"
        f"<Distortion><K1>{K1}</K1><K2>{K2}</K2><P1>{P2}</P1><P2>{P1}</P2></Distortion>"
        f"<AspectRatio>{FY / FX!r}</AspectRatio><Skew>0</Skew>\n"
        f"{''.join(photos)}</Photogroup></Photogroups>\n{control}\n"
        f"<TiePoints>{''.join(ties)}</TiePoints></Block></BlocksExchange>\n"
    )
    return file
