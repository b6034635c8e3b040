"""Drawn actuator: dimensions, meshes, pose from a sample, and viser nodes."""

import asyncio
import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
import viser
from numpy.typing import NDArray

from backend.sample import NAMES
from backend.scene import messages
from backend.scene.server import PortlessServer, SceneEndedError, Send
from backend.supervision import Part
from plant import Obstacle, PlantParameters, Spring

# Layout --------------------------------------------------------------------------------------------
# Positions of the parts of the drawn actuator in metres; x to the right, z up, the joint axis along y at the origin.
#
# Pulley and reels have their true radii. Each motor is on a carriage that its tendon pulls against the compression
# spring: the spring shortens by x = r_m θ ∓ r_j q, the elongation of equation 1, and is visible at any joint position.


PLATE_Y = 0.030
PLATE_WIDTH = 0.236
PLATE_TOP = 0.052
PLATE_BOTTOM = -0.305

BRACKET_Z = -0.125
"""Upper seat of the springs; the tendons pass through it."""

SEAT = 0.003
"""Half the thickness of a spring's seat."""

SPRING_FREE = 0.094
SPRING_RADIUS = 0.0200
SPRING_WIRE = 0.0021
SPRING_COILS = 7.0

CARRIAGE_DROP = 0.024
"""Distance from the lower spring seat to the axis of the reel."""

PULLEY_WIDTH = 0.016
LINK_LENGTH = 0.185
LINK_WIDTH = 0.030
LINK_FRONT = -0.019
WALL_THICKNESS = 0.014

TENDON_RADIUS = 0.0019
FAN_TORQUE = 2.0
"""Torque that defines the fan of compliance [N·m]: ± torque / S."""


# Pose ----------------------------------------------------------------------------------------------
# Pose of the actuator from a sample: lengths, angles and colours, without drawing.


SOLID_FORCE_N = 50.0
PRESSED_N = 0.05
"""Least force of the obstacle at which the joint is drawn as pressing on it [N]."""

# Dark blue to amber with uniform lightness, distinguishable with every kind of colour vision; red is reserved for
# faults.
_FORCE_COLOURS = ((0.0, (52, 78, 130)), (0.35, (72, 130, 168)), (0.65, (150, 178, 140)), (1.0, (245, 176, 40)))
SLACK_COLOUR = (140, 146, 156)
_COLOUR_STEPS = 40


@dataclass(frozen=True)
class Side:
    """One tendon with its spring and reel.

    ``sag`` is the length of slack tendon [m], 0 while it is taut.
    """

    theta: float
    force_N: float
    spring_length: float
    sag: float
    colour: tuple[int, int, int]

    @property
    def slack(self) -> bool:
        """Whether the tendon is slack."""
        return self.sag > 0.0


@dataclass(frozen=True)
class Pose:
    """Pose of the actuator; angles in rad, lengths in m.

    ``fan`` is ± the angle that 2 N·m deflects, 0 while a tendon is slack because S is then unknown. ``F_ext_hat`` [N]
    is NaN if unknown, as in recordings of earlier versions; ``pressed``: the joint presses on an obstacle.
    """

    q: float
    q_ref: float
    fan: float
    F_push: float
    F_ext_hat: float
    pressed: bool
    A: Side
    B: Side


def pose(sample: dict[str, float], r_m: float, r_j: float, spring_A: Spring, spring_B: Spring) -> Pose:
    """Return the pose for ``sample`` (signals by name).

    Elongations follow equation 1, forces the load cells. Without a reference the ghost is at the joint position.
    """
    x_A = r_m * sample["theta_A"] - r_j * sample["q"]
    x_B = r_m * sample["theta_B"] + r_j * sample["q"]
    A = _side(sample["theta_A"], x_A, sample["F_A"], spring_A)
    B = _side(sample["theta_B"], x_B, sample["F_B"], spring_B)
    return Pose(
        q=sample["q"],
        q_ref=sample["q"] if math.isnan(sample["q_ref"]) else sample["q_ref"],
        fan=0.0 if A.slack or B.slack or math.isnan(sample["S"]) else FAN_TORQUE / max(sample["S"], 1.0),
        F_push=sample["F_push"],
        F_ext_hat=sample.get("F_ext_hat", math.nan),
        pressed=abs(sample.get("F_wall", math.nan)) >= PRESSED_N,
        A=A,
        B=B,
    )


