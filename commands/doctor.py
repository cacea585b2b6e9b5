"""deformrf doctor: the facts that a report of a problem should begin with."""

import os
import platform
import sys
from dataclasses import dataclass

from ..core.base.device import Choice, device_name
from .options import parsed
from .running import run

PROGRAM = "deformrf doctor"
PACKAGES = ("warp-lang", "moderngl", "pyglet", "imgui-bundle", "av", "numpy")
EXTRAS = {  # what training, reports and exchange need besides
    "train": ("torch", "scipy", "pycolmap"),
    "report": ("matplotlib", "markdown-it-py", "scipy"),
    "lpips": ("lpips", "torchvision"),
    "exchange": ("meshio", "usd-core"),
}


@dataclass(frozen=True)
class DoctorArguments:
    """Print versions, folders, CUDA, OpenGL, how frames reach it, and the video encoder."""

    headless: bool = False
    """Look for OpenGL without a display."""
    device: Choice = "auto"
    """Accepted as by the other commands; by default, and always, all devices are shown."""


def main(words: list[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    chosen = parsed(PROGRAM, DoctorArguments, words)

    return run(PROGRAM, lambda: lambda: report(chosen.headless))


def report(headless: bool) -> int:
    """Print what the program runs on; exit code 0 if it can draw."""
    from ..core.base.paths import BUNDLED, program_version
    from ..core.field import load
    from ..viewer.crash import version_of

    _line("deformrf", program_version())
    _line("python", f"{sys.version.split()[0]} on {platform.platform()}")
    for package in PACKAGES:
        _line(package, version_of(package))
    for extra, packages in EXTRAS.items():
        _line(f"extra {extra}", ", ".join(f"{name} {version_of(name)}" for name in packages))
    try:
        import av

        from ..viewer.films import CODECS

        _line("encoder", av.Codec(CODECS["h264"][0], "w").long_name)
    except Exception as error:  # whatever is wrong with it is to be reported
        _line("encoder", f"none ({error})")
    for name, path in BUNDLED.items():
        try:
            model = load(path)
            told = [f"{model.mesh.tet_count} tets", model.attribution]
            _line(f"model {name}", "; ".join(filter(None, told)))
        except ValueError as error:
            _line(f"model {name}", error)
    from ..viewer import logs, preferences

    _line("preferences", preferences.file())
    _line("log", logs.file())
    device = device_name("auto")
    import warp as wp

    cuda = "no device"
    if device != "cpu":
        gpu = wp.get_device(device)
        cuda = f"{gpu.name}, {gpu.total_memory / 2**30:.0f} GiB, sm_{gpu.arch}"
    _line("CUDA", cuda)
    return _opengl(headless, device)


def _line(name, value):
    print(f"{name:16}{value}", flush=True)


def _opengl(headless, device):
    from ..viewer.layers import choose_path
    from ..viewer.window import WindowError, open_window

    # pyglet chooses between a display and none once for the life of a program.
    headless = headless or (sys.platform == "linux" and not os.environ.get("DISPLAY"))
    name = "OpenGL (EGL)" if headless else "OpenGL (window)"
    try:
        window, context = open_window((64, 64), headless)
    except WindowError as error:
        _line(name, error)
        return 1
    _line(name, f"{context.info['GL_RENDERER']}, {context.info['GL_VERSION']}")
    _line("interop", choose_path(context, device, "auto"))
    context.release()
    window.close()
    return 0
