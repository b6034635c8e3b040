"""Triangle meshes of the parts, as plain arrays: turned bodies, tubes along a path, flat plates.

Faces that meet at an edge share no vertices, so that the renderer shades edges sharp and turned surfaces smooth. All
are drawn from both sides, so the sense of a face does not matter.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]


class Mesh(NamedTuple):
    """``vertices`` (n, 3) in metres, ``faces`` (m, 3) indices into them."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Mesh":
        """Return the mesh shifted by (x, y, z) [m]."""
        return Mesh(self.vertices + np.array([x, y, z]), self.faces)


def joined(*meshes: Mesh) -> Mesh:
    """Return one mesh of several."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets[:-1], strict=True)]),
    )


def turned(profile: Sequence[Point], sections: int = 48) -> Mesh:
    """Return a body turned about the y axis; ``profile`` lists (radius, y)."""
    angles = np.linspace(0.0, 2.0 * np.pi, sections, endpoint=False)
    cos, sin = np.cos(angles), np.sin(angles)
    rings = np.arange(sections)
    after = (rings + 1) % sections
    faces = np.concatenate(
        [np.stack([rings, after, after + sections], 1), np.stack([rings, after + sections, rings + sections], 1)]
    )
    bands = []
    for (r0, y0), (r1, y1) in pairwise(profile):
        lower = np.stack([r0 * cos, np.full(sections, y0), r0 * sin], 1)
        upper = np.stack([r1 * cos, np.full(sections, y1), r1 * sin], 1)
        bands.append(Mesh(np.concatenate([lower, upper]), faces))
    return joined(*bands)


def disc(
    radius: float, y_from: float, y_to: float, bore: float = 0.0, chamfer: float = 0.0, sections: int = 48
) -> Mesh:
    """Return a cylinder about the y axis, with chamfered rims and a bore."""
    c = chamfer
    outline = [(bore, y_from), (radius - c, y_from), (radius, y_from + c), (radius, y_to - c), (radius - c, y_to)]
    closing = [(bore, y_to), (bore, y_from)] if bore > 0.0 else [(0.0, y_to)]
    return turned([*outline, *closing], sections)


def tube(path: NDArray[np.float64], radius: float, sides: int = 8) -> Mesh:
    """Return a round tube along ``path`` (n, 3), open at its ends."""
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.cross(tangents, np.array([0.0, 1.0, 0.0]))
    short = np.linalg.norm(across, axis=1) < 1e-6
    across[short] = np.cross(tangents[short], np.array([1.0, 0.0, 0.0]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(tangents, across)
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring = np.cos(angles)[None, :, None] * across[:, None, :] + np.sin(angles)[None, :, None] * other[:, None, :]
    vertices = (path[:, None, :] + radius * ring).reshape(-1, 3)
    side = np.arange(sides)
    after = (side + 1) % sides
    quads = [
        np.concatenate([np.stack([a + side, a + after, b + after], 1), np.stack([a + side, b + after, b + side], 1)])
        for a, b in ((sides * i, sides * (i + 1)) for i in range(len(path) - 1))
    ]
    return Mesh(vertices, np.concatenate(quads))


def helix(length: float, radius: float, wire: float, coils: float, sides: int = 8) -> Mesh:
    """Return a compression spring that hangs from z = 0 to z = -length, with closed coils at both ends."""
    turns = np.linspace(0.0, coils, round(coils * 24) + 1)
    drop = np.interp(turns, [0.0, 1.0, coils - 1.0, coils], [wire, 3.0 * wire, length - 3.0 * wire, length - wire])
    angle = 2.0 * np.pi * turns
    return tube(np.stack([radius * np.cos(angle), radius * np.sin(angle), -drop], 1), wire, sides)


def plate(outline: Sequence[Point], y_front: float, y_back: float) -> Mesh:
    """Return a flat plate with a convex ``outline`` of (x, z)."""
    points = np.array(outline)
    n = len(points)
    front = np.stack([points[:, 0], np.full(n, y_front), points[:, 1]], 1)
    back = np.stack([points[:, 0], np.full(n, y_back), points[:, 1]], 1)
    fan = np.stack([np.zeros(n - 2, dtype=np.int64), np.arange(1, n - 1), np.arange(2, n)], 1)
    i = np.arange(n)
    j = (i + 1) % n
    rim = Mesh(
        np.concatenate([front, back]),
        np.concatenate([np.stack([i, i + n, j + n], 1), np.stack([i, j + n, j], 1)]),
    )
    return joined(Mesh(front, fan), Mesh(back, fan[:, ::-1]), rim)


def rounded(width: float, z_from: float, z_to: float, corner: float, steps: int = 8) -> list[Point]:
    """Return the outline of a rectangle about x = 0 with round corners, for ``plate``."""
    points: list[Point] = []
    half = width / 2.0 - corner
    centres = ((half, z_from + corner, -90.0), (half, z_to - corner, 0.0), (-half, z_to - corner, 90.0))
    for x, z, begin in (*centres, (-half, z_from + corner, 180.0)):
        for angle in np.radians(np.linspace(begin, begin + 90.0, steps)):
            points.append((x + corner * float(np.cos(angle)), z + corner * float(np.sin(angle))))
    return points


def sector(radius_in: float, radius_out: float, half_angle: float, y: float, steps: int = 24) -> Mesh:
    """Return a flat ring sector about the y axis, centred on +z, from -half_angle to +half_angle [rad]."""
    angles = np.linspace(-half_angle, half_angle, steps + 1)
    inner = np.stack([radius_in * np.sin(angles), np.full(steps + 1, y), radius_in * np.cos(angles)], 1)
    outer = np.stack([radius_out * np.sin(angles), np.full(steps + 1, y), radius_out * np.cos(angles)], 1)
    i = np.arange(steps)
    o = i + steps + 1
    return Mesh(
        np.concatenate([inner, outer]), np.concatenate([np.stack([i, i + 1, o + 1], 1), np.stack([i, o + 1, o], 1)])
    )
