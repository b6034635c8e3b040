"""The model of the 3D view: poses and meshes."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.scene import model
from backend.scene.model import (
    SCALE,
    SLACK_COLOUR,
    SceneNodes,
    can_be_drawn,
    disc,
    draw_force,
    force_colour,
    join_meshes,
    plate,
    pose,
    round_rectangle,
    sector,
    tube,
)
from backend.scene.server import PortlessServer
from plant.dynamics import Obstacle, spring_elongation
from plant.parameters import load_parameters

# How a sample looks: lengths from equation 1, slack, colours, mirror symmetry.

IDEAL = load_parameters("ideal")
R_M, R_J = IDEAL.geometry.r_m, IDEAL.geometry.r_j
SPRINGS = IDEAL.make_identified_spring("A"), IDEAL.make_identified_spring("B")


def sample(q: float, x_A: float, x_B: float, **others: float) -> dict[str, float]:
    """A sample with elongations x_A, x_B [m] at joint position q [rad]."""
    given_values = {"q_ref": q, "S": 10.0, "F_A": 0.0, "F_B": 0.0, "F_push": 0.0, "F_wall": math.nan, **others}
    return {"q": q, "theta_A": (x_A + R_J * q) / R_M, "theta_B": (x_B - R_J * q) / R_M, **given_values}


@given(q=st.floats(-1.4, 1.4), F=st.floats(1.0, 49.0))
def test_springs_shorten_by_their_elongation_at_any_joint_position(q: float, F: float) -> None:
    x = spring_elongation(SPRINGS[0], F)
    drawn = pose(sample(q, x, x), R_M, R_J, *SPRINGS)
    for side in (drawn.A, drawn.B):
        assert side.spring_length == pytest.approx(model.SPRING_FREE - x, abs=1e-9)
        assert not side.slack


def test_a_slack_tendon_sags_by_its_excess_length() -> None:
    drawn = pose(sample(0.0, 0.0, 0.030), R_M, R_J, *SPRINGS)
    assert drawn.A.slack
    assert drawn.A.sag == pytest.approx(0.00646, abs=1e-5)
    assert drawn.A.colour == SLACK_COLOUR
    assert drawn.A.spring_length == pytest.approx(model.SPRING_FREE - drawn.A.sag)
    assert not drawn.B.slack


def test_a_spring_is_never_drawn_shorter_than_its_coils() -> None:
    drawn = pose(sample(0.0, 0.080, 0.080), R_M, R_J, *SPRINGS)
    assert drawn.A.spring_length == pytest.approx(model.SPRING_FREE - IDEAL.spring.x_solid)
    assert drawn.A.spring_length > 2.0 * model.SPRING_WIRE * model.SPRING_COILS


@given(q=st.floats(-1.0, 1.0), x_A=st.floats(0.0, 0.06), x_B=st.floats(0.0, 0.06))
def test_swapping_the_sides_gives_the_mirrored_pose(q: float, x_A: float, x_B: float) -> None:
    one = pose(sample(q, x_A, x_B, F_A=11.0, F_B=22.0), R_M, R_J, *SPRINGS)
    other = pose(sample(-q, x_B, x_A, F_A=22.0, F_B=11.0), R_M, R_J, *SPRINGS)
    assert other.q == -one.q
    for mine, theirs in ((one.A, other.B), (one.B, other.A)):
        assert theirs.spring_length == pytest.approx(mine.spring_length, abs=1e-12)
        assert replace(theirs, theta=0.0, spring_length=0.0, sag=0.0) == replace(
            mine, theta=0.0, spring_length=0.0, sag=0.0
        )


def test_the_fan_narrows_as_the_joint_stiffens() -> None:
    soft = pose(sample(0.0, 0.02, 0.02, S=8.0), R_M, R_J, *SPRINGS)
    stiff = pose(sample(0.0, 0.05, 0.05, S=14.0), R_M, R_J, *SPRINGS)
    assert soft.fan == pytest.approx(2.0 / 8.0)
    assert stiff.fan < soft.fan


def test_without_references_the_ghost_is_at_the_joint_position() -> None:
    drawn = pose(sample(0.3, 0.02, 0.02, q_ref=math.nan, F_A=math.nan), R_M, R_J, *SPRINGS)
    assert drawn.q_ref == 0.3
    assert drawn.A.force_N == 0.0


def test_colours_become_lighter_with_force_and_are_never_red() -> None:
    shades = [force_colour(F) for F in range(0, 51, 2)]
    lightness = [0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in shades]
    assert lightness == sorted(lightness)
    assert force_colour(80.0) == force_colour(50.0)
    assert all(g > 0.5 * r for r, g, _ in shades)


def test_a_broken_sensor_keeps_the_last_pose() -> None:
    assert can_be_drawn(sample(0.1, 0.02, 0.02, F_A=math.nan, q_ref=math.nan))
    assert not can_be_drawn({**sample(0.1, 0.02, 0.02), "theta_A": math.nan})


def test_an_unknown_or_unrecorded_external_force_is_not_drawn() -> None:
    assert pose(sample(0.0, 0.02, 0.02, F_ext_hat=-3.0), R_M, R_J, *SPRINGS).F_ext_hat == -3.0
    assert math.isnan(pose(sample(0.0, 0.02, 0.02), R_M, R_J, *SPRINGS).F_ext_hat)


def test_the_force_arrow_points_in_the_force_direction_and_ends_at_the_joint() -> None:
    arrow = SimpleNamespace(points=None, visible=None)
    for force, visible in ((6.0, True), (-6.0, True), (0.4, False)):
        draw_force(arrow, force, 0.1, 0.5)
        ((tail, tip),) = arrow.points
        assert np.sign(tail[0]) == np.sign(force)
        assert tip[0] == 0.0
        assert tail[1:] == pytest.approx(tip[1:])
        assert arrow.visible is visible


@pytest.mark.parametrize(
    ("F_wall", "pressed"), [(math.nan, False), (0.0, False), (0.04, False), (-3.0, True), (0.2, True)]
)
def test_an_obstacle_is_drawn_at_its_angle_with_its_force(F_wall: float, pressed: bool) -> None:
    assert pose(sample(0.0, 0.02, 0.02, F_wall=F_wall), R_M, R_J, *SPRINGS).pressed is pressed


@pytest.mark.parametrize("q_wall", [-0.7, 0.0, 0.4])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_obstacle_begins_at_the_flank_of_the_link_at_its_angle(side: float, q_wall: float) -> None:
    """The link points to z at q = 0 and turns from z to −x: the face of the obstacle lies along its flank."""
    server = PortlessServer()
    stage = SceneNodes(server, R_J, R_M)
    stage.show_wall(Obstacle(side, q_wall, 1e4, 0.0))
    stands = [stage._walls.visible]
    assert [face.visible for face in stage._faces.values()] == [side > 0.0, side < 0.0]
    w, _, y, _ = stage._walls.wxyz
    q = -2.0 * math.atan2(y, w)
    assert q == pytest.approx(q_wall)
    x, z = stage._faces[side].vertices[:, 0], stage._faces[side].vertices[:, 2]
    beyond = -side * x / SCALE - model.LINK_WIDTH / 2.0  # along the flank's normal, in the wall's own frame
    assert beyond.min() == pytest.approx(0.0, abs=1e-6)
    assert beyond.max() == pytest.approx(model.WALL_THICKNESS, abs=1e-6)
    assert z.min() / SCALE > R_J
    stage.show_wall(None)
    stands.append(stage._walls.visible)
    assert stands == [True, False]
    server.stop()


# The meshes have the measures that they were asked for.


@pytest.mark.parametrize("length", [0.031, 0.05, model.SPRING_FREE])
def test_a_coil_has_exactly_its_length(length: float) -> None:
    mesh = model.make_coil(length)
    z = mesh.vertices[:, 2]
    assert z.max() <= 1e-9
    assert z.min() == pytest.approx(-length, abs=1e-4)
    radii = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    assert radii.max() == pytest.approx(model.SPRING_RADIUS + model.SPRING_WIRE, abs=2e-4)


def test_the_excess_length_of_a_slack_tendon_matches_its_sag() -> None:
    sag = 0.006
    vertices = model.make_loose_tendon(1.0, sag).vertices.reshape(25, -1, 3)
    centre = vertices.mean(axis=1)
    length = np.linalg.norm(np.diff(centre, axis=0), axis=1).sum()
    assert length + model.BRACKET_Z == pytest.approx(sag, rel=0.05)
    assert np.all(centre[1:-1, 0] > 0.0)


def test_a_disc_has_its_radius_its_bore_and_its_thickness() -> None:
    vertices = disc(0.02, -0.003, 0.004, bore=0.005).vertices
    radii = np.hypot(vertices[:, 0], vertices[:, 2])
    assert (radii.min(), radii.max()) == pytest.approx((0.005, 0.02))
    assert (vertices[:, 1].min(), vertices[:, 1].max()) == pytest.approx((-0.003, 0.004))


def test_a_rounded_plate_stays_within_its_outline() -> None:
    mesh = plate(round_rectangle(0.2, -0.3, 0.05, 0.02), 0.03, 0.04)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose(low, [-0.1, 0.03, -0.3])
    np.testing.assert_allclose(high, [0.1, 0.04, 0.05])


def test_a_sector_spans_its_angle() -> None:
    vertices = sector(0.05, 0.1, 0.3, 0.0).vertices
    angles = np.arctan2(vertices[:, 0], vertices[:, 2])
    assert (angles.min(), angles.max()) == pytest.approx((-0.3, 0.3))


def test_faces_refer_to_existing_vertices() -> None:
    mesh = join_meshes(tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), 0.1), disc(1.0, 0.0, 1.0))
    assert mesh.faces.min() == 0
    assert mesh.faces.max() == len(mesh.vertices) - 1
    assert np.isfinite(mesh.vertices).all()
