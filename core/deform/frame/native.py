"""Kernels around cpu.cpp and cuda.cu: both take the same arguments."""

from pathlib import Path

import warp as wp

from ..arrays import FrameArrays
from ..constraints import COLLAPSED, STEP_LIMIT

FOLDER = Path(__file__).parent
SHARED = "substep.h"


def native_source(name: str, **values) -> str:
    """A file's text with substep.h in its place and a value for each @NAME."""
    text = (FOLDER / name).read_text(encoding="utf-8")
    shared = (FOLDER / SHARED).read_text(encoding="utf-8")
    text = text.replace(f'#include "{SHARED}"\n', shared)
    values |= {"COLLAPSED": f"{COLLAPSED}f", "STEP_LIMIT": f"{STEP_LIMIT}f"}
    for key, value in values.items():
        text = text.replace(f"@{key}", str(value))
    return text


def native_kernel(source: str, scratch_type, **options):
    """A kernel whose body is the source.

    Args:
        scratch_type: A struct of arrays that the source uses besides FrameArrays.
        options: Options of wp.kernel.
    """

    @wp.func_native(source)
    def frame_native(
        frame: FrameArrays,
        scratch: scratch_type,
        substep_count: int,
        has_volumes: int,
        has_springs: int,
        has_ground: int,
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
            thread,
            thread_count,
        )

    return frame_kernel
