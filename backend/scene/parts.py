"""What the actuator is made of: each part's meshes and colours, in metres."""

import math
from typing import Any, Protocol

import numpy as np

from backend.scene import layout
from backend.scene.shapes import Mesh, disc, helix, joined, plate, rounded, sector, tube, turned

PLATE = (196, 202, 211)
DARK = (74, 82, 95)
STEEL = (205, 210, 218)
MOTOR = (58, 64, 75)
SPRING = (142, 150, 163)
BRASS = (190, 164, 108)
SIDE_COLOURS = {"A": (0, 158, 115), "B": (204, 121, 167)}
"""Hues of F_A and F_B in the charts."""
WALL, PRESSED = (110, 116, 126), (213, 94, 0)
"""A wall by itself, and one that is pressed on: in the hue of a push."""
REFERENCE = (0, 114, 178)
"""Hue of q in the charts; its reference is the ghost."""

TOUCH = (140, 148, 158)
"""Hue of F_ext in the charts."""


class Add(Protocol):
    """Puts a mesh on the stage."""

    def __call__(
        self,
        name: str,
        mesh: Mesh,
        colour: tuple[int, int, int],
        opacity: float | None = None,
    ) -> Any:
        """Add ``mesh`` under ``name``."""
        ...


def fixed(add: Add, r_j: float) -> None:
    """Add what does not move: base plate, bearing, spring brackets, slide rails."""
    y = layout.PLATE_Y
    outline = rounded(layout.PLATE_WIDTH, layout.PLATE_BOTTOM, layout.PLATE_TOP, 0.018)
    add("/base", plate(outline, y, y + 0.008), PLATE)
    add("/bearing", disc(0.026, 0.008, y, chamfer=0.002), DARK)
    for name, x in (("A", -r_j), ("B", r_j)):
        ring = disc(0.024, -0.003, 0.003, bore=0.004, chamfer=0.0008)
        seat = Mesh(ring.vertices[:, [0, 2, 1]], ring.faces).moved(x=x, z=layout.BRACKET_Z)
        arm = plate([(-0.007, -0.003), (0.007, -0.003), (0.007, 0.003), (-0.007, 0.003)], 0.018, y)
        add(f"/bracket_{name}", joined(seat, arm.moved(x=x, z=layout.BRACKET_Z)), SIDE_COLOURS[name])
        rail = rounded(0.010, layout.PLATE_BOTTOM + 0.012, layout.BRACKET_Z - 0.016, 0.004)
        add(f"/rail_{name}", plate([(x + px, pz) for px, pz in rail], y - 0.004, y), DARK)


def joint(add: Add, parent: str, r_j: float) -> None:
    """Add the pulley and the link that turn with q."""
    half = layout.PULLEY_WIDTH / 2.0
    rim = turned(
        [
            (r_j - 0.009, -half),
            (r_j + 0.003, -half),
            (r_j + 0.003, -half + 0.003),
            (r_j - layout.TENDON_RADIUS, -0.003),
            (r_j - layout.TENDON_RADIUS, 0.003),
            (r_j + 0.003, half - 0.003),
            (r_j + 0.003, half),
            (r_j - 0.009, half),
            (r_j - 0.009, -half),
        ],
        sections=96,
    )
    web = disc(r_j - 0.008, -0.003, 0.003, bore=0.012, sections=96)
    add(f"{parent}/rim", rim, DARK)
    add(f"{parent}/web", web, (120, 129, 143))
    add(f"{parent}/hub", disc(0.019, layout.LINK_FRONT - 0.004, 0.012, chamfer=0.0015), STEEL)
    add(f"{parent}/link", _bar(layout.LINK_WIDTH, layout.LINK_FRONT, 0.007), STEEL)
    add(f"{parent}/stripe", _bar(0.007, layout.LINK_FRONT - 0.0006, 0.0012), REFERENCE)
    tip = disc(0.0075, layout.LINK_FRONT - 0.003, layout.LINK_FRONT + 0.009, chamfer=0.001)
    add(f"{parent}/tip", tip.moved(z=layout.LINK_LENGTH), DARK)
    for index, angle in enumerate(np.radians([60.0, 120.0, 180.0, 240.0, 300.0])):
        hole = disc(0.009, -0.0036, 0.0036, sections=32)
        r = 0.6 * r_j
        add(f"{parent}/hole_{index}", hole.moved(x=r * math.sin(angle), z=r * math.cos(angle)), DARK)


