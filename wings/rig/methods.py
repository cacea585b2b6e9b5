"""The names of the ways to move vertices by bones (skinning.py); imported without Warp."""

from typing import Literal, get_args

Method = Literal["linear", "dual quaternion"]
METHODS: tuple[Method, ...] = get_args(Method)


def check_method(method: str):
    if method not in METHODS:
        raise ValueError(f"skinning is {method!r}; it can be {' or '.join(METHODS)}")
