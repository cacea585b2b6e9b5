"""Licenses: of every package that is installed with the program, and of what is bundled."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]


def test_every_dependency_has_its_license_on_the_page():
    page = (ROOT / "docs" / "licenses.md").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(r for e, rs in extras.items() if e != "dev" for r in rs)]
    names = {Requirement(r).name for r in wanted} - {project["name"]}
    versions = dict(
        line.split("==")
        for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
        if "==" in line
    )
    rows = [line for line in page.splitlines() if line.startswith("|")]
    for name in names:
        (row,) = [row for row in rows if name in row.split("|")[1].replace(",", " ").split()]
        assert versions[name] in row, f"docs/licenses.md has another version of {name}"


def test_the_wheel_s_license_files_are_there_and_name_the_fox_s_makers():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in project["license-files"]}
    assert "MIT" in texts["LICENSE"]
    page = (ROOT / "docs" / "licenses.md").read_text(encoding="utf-8")
    for maker in ("PixelMannen", "tomkranis", "AsoboStudio", "scurest"):
        assert maker in texts["assets/LICENSE-fox.txt"] and maker in page
