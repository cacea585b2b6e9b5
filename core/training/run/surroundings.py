"""The surroundings of the object in photographs without masks: training learns and then drops them.

Outside the object's box, a small field of its own (../field/grid.py) represents the world.  Every
ray has the same number of pieces in it.  Some are between the camera and the box, evenly spaced;
some are between the box and infinity, evenly spaced in contracted space.  On a ray that misses the
box, the point nearest to the box's center separates the two.  A pixel is then

    C_front + T_front (C_object + T_object (C_behind + T_behind sky))

where the sky is one trained color.  So the tets contain only what is inside the box.

Shapes: R rays, K_f + K_b pieces per ray.
"""

from functools import partial
from itertools import pairwise, starmap

import numpy as np
import torch
import warp as wp

from ...field import (
    BASIS_COUNT,
    GRID_ENTRIES,
    GRID_LEVELS,
    RESOLUTIONS,
    Surroundings,
    TorchNetworks,
    basis_of,
    basis_vector,
    contracted,
    grid_encode_backward_kernel,
    grid_encode_kernel,
    surroundings_widths,
)
from .differentiable import Composite

FRONT_PIECES, BEHIND_PIECES = 16, 48
NEAR = 0.05  # from the camera; nothing is photographed from closer [model units]
INITIAL_CONTRAST = 1e-4  # of the features
INITIAL_LOG_SIGMA = -2.0  # the object has to be seen through it
BEHIND_DISTANCE = 0.5  # from the object to what is behind it, for the distortion loss
DISTORTION_SHARE = 0.1  # of its weight elsewhere: alpha leaves less to decide there
FRONT_PRICE = 1e-2  # mean squared error that full opacity before the box has to be worth
END = 0.98  # of contracted space: the rest is the sky

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.func
def behind_distance(s: float, reach: float):
    """From where `behind` begins: s = 0 is there, s -> 1 infinitely far."""
    return reach * s / (1.0 - s)


@wp.kernel
def pieces_kernel(
    origins: wp.array(dtype=wp.vec3),  # [R]
    directions: wp.array(dtype=wp.vec3),  # [R]
    center: wp.vec3,
    half: wp.vec3,
    seed: wp.array(dtype=int),  # [1]; 0: evaluate at the middle
    first: int,  # number of ray 0: random places follow a ray's number
    points: wp.array(dtype=wp.vec3),  # [R·(K_f + K_b)] out, contracted; all in front first
    length: wp.array(dtype=float),  # out: in contracted space
    t: wp.array(dtype=float),  # out: of the middle
    basis: wp.array(dtype=basis_vector),  # out
):
    ray, k = wp.tid()
    o = origins[ray]
    d = directions[ray]
    enter = float(-1.0e30)
    leave = float(1.0e30)
    axis = int(0)
    while axis < 3:
        if wp.abs(d[axis]) > 1.0e-9:
            a = (center[axis] - half[axis] - o[axis]) / d[axis]
            b = (center[axis] + half[axis] - o[axis]) / d[axis]
            enter = wp.max(enter, wp.min(a, b))
            leave = wp.min(leave, wp.max(a, b))
        elif wp.abs(o[axis] - center[axis]) > half[axis]:
            leave = -1.0e30
        axis += 1
    if leave <= enter or leave <= 0.0:  # misses the box
        enter = wp.max(wp.dot(center - o, d), 0.0)
        leave = enter
    enter = wp.max(enter, 0.0)
    near = wp.min(float(NEAR), enter)
    reach = wp.max(half[0], wp.max(half[1], half[2]))
    index = ray * wp.static(FRONT_PIECES) + k
    low = near + (enter - near) * float(k) / float(FRONT_PIECES)
    high = near + (enter - near) * float(k + 1) / float(FRONT_PIECES)
    if k >= wp.static(FRONT_PIECES):
        j = k - wp.static(FRONT_PIECES)
        index = wp.int32(origins.shape[0]) * wp.static(FRONT_PIECES)
        index += ray * wp.static(BEHIND_PIECES) + j
        low = leave + behind_distance(float(END) * float(j) / float(BEHIND_PIECES), reach)
        high = leave + behind_distance(float(END) * float(j + 1) / float(BEHIND_PIECES), reach)
    share = float(0.5)
    if seed[0] != 0:
        place = (first + ray) * wp.static(FRONT_PIECES + BEHIND_PIECES) + k
        share = wp.randf(wp.rand_init(seed[0], (1 << 29) + place))
    points[index] = contracted(o + (low + share * (high - low)) * d, center, half)
    ends = contracted(o + high * d, center, half) - contracted(o + low * d, center, half)
    length[index] = wp.length(ends)
    t[index] = 0.5 * (low + high)
    basis[index] = basis_of(d)


class GridEncode(torch.autograd.Function):
    """features [N, G·F] = grid(points); differentiable in the table only."""

    @staticmethod
    def forward(ctx, table, points, resolutions):
        features = torch.empty(len(points), GRID_LEVELS, 4, device=table.device)
        wp.launch(
            grid_encode_kernel,
            dim=(len(points), GRID_LEVELS),
            inputs=[points, resolutions, wp.from_torch(table.detach(), dtype=wp.vec4)],
            outputs=[wp.from_torch(features, dtype=wp.vec4)],
            device=points.device,
        )
        ctx.points, ctx.resolutions, ctx.table_shape = points, resolutions, table.shape
        return features.flatten(1)

    @staticmethod
    def backward(ctx, features_grad):
        table_grad = torch.zeros(ctx.table_shape, device=features_grad.device)
        gradient = features_grad.float().reshape(-1, GRID_LEVELS, 4).contiguous()
        wp.launch(
            grid_encode_backward_kernel,
            dim=(len(ctx.points), GRID_LEVELS),
            inputs=[ctx.points, ctx.resolutions, wp.from_torch(gradient, dtype=wp.vec4)],
            outputs=[wp.from_torch(table_grad, dtype=wp.vec4)],
            device=ctx.points.device,
        )
        return table_grad, None, None


