"""How to render."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RenderOptions:
    """How to render.

    Attributes:
        background: Color behind the object, 0..1.
        conformance: Equal the reference (float32, stop at T < 1e-3); otherwise stop
            earlier and, on CUDA, evaluate the networks in half precision.
        step_factor: Of the model's Δ: with less, an image takes longer and is closer to the
            integral that the sum stands for.
        level_count: Levels that are encoded, all by default; the finer ones count as zero.
        termination: Transmittance below which a ray ends; None for the mode's own.
        single_precision: Evaluate the networks in float32 on CUDA, too.
        layers: Take every ray the way that rays take where the mesh overlaps itself.
        details: Also tell each pixel's tet and number of samples.
    """

    background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    conformance: bool = False
    step_factor: float = 1.0
    level_count: int | None = None
    termination: float | None = None
    single_precision: bool = False
    layers: bool = False
    details: bool = False

    @property
    def half(self) -> bool:
        """Whether networks may be evaluated in half precision; on the CPU they never are."""
        return not (self.conformance or self.single_precision)

    @property
    def stop(self) -> float:
        """Transmittance below which a ray ends.

        In default mode what is behind a ray's end is taken to look like what is before it,
        which makes a large value harmless: at 2e-2 64 to 67 dB against 49 to 56 without.
        """
        if self.termination is not None:
            return self.termination
        return 1e-3 if self.conformance else 3e-2


def checked(options: RenderOptions | None, level_count: int) -> RenderOptions:
    """The options, or the default ones, for a field of so many levels.

    Raises:
        ValueError: The field has no so many levels, the step is none, or rays would end
            before they begin.
    """
    options = options or RenderOptions()
    if options.level_count is not None and not 1 <= options.level_count <= level_count:
        raise ValueError(
            f"level_count is {options.level_count}; the field has {level_count} levels"
        )
    if not options.step_factor > 0.0:
        raise ValueError(f"step_factor is {options.step_factor}; give a positive number")
    if not 0.0 <= options.stop < 1.0:
        raise ValueError(f"termination is {options.stop}; give a number from 0 to below 1")
    return options
