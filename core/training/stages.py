"""Options of the fields that the two stages train."""

from dataclasses import replace

from ..field import FieldOptions
from .train_options import TrainOptions

COARSE_LEVELS = 4
COARSE_STEP_FACTOR = 2.0  # Δ of stage 1 over Δ of stage 2
# Learning rates at a stage's end, as shares of the highest.  At a higher one in stage 1 densities
# still come and go, and some that no ray has met become matter far from the object.  Stage 2 ends
# with averaged weights, which need rates that keep the steps apart.
FINAL_RATES = {1: 0.1, 2: 0.6}
# Hidden layers of the color network where each sample has a color, and in stage 1.  Wider ones find
# colors before there are densities, and stage 1 ends with nothing if it is short.
SMALL_COLOR = 64, 64


def field_options(options: TrainOptions) -> FieldOptions:
    deferred = "ray-color" not in options.leave_out
    hidden = (options.color_width,) * options.color_depth if deferred else SMALL_COLOR
    return FieldOptions(
        level_count=options.level_count,
        table_size=2**options.table_size_log2,
        march_step=options.march_step,
        view_dependence=options.view_dependence,
        deferred=deferred,
        color_hidden=hidden,
        dense_levels="dense-levels" not in options.leave_out,
    )


def coarse_options(options: TrainOptions) -> FieldOptions:
    """The field of stage 1."""
    fine = field_options(options)
    return replace(
        fine,
        level_count=min(COARSE_LEVELS, options.level_count),
        march_step=COARSE_STEP_FACTOR * fine.march_step,
        color_hidden=SMALL_COLOR,
    )
