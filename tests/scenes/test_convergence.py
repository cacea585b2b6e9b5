"""The image converges as the march step shrinks, and as fast as its pieces allow.

σ and color are constant on a piece and taken at its middle: the midpoint rule, of order 2
wherever they are continuous along the piece, kinks included.  Tets cut pieces, so nothing
jumps inside of one but the mask, whose edge is only known to within a piece: order 1.
"""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.definition.image import render_rays
from deformrf.core.field import FieldOptions, random_field
from deformrf.core.geometry import TetMesh

HALVINGS = 3
NEAR_STEPS = (0.8, 0.9, 1.0)


def deformed(rest, rng):
    """Sheared and stretched by some 20 %, and bent in waves.  [V, 3]"""
    shear = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    waves = np.sin((rest - 0.5) @ rng.normal(size=(3, 3)) * 6.0 + rng.uniform(0, 6, 3))
    return 0.5 + (rest - 0.5) @ shear + 0.02 * waves


def convergence_order(field, rng, first_step, ray_count=60):
    """Of the mean error of color and opacity, over some halvings of the step.

    Where a piece lies on an edge of the mask is chance.  So this is the mean and not the RMS,
    in which a few rays hide the others, and of several steps that are almost the same.
    """
    vertices = deformed(field.mesh.rest_vertices, rng)
    directions = rng.normal(size=(ray_count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    targets = vertices.mean(axis=0) + 0.3 * vertices.std(axis=0) * rng.normal(size=(ray_count, 3))

    def image(step):
        stepped = replace(field, options=replace(field.options, march_step=step))
        color, opacity, _ = render_rays(
            stepped.definition, vertices, targets - 2.0 * directions, directions, (1.0, 1.0, 1.0)
        )
        return np.column_stack([color, opacity])

    finest = image(first_step / 2 ** (HALVINGS + 3))

    def error(step):
        return np.mean([np.abs(image(step * near) - finest).mean() for near in NEAR_STEPS])

    coarse, fine = error(first_step), error(first_step / 2**HALVINGS)
    return np.log2(coarse / fine) / HALVINGS


@pytest.mark.parametrize("occupied_share, least_order", [(0.7, 0.8), (1.0, 1.2)])
def test_the_image_converges_in_a_random_pose(make_ball_field, occupied_share, least_order):
    """Three levels, whose finest kinks are a few steps apart."""
    rng = np.random.default_rng()
    seed = int(rng.integers(10_000))
    field = make_ball_field(seed, occupied_share=occupied_share, level_count=3)
    assert convergence_order(field, rng, first_step=0.01) >= least_order


def test_where_the_field_is_smooth_the_order_is_two():
    """One tet, one level, no hidden layer for density: its logarithm is linear in a tet."""
    rng = np.random.default_rng()
    corners = np.array([[0.1, 0.1, 0.1], [0.9, 0.2, 0.1], [0.2, 0.9, 0.2], [0.3, 0.3, 0.9]])
    mesh = TetMesh(
        corners, np.round(10 * corners).astype(np.int32), np.arange(4, dtype=np.int32)[None]
    )
    options = FieldOptions(1, 2**8, (), (16,))
    field = random_field(mesh, np.full((1, 4), -1, np.int32), options, int(rng.integers(10_000)))
    assert 1.9 < convergence_order(field, rng, first_step=0.02) < 2.15
