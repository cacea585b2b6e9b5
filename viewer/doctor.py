"""--doctor: the facts that a report of a problem should begin with."""

import os
import platform
import sys
from importlib import metadata

PACKAGES = ("warp-lang", "torch", "moderngl", "pyglet", "imgui-bundle", "av", "numpy")


def report(headless: bool) -> int:
    """Print what the program runs on; exit code 0 if it can draw."""
    from ..core.paths import program_version

    _line("deformrf", program_version())
    _line("python", f"{sys.version.split()[0]} on {platform.platform()}")
    for package in PACKAGES:
        try:
            _line(package, metadata.version(package))
        except metadata.PackageNotFoundError:
            _line(package, "missing")
    _line("encoder", _encoder())
    return _opengl(headless, _device())


def _line(name, value):
    print(f"{name:16}{value}", flush=True)


def _encoder():
    try:
        import av

        from .video import CODEC

        return av.Codec(CODEC, "w").long_name
    except Exception as error:  # whatever is wrong with it is to be reported
        return f"none ({error})"


def _device():
    from ..core.device import start_warp

    start_warp()
    import warp as wp

    if not wp.is_cuda_available():
        _line("CUDA", "no device")
        return "cpu"
    device = wp.get_device("cuda:0")
    _line("CUDA", f"{device.name}, {device.total_memory / 2**30:.0f} GiB, sm_{device.arch}")
    return "cuda:0"


def _opengl(headless, device):
    from .upload import choose_path
    from .window import WindowError, open_window

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
