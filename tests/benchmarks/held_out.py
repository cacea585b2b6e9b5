"""What a sector of views costs beside as many views held out here and there.

    python tests/benchmarks/held_out.py DATA ... [--device cuda:0] [--preset default] [--steps N]
        [--image-size PIXELS] [--views N] [--seed N] [--lpips-weights FILE] [--json FILE]

Of each data set two models are trained: without the training views of a sector of 60° (as deformrf
train --hold-out sector), and without every n-th training view, as many.  A row has the scores of
what its model was not trained on, with the angle to the nearest training view, and then those of
the data set's own test views in that sector and elsewhere: the same for both models.  What is
scored is what a model file with one-byte entries holds, with four rays a pixel.

FILE is the table, as those in docs/results are; beside it is FILE-scores.json with the scores of
each view.  Both are written after each row.
"""

import argparse
import json
import shlex
import sys
import tempfile
from dataclasses import asdict, replace
from datetime import date
from pathlib import Path

import numpy as np

from deformrf.commands.train_choices import with_steps
from deformrf.core.base.device import start_warp
from deformrf.core.field import load, save
from deformrf.core.training import (
    SECTOR,
    Lpips,
    evaluate,
    find_sector,
    list_images,
    load_dataset,
    name_of,
    preset,
    train,
)

DECIBELS = {"format": ".2f"}
COLUMNS = [
    "data",
    "held out",
    {"name": "trained on", "format": "d"},
    {"name": "scored", "format": "d"},
    {"name": "angle to the nearest, median [°]", "format": ".1f"},
    {"name": "largest [°]", "format": ".1f"},
    {"name": "PSNR [dB]", **DECIBELS},
    {"name": "SSIM", "format": ".4f"},
    {"name": "LPIPS", "format": ".4f"},
    {"name": "test views in the sector [dB]", **DECIBELS},
    {"name": "elsewhere [dB]", **DECIBELS},
]


def held_out(data) -> dict:
    """By name, the sector, and the same with every n-th view instead of its own."""
    sector = find_sector(data)
    names = [name_of(Path(data), image) for image in list_images(Path(data), "train").images]
    count = len(sector.views)
    places = (np.arange(count) + 0.5) * len(names) / count
    others = tuple(names[int(place)] for place in places)
    return {"sector": sector, f"every {len(names) / count:.1f}th": replace(sector, views=others)}


def trained_without(held, data, arguments):
    """The field of a model file that was trained without these views, and the run's seconds."""
    options = preset(arguments.preset, seed=arguments.seed)
    if arguments.steps is not None:
        options = with_steps(options, arguments.steps)
    views = load_dataset(data, "train", arguments.image_size, sector=held)
    trained = train(views, options, arguments.device)
    if trained.diverged:
        raise SystemExit(f"{data}: {trained.diverged}")
    if not trained.complete:
        raise KeyboardInterrupt
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        save(replace(trained.field, surroundings=None), path, entry_bits=8)
        field = replace(load(path), surroundings=trained.field.surroundings)
    facts = {
        "seconds": trained.report["seconds"],
        "tets": trained.field.mesh.tet_count,
        "device": trained.report["device"],
        "options": asdict(options),
    }
    return field, views.view_count, facts


def measured(name, held, data, arguments, lpips) -> dict:
    """One model's scores, plain JSON values."""
    field, view_count, facts = trained_without(held, data, arguments)

    def scored(split, most=None):
        views = load_dataset(data, split, arguments.image_size, most, sector=held)
        return evaluate(field, views, device=arguments.device, lpips=lpips)

    held_scores, test = scored(SECTOR), scored("test", arguments.views)
    if not held_scores["complete"] or not test["complete"]:
        raise KeyboardInterrupt
    return {
        "data": Path(data).resolve().name,
        "held_out": name,
        "view_count": view_count,
        "begin": held.begin,
        "scores": {"held_out": held_scores, "test": test},
        **facts,
    }


def cells(row) -> list:
    """The row of the table."""
    held, test = row["scores"]["held_out"], row["scores"]["test"]["sector"]
    angles = held["angles"] or {"median": None, "largest": None}
    mean = held["mean"]
    return [
        row["data"],
        row["held_out"],
        row["view_count"],
        held["view_count"],
        *(angles["median"], angles["largest"]),
        *(mean["psnr"], mean["ssim"], mean["lpips"]),
        *(test[part]["mean"]["psnr"] for part in ("inside", "outside")),
    ]


def shown(values) -> str:
    formats = [column.get("format", "") if isinstance(column, dict) else "" for column in COLUMNS]
    pairs = zip(values, formats, strict=True)
    return "".join(f"{'-' if value is None else format(value, form):>13}" for value, form in pairs)


def write(path, measured_rows):
    """The table and all scores; a column without any value is left out."""
    rows = [cells(row) for row in measured_rows]
    used = [i for i in range(len(COLUMNS)) if any(row[i] is not None for row in rows)]
    table = {
        "title": "A sector held out, and every n-th view",
        "command": shlex.join(["python", "tests/benchmarks/held_out.py", *sys.argv[1:]]),
        "hardware": measured_rows[0]["device"],
        "date": date.today().isoformat(),
        "commit": None,
        "columns": [COLUMNS[i] for i in used],
        "rows": [[row[i] for i in used] for row in rows],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    for place, content in ((path, table), (path.with_stem(f"{path.stem}-scores"), measured_rows)):
        text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
        place.write_text(text, encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--preset", default="default", choices=("default", "fast", "small", "tiny"))
    parser.add_argument("--steps", type=int, help="of both stages together")
    parser.add_argument("--image-size", type=int)
    parser.add_argument("--views", type=int, help="test views to score")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lpips-weights", type=Path, help="as of deformrf eval")
    parser.add_argument("--json", type=Path, default=Path("out/held_out.json"))
    arguments = parser.parse_args()
    start_warp()
    lpips = arguments.lpips_weights and Lpips(arguments.lpips_weights, arguments.device)
    headings = ("data", "held out", "trained on", "scored", "median [°]", "largest [°]")
    headings += ("PSNR [dB]", "SSIM", "LPIPS", "test inside", "elsewhere")
    print("".join(f"{heading:>13}" for heading in headings))
    rows = []
    for data in arguments.data:
        for name, held in held_out(data).items():
            rows.append(measured(name, held, data, arguments, lpips))
            print(shown(cells(rows[-1])), flush=True)
            write(arguments.json, rows)


if __name__ == "__main__":
    main()
