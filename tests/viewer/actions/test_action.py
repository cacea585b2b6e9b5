"""The table of inputs, with each of the KEYS."""

from types import SimpleNamespace

import pytest

from deformrf.viewer.actions import ACTIONS, BoundActions, action_of, input_of, inputs_of
from deformrf.viewer.settings import KEYS
from deformrf.viewer.tools import ALT, CTRL, LEFT, MIDDLE, RIGHT, SHIFT

MODIFIERS = {"CTRL": CTRL, "ALT": ALT, "SHIFT": SHIFT}


def parts_of(key):
    """Its name without modifiers, and these."""
    *held, name = key.split("+")
    return name, sum(MODIFIERS[one] for one in held)


@pytest.mark.parametrize("keys", KEYS)
def test_every_action_is_in_the_table_and_has_a_key_or_a_place_in_a_menu(keys):
    inputs = inputs_of(keys)
    assert {entry.action for entry in inputs if entry.action} == set(ACTIONS)
    assert all(entry.key or entry.menu for entry in inputs if entry.action)
    used = [entry.key for entry in inputs if entry.key]
    assert len(used) == len(set(used))


@pytest.mark.parametrize("keys", KEYS)
def test_a_key_calls_its_action_and_the_label_says_which_it_is(keys):
    for entry in inputs_of(keys):
        if entry.key:
            assert action_of(*parts_of(entry.key), keys) == entry.action
            assert input_of(entry.action, keys).label == entry.label != ""


@pytest.mark.gl
def test_keys_and_buttons_are_pyglets(window):
    from pyglet.window import key, mouse

    assert (LEFT, MIDDLE, RIGHT) == (mouse.LEFT, mouse.MIDDLE, mouse.RIGHT)
    assert (SHIFT, CTRL, ALT) == (key.MOD_SHIFT, key.MOD_CTRL, key.MOD_ALT)
    for keys in KEYS:
        for entry in inputs_of(keys):
            assert not entry.key or hasattr(key, parts_of(entry.key)[0]), entry


def test_modifiers_tell_two_keys_apart():
    assert action_of("Q", CTRL) == "quit"
    assert action_of("Q") == "next_gizmo"
    assert action_of("R", CTRL) is None
    assert action_of("Z", CTRL) == "undo"
    assert action_of("Z", CTRL | SHIFT) == "redo"
    assert action_of("F", SHIFT) == "focus"
    assert action_of("R", ALT) == "reset"  # Alt alone changes no key that has nothing with it


def test_with_blenders_keys_g_r_and_s_move_turn_and_scale():
    found = [action_of(key, 0, "blender") for key in "GRSXYZA"]
    assert found == ["move", "turn", "scale", "along_x", "along_y", "along_z", "select_all"]
    assert action_of("G", ALT, "blender") == "reset" and action_of("R", ALT, "blender") == (
        "rest_bones"
    )
    assert action_of("F", SHIFT, "blender") == "fly" and action_of("R") == "reset"
    assert input_of("rest_bones", "blender").label == "Alt+R"


def test_the_page_of_keys_says_what_the_inputs_are():
    import keys_page

    assert keys_page.PAGE.read_text(encoding="utf-8") == keys_page.page()


def test_what_is_exported_is_told_with_the_word_and_its_item_without():
    assert input_of("save_model", "deformrf").title == "Export model"
    assert input_of("save_model", "deformrf").menu == "File/Export/Model"


def test_a_title_says_what_a_click_does_now():
    settings = SimpleNamespace(keys="deformrf", tool="grab")
    scene = SimpleNamespace(settings=settings, clock=SimpleNamespace(paused=False))
    actions = BoundActions(SimpleNamespace(scene=scene))
    assert actions.title("pause") == "Pause" and actions.title("bones") == "Pose bones"
    scene.clock.paused, settings.tool = True, "bones"
    assert actions.title("pause") == "Go on" and actions.title("bones") == "Stop posing"
    assert actions.told("pause") == "pause, or go on (Space)"
    assert actions.told("save_model", "so") == "so"


def test_escape_does_not_quit():
    assert action_of("ESCAPE") == "cancel"
