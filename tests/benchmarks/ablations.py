"""What each part of the method is worth: the same training without it, scored on test views.

    python tests/benchmarks/ablations.py DATA [--device cuda:0] [--preset fast] [--steps N]
        [--views 20] [--image-size PIXELS] [--only NAME ...] [--out out/ablations]

Names: the rows of ROWS; all of them if none is given.  Prints a table and writes
ablations.json and ablations.png; rows that an earlier call with the same settings wrote there
are kept, so the work may be split.  What is scored is what a model file with one-byte entries
holds.  Seconds are those of training, after a short run that loads the kernels.  One run a row:
differences below 0.2 dB mean nothing.
"""

import argparse
import gc
import json
import tempfile
from dataclasses import asdict, replace
from pathlib import Path

import torch

from deformrf.commands.train_choices import with_steps
from deformrf.core.base.device import start_warp
from deformrf.core.field import modelfile
from deformrf.core.training import DatasetError, load_dataset, preset, trainer
from deformrf.core.training import evaluation as evaluate

WHOLE = "whole method"
LEVELS = {f"L = {count}": {"level_count": count} for count in range(1, 8)}
ROWS = {
    WHOLE: {},
    **LEVELS,
    "one stage": {"leave_out": ("coarse-stage",)},  # with the steps of both
    "occupancy per tet": {"leave_out": ("subtet-mask",)},
    "all levels hashed": {"leave_out": ("dense-levels",)},
    "no distortion loss": {"leave_out": ("distortion",)},
    "colors of samples": {"leave_out": ("ray-color",)},
    "no view dependence": {"view_dependence": False},
}
WARM_UP_STEPS = 32
HEADINGS = ("PSNR", "SSIM", "seconds", "tets", "occupied", "GiB 1", "GiB 2", "MB")


def row_options(name, base):
    options = replace(base, **ROWS[name])
    if "coarse-stage" in options.leave_out:
        options = replace(options, fine_steps=base.coarse_steps + base.fine_steps)
    return options


def warm_up(options, train_views, device):
    """Load the kernels.  In one stage, which needs to find nothing."""
    short = replace(options, fine_steps=WARM_UP_STEPS, leave_out=("coarse-stage",))
    trainer.train(train_views, short, device)


def measure(options, train_views, test_views, device):
    """Train, write, read, score: a row of plain JSON values.

    Raises:
        DatasetError, MemoryError: Stage 1 finds nothing; the GPU is too small.
        KeyboardInterrupt: Also if it came while training or scoring.
    """
    gc.collect()  # peak memory is this row's alone
    if device != "cpu":
        torch.cuda.empty_cache()
    trained = trainer.train(train_views, options, device)
    if trained.interrupted:
        raise KeyboardInterrupt
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        modelfile.save(replace(trained.field, surroundings=None), path, entry_bits=8)
        size = path.stat().st_size
        field = replace(modelfile.load(path), surroundings=trained.field.surroundings)
    scores = evaluate.evaluate(field, test_views, device=device, samples=1)
    if not scores["complete"]:
        raise KeyboardInterrupt
    report = trained.report
    return {
        "psnr": scores["mean"]["psnr"],
        "ssim": scores["mean"]["ssim"],
        "seconds": report["seconds"],
        "tets": report["tet_count"],
        "occupied_share": report["occupied_share"],
        "peak_memory_bytes": report.get("peak_memory_bytes"),
        "model_bytes": size,
        "diverged": trained.diverged,
        "device": report["device"],
        "options": plain(asdict(options)),
    }


def plain(values):
    """As JSON gives them back: lists for tuples."""
    return json.loads(json.dumps(values))


def earlier_rows(path, settings):
    """The rows that a call with the same settings has written."""
    if not path.is_file():
        return {}
    result = json.loads(path.read_text(encoding="utf-8"))
    return result["rows"] if result["settings"] == settings else {}


def line(row):
    memory = row["peak_memory_bytes"] or (None, None)
    gibibytes = ("-" if not used else f"{used / 2**30:.2f}" for used in memory)
    cells = (
        f"{row['psnr']:.2f}",
        f"{row['ssim']:.4f}",
        f"{row['seconds']:.1f}",
        row["tets"],
        f"{row['occupied_share']:.3f}",
        *gibibytes,
        f"{row['model_bytes'] / 1e6:.2f}",
    )
    return "".join(f"{cell:>10}" for cell in cells)


def plot(rows, path):
    """PSNR over the number of levels, and what the other rows lose to the whole method."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4), layout="constrained")
    levels = [name for name in LEVELS if name in rows]
    counts = [LEVELS[name]["level_count"] for name in levels]
    left.plot(counts, [rows[name]["psnr"] for name in levels], "o-")
    left.set(xlabel="levels L", ylabel="PSNR [dB]", title="Levels", xticks=range(1, 8))
    left.grid(alpha=0.3)
    if WHOLE in rows:
        others = [name for name in ROWS if name in rows and name not in (WHOLE, *LEVELS)]
        bars = right.barh(others, [rows[n]["psnr"] - rows[WHOLE]["psnr"] for n in others])
        right.bar_label(bars, fmt="%+.2f", padding=3)
        right.axvline(0.0, color="black", linewidth=0.8)
        right.margins(x=0.2)
        right.invert_yaxis()
        right.set(xlabel="PSNR beside the whole method [dB]", title="Parts")
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--preset", default="fast", choices=("fast", "tiny", "default"))
    parser.add_argument("--steps", type=int, help="of both stages together")
    parser.add_argument("--views", type=int, default=20, help="test views to score")
    parser.add_argument("--image-size", type=int)
    parser.add_argument("--only", nargs="+", default=list(ROWS), choices=ROWS, metavar="NAME")
    parser.add_argument("--out", type=Path, default=Path("out/ablations"))
    arguments = parser.parse_args()
    start_warp()
    base = preset(arguments.preset)
    if arguments.steps is not None:
        base = with_steps(base, arguments.steps)
    train_views = load_dataset(arguments.data, "train", arguments.image_size)
    test_views = load_dataset(arguments.data, "test", arguments.image_size, arguments.views)
    settings = {
        "data": Path(arguments.data).resolve().name,
        "image_size": arguments.image_size,
        "views": test_views.view_count,
        "device": arguments.device,
        "base": plain(asdict(base)),
    }
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "ablations.json"
    rows = earlier_rows(path, settings)
    warm_up(base, train_views, arguments.device)
    print(f"{'':<20}" + "".join(f"{heading:>10}" for heading in HEADINGS))
    made = []
    for name in arguments.only:
        options = row_options(name, base)
        same = [n for n in made if rows[n]["options"] == plain(asdict(options))]
        try:
            if same:
                rows[name] = rows[same[0]]
            else:
                rows[name] = measure(options, train_views, test_views, arguments.device)
        except (DatasetError, MemoryError) as error:
            print(f"{name:<20}  {error}")
            continue
        except KeyboardInterrupt:
            break
        made.append(name)
        print(f"{name:<20}{line(rows[name])}", flush=True)
        ordered = {known: rows[known] for known in ROWS if known in rows}
        result = {"settings": settings, "rows": ordered}
        path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if len(rows) > 1:
        plot(rows, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
