"""The panel of material and time: what a choice does, and what is said of the outcome."""

from types import SimpleNamespace

import pytest

from deformrf.core.deform import HELD_SHARE, PRESETS, Material
from deformrf.viewer.actions import BoundActions
from deformrf.viewer.settings import Settings
from deformrf.viewer.times import FrameTimes

pytestmark = pytest.mark.gl


class Panel:
    """The panel over a scene of plain data; `choice` is picked in the box "material"."""

    def __init__(self, window, monkeypatch):
        from imgui_bundle import imgui

        from deformrf.viewer.gui import Gui
        from deformrf.viewer.panels import widgets

        self.choice, self.texts = None, []
        solver = SimpleNamespace(
            options=SimpleNamespace(substep_count=20, contact=True),
            rescue=SimpleNamespace(running=False, given_up=False, held_by=None),
        )
        self.scene = SimpleNamespace(
            body=SimpleNamespace(
                material=Material(),
                set_material=self.set_material,
                held_young_modulus=1e6,
                automatic_substeps=True,
                set_automatic_substeps=self.called("automatic"),
                gravity=0.0,
                air_drag=0.0,
                meters=1.0,
                rests_elsewhere=False,
                factors=None,
                solver=solver,
                wind=0.0,
                set_options=self.called("options"),
                set_meters=self.called("meters"),
                set_air_drag=self.called("air drag"),
            ),
            settings=Settings(grab_radius=0.1, gizmo="off"),
            solver=solver,
            on_ground=False,
            set_gravity=self.called("gravity"),
            set_ground=self.called("ground"),
            hold=self.called("hold"),
            cuts=SimpleNamespace(some=False),
            clock=SimpleNamespace(paused=False, moving=False),
            held=True,
            handles=SimpleNamespace(grabbed=None, hover=None, selected=[]),
        )
        self.times = FrameTimes()
        self.actions = BoundActions(SimpleNamespace(scene=self.scene))
        self.gui = Gui(window)
        self.boxes, self.calls, self.dim = {}, [], []
        monkeypatch.setattr(imgui, "combo", self.combo)
        monkeypatch.setattr(imgui, "checkbox", self.checkbox)
        monkeypatch.setattr(widgets, "section", lambda title, is_open=True: True)
        monkeypatch.setattr(imgui, "text", self.texts.append)
        monkeypatch.setattr(imgui, "text_wrapped", self.texts.append)
        monkeypatch.setattr(imgui, "text_disabled", self.dim.append)

    def called(self, name):
        return lambda value: self.calls.append((name, value))

    def checkbox(self, label, value):
        """`boxes` says which ones are clicked on in this frame."""
        return (True, not value) if self.boxes.pop(label, False) else (False, value)

    def set_material(self, **values):
        self.scene.body.material = Material(**values)

    def combo(self, label, current, names):
        assert label == "##material"
        self.shown = names[current]
        chosen, self.choice = self.choice, None
        return chosen is not None, current if chosen is None else names.index(chosen)

    def frame(self):
        from imgui_bundle import imgui

        from deformrf.viewer.panels import bend

        self.gui.begin()
        imgui.begin("panel")
        scene, gizmo = self.scene, SimpleNamespace(tool=SimpleNamespace(gizmo=None))
        parts = scene, scene.body, scene.cuts, scene.handles, scene.settings
        bend.bend_panel(*parts, gizmo, self.gui, self.times, self.actions)
        imgui.end()
        self.gui.end()


@pytest.fixture
def panel(window, monkeypatch):
    made = Panel(window[0], monkeypatch)
    yield made
    made.gui.close()


@pytest.mark.parametrize("name", PRESETS)
def test_a_material_is_chosen_by_its_name(panel, name):
    panel.frame()
    assert panel.shown == "default"
    panel.choice = name
    panel.frame()
    assert panel.scene.body.material == PRESETS[name]
    panel.frame()
    assert panel.shown == name