def can_be_drawn(sample: dict[str, float]) -> bool:
    """Return whether all angles are finite; a broken sensor reads NaN."""
    return all(math.isfinite(sample[name]) for name in ("q", "theta_A", "theta_B"))


def force_colour(force_N: float) -> tuple[int, int, int]:
    """Return the colour of a tendon with force ``force_N``, finely quantized."""
    level = round(_COLOUR_STEPS * min(max(force_N / SOLID_FORCE_N, 0.0), 1.0)) / _COLOUR_STEPS
    for (low, begin), (high, end) in pairwise(_FORCE_COLOURS):
        if level <= high:
            part = (level - low) / (high - low)
            red, green, blue = (round(a + part * (b - a)) for a, b in zip(begin, end, strict=True))
            return red, green, blue
    return _FORCE_COLOURS[-1][1]


def _side(theta: float, x: float, force_N: float, spring: Spring) -> Side:
    force_N = 0.0 if math.isnan(force_N) else force_N
    slack = x <= spring.x_slack
    compressed = min(max(x, spring.x_slack), spring.x_solid)
    return Side(
        theta=theta,
        force_N=force_N,
        spring_length=SPRING_FREE - compressed,
        sag=max(spring.x_slack - x, 1e-4) if slack else 0.0,
        colour=SLACK_COLOUR if slack else force_colour(force_N),
    )


# Shapes --------------------------------------------------------------------------------------------
# Triangle meshes of the parts as arrays: bodies of revolution, tubes along a path, flat plates.
#
# Faces that meet at an edge share no vertices, so the renderer shades edges sharp and curved surfaces smooth. All are
# drawn from both sides, so the orientation of a face does not matter.


Point = tuple[float, float]


class Mesh(NamedTuple):
    """A mesh: ``vertices`` (n, 3) [m], and ``faces`` (m, 3) as indices into them."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    def translate(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Mesh":
        """Return the mesh shifted by (x, y, z) [m]."""
        return Mesh(self.vertices + np.array([x, y, z]), self.faces)


def join_meshes(*meshes: Mesh) -> Mesh:
    """Return one mesh of several."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets[:-1], strict=True)]),
    )


def revolve(profile: Sequence[Point], sections: int = 48) -> Mesh:
    """Return a body of revolution about the y axis; ``profile`` lists (radius, y)."""
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
    return join_meshes(*bands)


def disc(
    radius: float, y_from: float, y_to: float, bore: float = 0.0, chamfer: float = 0.0, sections: int = 48
) -> Mesh:
    """Return a cylinder about the y axis, with chamfered rims and a bore."""
    c = chamfer
    outline = [(bore, y_from), (radius - c, y_from), (radius, y_from + c), (radius, y_to - c), (radius - c, y_to)]
    closing = [(bore, y_to), (bore, y_from)] if bore > 0.0 else [(0.0, y_to)]
    return revolve([*outline, *closing], sections)


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
    """Return a compression spring from z = 0 to z = -length, with closed end coils."""
    turns = np.linspace(0.0, coils, round(coils * 24) + 1)
    drop = np.interp(turns, [0.0, 1.0, coils - 1.0, coils], [wire, 3.0 * wire, length - 3.0 * wire, length - wire])
    angle = 2.0 * np.pi * turns
    return tube(np.stack([radius * np.cos(angle), radius * np.sin(angle), -drop], 1), wire, sides)


