"""Read, draw and play damaged files of every layout, in processes that are watched.

    python tests/benchmarks/fuzz_inputs.py --seconds 240 [--seed 7] [--kind colmap] [--out F.json]
    python tests/benchmarks/fuzz_inputs.py --again /tmp/fuzz-abc/colmap-7-311

A mutant is read, or refused with one sentence, in 5 s of processor time and 500 MB.  One that ends
otherwise (a traceback, a signal, a limit) is kept under the name that is printed, with a .json of
what was done to it, and the program ends with 1.  --put-back shows that faults are found that the
program once had: see fuzzing/old_faults.py.
"""

import argparse
import importlib
import json
import sys
import tempfile
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))

from fuzzing import old_faults, watch

KINDS = {  # name: (module of fuzzing, class)
    "transforms": ("datasets", "Transforms"),
    "masks": ("datasets", "Masks"),
    "nsvf": ("datasets", "Nsvf"),
    "points": ("datasets", "Points"),
    "colmap": ("colmap", "Colmap"),
    "sessions": ("sessions", "Sessions"),
    "autosaves": ("sessions", "Autosaves"),
    "takes": ("sessions", "Takes"),
    "models": ("models", "Models"),
    "gltf": ("rig_files", "Gltf"),
    "rigs": ("rig_files", "Rigs"),
    "blender": ("rig_files", "Blender"),
    "checkpoints": ("checkpoints", "Checkpoints"),
    "videos": ("videos", "Videos"),
    "heic": ("heic", "Heic"),
    "heic_headers": ("heic", "HeicHeaders"),
    "preferences": ("user_files", "Preferences"),
    "camera_paths": ("user_files", "CameraPaths"),
    "works": ("user_files", "Works"),
    "same_colmap": ("same", "SameColmap"),
    "same_paths": ("same", "SamePaths"),
    "same_cameras": ("same", "SameCameras"),
}


def maker(name):
    """The function that makes a kind; imports what it needs."""
    module, kind = KINDS[name]
    return getattr(importlib.import_module(f"fuzzing.{module}"), kind)


def again(folder: Path) -> int:
    """Read a mutant that was kept, here, without limits."""
    name = json.loads(folder.with_suffix(".json").read_text())["kind"]
    with tempfile.TemporaryDirectory() as bases:
        found = watch.outcome(maker(name)(Path(bases)), folder)
    print(*found, sep="\n")
    return found[0] == "fault"


def put_back(folder: Path, seed: int, seconds: float, names) -> int:
    """Look for each fault that the program once had; the exit code."""
    chosen = [one for one in old_faults.FAULTS if not names or one.name in names]
    makers, lost = {one.kind: maker(one.kind) for one in chosen}, 0
    for one in chosen:
        found, words = old_faults.find(one, makers[one.kind], seed, folder, seconds)
        lost += not found
        print(f"{one.name:24s} {one.kind:14s} {words}: {found}", flush=True)
    return bool(lost)


def table(summaries):
    """Lines of the figures of each kind."""
    heads = "mutants", "accepted", "refused", "faults"
    yield f"{'kind':14s}" + "".join(f"{head:>9s}" for head in heads) + "  slowest   largest"
    for one in summaries:
        counts = one.mutants, one.accepted, one.refused, one.faults.total()
        yield (
            f"{one.kind:14s}"
            + "".join(f"{count:9d}" for count in counts)
            + f"{one.slowest[0]:7.2f} s{one.largest[0]:7.0f} MB"
        )


def as_json(summary):
    return vars(summary) | {"mutants": summary.mutants}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="for all kinds together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=KINDS, help="again for several")
    parser.add_argument("--again", type=Path, metavar="FOLDER", help="a mutant that was kept")
    parser.add_argument(
        "--put-back", nargs="*", metavar="NAME", help="find faults that the program once had"
    )
    parser.add_argument("--out", type=Path, help="figures and faults as JSON")
    arguments = parser.parse_args()
    if arguments.again:
        sys.exit(again(arguments.again.resolve()))
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    print(f"seed {arguments.seed}, mutants with faults in {folder}", flush=True)
    if arguments.put_back is not None:
        sys.exit(put_back(folder, arguments.seed, arguments.seconds, arguments.put_back))
    chosen = arguments.kind or list(KINDS)
    summaries = []
    for name in chosen:
        make, seconds = maker(name), arguments.seconds / len(chosen)
        summary = watch.run(make, name, arguments.seed, folder, seconds)
        summaries.append(summary)
        for fault, count in summary.faults.most_common():
            place, what, _ = summary.kept[fault][0]
            print(f"{name}: {count} times {fault}; {place}: {what}", flush=True)
        for fault, count in summary.told.most_common():
            print(f"{name}: {count} refusals of {fault}", flush=True)
        if arguments.out:
            about = {"seed": arguments.seed, "kinds": [as_json(one) for one in summaries]}
            arguments.out.write_text(json.dumps(about, indent=1), encoding="utf-8")
    print(*table(summaries), sep="\n")
    sys.exit(any(one.faults for one in summaries))


if __name__ == "__main__":
    main()
