"""The panel of material and time: what a choice does, and what is said of the outcome."""

from types import SimpleNamespace

import pytest

from deformrf.core.deform.constraints import COMPLIANCE_FLOOR
from deformrf.core.deform.material import PRESETS, Material

pytestmark = pytest.mark.gl


class Panel:
    """The panel over a scene of plain data; `choice` is picked in the box "material"."""

    def __init__(self, window, monkeypatch):
        from imgui_bundle import imgui

        from deformrf.viewer.gui import Gui

        self.choice, self.texts = None, []
        self.scene = SimpleNamespace(
            material=Material(),
            set_material=self.set_material,
            settings=SimpleNamespace(grab_radius=0.1),
            solver=SimpleNamespace(options=SimpleNamespace(substep_count=20)),
            stiffness_ratio=1.0,
            paused=False,
            moving=False,
            held=True,
            grabbed=None,
            hover=None,
        )
        self.gui = Gui(window)
        monkeypatch.setattr(imgui, "combo", self.combo)
        monkeypatch.setattr(imgui, "text", self.texts.append)

    def set_material(self, **values):
        self.scene.material = Material(**values)

    def combo(self, label, current, names):
        assert label == "material"
        self.shown = names[current]
        chosen, self.choice = self.choice, None
        return chosen is not None, current if chosen is None else names.index(chosen)

    def frame(self):
        from imgui_bundle import imgui

        from deformrf.viewer.panels.deform import deform_panel

        self.gui.begin()
        imgui.begin("panel")
        deform_panel(self.scene, None, None)
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
    assert panel.shown == "custom"
    panel.choice = name
    panel.frame()
    assert panel.scene.material == PRESETS[name]
    panel.frame()
    assert panel.shown == name


def test_a_material_that_was_changed_is_custom_and_choosing_that_changes_nothing(panel):
    panel.scene.material = Material(**{**vars(PRESETS["wood"]), "damping": 1.0})
    panel.choice = "custom"
    panel.frame()
    assert panel.shown == "custom"
    assert panel.scene.material.damping == 1.0


def test_it_is_said_when_the_solver_softens_the_material(panel):
    panel.scene.stiffness_ratio = 1.01 * COMPLIANCE_FLOOR
    panel.frame()
    assert panel.texts == []
    panel.scene.stiffness_ratio = 0.99 * COMPLIANCE_FLOOR
    panel.frame()
    assert panel.texts == ["softened: take more substeps"]


def test_the_limit_is_the_solvers_own():
    from deformrf.viewer.panels import deform

    assert deform.COMPLIANCE_FLOOR is COMPLIANCE_FLOOR


@pytest.mark.parametrize("value, text", [(500.0, "500 "), (5e5, "500 k"), (2.5e9, "2.5 G")])
def test_large_numbers_have_prefixes(value, text):
    from deformrf.viewer.panels.deform import si

    assert si(value) == text
