"""Checkpoints: torch's files, with the values of what is pickled, and lists that share lists."""

import io
import pickle
import zipfile
from types import SimpleNamespace

import numpy as np
import torch

from deformrf.commands.train_choices import check_resumed_views
from deformrf.core.geometry import a15_grid
from deformrf.core.render import Lens
from deformrf.core.training import CheckpointError, load_checkpoint, preset
from deformrf.core.training.finding import FoundBox
from deformrf.core.training.run.checkpoint import Checkpoint, save_checkpoint

from .damage import Binary, with_structure, with_values

NAME = "a.checkpoint"


def shared(rng, depth):
    """A value whose parts share parts: small in a file, and longer by the factor 2 a step."""
    kind, value = int(rng.integers(4)), "a"
    for _ in range(depth):
        value = [[value, value], (value, value), {"a": value, "b": value}, [value] * 3][kind]
    return value


def circular():
    value = []
    value += [value, {"a": value}]
    return value


class Checkpoints:
    """One of a tiny run."""

    errors = (CheckpointError, ValueError)  # the latter of other photographs

    def __init__(self, folder):
        fit = {"number": 7, "parameters": [torch.arange(30.0)]}
        report = {"seconds": 1.0, "view_count": 3, "image_size": [9, 9], "history": []}
        run = Checkpoint(preset("tiny"), 2, a15_grid(0.25), fit, np.eye(4), report)
        save_checkpoint(run, folder / NAME)
        self.data = (folder / NAME).read_bytes()
        self.content = torch.load(folder / NAME, weights_only=True)
        parts = [at for at in range(len(self.data)) if self.data[at : at + 2] == b"PK"]
        counts = tuple((at + 18 + i, "<I") for at in parts[:-2] for i in (0, 4, 8))
        self.binary = Binary(self.data, counts, tuple(parts))
        lens = Lens(9, 9, (9.0, 9.0), (4.5, 4.5))
        self.views = SimpleNamespace(view_count=3, lenses=(lens,))

    def original(self, folder):
        (folder / NAME).write_bytes(self.data)

    def mutate(self, rng, folder):
        kind = int(rng.integers(10))
        if kind <= 2:
            data, what = with_structure(rng, self.binary, self.data[len(self.data) // 2 :])
        elif kind == 3:
            data, what = self._with_pickle(rng)
        elif kind <= 6:
            data, what = self._with_shared(rng)
        else:
            data, what = self._with_values(rng)
        (folder / NAME).write_bytes(data)
        return what

    def read(self, folder):
        checkpoint = load_checkpoint(folder / NAME)
        check_resumed_views(checkpoint.report, self.views)
        FoundBox.of_report(checkpoint.report)

    def _with_values(self, rng):
        content = with_values(rng, {k: v for k, v in self.content.items() if k != "mesh"})
        mesh, what = [tensor.clone() for tensor in self.content["mesh"]], "values"
        kind = int(rng.integers(4))
        if kind == 0:
            tensor = mesh[rng.integers(3)].view(-1)
            tensor[rng.integers(len(tensor))] = int(rng.choice([-1, 2**31 - 1, 0, 2**15]))
        elif kind == 1:  # one number, seen very often
            many = int(rng.choice([10**3, 10**9, 10**12]))
            mesh[rng.integers(3)] = torch.zeros(1).expand(many, 3)
            what = f"a tensor of {many} rows that is one number"
        elif kind == 2:
            mesh = [mesh[0]] * int(rng.choice([1, 3, 10_000]))
        return _saved({"mesh": mesh} | content), what

    def _with_shared(self, rng):
        """Somewhere in it a list doubles at every step, or holds itself."""
        content = dict(self.content)
        depth = int(rng.choice([5, 20, 25, 28, 32, 60, 400]))
        value = circular() if rng.random() < 0.1 else shared(rng, depth)
        if rng.random() < 0.5:
            options = dict(content["options"])
            name = list(options)[rng.integers(len(options))]
            content["options"] = options | {name: value}
        else:
            name = list(content)[rng.integers(len(content))]
            content[name] = value
        return _saved(content), f"{name} is shared {depth} times"

    def _with_pickle(self, rng):
        """Another pickle in the same zip."""
        kind, depth = int(rng.integers(5)), int(rng.choice([1000, 100_000]))
        if kind == 0:
            text = b"\x80\x02" + b"]" * depth + b"a" * (depth - 1) + b"."
        elif kind == 1:  # each step refers to the one before
            text = b"\x80\x02]q\x00" + b"".join(
                b"]q" + bytes([i]) + (b"h" + bytes([i - 1]) + b"a") * 2 for i in range(1, 200)
            )
            text += b"."
        elif kind == 2:
            text = pickle.dumps({"format": 10**3000, "options": ["x" * 100_000] * 50}, protocol=2)
        elif kind == 3:
            text = b"\x80\x02cos\nsystem\nX\x04\x00\x00\x00true\x85R."
        else:
            text = b"\x80\x02X\xff\xff\xff\x7fabc."
        stream = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(self.data)) as old, zipfile.ZipFile(stream, "w") as new:
            for entry in old.infolist():
                pickled = entry.filename.endswith("data.pkl")
                new.writestr(entry.filename, text if pickled else old.read(entry))
        return stream.getvalue(), f"pickle {kind} of {depth}"


def _saved(content) -> bytes:
    stream = io.BytesIO()
    try:
        torch.save(content, stream)
    except Exception:  # torch writes no number of 400 digits, and no depth of a thousand
        return b""
    return stream.getvalue()
