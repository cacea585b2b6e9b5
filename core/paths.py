"""Where shaders and assets are, in a checkout and in site-packages alike; the version."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent  # the checkout, or site-packages/deformrf
SHADERS = ROOT / "shaders"
ASSETS = ROOT / "assets"
DEFAULT_MODEL = ASSETS / "helmet.npz"


def program_version() -> str:
    """The version of this program, installed or in a checkout."""
    import tomllib
    from importlib import metadata

    try:
        return metadata.version("deformrf")
    except metadata.PackageNotFoundError:
        project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        return tomllib.loads(project)["project"]["version"]
