"""The stored colors are matplotlib's."""

import matplotlib
import numpy as np
import pytest

from deformrf.viewer.layers.legend import COLORS, colored


@pytest.mark.parametrize("name", COLORS)
def test_a_map_is_that_of_matplotlib(name):
    shares = np.linspace(0.0, 1.0, 256)
    wanted = matplotlib.colormaps[name](shares)[:, :3]
    assert abs(colored(name, shares) - wanted).max() < 0.035  # 17 colors instead of 256


def test_beyond_the_ends_the_colors_stay():
    np.testing.assert_array_equal(colored("viridis", [-1.0, 2.0]), COLORS["viridis"][[0, -1]])