def plate(outline: Sequence[Point], y_front: float, y_rear: float) -> Mesh:
    """Return a flat plate with a convex ``outline`` of (x, z)."""
    points = np.array(outline)
    n = len(points)
    front = np.stack([points[:, 0], np.full(n, y_front), points[:, 1]], 1)
    rear = np.stack([points[:, 0], np.full(n, y_rear), points[:, 1]], 1)
    fan = np.stack([np.zeros(n - 2, dtype=np.int64), np.arange(1, n - 1), np.arange(2, n)], 1)
    i = np.arange(n)
    j = (i + 1) % n
    rim = Mesh(
        np.concatenate([front, rear]),
        np.concatenate([np.stack([i, i + n, j + n], 1), np.stack([i, j + n, j], 1)]),
    )
    return join_meshes(Mesh(front, fan), Mesh(rear, fan[:, ::-1]), rim)


def round_rectangle(width: float, z_from: float, z_to: float, corner: float, steps: int = 8) -> list[Point]:
    """Return the outline of a rectangle about x = 0 with round corners, for ``plate``."""
    points: list[Point] = []
    half = width / 2.0 - corner
    centres = ((half, z_from + corner, -90.0), (half, z_to - corner, 0.0), (-half, z_to - corner, 90.0))
    for x, z, begin in (*centres, (-half, z_from + corner, 180.0)):
        for angle in np.radians(np.linspace(begin, begin + 90.0, steps)):
            points.append((x + corner * float(np.cos(angle)), z + corner * float(np.sin(angle))))
    return points


def sector(radius_in: float, radius_out: float, half_angle: float, y: float, steps: int = 24) -> Mesh:
    """Return a flat ring sector about the y axis, centred on +z.

    From -half_angle to +half_angle [rad].
    """
    angles = np.linspace(-half_angle, half_angle, steps + 1)
    inner = np.stack([radius_in * np.sin(angles), np.full(steps + 1, y), radius_in * np.cos(angles)], 1)
    outer = np.stack([radius_out * np.sin(angles), np.full(steps + 1, y), radius_out * np.cos(angles)], 1)
    i = np.arange(steps)
    o = i + steps + 1
    return Mesh(
        np.concatenate([inner, outer]), np.concatenate([np.stack([i, i + 1, o + 1], 1), np.stack([i, o + 1, o], 1)])
    )


# Parts ---------------------------------------------------------------------------------------------
# Parts of the actuator: meshes and colours, in metres.


PLATE = (196, 202, 211)
DARK = (74, 82, 95)
STEEL = (205, 210, 218)
MOTOR = (58, 64, 75)
SPRING = (142, 150, 163)
BRASS = (190, 164, 108)
SIDE_COLOURS = {"A": (0, 158, 115), "B": (204, 121, 167)}
"""Hues of F_A and F_B in the charts."""
WALL, PRESSED = (110, 116, 126), (213, 94, 0)
"""Colours of an obstacle, and of one that is pressed on: the hue of a push."""
REFERENCE = (0, 114, 178)
"""Hue of q in the charts; its reference is the ghost."""

TOUCH = (140, 148, 158)
"""Hue of F_ext in the charts."""


class Add(Protocol):
    """Function that adds a mesh to the scene."""

    def __call__(
        self,
        name: str,
        mesh: Mesh,
        colour: tuple[int, int, int],
        opacity: float | None = None,
    ) -> Any:
        """Add ``mesh`` under ``name``."""
        ...


