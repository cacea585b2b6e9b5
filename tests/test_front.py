"""Merged pieces that a ray can't see are not shaded, and the image stays the defined one."""

from dataclasses import replace

import numpy as np

from deformrf.core.render import Renderer, RenderOptions, from_field_of_view, look_at, reference
from deformrf.core.render.rays.camera import camera_rays


def test_a_camera_inside_a_fold_shades_what_it_sees(make_ball_field):
    field = make_ball_field(3, occupied_share=1.0, march_step=0.004)
    weights, bias = field.density_layers[-1]
    bias = bias + np.float32([4.0] + [0.0] * (len(bias) - 1))  # opaque after a few pieces
    field = replace(field, density_layers=(*field.density_layers[:-1], (weights, bias)))
    vertices = field.mesh.rest_vertices.copy()
    low, high = vertices[:, 0].min(), vertices[:, 0].max()
    thirds = 3.0 * (vertices[:, 0] - low) / (high - low)
    vertices[:, 0] = low + (np.abs((thirds + 1) % 2 - 1) + 0.02 * thirds) * (high - low) / 3
    vertices = vertices.astype(np.float32)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    camera = from_field_of_view(look_at(middle, middle + np.array([0.1, 0.5, 0.2])), 0.9, 12, 12)
    renderer = Renderer(field, "cpu")
    renderer.set_vertices(vertices)
    origins, directions = camera_rays(camera)
    expected, _, _ = reference.render_rays(field, vertices, origins, directions, (1, 1, 1))
    found, _, _ = renderer.render_rays(origins, directions, RenderOptions(conformance=True))
    off = 255.0 * np.abs(found - expected).max(axis=1)
    assert off.mean() <= 0.3 and (off > 2.0).mean() <= 0.02
    image = renderer.render(camera, RenderOptions(conformance=True, details=True))
    assert image.sample_count < 0.6 * image.samples.numpy().sum()