def ghost(add: Add, parent: str) -> None:
    """Add the see-through link that stands at the reference."""
    add(f"{parent}/link", _bar(layout.LINK_WIDTH + 0.006, layout.LINK_FRONT + 0.008, 0.004), REFERENCE, 0.30)


def wall(add: Add, parent: str, side: float) -> Any:
    """Add a wall whose face stands where the link's flank is at the parent's angle; ``side`` 1 above it, -1 below."""
    x = -side * (layout.LINK_WIDTH / 2.0 + layout.WALL_THICKNESS / 2.0)
    outline = rounded(layout.WALL_THICKNESS, 0.55 * layout.LINK_LENGTH, 1.08 * layout.LINK_LENGTH, 0.002)
    return add(parent, plate(outline, layout.LINK_FRONT - 0.006, 0.012).moved(x=x), WALL)


def carriage(add: Add, parent: str, name: str, reel_offset: float) -> None:
    """Add the motor on its carriage; the origin is the lower seat of the spring."""
    ring = disc(0.024, -0.002, 0.002, bore=0.004, chamfer=0.0008)
    seat = Mesh(ring.vertices[:, [0, 2, 1]], ring.faces).moved(z=-0.002)
    slide = plate(rounded(0.034, -0.047, -0.001, 0.004), 0.016, layout.PLATE_Y - 0.004)
    add(f"{parent}/seat", joined(seat, slide), DARK)
    gearbox = disc(0.017, 0.009, 0.018, chamfer=0.001).moved(x=-reel_offset, z=-layout.CARRIAGE_DROP)
    add(f"{parent}/gearbox", gearbox, STEEL)
    motor = disc(0.019, layout.PLATE_Y + 0.008, layout.PLATE_Y + 0.060, chamfer=0.002)
    add(f"{parent}/motor", motor.moved(x=-reel_offset, z=-layout.CARRIAGE_DROP), MOTOR)
    band = disc(0.0175, 0.0095, 0.012).moved(x=-reel_offset, z=-layout.CARRIAGE_DROP)
    add(f"{parent}/band", band, SIDE_COLOURS[name])


def reel(add: Add, parent: str, r_m: float) -> None:
    """Add a reel that turns with its motor; the mark shows by how much."""
    body = turned(
        [
            (0.0, -0.008),
            (r_m + 0.006, -0.008),
            (r_m + 0.006, -0.005),
            (r_m - layout.TENDON_RADIUS, -0.004),
            (r_m - layout.TENDON_RADIUS, 0.004),
            (r_m + 0.006, 0.005),
            (r_m + 0.006, 0.008),
            (0.0, 0.008),
        ]
    )
    add(f"{parent}/body", body, BRASS)
    add(f"{parent}/mark", disc(0.0022, -0.0086, -0.0078, sections=20).moved(z=r_m + 0.002), MOTOR)


def coil(length: float) -> Mesh:
    """Return a spring of ``length`` [m] that hangs from the origin."""
    return helix(length, layout.SPRING_RADIUS, layout.SPRING_WIRE, layout.SPRING_COILS)


def unit_tendon() -> Mesh:
    """Return a straight tendon that hangs from the origin, 1 m long, to be scaled to its length."""
    return tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), layout.TENDON_RADIUS)


def loose_tendon(sign: float, sag: float) -> Mesh:
    """Return a tendon longer by ``sag`` [m] than from pulley to bracket: half a sine of that arc length, outwards."""
    width = 2.0 / math.pi * math.sqrt(-layout.BRACKET_Z * min(sag, 0.05))
    s = np.linspace(0.0, 1.0, 25)
    path = np.stack([sign * width * np.sin(np.pi * s), np.zeros_like(s), layout.BRACKET_Z * s], 1)
    return tube(path, layout.TENDON_RADIUS)


def fan(half_angle: float) -> Mesh:
    """Return the fan of compliance about the link: ± ``half_angle`` [rad]."""
    return sector(0.082, layout.LINK_LENGTH, half_angle, layout.LINK_FRONT + 0.016)


def _bar(width: float, y_front: float, thickness: float) -> Mesh:
    outline = rounded(width, -width / 2.0, layout.LINK_LENGTH + width / 2.0, width / 2.0 - 1e-6, steps=16)
    return plate(outline, y_front, y_front + thickness)