def test_a_material_that_was_changed_is_custom_and_choosing_that_changes_nothing(panel):
    panel.scene.body.material = Material(**{**vars(PRESETS["stiff"]), "damping": 1.0})
    panel.choice = "custom"
    panel.frame()
    assert panel.shown == "custom"
    assert panel.scene.body.material.damping == 1.0


def test_it_is_said_what_is_held_and_why_not_all(panel):
    body = panel.scene.body
    body.material = Material(young_modulus=1e8)
    body.held_young_modulus = 1.01e8 * HELD_SHARE
    panel.frame()
    assert panel.texts == [] and {"0.0 of 16.7 ms", "holds 100 MPa"} <= {*panel.dim}
    body.held_young_modulus = 6.02e7
    panel.frame()
    assert panel.texts == ["holds 60 MPa of 100 MPa: more are too slow"]
    body.automatic_substeps = False
    panel.frame()
    assert panel.texts[1:] == ["holds 60 MPa of 100 MPa: take more substeps"]


def test_it_is_said_which_poisson_ratio_is_held(panel):
    with pytest.warns(UserWarning, match="is held instead"):
        panel.scene.body.material = Material(poisson_ratio=0.1)
    panel.frame()
    assert panel.texts == ["0.25 is held: springs can't follow a lower ratio"]


def test_a_rescue_its_failure_and_a_pause_are_said(panel):
    from deformrf.viewer.panels.status import pause_line, state_line

    scene = panel.scene
    scene.timeline = SimpleNamespace(shows_poses=False, stands=False)
    scene.posing = SimpleNamespace(playing=False)
    rescue = scene.solver.rescue
    rescue.running = rescue.given_up = scene.clock.moving = True
    assert state_line(scene) == "rescuing ..."
    rescue.running = scene.clock.moving = False
    assert state_line(scene) == "tangled: take Original shape"
    rescue.given_up = False
    assert state_line(scene) == "still" and pause_line(scene, panel.actions) == ""
    scene.clock.paused = True
    told = "paused: Space goes on; what you bend follows then"
    assert state_line(scene) == "paused" and pause_line(scene, panel.actions) == told
    scene.timeline.shows_poses = True  # for which it stops time itself
    assert state_line(scene) == "playing" and pause_line(scene, panel.actions) == ""


def test_boxes_switch_what_surrounds_the_object(panel):
    from deformrf.viewer.document import EARTH

    for label, call in (
        ("gravity", EARTH),
        ("solid ground", True),
        ("foot held", False),
        ("automatic", False),
    ):
        panel.boxes[label] = True
        panel.frame()
        called = {"foot held": "hold", "solid ground": "ground"}.get(label, label)
        assert panel.calls.pop() == (called, call)
    panel.scene.body.gravity = 5.0
    panel.boxes = {"gravity": True, "soft grip": True}
    panel.frame()
    assert panel.calls == [("gravity", 0.0)]
    assert panel.scene.settings.soft_grab


@pytest.mark.parametrize(
    "value, text", [(500.0, "500 "), (5e5, "500 k"), (999.7e3, "1 M"), (2.5e9, "2.5 G")]
)
def test_large_numbers_have_prefixes(value, text):
    from deformrf.viewer.panels.bend import si

    assert si(value) == text


def test_what_is_held_is_named_with_how_many_more():
    from deformrf.viewer.panels.bend import vertex_line

    handles = SimpleNamespace(grabbed=None, hover=9, selected=[], title="point {}".format)
    assert vertex_line(handles) == "nothing selected; mouse on point 9"
    handles.selected = [4, 7]
    assert vertex_line(handles) == "2 points selected; mouse on point 9"
    handles.grabbed = SimpleNamespace(handles=[9])
    assert vertex_line(handles) == "holding point 9"
    handles.grabbed.handles.append(3)
    assert vertex_line(handles) == "holding point 9 and 1 more"