def over(front, object_color, object_opacity, behind):
    """A pixel, by the sum at the top.  torch [R, 3], [R] -> [R, 3]

    Args:
        front: Color and opacity before the object.
    """
    color, opacity = front
    seen = object_color + (1.0 - object_opacity[:, None]) * behind
    return color + (1.0 - opacity[:, None]) * seen


def surrounded_cost(weight, distortion, opacity, front_opacity):
    """The cost of rays besides their error, where no alpha tells the object apart.  torch [R]

    The distortion loss of the object alone is least without an object.  Few views allow that:
    each image can be painted on something before or behind the object that no other view sees.
    So the loss here is that of whole rays, with everything behind as one sample half a unit
    away: it makes a ray end in the object or miss it.  Matter before the box has a price.

    Args:
        weight: Weight of the distortion loss.
        distortion, opacity: Values of the object's samples.  [R]
        front_opacity: Opacity in front of the box.  [R]
    """
    whole = distortion + 2.0 * BEHIND_DISTANCE * opacity * (1.0 - opacity)
    return DISTORTION_SHARE * weight * whole + FRONT_PRICE * front_opacity


class LearnedSurroundings(torch.nn.Module):
    """The surroundings on a device, for training and for evaluation."""

    def __init__(self, start: Surroundings, device):
        super().__init__()
        self.device = wp.get_device(device)
        torch_device = wp.device_to_torch(self.device)
        self.box = start.box
        low, high = start.box
        self._center, self._half = wp.vec3(*(0.5 * (low + high))), wp.vec3(*(0.5 * (high - low)))
        self.table = torch.nn.Parameter(torch.from_numpy(start.table.copy()))
        self.networks = TorchNetworks(start.density_layers, start.color_layers)
        sky = np.clip(start.sky, 1e-3, 1 - 1e-3)
        self.sky_logit = torch.nn.Parameter(torch.from_numpy(np.log(sky / (1 - sky))).float())
        self.to(torch_device)
        self._resolutions = wp.array(RESOLUTIONS, dtype=int, device=self.device)

    def forward(self, origins, directions, seed, first_ray=0):
        """Colors of rays in front of the box and behind it.

        Args:
            origins, directions: wp.array of vec3.  [R]
            seed: Seed of the jitter, 0 for none.  wp.array of int [1]
            first_ray: Number of ray 0, which the jitter follows.

        Returns:
            (color [R, 3], opacity [R]) in front, and the color behind, sky included.  [R, 3]
        """
        rays, kinds = len(origins), FRONT_PIECES + BEHIND_PIECES
        count = rays * kinds
        # Of torch, whose memory a CUDA graph can hold.
        empty = partial(torch.empty, device=self.table.device)
        points = wp.from_torch(empty(count, 3), dtype=wp.vec3)
        length, t = wp.from_torch(empty(count)), wp.from_torch(empty(count))
        basis = empty(count, BASIS_COUNT)
        wp.launch(
            pieces_kernel,
            dim=(rays, kinds),
            inputs=[origins, directions, self._center, self._half, seed, first_ray],
            outputs=[points, length, t, wp.from_torch(basis, dtype=basis_vector)],
            device=self.device,
        )
        features = GridEncode.apply(self.table, points, self._resolutions)
        sigma, rgb = self.networks.evaluate(features, basis)
        samples, split = (sigma, rgb, length, t), rays * FRONT_PIECES
        front = self._composite(rays, FRONT_PIECES, [array[:split] for array in samples])
        color, opacity = self._composite(rays, BEHIND_PIECES, [array[split:] for array in samples])
        sky = torch.sigmoid(self.sky_logit)
        return front, color + (1.0 - opacity[:, None]) * sky

    def _composite(self, rays, pieces, samples):
        ends = torch.arange(1, rays + 1, dtype=torch.int32, device=self.table.device) * pieces
        counts = wp.from_torch(torch.full_like(ends, pieces))
        return Composite.apply(*samples, counts, wp.from_torch(ends))[:2]

    def export(self) -> Surroundings:
        density, color = self.networks.layers()
        return Surroundings(
            self.box,
            self.table.detach().cpu().numpy().copy(),
            density,
            color,
            torch.sigmoid(self.sky_logit).detach().cpu().numpy(),
        )


def random_surroundings(box, seed=0) -> Surroundings:
    """The surroundings that learning begins with: thin gray fog."""
    rng = np.random.default_rng(seed)

    def layer(fan_in, fan_out):
        weights = rng.uniform(-1, 1, (fan_in, fan_out)).astype(np.float32)
        return weights * np.float32(np.sqrt(6.0 / fan_in)), np.zeros(fan_out, np.float32)

    table = rng.uniform(-1, 1, (GRID_LEVELS * GRID_ENTRIES, 4)) * INITIAL_CONTRAST
    table, sky = table.astype(np.float32), np.full(3, 0.5, np.float32)
    density, color = (tuple(starmap(layer, pairwise(w))) for w in surroundings_widths())
    density[-1][1][0] = INITIAL_LOG_SIGMA
    return Surroundings(np.asarray(box, float), table, density, color, sky)
