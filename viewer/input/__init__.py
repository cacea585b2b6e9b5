"""Mouse and keys: gestures in the view, and the actions of keys, buttons and menus."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "controls": ["Controls"],
        "fly": ["Fly"],
        "actions": ["ACTIONS", "INPUTS", "action_of", "label_of"],
        "view_actions": ["AXIS_VIEWS", "FROM_VIEW", "UPS", "set_up", "up_name"],
        "delete_actions": ["found_box"],
        "deleting": ["BRUSH"],
        "rig_actions": ["bone_line", "name_bone", "rest_bone"],
        "timeline_actions": ["delete_key"],
        "photo_actions": ["line_of", "placed_photograph", "show_photograph"],
    },
)
