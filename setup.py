"""README for a package index, and a reason where Python doesn't fit: pyproject.toml has all else.

An index shows README without the repository, so links to files become links to the address of
`[project.urls]`, in the form that GitHub has: /raw/ for pictures, /blob/ for pages.
"""

import re
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

# pip itself would name a dependency that has no wheel.
if not (3, 11) <= sys.version_info[:2] <= (3, 14):
    sys.exit(
        "deformrf needs Python 3.11 to 3.14, for which its dependencies have wheels; this is "
        f"{sys.version.split()[0]}.  uv (https://docs.astral.sh/uv) fetches one: "
        "uv venv --seed --python 3.13"
    )
import tomllib  # since 3.11

ROOT = Path(__file__).parent
ADDRESS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["urls"]["Homepage"]
PICTURES = (".png", ".webp", ".gif", ".jpg", ".svg")
LINK = re.compile(r"""(\]\(|src="|href=")(?!https?:|mailto:|#)([^)"\s]+)""")


def absolute(link: re.Match) -> str:
    before, path = link.groups()
    kind = "raw" if path.endswith(PICTURES) else "blob"
    return f"{before}{ADDRESS}/{kind}/HEAD/{path}"


class BuildModules(build_py):
    """The root is the package, but for this file."""

    def find_package_modules(self, package, package_dir):
        found = super().find_package_modules(package, package_dir)
        return [one for one in found if one[:2] != ("deformrf", "setup")]


setup(
    cmdclass={"build_py": BuildModules},
    long_description=LINK.sub(absolute, (ROOT / "README.md").read_text("utf-8")),
    long_description_content_type="text/markdown",
)
