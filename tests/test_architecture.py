"""ARCHITECTURE.md is true of the code: its tree exists, and its walks are calls that are made."""

import re
import sys
import threading
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
STATION = re.compile(r"^\d+\. `(?P<path>[\w/.]+\.py)` `(?P<name>[\w.]+)`", re.MULTILINE)
MOST_STATIONS = 8


def walk(title):
    """(path, qualified name) of each station of a walk."""
    text = re.search(rf"^### {title}$(.*?)(?=^##|\Z)", TEXT, re.MULTILINE | re.DOTALL)[1]
    places = [(match["path"], match["name"]) for match in STATION.finditer(text)]
    assert 2 <= len(places) <= MOST_STATIONS, places
    return places


@pytest.fixture
def follow():
    """Run a function, and check that a station before it calls each station of a walk."""
    tracers = sys.getprofile(), threading.getprofile()

    def follow(title, function):
        places = walk(title)
        numbers = {name: (n, f"/{path}") for n, (path, name) in enumerate(places)}
        running, called = Counter(), {}  # stations; called -> whether one before it was running

        def profile(frame, event, _):
            code = frame.f_code
            number, path = numbers.get(code.co_qualname, (None, ""))
            if number is None or not code.co_filename.endswith(path):
                return
            if event == "call":
                before = number == 0 or any(running[n] > 0 for n in range(number))
                called[number] = called.get(number, False) or before
                running[number] += 1
            elif event == "return":
                running[number] -= 1

        threading.setprofile(profile)  # tiles of an image are rendered in threads
        sys.setprofile(profile)
        try:
            function()
        finally:
            sys.setprofile(tracers[0])
            threading.setprofile(tracers[1])
        for number, place in enumerate(places):
            assert number in called, f"{place} is not called"
            assert called[number], f"no station before it calls {place}"

    return follow


@pytest.mark.gl
def test_a_frame_goes_from_the_mouse_to_the_pixel(follow, window, ball):
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    def drag():
        app = App(*window, EventLog(False), gui=False)
        app.load(ball, "ball", "cpu")
        app.controls.grab(int(app.scene.handles.control_ids[0]))
        app.window.dispatch_event("on_mouse_drag", 100, 100, 5, 5, 1, 0)  # waits for the loop
        app.run(2)
        app.close()

    follow("A frame, from the mouse to the pixel", drag)


def test_a_training_step_is_as_described(follow, data):
    from deformrf.core.training import load_dataset, preset, train

    views = load_dataset(data, "train")
    few = {"fine_steps": 2, "spacing": 0.1, "samples_per_step": 2**12}
    options = preset("tiny", leave_out=("coarse-stage", "found-box"), **few)
    follow("A training step", lambda: train(views, options, "cpu"))


def test_a_section_of_the_report_is_as_described(follow, ball_file, tmp_path, monkeypatch):
    from deformrf.commands import report as command
    from deformrf.wings.lab.effort import EFFORTS

    least = EFFORTS[True, True]._replace(size=24, view_count=1, pixel_count=20, turns=1)
    plan = command.plan
    monkeypatch.setattr(command, "plan", lambda *arguments: plan(*arguments)[:1])
    monkeypatch.setattr(command, "EFFORTS", {(True, True): least})
    words = ["deformrf", str(ball_file), "-o", str(tmp_path / "report")]
    monkeypatch.setattr(sys, "argv", [*words, "--device", "cpu", "--quick"])

    def report():
        assert command.main() == 0

    follow("A section of the report", report)


def test_the_tree_names_every_room():
    """Each line of the tree is a path that exists; no room is left out."""
    tree = re.search(r"```\n(.*?)```", TEXT, re.DOTALL)[1]
    parents, named = {}, set()
    for line in tree.splitlines():
        indent, names = re.match(r"( *)(\S+(?:  \S+/)*)", line).groups()
        depth = len(indent)
        if depth > 6:  # the end of what the line before says
            continue
        for name in names.split():
            path = parents.get(depth - 2, Path()) / name
            assert (ROOT / path).exists(), f"ARCHITECTURE.md names {path}"
            parents[depth] = path
            named.add(str(path))
    rooms = {
        str(init.parent.relative_to(ROOT))
        for part in ("core", "wings", "commands", "viewer")
        for init in (ROOT / part).rglob("__init__.py")
    }
    assert rooms <= named, f"ARCHITECTURE.md leaves out {sorted(rooms - named)}"


def test_places_of_the_table_exist():
    """`name` in `path`, and paths alone, as the table of places has them."""
    table = TEXT.split("## Where is ...?")[1].split("\n## ")[0]
    found = re.findall(r"((?:`[\w.]+`(?:, | and ))*`[\w.]+`) in `([\w/]+/[\w.]+)`", table)
    for names, path in found:
        text = (ROOT / path).read_text(encoding="utf-8")
        for name in re.findall(r"`([\w.]+)`", names):
            last = name.rpartition(".")[2]
            pattern = rf"(def|class|auto) {last}\b|^{last} = "
            assert re.search(pattern, text, re.MULTILINE), f"{path} has no {name}"
    assert len(found) > 40
    for path in re.findall(r"`([\w/]+/[\w.]*)`", table):
        assert (ROOT / path).exists(), path


def test_contributing_counts_the_fields_of_the_largest_options():
    from dataclasses import fields

    from deformrf.viewer.settings import Settings

    told = (ROOT / "CONTRIBUTING.md").read_text()
    assert f"`Settings`, has {len(fields(Settings))}." in told
