"""The overlay with everything that mouse and keys do, and the short hints in the panel."""

from imgui_bundle import imgui

from ..controls import INPUTS

HINT_COUNT = 4  # the gestures of the mouse


def help_overlay(scene, actions, status):
    if imgui.begin_table("inputs", 2, imgui.TableFlags_.sizing_fixed_fit.value):
        for entry in INPUTS:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text(entry.label)
            imgui.table_next_column()
            imgui.text_disabled(entry.help)
        imgui.end_table()


def hints_panel(scene, actions, status):
    for entry in INPUTS[:HINT_COUNT]:
        imgui.text_disabled(f"{entry.label}: {entry.help}")
