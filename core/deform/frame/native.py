"""Wrap cpu.cpp and cuda.cu in Warp kernels whose arguments differ only in scratch's type."""

from pathlib import Path

import warp as wp

from ...base.native import native_source
from ...definition.contact import CONTACT_SHARE_OUT, CONTACT_SLACK
from ...definition.solver import COLLAPSED, STEP_LIMIT
from ..arrays import FrameArrays
from ..colliders import COLLIDER_SIZE
from ..constraints import CONTACT_LOAD_UNIT, LEAVING_SPEED, PRESS_SHARE

FOLDER = Path(__file__).parent


def native_kernel(name: str, scratch_type, values: dict, **options):
    """A kernel whose body is a file's text, with substep.h and contact.h in their places.

    Args:
        scratch_type: A struct of arrays that the file uses besides FrameArrays.
        values: What stands for @NAME in the text, by NAME.
        options: Options of wp.kernel.
    """
    limits = {
        "COLLAPSED": COLLAPSED,
        "STEP_LIMIT": STEP_LIMIT,
        "PRESS_SHARE": PRESS_SHARE,
        "LEAVING_SPEED": LEAVING_SPEED,
        "CONTACT_LOAD_UNIT": float(CONTACT_LOAD_UNIT),
        "CONTACT_SHARE_OUT": CONTACT_SHARE_OUT,
        "CONTACT_SLACK": CONTACT_SLACK,
    }
    values = values | {name: f"{value}f" for name, value in limits.items()}
    values["COLLIDER_SIZE"] = COLLIDER_SIZE
    shared = [FOLDER / "substep.h", FOLDER / "contact.h"]
    source = native_source(FOLDER / name, shared, values)

    @wp.func_native(source)
    def frame_native(
        frame: FrameArrays,
        scratch: scratch_type,
        substep_count: int,
        has_volumes: int,
        has_springs: int,
        has_ground: int,
        has_free: int,
        collider_count: int,
        has_contacts: int,
        thread: int,
        thread_count: int,
    ): ...

    @wp.kernel(grid_stride=False, enable_backward=False, **options)
    def frame_kernel(
        frame: FrameArrays,
        scratch: scratch_type,
        substep_count: int,
        has_volumes: int,
        has_springs: int,
        has_ground: int,
        has_free: int,
        collider_count: int,
        has_contacts: int,
        thread: int,  # of a CPU; a GPU ignores it
        thread_count: int,
    ):
        frame_native(
            frame,
            scratch,
            substep_count,
            has_volumes,
            has_springs,
            has_ground,
            has_free,
            collider_count,
            has_contacts,
            thread,
            thread_count,
        )

    return frame_kernel