def make_fixed(add: Add, r_j: float) -> None:
    """Add the fixed parts: base plate, bearing, spring brackets, slide rails."""
    y = PLATE_Y
    outline = round_rectangle(PLATE_WIDTH, PLATE_BOTTOM, PLATE_TOP, 0.018)
    add("/base", plate(outline, y, y + 0.008), PLATE)
    add("/bearing", disc(0.026, 0.008, y, chamfer=0.002), DARK)
    for name, x in (("A", -r_j), ("B", r_j)):
        ring = disc(0.024, -0.003, 0.003, bore=0.004, chamfer=0.0008)
        seat = Mesh(ring.vertices[:, [0, 2, 1]], ring.faces).translate(x=x, z=BRACKET_Z)
        arm = plate([(-0.007, -0.003), (0.007, -0.003), (0.007, 0.003), (-0.007, 0.003)], 0.018, y)
        add(f"/bracket_{name}", join_meshes(seat, arm.translate(x=x, z=BRACKET_Z)), SIDE_COLOURS[name])
        rail = round_rectangle(0.010, PLATE_BOTTOM + 0.012, BRACKET_Z - 0.016, 0.004)
        add(f"/rail_{name}", plate([(x + px, pz) for px, pz in rail], y - 0.004, y), DARK)


def make_joint(add: Add, parent: str, r_j: float) -> None:
    """Add the pulley and the link that turn with q."""
    half = PULLEY_WIDTH / 2.0
    rim = revolve(
        [
            (r_j - 0.009, -half),
            (r_j + 0.003, -half),
            (r_j + 0.003, -half + 0.003),
            (r_j - TENDON_RADIUS, -0.003),
            (r_j - TENDON_RADIUS, 0.003),
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
    add(f"{parent}/hub", disc(0.019, LINK_FRONT - 0.004, 0.012, chamfer=0.0015), STEEL)
    add(f"{parent}/link", _bar(LINK_WIDTH, LINK_FRONT, 0.007), STEEL)
    add(f"{parent}/stripe", _bar(0.007, LINK_FRONT - 0.0006, 0.0012), REFERENCE)
    tip = disc(0.0075, LINK_FRONT - 0.003, LINK_FRONT + 0.009, chamfer=0.001)
    add(f"{parent}/tip", tip.translate(z=LINK_LENGTH), DARK)
    for index, angle in enumerate(np.radians([60.0, 120.0, 180.0, 240.0, 300.0])):
        hole = disc(0.009, -0.0036, 0.0036, sections=32)
        r = 0.6 * r_j
        add(f"{parent}/hole_{index}", hole.translate(x=r * math.sin(angle), z=r * math.cos(angle)), DARK)


def make_ghost(add: Add, parent: str) -> None:
    """Add the transparent link at the reference."""
    add(f"{parent}/link", _bar(LINK_WIDTH + 0.006, LINK_FRONT + 0.008, 0.004), REFERENCE, 0.30)


def make_wall(add: Add, parent: str, side: float) -> Any:
    """Add an obstacle that touches the link's flank at the parent's angle.

    ``side`` 1 is above the joint, -1 below.
    """
    x = -side * (LINK_WIDTH / 2.0 + WALL_THICKNESS / 2.0)
    outline = round_rectangle(WALL_THICKNESS, 0.55 * LINK_LENGTH, 1.08 * LINK_LENGTH, 0.002)
    return add(parent, plate(outline, LINK_FRONT - 0.006, 0.012).translate(x=x), WALL)


def make_carriage(add: Add, parent: str, name: str, reel_offset: float) -> None:
    """Add the motor on its carriage; the origin is the lower seat of the spring."""
    ring = disc(0.024, -0.002, 0.002, bore=0.004, chamfer=0.0008)
    seat = Mesh(ring.vertices[:, [0, 2, 1]], ring.faces).translate(z=-0.002)
    slide = plate(round_rectangle(0.034, -0.047, -0.001, 0.004), 0.016, PLATE_Y - 0.004)
    add(f"{parent}/seat", join_meshes(seat, slide), DARK)
    gearbox = disc(0.017, 0.009, 0.018, chamfer=0.001).translate(x=-reel_offset, z=-CARRIAGE_DROP)
    add(f"{parent}/gearbox", gearbox, STEEL)
    motor = disc(0.019, PLATE_Y + 0.008, PLATE_Y + 0.060, chamfer=0.002)
    add(f"{parent}/motor", motor.translate(x=-reel_offset, z=-CARRIAGE_DROP), MOTOR)
    band = disc(0.0175, 0.0095, 0.012).translate(x=-reel_offset, z=-CARRIAGE_DROP)
    add(f"{parent}/band", band, SIDE_COLOURS[name])


def make_reel(add: Add, parent: str, r_m: float) -> None:
    """Add a reel that turns with its motor, with a mark that shows the rotation."""
    body = revolve(
        [
            (0.0, -0.008),
            (r_m + 0.006, -0.008),
            (r_m + 0.006, -0.005),
            (r_m - TENDON_RADIUS, -0.004),
            (r_m - TENDON_RADIUS, 0.004),
            (r_m + 0.006, 0.005),
            (r_m + 0.006, 0.008),
            (0.0, 0.008),
        ]
    )
    add(f"{parent}/body", body, BRASS)
    add(f"{parent}/mark", disc(0.0022, -0.0086, -0.0078, sections=20).translate(z=r_m + 0.002), MOTOR)


def make_coil(length: float) -> Mesh:
    """Return a spring of ``length`` [m] that hangs from the origin."""
    return helix(length, SPRING_RADIUS, SPRING_WIRE, SPRING_COILS)


def make_unit_tendon() -> Mesh:
    """Return a straight tendon of 1 m that hangs from the origin, to be scaled."""
    return tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), TENDON_RADIUS)


