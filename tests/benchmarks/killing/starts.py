"""Commands that begin as a shell begins them, and get a signal in their first seconds."""

import subprocess
import sys
import time

from fuzzing.models import small_models

from .kinds import CAUGHT, Signals
from .trainings import write_data

FIRST_SECONDS = 3.0
PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # also in the background
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from deformrf.commands.entry import begin
program, *sys.argv[1:] = sys.argv[1:]
print('ready', flush=True)
sys.exit(begin(program))
"""


class Starts:
    """One line at most, and an exit code that tells of the signal; no traceback."""

    sends = Signals.sends

    def __init__(self, context, folder, rng):
        self.rng, self.told = rng, []
        (model, rigged), out, data = small_models(folder), folder / "out", folder / "data"
        write_data(data)
        self.commands = {
            "view": [model, "--headless", "--frames", 900, "--record", f"{out}.mp4"],
            "render": [model, "--turntable", 9, "-o", f"{out}.mp4"],
            "train": [data, "-o", f"{out}.npz", "--scene-radius", 1.3],
            "eval": [model, data, "--device", "cpu"],
            "report": [model, "--device", "cpu", "-o", out],
            "edit": [model, "-o", f"{out}.npz"],
            "rig": ["info", rigged],
        }

    def trials(self, count):
        names = list(self.commands)
        for number in range(count):
            name, sent = names[number % len(names)], self.sends[number % len(self.sends)]
            share = (number * 0.618 + self.rng.random() / count) % 1.0
            begun = time.monotonic()
            code, said = interrupted([name, *self.commands[name]], share * FIRST_SECONDS, sent)
            lines = [line for line in said.splitlines() if "interrupted" in line or "Error" in line]
            # Minus its number: before the command had begun, or while Python itself ended.
            good = code in (0, CAUGHT, -sent) and "Traceback" not in said and len(lines) < 2
            result = "quiet" if good else f"fault: {name}, exit code {code}: {said[-1500:]}"
            self.told.append(
                {
                    "share": round(share, 3),
                    "event": f"start of {name}",
                    "signal": sent.name,
                    "code": code,
                    "result": result,
                    "answered": round(time.monotonic() - begun - share * FIRST_SECONDS, 3),
                }
            )
            yield result


def interrupted(arguments, seconds, number):
    """Run Python, and send a signal some seconds after it is ready; exit code and stderr."""
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        for line in process.stdout:
            if line == "ready\n":
                break
        time.sleep(seconds)
        process.send_signal(number)
        _, said = process.communicate(timeout=120)
    return process.returncode, said
