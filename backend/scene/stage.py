"""The actuator as viser nodes: built once, then only what changed is moved."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from backend.scene import layout, parts
from backend.scene.parts import SPRING
from backend.scene.pose import SLACK_COLOUR, Pose, Side
from backend.scene.shapes import Mesh
from plant.dynamics import Obstacle

SCALE = 10.0
"""Scene units per metre: the renderer's clipping planes are made for bodies of about this size."""

_LENGTHS = np.geomspace(0.024, layout.SPRING_FREE, 9)
"""Spring lengths for which a coil is kept ready; between them the nearest is stretched by at most 9 %."""

_ANGLE_STEP = 5e-4
_LENGTH_STEP = 1e-4
_FORCE_STEP = 0.1
_TOUCH_N = 0.5
"""Least outside force that is drawn [N]: several times what the estimate moves by at rest."""
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
    """Remembers what is drawn, so that only a visible change is sent."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}

    def changes(self, name: str, value: float, step: float) -> bool:
        """Return whether ``value`` differs from the drawn one by ``step`` or more, and take it as drawn then."""
        if name in self._values and abs(self._values[name] - value) < step:
            return False
        self._values[name] = value
        return True


class Stage:
    """Draws on a viser server. ``show`` takes the newest pose; it may be called from one thread only."""

    def __init__(self, server: viser.ViserServer, r_j: float, r_m: float) -> None:
        self._server = server
        self._scene = server.scene
        self._r_j = r_j
        self._r_m = r_m
        self._drawn = _Drawn()
        self._frame = 0
        self._wall: Obstacle | None = None
        self._set_up()
        parts.fixed(self._add, r_j)
        self._joint = self._scene.add_frame("/joint", show_axes=False)
        parts.joint(self._add, "/joint", r_j)
        self._ghost = self._scene.add_frame("/ghost", show_axes=False)
        parts.ghost(self._add, "/ghost")
        self._fan = self._add("/joint/fan", parts.fan(0.2), (230, 159, 0), opacity=0.32)
        self._stiffness = self._scene.add_label(
            "/stiffness", "", position=_units(0.0, 0.0, -0.285), anchor="center-center"
        )
        self._push = self._scene.add_arrows(
            "/push", np.zeros((1, 2, 3)), (213, 94, 0), shaft_radius=0.03, head_radius=0.09, head_length=0.16
        )
        self._touch = self._scene.add_arrows(
            "/touch", np.zeros((1, 2, 3)), parts.TOUCH, shaft_radius=0.03, head_radius=0.09, head_length=0.16
        )
        self._walls = self._scene.add_frame("/wall", show_axes=False, visible=False)
        self._faces = {side: parts.wall(self._add, f"/wall/{side:+.0f}", side) for side in (1.0, -1.0)}
        self._A = self._side("A", -1.0)
        self._B = self._side("B", +1.0)

    def show(self, pose: Pose) -> None:
        """Move what differs visibly from what is drawn."""
        self._frame += 1
        with self._server.atomic():
            if self._drawn.changes("q", pose.q, _ANGLE_STEP):
                self._joint.wxyz = _turn(pose.q)
            if self._drawn.changes("q_ref", pose.q_ref, _ANGLE_STEP):
                self._ghost.wxyz = _turn(pose.q_ref)
            if self._drawn.changes("fan", pose.fan, _ANGLE_STEP):
                self._fan.visible = pose.fan > 0.0
                self._fan.vertices = _scaled(parts.fan(pose.fan))
            if self._drawn.changes("F_push", pose.F_push, _FORCE_STEP):
                draw_force(self._push, pose.F_push, self._r_j + 0.03, _FORCE_STEP)
            if self._drawn.changes("F_ext_hat", _known(pose.F_ext_hat), _FORCE_STEP):
                draw_force(self._touch, _known(pose.F_ext_hat), self._r_j + 0.05, _TOUCH_N)
            if self._drawn.changes("pressed", pose.pressed, 1):
                for face in self._faces.values():
                    face.color = parts.PRESSED if pose.pressed else parts.WALL
            self._show_side(self._A, pose.A)
            self._show_side(self._B, pose.B)
            if self._frame % _TEXT_PERIOD_FRAMES == 1:
                self._stiffness.text = f"S {layout.FAN_TORQUE / pose.fan:.1f} N·m/rad" if pose.fan else "S slack"

    def show_wall(self, wall: Obstacle | None) -> None:
        """Let a wall stand where it stands, None: nowhere."""
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
        # Shadows and the reflections of a surrounding take seconds a picture on a machine without a graphics card.
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
        parts.carriage(self._add, f"/carriage_{name}", name, sign * self._r_m)
        axis = _units(-sign * self._r_m, 0.0, -layout.CARRIAGE_DROP)
        reel = self._scene.add_frame(f"/carriage_{name}/reel", show_axes=False, position=axis)
        parts.reel(self._add, f"/carriage_{name}/reel", self._r_m)
        coils = [self._add(f"/spring_{name}/{i}", parts.coil(length), SPRING) for i, length in enumerate(_LENGTHS)]
        for coil in coils:
            coil.position = _units(x, 0.0, layout.BRACKET_Z - layout.SEAT)
        taut = self._add(f"/tendon_{name}", parts.unit_tendon(), SLACK_COLOUR)
        loose = self._add(f"/loose_{name}", parts.loose_tendon(sign, 0.01), SLACK_COLOUR)
        taut.position = loose.position = _units(x, 0.0, 0.0)
        label = self._scene.add_label(
            f"/label_{name}",
            name,
            position=_units(sign * (self._r_j + 0.030), 0.0, -0.075),
            anchor="center-left" if sign > 0 else "center-right",
        )
        return _SideNodes(name, sign, reel, carriage, coils, taut, loose, label)

    def _show_side(self, nodes: _SideNodes, side: Side) -> None:
        drawn, name = self._drawn, nodes.name
        if drawn.changes(f"theta_{name}", side.theta, 4 * _ANGLE_STEP):
            nodes.reel.wxyz = _turn(-nodes.sign * side.theta)
        if drawn.changes(f"spring_{name}", side.spring_length, _LENGTH_STEP):
            self._compress(nodes, side.spring_length)
        if drawn.changes(f"colour_{name}", hash(side.colour), 1):
            nodes.taut.color = side.colour
        if drawn.changes(f"slack_{name}", side.slack, 1):
            nodes.taut.visible = not side.slack
            nodes.loose.visible = side.slack
        if side.slack and drawn.changes(f"sag_{name}", side.sag, 3 * _LENGTH_STEP):
            nodes.loose.vertices = _scaled(parts.loose_tendon(nodes.sign, side.sag))
        if self._frame % _TEXT_PERIOD_FRAMES == 1:
            nodes.label.text = f"{name} slack" if side.slack else f"{name} {side.force_N:.1f} N"

    def _compress(self, nodes: _SideNodes, length: float) -> None:
        nearest = int(np.argmin(np.abs(np.log(_LENGTHS / length))))
        for index, coil in enumerate(nodes.coils):
            coil.visible = index == nearest
        nodes.coils[nearest].scale = (1.0, 1.0, length / float(_LENGTHS[nearest]))
        seat = layout.BRACKET_Z - layout.SEAT - length
        nodes.carriage.position = _units(nodes.sign * self._r_j, 0.0, seat)
        nodes.taut.scale = (1.0, 1.0, layout.CARRIAGE_DROP - seat)

    def _add(
        self,
        name: str,
        mesh: Mesh,
        colour: tuple[int, int, int],
        opacity: float | None = None,
    ) -> Any:
        return self._scene.add_mesh_simple(
            name,
            vertices=_scaled(mesh),
            faces=mesh.faces.astype(np.uint32),
            color=colour,
            opacity=opacity,
            side="double",
        )


def draw_force(arrow: Any, force_N: float, height: float, least_N: float) -> None:
    """Point at the joint from where a force comes, at ``height`` [m]; nothing below ``least_N``."""
    tip, tail = _units(0.0, layout.LINK_FRONT, height), _units(0.004 * force_N, layout.LINK_FRONT, height)
    arrow.points = np.array([[tail, tip]], dtype=np.float32)
    arrow.visible = abs(force_N) >= least_N


def _known(force_N: float) -> float:
    return force_N if math.isfinite(force_N) else 0.0


def _scaled(mesh: Mesh) -> NDArray[np.float32]:
    return (mesh.vertices * SCALE).astype(np.float32)


def _turn(angle: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of ``angle`` [rad], counter-clockwise seen from the front, that is about -y."""
    return math.cos(angle / 2.0), 0.0, -math.sin(angle / 2.0), 0.0


def _units(x: float, y: float, z: float) -> tuple[float, float, float]:
    return x * SCALE, y * SCALE, z * SCALE
