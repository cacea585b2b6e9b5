"""deformrf train DATA --check: the cameras of photographs are found, and work is kept meanwhile."""

import json
import re
import shutil
import signal
from itertools import combinations

import numpy as np
from captures import circle, similarity_errors, write_capture

from deformrf.core.training import load_points
from deformrf.wings.capture import work
from deformrf.wings.capture.library import load_pycolmap

from .kinds import Fault, Kind, Signals
from .process import Job, command

PHOTOS = 16
PAIRS = PHOTOS * (PHOTOS - 1) // 2
OFF = 0.02  # of the cameras' spread: so far from where they were may the median one be found
TOLD = "worked at: "  # before what a run does, in JSON


def find(*arguments):
    """deformrf train, which says which photographs and pairs it works at."""
    from deformrf.wings.capture import features, matching

    extract, alike = features.interruptible, matching.pairs_alike

    def extracting(call, *values, **named):
        print(TOLD + json.dumps({"features": values[2]}), flush=True)
        return extract(call, *values, **named)

    def comparing(pairs, *values):
        print(TOLD + json.dumps({"pairs": pairs}), flush=True)
        return alike(pairs, *values)

    features.interruptible, matching.pairs_alike = extracting, comparing
    command("train", *arguments)


class Finding(Kind):
    """The search is cut off, and then gone on with: what was kept is not worked at again."""

    def prepare(self):
        write_capture(self.inputs / "photos", circle(PHOTOS), np.random.default_rng(7))

    def put(self, number):
        self.photos = self.out / "photos"
        shutil.copytree(self.inputs / "photos", self.photos)
        self.kept = self.out / "model.capture"
        self.others = self.inputs.joinpath("photos").iterdir()
        self.others = {path.name for path in self.others} | {"transforms.json", "points.npz"}

    def job(self):
        arguments = self.photos, "-o", self.out / "model.npz", "--check", "--image-size", 240
        return Job(arguments, find)

    def learn(self):
        self.check_cameras()

    def check_cameras(self):
        """A Fault or another exception unless the cameras are where the photographs' were."""
        scene = json.loads((self.photos / "transforms.json").read_text())
        load_points(self.photos)
        found = {int(f["file_path"][:3]): f["transform_matrix"] for f in scene["frames"]}
        if len(found) != PHOTOS:
            raise Fault(f"{len(found)} of {PHOTOS} photographs have cameras")
        found = np.array([found[number] for number in range(PHOTOS)])
        off = np.median(similarity_errors(found, circle(PHOTOS))[0])
        if off > OFF:
            raise Fault(f"the median camera is {off:.3f} of their spread off")

    def look(self, ended):
        self.check_strays(ended, "photos", "model.capture", "model-check.png")
        self.check_strays(ended, *self.others, folder=self.photos)
        if (self.photos / "transforms.json").exists():
            self.check_cameras()
            result = "new"
        elif not ended.code:
            raise Fault(f"it says that it is done, but there are no cameras: {ended.said}")
        else:
            result = "absent"
        kept = self.known()
        if ended.number != signal.SIGKILL and self.kept.exists() and result == "absent":
            if "goes on there" not in ended.said:
                raise Fault(f"work is kept, but it does not say so: {ended.said}")
        if ended.code:
            self.go_on(kept, result)
        if self.kept.exists():
            raise Fault(f"model.capture is left with {[p.name for p in self.kept.iterdir()]}")
        return f"{result}, resumed" if kept[0] and result == "absent" else result

    def known(self):
        """What the work folder holds: photographs that have all that is needed, and pairs."""
        if not (self.kept / work.DATABASES[0]).exists():
            return set(), set()
        copy = self.folder / "copy"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(self.kept, copy)
        with load_pycolmap().Database.open(str(copy / work.DATABASES[0])) as database:
            images = {image.image_id: image.name for image in database.read_all_images()}
            done = {name for key, name in images.items() if database.exists_descriptors(key)}
            pairs = [p for p in combinations(images, 2) if database.exists_two_view_geometry(*p)]
            number = {key: work.number_of(name) for key, name in images.items()}
            return done, {frozenset((number[a], number[b])) for a, b in pairs}

    def go_on(self, kept, result):
        """Run the command again, to its end."""
        ended = self.run(None, name="said again")
        if ended.code:
            raise Fault(f"it can't go on: exit code {ended.code}, {ended.said}")
        self.check_strays(ended, "photos", "model.capture", "model-check.png")
        self.check_strays(ended, *self.others, folder=self.photos)
        self.check_cameras()
        if result == "new":
            return
        again = re.findall(TOLD + "(.*)", ended.said)
        again = [json.loads(line) for line in again]
        features = {name for line in again for name in line.get("features", ())}
        pairs = {frozenset(pair) for line in again for pair in line.get("pairs", ())}
        if features & kept[0] or pairs & kept[1]:
            raise Fault(f"worked at again: {features & kept[0]}, {len(pairs & kept[1])} pairs")
        if len(features | kept[0]) != PHOTOS or len(pairs | kept[1]) != PAIRS:
            raise Fault(f"{len(features | kept[0])} photographs, {len(pairs | kept[1])} pairs")


class FindingSignals(Signals, Finding):
    pass