def make_loose_tendon(sign: float, sag: float) -> Mesh:
    """Return a slack tendon, longer by ``sag`` [m] than the distance to the bracket.

    Half a sine of that arc length, curved outwards.
    """
    width = 2.0 / math.pi * math.sqrt(-BRACKET_Z * min(sag, 0.05))
    s = np.linspace(0.0, 1.0, 25)
    path = np.stack([sign * width * np.sin(np.pi * s), np.zeros_like(s), BRACKET_Z * s], 1)
    return tube(path, TENDON_RADIUS)


def make_fan(half_angle: float) -> Mesh:
    """Return the fan of compliance about the link: ± ``half_angle`` [rad]."""
    return sector(0.082, LINK_LENGTH, half_angle, LINK_FRONT + 0.016)


def _bar(width: float, y_front: float, thickness: float) -> Mesh:
    outline = round_rectangle(width, -width / 2.0, LINK_LENGTH + width / 2.0, width / 2.0 - 1e-6, steps=16)
    return plate(outline, y_front, y_front + thickness)


# Scene nodes ---------------------------------------------------------------------------------------
# The actuator as viser nodes: built once, then only changes are sent.


SCALE = 10.0
"""Scene units per metre: the renderer's clipping planes suit bodies of about this size."""

_LENGTHS = np.geomspace(0.024, SPRING_FREE, 9)
"""Spring lengths with a prepared coil; in between the nearest is stretched by at most 9 %."""

_ANGLE_STEP = 5e-4
_LENGTH_STEP = 1e-4
_FORCE_STEP = 0.1
_TOUCH_N = 0.5
"""Least external force that is drawn [N]: several times the estimate's noise at rest."""
_TEXT_PERIOD_FRAMES = 6


@dataclass(frozen=True)
class _SideNodes:
    """Nodes of one tendon; ``sign`` is -1 for A on the left, +1 for B on the right."""

    name: str
    sign: float
    reel: Any
    carriage: Any
    coils: list[Any]
    taut: Any
    loose: Any
    label: Any


