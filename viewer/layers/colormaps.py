"""Colors for numbers: 17 colors each of matplotlib's maps, which viewing does without.

Viridis rises in lightness evenly, for what has a lowest value; coolwarm is gray in the middle,
for what lies on both sides of a normal value.
"""

import numpy as np

_HEX = {
    "viridis": "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 "
    "3fbc73 5ec962 84d44b addc30 d8e219 fde725",
    "coolwarm": "3b4cc0 4e68d8 6282ea 779af7 8db0fe a3c2fe b9d0f9 ccd9ed dddcdc ecd3c5 f5c4ac "
    "f7b093 f4987a eb7d62 dd5f4b ca3b37 b40426",
}
COLORS = {  # [17, 3] in 0..1, evenly spaced
    name: np.array([list(bytes.fromhex(color)) for color in colors.split()]) / 255.0
    for name, colors in _HEX.items()
}


def colored(name: str, shares):
    """Colors of numbers [...], 0 for the first color and 1 for the last.  [..., 3]"""
    table = COLORS[name]
    places = np.linspace(0.0, 1.0, len(table))
    return np.stack([np.interp(shares, places, channel) for channel in table.T], axis=-1)
