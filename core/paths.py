"""Where shaders and assets are, in a checkout and in site-packages alike."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent  # the checkout, or site-packages/deformrf
SHADERS = ROOT / "shaders"
ASSETS = ROOT / "assets"
DEFAULT_MODEL = ASSETS / "helmet.npz"