class _Drawn:
    """Stores the drawn values, so that only visible changes are sent."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}

    def has_changed(self, name: str, value: float, step: float) -> bool:
        """Return whether ``value`` differs from the drawn one by ``step``, and store it."""
        if name in self._values and abs(self._values[name] - value) < step:
            return False
        self._values[name] = value
        return True


class SceneNodes:
    """Nodes on a viser server. ``show`` must be called from one thread only."""

    def __init__(self, server: viser.ViserServer, r_j: float, r_m: float) -> None:
        self._server = server
        self._scene = server.scene
        self._r_j = r_j
        self._r_m = r_m
        self._drawn = _Drawn()
        self._frame = 0
        self._wall: Obstacle | None = None
        self._set_up()
        make_fixed(self._add, r_j)
        self._joint = self._scene.add_frame("/joint", show_axes=False)
        make_joint(self._add, "/joint", r_j)
        self._ghost = self._scene.add_frame("/ghost", show_axes=False)
        make_ghost(self._add, "/ghost")
        self._fan = self._add("/joint/fan", make_fan(0.2), (230, 159, 0), opacity=0.32)
        self._stiffness = self._scene.add_label(
            "/stiffness", "", position=_units(0.0, 0.0, -0.285), anchor="center-center"
        )
        self._push = self._scene.add_arrows(
            "/push", np.zeros((1, 2, 3)), (213, 94, 0), shaft_radius=0.03, head_radius=0.09, head_length=0.16
        )
        self._touch = self._scene.add_arrows(
            "/touch", np.zeros((1, 2, 3)), TOUCH, shaft_radius=0.03, head_radius=0.09, head_length=0.16
        )
        self._walls = self._scene.add_frame("/wall", show_axes=False, visible=False)
        self._faces = {side: make_wall(self._add, f"/wall/{side:+.0f}", side) for side in (1.0, -1.0)}
        self._A = self._side("A", -1.0)
        self._B = self._side("B", +1.0)

    def show(self, pose: Pose) -> None:
        """Send the visible differences between the pose and the drawn one."""
        self._frame += 1
        with self._server.atomic():
            if self._drawn.has_changed("q", pose.q, _ANGLE_STEP):
                self._joint.wxyz = _turn(pose.q)
            if self._drawn.has_changed("q_ref", pose.q_ref, _ANGLE_STEP):
                self._ghost.wxyz = _turn(pose.q_ref)
            if self._drawn.has_changed("fan", pose.fan, _ANGLE_STEP):
                self._fan.visible = pose.fan > 0.0
                self._fan.vertices = _scale_vertices(make_fan(pose.fan))
            if self._drawn.has_changed("F_push", pose.F_push, _FORCE_STEP):
                draw_force(self._push, pose.F_push, self._r_j + 0.03, _FORCE_STEP)
            if self._drawn.has_changed("F_ext_hat", _finite_or_zero(pose.F_ext_hat), _FORCE_STEP):
                draw_force(self._touch, _finite_or_zero(pose.F_ext_hat), self._r_j + 0.05, _TOUCH_N)
            if self._drawn.has_changed("pressed", pose.pressed, 1):
                for face in self._faces.values():
                    face.color = PRESSED if pose.pressed else WALL
            self._show_side(self._A, pose.A)
            self._show_side(self._B, pose.B)
            if self._frame % _TEXT_PERIOD_FRAMES == 1:
                self._stiffness.text = f"S {FAN_TORQUE / pose.fan:.1f} N·m/rad" if pose.fan else "S slack"

    def show_wall(self, wall: Obstacle | None) -> None:
        """Show an obstacle at its position, None for no obstacle."""
        if wall == self._wall:
            return
        self._wall = wall
        with self._server.atomic():
            self._walls.visible = wall is not None
            if wall is not None:
                self._walls.wxyz = _turn(wall.q_wall)
                for side, face in self._faces.items():
                    face.visible = side == wall.side

    def _set_up(self) -> None:
        scene = self._scene
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        # Shadows and environment reflections take seconds per frame on a machine without a graphics card.
        scene.configure_environment_map(None)
        scene.configure_default_lights(enabled=True, cast_shadow=False)
        scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(150, 155, 165), intensity=3.0)
        camera = self._server.initial_camera
        camera.position = _units(0.16, -1.02, 0.10)
        camera.look_at = _units(0.0, 0.0, -0.048)
        camera.fov = math.radians(30.0)
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)

    def _side(self, name: str, sign: float) -> _SideNodes:
        x = sign * self._r_j
        carriage = self._scene.add_frame(f"/carriage_{name}", show_axes=False)
        make_carriage(self._add, f"/carriage_{name}", name, sign * self._r_m)
        axis = _units(-sign * self._r_m, 0.0, -CARRIAGE_DROP)
        reel = self._scene.add_frame(f"/carriage_{name}/reel", show_axes=False, position=axis)
        make_reel(self._add, f"/carriage_{name}/reel", self._r_m)
        coils = [self._add(f"/spring_{name}/{i}", make_coil(length), SPRING) for i, length in enumerate(_LENGTHS)]
        for coil in coils:
            coil.position = _units(x, 0.0, BRACKET_Z - SEAT)
        taut = self._add(f"/tendon_{name}", make_unit_tendon(), SLACK_COLOUR)
        loose = self._add(f"/loose_{name}", make_loose_tendon(sign, 0.01), SLACK_COLOUR)
        taut.position = loose.position = _units(x, 0.0, 0.0)
        label = self._scene.add_label(
            f"/label_{name}",
            name,
            position=_units(sign * (self._r_j + 0.030), 0.0, -0.075),
            anchor="center-left" if sign > 0 else "center-right",
        )
        return _SideNodes(
            name=name, sign=sign, reel=reel, carriage=carriage, coils=coils, taut=taut, loose=loose, label=label
        )

    def _show_side(self, nodes: _SideNodes, side: Side) -> None:
        drawn, name = self._drawn, nodes.name
        if drawn.has_changed(f"theta_{name}", side.theta, 4 * _ANGLE_STEP):
            nodes.reel.wxyz = _turn(-nodes.sign * side.theta)
        if drawn.has_changed(f"spring_{name}", side.spring_length, _LENGTH_STEP):
            self._compress(nodes, side.spring_length)
        if drawn.has_changed(f"colour_{name}", hash(side.colour), 1):
            nodes.taut.color = side.colour
        if drawn.has_changed(f"slack_{name}", side.slack, 1):
            nodes.taut.visible = not side.slack
            nodes.loose.visible = side.slack
        if side.slack and drawn.has_changed(f"sag_{name}", side.sag, 3 * _LENGTH_STEP):
            nodes.loose.vertices = _scale_vertices(make_loose_tendon(nodes.sign, side.sag))
        if self._frame % _TEXT_PERIOD_FRAMES == 1:
            nodes.label.text = f"{name} slack" if side.slack else f"{name} {side.force_N:.1f} N"

    def _compress(self, nodes: _SideNodes, length: float) -> None:
        nearest = int(np.argmin(np.abs(np.log(_LENGTHS / length))))
        for index, coil in enumerate(nodes.coils):
            coil.visible = index == nearest
        nodes.coils[nearest].scale = (1.0, 1.0, length / float(_LENGTHS[nearest]))
        seat = BRACKET_Z - SEAT - length
        nodes.carriage.position = _units(nodes.sign * self._r_j, 0.0, seat)
        nodes.taut.scale = (1.0, 1.0, CARRIAGE_DROP - seat)

    def _add(
        self,
        name: str,
        mesh: Mesh,
        colour: tuple[int, int, int],
        opacity: float | None = None,
    ) -> Any:
        return self._scene.add_mesh_simple(
            name,
            vertices=_scale_vertices(mesh),
            faces=mesh.faces.astype(np.uint32),
            color=colour,
            opacity=opacity,
            side="double",
        )


def draw_force(arrow: Any, force_N: float, height: float, least_N: float) -> None:
    """Draw a force as an arrow at ``height`` [m]; hide it below ``least_N``."""
    tip, tail = _units(0.0, LINK_FRONT, height), _units(0.004 * force_N, LINK_FRONT, height)
    arrow.points = np.array([[tail, tip]], dtype=np.float32)
    arrow.visible = abs(force_N) >= least_N


def _finite_or_zero(force_N: float) -> float:
    return force_N if math.isfinite(force_N) else 0.0


def _scale_vertices(mesh: Mesh) -> NDArray[np.float32]:
    return (mesh.vertices * SCALE).astype(np.float32)


def _turn(angle: float) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of ``angle`` [rad] about -y.

    Counter-clockwise seen from the front.
    """
    return math.cos(angle / 2.0), 0.0, -math.sin(angle / 2.0), 0.0


