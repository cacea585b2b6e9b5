"""Cut programs off at chosen moments, and look at what they leave.

    python tests/benchmarks/kills.py --count 10 [--seed 7] [--kind edit film] [--out kills.json]

SIGKILL, which no program can answer; SIGTERM, SIGHUP and SIGINT (`... signals`); two processes
that write to one place (`two ...`).  A run is measured first, and its trials cover it: by time, at
the moments at which it opens, renames or removes a file, and between these.  The file that was
there has to be whole, or the new one is; what was not there may be absent; SIGKILL alone leaves
other files, .<name>-<random>.part; what can be gone on with goes on where it was.  `starts` are
processes as a shell begins them; the others are forked from one that has imported the commands.

The windows of `live`, `sessions` and `projects` are on a screen of their own if Xvfb is there, else
left out.
"""

import argparse
import importlib
import json
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from killing.process import fork_server
from xwindow import missing_tools, screen

KINDS = {  # module and class of each
    "save": ("models", "Save"),
    "edit": ("models", "Edit"),
    "edit signals": ("models", "EditSignals"),
    "rig import": ("models", "Import"),
    "rig import signals": ("models", "ImportSignals"),
    "rig bind": ("models", "Bind"),
    "film": ("films", "Film"),
    "film signals": ("films", "FilmSignals"),
    "film of a session": ("films", "SessionFilm"),
    "recording": ("films", "Recording"),
    "recording signals": ("films", "RecordingSignals"),
    "live": ("films", "Live"),
    "sessions": ("sessions", "Sessions"),
    "sessions signals": ("sessions", "SessionSignals"),
    "projects": ("projects", "Projects"),
    "projects signals": ("projects", "ProjectSignals"),
    "report": ("reports", "WrittenReport"),
    "training": ("trainings", "Training"),
    "training signals": ("trainings", "TrainingSignals"),
    "capture": ("finding", "Finding"),
    "capture signals": ("finding", "FindingSignals"),
    "starts": ("starts", "Starts"),
    "two edits": ("pairs", "TwoEdits"),
    "two films": ("pairs", "TwoFilms"),
    "two folders of pictures": ("pairs", "TwoPictures"),
    "two trainings": ("pairs", "TwoTrainings"),
    "two captures": ("pairs", "TwoFindings"),
}
NEED_DISPLAY = {"live", *(name for name in KINDS if name.startswith(("sessions", "projects")))}


def tried(name, context, count, rng) -> dict:
    """Do the trials of a kind; returns its row of the table."""
    module, kind = KINDS[name]
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        try:
            trials = getattr(importlib.import_module(f"killing.{module}"), kind)
            trials = trials(context, Path(folder), rng)
        except Exception as error:  # one kind that can't run keeps no other from running
            print(f"{name}: fault: {error}", flush=True)
            return {"kind": name, "trials": [], "faults": 1, "seconds": 0.0}
        for result in trials.trials(count):
            if result.startswith("fault"):
                told = trials.told[-1]
                print(f"{name}, {told['signal']} {told['event']}: {result}", flush=True)
    faults = sum(told["result"].startswith("fault") for told in trials.told)
    seconds = round(time.monotonic() - begun, 1)
    return {"kind": name, "trials": trials.told, "faults": faults, "seconds": seconds}


def line_of(row) -> str:
    """A kind's line: results, exit codes, moments, the slowest answer to a signal."""
    counts, codes, shares = {}, {}, []
    for told in row["trials"]:
        result, code = told["result"].split(":")[0], str(told["code"])
        counts[result] = counts.get(result, 0) + 1
        codes[code] = codes.get(code, 0) + 1
        shares.append(min(told["share"], 1.0))
    results = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    codes = ", ".join(f"{count} x {code}" for code, count in sorted(codes.items()))
    thirds = [int(n) for n in np.histogram(shares, 3, (0.0, 1.0))[0]]
    slowest = max((told["answered"] for told in row["trials"]), default=0.0)
    return (
        f"{row['kind']}: {len(row['trials'])} trials, {results}; exit codes {codes}; moments in "
        f"the run's thirds {thirds}; slowest end {slowest:.1f} s; {row['faults']} faults "
        f"({row['seconds']:.0f} s)"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=10, help="trials of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", nargs="+", choices=KINDS, metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--out", type=Path, help="write all trials into this file, JSON")
    arguments = parser.parse_args()
    rows = []
    with ExitStack() as stack:
        home = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="kills-")))
        for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME"):  # not the user's log and preferences
            os.environ[name] = str(home / name)
        if not missing_tools():
            os.environ["DISPLAY"] = stack.enter_context(screen(home))[0]
            os.environ.pop("WAYLAND_DISPLAY", None)
        context = fork_server()
        for name in arguments.kind or KINDS:
            if name in NEED_DISPLAY and "DISPLAY" not in os.environ:
                print(f"{name}: left out, there is no display", flush=True)
                continue
            rng = np.random.default_rng([arguments.seed, list(KINDS).index(name)])
            rows.append(tried(name, context, arguments.count, rng))
            print(line_of(rows[-1]), flush=True)
    trials, faults = sum(len(row["trials"]) for row in rows), sum(row["faults"] for row in rows)
    print(f"{trials} trials, {faults} faults, seed {arguments.seed}")
    if arguments.out:
        arguments.out.write_text(json.dumps({"seed": arguments.seed, "kinds": rows}, indent=1))
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
