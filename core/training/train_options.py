"""Training options: one dataclass, four presets.  Imports nothing slow."""

from dataclasses import dataclass, replace
from typing import Any

LEAVE_OUT = (
    "coarse-stage",
    "subtet-mask",
    "dense-levels",
    "ray-color",
    "distortion",
    "table-decay",
    "strong-decay",
    "depth-cost",
    "found-box",
    "isolation",
    "exposure",
    "blur-weights",
)


WIDEST, DEEPEST = 256, 4  # layers of the color network: a file may hold so many weights


@dataclass(frozen=True)
class TrainOptions:
    """Settings of a training run; lengths are in model units (the scene box has edge 1).

    Attributes:
        aabb: The object's box in the data's space, lowest and highest corner; see scene_box.py.
        scene_radius: The box from -r to r, if there is no aabb; None leaves it to the data.
        spacing: dx of the A15 grid of stage 1 (the paper's 0.02).
        coarse_steps: Optimizer steps of stage 1, which finds the occupied tets.
        fine_steps: Optimizer steps of stage 2, on the kept tets with all levels.
        level_count: Nested levels of the model.
        table_size_log2: Entries of a hashed level.
        march_step: Δ, rest length of a quadrature piece.
        samples_per_step: Samples that an optimizer step aims at, on all GPUs together; the ray
            count follows.
        learning_rate: Adam's highest learning rate; decays along a cosine.
        surroundings: Surroundings of the object: "white" (or cut out by alpha), "learnt"
            beside it, or "auto": learned where images have neither alpha nor a white border.
        view_dependence: Whether color may depend on the direction.
        color_width: Of the color network's hidden layers in stage 2.  It is 64 in stage 1, and
            where samples have colors.
        color_depth: Number of these layers, two where samples have colors.
        distortion: Weight of the distortion loss (the paper's 1e-2).
        table_decay: Weight of the squares of features, times the number of pixels that are
            drawn from, see loss.py; against noise.
        strong_decay: The same, with which stage 2 is tried, see beginnings.py; 0: it isn't tried.
        depth_cost: Weight of the cost of depth with which stage 2 is tried, likewise.
        leave_out: What of the method that this scene is learned without, of LEAVE_OUT:
            "found-box": the object isn't sought, its box lies where the cameras look;
            "isolation": what it stands and leans on isn't cut off (meant.py);
            "coarse-stage": all fine_steps go to all levels on the whole grid, which the model
            then holds; "subtet-mask": a tet is occupied wholly or not at all; "dense-levels":
            every level is hashed; "ray-color": each sample has a color of its own, and a ray the
            sum of them (FieldOptions.deferred); "distortion", "table-decay", "depth-cost": the
            loss has no such term; "strong-decay": it isn't tried; "exposure": photographs have no
            color maps (run/exposure.py); "blur-weights": blurred photographs count as much as
            sharp ones.
        seed: Seed of all random choices.
    """

    aabb: tuple[float, ...] | None = None
    scene_radius: float | None = None
    spacing: float = 0.02
    coarse_steps: int = 1500
    fine_steps: int = 21000
    level_count: int = 7
    table_size_log2: int = 20
    march_step: float = 0.0013
    samples_per_step: int = 2**19
    learning_rate: float = 1e-2
    surroundings: str = "auto"
    view_dependence: bool = True
    color_width: int = 256
    color_depth: int = 3
    distortion: float = 1e-2
    table_decay: float = 0.1
    strong_decay: float = 8.0
    depth_cost: float = 0.05
    leave_out: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self):
        if not 1 <= self.color_width <= WIDEST:
            raise ValueError(f"color_width is {self.color_width}: give 1 to {WIDEST}")
        if not 0 <= self.color_depth <= DEEPEST:
            raise ValueError(f"color_depth is {self.color_depth}: give 0 to {DEEPEST}")
        for word in self.leave_out:
            if word not in LEAVE_OUT:
                words = ", ".join(LEAVE_OUT)
                raise ValueError(f"there is no '{word}' to leave out; choose from {words}")


PRESETS = {
    "default": TrainOptions(),
    "fast": TrainOptions(
        coarse_steps=1000, fine_steps=12000, color_depth=2, strong_decay=0.0, depth_cost=0.0
    ),
    "small": TrainOptions(
        fine_steps=15000,
        level_count=6,
        table_size_log2=18,
        march_step=0.002,
        samples_per_step=2**18,
        color_width=128,
        color_depth=2,
    ),
    "tiny": TrainOptions(
        spacing=0.04,
        coarse_steps=300,
        fine_steps=600,
        level_count=4,
        table_size_log2=16,
        march_step=0.005,
        samples_per_step=2**15,
        learning_rate=2e-2,
        color_width=64,
        color_depth=2,
        strong_decay=0.0,
        depth_cost=0.0,
    ),
}


def preset(name: str, **changes: Any) -> TrainOptions:
    """A preset with some fields replaced.

    Raises:
        ValueError: There is no such preset.
    """
    if name not in PRESETS:
        raise ValueError(f"there is no preset '{name}'; choose one of {', '.join(PRESETS)}")
    return replace(PRESETS[name], **changes)
