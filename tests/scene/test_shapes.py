"""The meshes have the measures that they were asked for."""

import numpy as np
import pytest

from backend.scene import model
from backend.scene.model import disc, join_meshes, plate, round_rectangle, sector, tube


@pytest.mark.parametrize("length", [0.031, 0.05, model.SPRING_FREE])
def test_a_coil_fills_its_length_and_no_more(length: float) -> None:
    mesh = model.make_coil(length)
    z = mesh.vertices[:, 2]
    assert z.max() <= 1e-9
    assert z.min() == pytest.approx(-length, abs=1e-4)
    radii = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    assert radii.max() == pytest.approx(model.SPRING_RADIUS + model.SPRING_WIRE, abs=2e-4)


def test_a_loose_tendon_is_as_much_longer_as_it_sags() -> None:
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


def test_a_rounded_plate_keeps_to_its_outline() -> None:
    mesh = plate(round_rectangle(0.2, -0.3, 0.05, 0.02), 0.03, 0.04)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    np.testing.assert_allclose(low, [-0.1, 0.03, -0.3])
    np.testing.assert_allclose(high, [0.1, 0.04, 0.05])


def test_a_sector_spans_its_angle() -> None:
    vertices = sector(0.05, 0.1, 0.3, 0.0).vertices
    angles = np.arctan2(vertices[:, 0], vertices[:, 2])
    assert (angles.min(), angles.max()) == pytest.approx((-0.3, 0.3))


def test_faces_point_at_vertices_that_are_there() -> None:
    mesh = join_meshes(tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), 0.1), disc(1.0, 0.0, 1.0))
    assert mesh.faces.min() == 0
    assert mesh.faces.max() == len(mesh.vertices) - 1
    assert np.isfinite(mesh.vertices).all()
