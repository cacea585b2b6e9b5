"""Poses are the starts of all cases; a renderer passes where it shows what it should."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import random_field
from deformrf.core.geometry import signed_volumes
from deformrf.core.render import Renderer
from deformrf.wings.lab.rendering.section import BOUND
from deformrf.wings.lab.stability import poses, stress

PIXELS = 100


@pytest.fixture(scope="module")
def found(ball):
    return poses.poses(ball, "cpu")


def test_every_start_and_drive_is_a_pose(ball, found):
    starts = {case.start for case in stress.CASES if not case.drive}
    drives = {case.name for case in stress.CASES if case.drive}
    assert set(found) == {"at rest", *starts, *drives}
    assert next(iter(found)) == "at rest"
    rest = ball.mesh.rest_vertices
    np.testing.assert_array_equal(found["at rest"], rest)
    for vertices in found.values():
        assert vertices.shape == rest.shape and np.isfinite(vertices).all()


def test_poses_are_what_they_are_called(ball, found):
    for name, sides in (("plane", 2), ("line", 1), ("point", 0)):
        assert (np.ptp(found[name], axis=0) > 0.0).tolist() == [i < sides for i in range(3)]
    volumes = signed_volumes(ball.mesh.rest_vertices, ball.mesh.tets)
    mirrored = signed_volumes(found["mirrored"], ball.mesh.tets)
    np.testing.assert_allclose(mirrored, -volumes, atol=1e-12)


@pytest.mark.parametrize("name", [case.name for case in stress.CASES if case.drive])
def test_what_is_driven_leaves_its_rest(ball, device, name):
    rest = ball.mesh.rest_vertices
    size = np.ptp(rest, axis=0).max()
    moved = poses.poses(ball, device)[name] - rest
    assert np.linalg.norm(moved, axis=1).max() > 0.05 * size


def test_a_seed_gives_the_same_again(ball, found):
    again, other = poses.poses(ball, "cpu"), poses.poses(ball, "cpu", seed=1)
    for name, vertices in found.items():
        np.testing.assert_array_equal(vertices, again[name])
    assert (found["random"] != other["random"]).any()


@pytest.mark.parametrize("name", ["at rest", "mirrored", "squashed", "point"])
def test_the_renderer_passes(ball, found, device, name):
    row = poses.measure(Renderer(ball, device), name, found[name], PIXELS, 2)
    assert row.passed and row.psnr >= BOUND and row.largest < 8.0, row
    assert row.pose == name
    assert row.inverted == (ball.mesh.tet_count if name == "mirrored" else 0)
    assert row.frame.count == 2 and 0.0 < row.frame.low <= row.frame.median <= row.frame.high


class Unmoved(Renderer):
    def set_vertices(self, vertices):
        super().set_vertices(self.field.mesh.rest_vertices)


def test_a_wrong_image_does_not_pass(ball, found):
    """One of a model with other contents, and one of another pose."""
    mesh = ball.mesh
    other = random_field(mesh, ball.neighbours, ball.options, seed=1, contrast=2.0)
    renderer = Renderer(replace(other, density_layers=ball.density_layers), "cpu")
    renderer.field = ball  # what it is compared with
    for wrong, name in ((renderer, "at rest"), (Unmoved(ball, "cpu"), "squashed")):
        row = poses.measure(wrong, name, found[name], PIXELS, 1)
        assert not row.passed and row.psnr < 40.0 and row.largest > 8.0, row
