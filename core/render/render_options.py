"""Rendering options and view modes.  Imports nothing slow, so --help answers at once."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

Mode = Literal["color", "depth", "accumulation", "normals", "tets", "levels", "samples", "error"]
MODES: tuple[Mode, ...] = get_args(Mode)  # described in modes.py

RayPath = Literal["auto", "host", "merge"]


@dataclass(frozen=True)
class RenderOptions:
    """Options of an image.

    Attributes:
        background: Color behind the object, 0..1.
        conformance: Equal the reference (float32, stop at T < 1e-3).  Otherwise rays stop
            earlier; the networks are evaluated in half precision (float16 on CUDA, bfloat16 on
            processors that multiply it); on a CPU, where samples have colors, those that weigh
            less than a byte's step lend their weight to the next.
        step_factor: Multiplies the model's march step Δ.  A smaller step takes longer and
            comes closer to the integral that the sum approximates.
        level_count: Levels that are encoded, all by default; the features of finer ones are 0.
        termination: Transmittance below which a ray ends; None for the mode's default.
        single_precision: Evaluate the networks in float32 everywhere.
        path: Path from rays to pixels.  "auto": the fastest path that the device and the other
            options allow, with tangled rays merged.  "host": rounds that the host waits for,
            as on the CPU, even where CUDA has a wavefront.  "merge": every ray is rendered as
            tangled rays are.
        details: Also return each pixel's tet and number of samples.  The wavefront counts
            neither, so "auto" then takes the path "host".
    """

    background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    conformance: bool = False
    step_factor: float = 1.0
    level_count: int | None = None
    termination: float | None = None
    single_precision: bool = False
    path: RayPath = "auto"
    details: bool = False

    @property
    def half(self) -> bool:
        """Whether networks may be evaluated in half precision, where the device has it."""
        return not (self.conformance or self.single_precision)


def default_stop(deferred: bool, conformance: bool = False) -> float:
    """Transmittance below which a ray ends by default.

    Default mode assumes that what is behind the end of a ray looks like what is before it.  Where
    samples have colors, that allows a large value: at 2e-2 images reach 64 to 67 dB with the
    assumption and 49 to 56 dB without.  Where a ray has one color (`deferred`), what is behind may
    have any h, however little it weighs: in four models pixels are off by up to 99/255 at 3e-2, by
    10 at 3e-3 and by 6 at 2e-3.
    """
    if conformance:
        return 1e-3
    return 2e-3 if deferred else 3e-2


def checked(options: RenderOptions | None, field_options) -> RenderOptions:
    """The options, or the default ones, for a field with FieldOptions.

    `termination` is not None then.

    Raises:
        ValueError: level_count is not in 1..level_count of the field, step_factor is not
            positive, termination is not in [0, 1), or path is unknown.
    """
    options = options or RenderOptions()
    level_count = field_options.level_count
    if options.termination is None:
        stop = default_stop(field_options.deferred, options.conformance)
        options = replace(options, termination=stop)
    if options.level_count is not None and not 1 <= options.level_count <= level_count:
        raise ValueError(
            f"level_count is {options.level_count}; the field has {level_count} levels"
        )
    if not 0.0 < options.step_factor < float("inf"):
        raise ValueError(f"step_factor is {options.step_factor}; give a positive number")
    if not 0.0 <= options.termination < 1.0:
        raise ValueError(f"termination is {options.termination}; give a number from 0 to below 1")
    if options.path not in get_args(RayPath):
        raise ValueError(f'path is "{options.path}"; take one of {", ".join(get_args(RayPath))}')
    return options