def _units(x: float, y: float, z: float) -> tuple[float, float, float]:
    return x * SCALE, y * SCALE, z * SCALE


# Scene updates -------------------------------------------------------------------------------------
# Updates the 3D view with the newest sample, 30 times a second, in its own thread.


RATE_HZ = 30.0
UP_WITHIN_S = 5.0
"""Time that a viewer waits for a scene that is starting [s]; it is disconnected then."""

_POLL_S = 0.05
SCENE_PART = Part(messages.scene(), messages.view_is_frozen())


class SceneMirror:
    """Scene without a port, and the thread ``run`` that updates it for viewers.

    ``newest`` returns the newest sample, one value per field, None before the first; ``wall`` the current obstacle.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        newest: Callable[[], NDArray[np.float64] | None],
        wall: Callable[[], Obstacle | None] = lambda: None,
    ) -> None:
        self._newest, self._wall = newest, wall
        self._geometry = parameters.geometry
        self.use(parameters)
        self._scene: tuple[PortlessServer, SceneNodes] | None = None
        self._up = threading.Event()
        self._ending = threading.Event()

    def use(self, parameters: PlantParameters) -> None:
        """Use the springs of these parameters from now on."""
        self._springs = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")

    @property
    def server(self) -> PortlessServer:
        """Server of the current scene. Raises SceneEndedError if there is none."""
        if self._scene is None:
            raise SceneEndedError(messages.no_view())
        return self._scene[0]

    async def show(self, send: Send) -> None:
        """Stream the scene to ``send`` until cancelled; see ``PortlessServer.show``.

        Raises SceneEndedError if it does not start within UP_WITHIN_S.
        """
        with suppress(TimeoutError):
            async with asyncio.timeout(UP_WITHIN_S):
                while not self._up.is_set():
                    await asyncio.sleep(_POLL_S)
        await self.server.show(send)

    def close(self) -> None:
        """Stop the server."""
        self.end()
        if self._scene is not None:
            self._scene[0].stop()

    def _step(self, stage: SceneNodes) -> None:
        row = self._newest()
        sample = None if row is None else dict(zip(NAMES, row.tolist(), strict=True))
        if sample is not None and can_be_drawn(sample):
            stage.show_wall(self._wall())
            stage.show(pose(sample, self._geometry.r_m, self._geometry.r_j, *self._springs))

    def end(self) -> None:
        """End ``run``."""
        self._ending.set()
        self._up.set()

    def run(self) -> None:
        """Start the scene and update it until ``end``.

        Raises SceneEndedError if viser's thread dies. Called again after that, it starts another scene; viewers of the
        first one were disconnected and reconnect.
        """
        if self._scene is None or not self._scene[0].is_alive:
            self._scene = self._start_server()
        server, stage = self._scene
        self._up.set()
        due = time.monotonic()
        while not self._ending.wait(max(0.0, due - time.monotonic())):
            due = max(due + 1.0 / RATE_HZ, time.monotonic())
            if not server.is_alive:
                server.clear_up()
                raise SceneEndedError(messages.viewer_thread_ended())
            if server.viewers:
                self._step(stage)

    def _start_server(self) -> tuple[PortlessServer, SceneNodes]:
        server = PortlessServer()
        return server, SceneNodes(server, self._geometry.r_j, self._geometry.r_m)
