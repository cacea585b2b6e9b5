"""docs/keys.md as the actions have it.

    python tests/support/keys_page.py

writes it.
"""

from deformrf.core.base.paths import ROOT
from deformrf.viewer.actions import INPUTS, SECTIONS, inputs_of, section_of

PAGE = ROOT / "docs" / "keys.md"
HEAD = """# Keys and the mouse

F1 lists them in the window, too, and Ctrl+F searches all actions. Blender's keys can be chosen at
the first start, and at any time in the menu Help.
"""
COLUMNS = "| input | with Blender's keys | action |\n|---|---|---|"


def page() -> str:
    """The text."""
    blenders = {(one.action, one.help): one.label for one in inputs_of("blender")}
    rows = {section: [] for section in SECTIONS}
    for entry in INPUTS:
        own = entry.label * (entry.only != "blender")
        other = blenders.get((entry.action, entry.help), "")
        if own or other:
            rows[section_of(entry)].append(f"| {own} | {other} | {entry.help} |")
    parts = [f"## {name}\n\n{COLUMNS}\n" + "\n".join(lines) for name, lines in rows.items()]
    return HEAD + "\n" + "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
