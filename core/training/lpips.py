"""LPIPS: how different two images look to a VGG-16 network; 0 for equal images, less is closer.

The authors' package `lpips` computes it, version 0.1 with net="vgg" (Zhang, Isola, Efros,
Shechtman and Wang, The Unreasonable Effectiveness of Deep Features as a Perceptual Metric, 2018).
The package includes the metric's own weights, but would download VGG-16's.  This program downloads
nothing: the user names the file with VGG-16's weights.
"""

import re
import warnings
from pathlib import Path
from threading import Lock

import numpy as np

from .metrics import as_float64, check_size

LPIPS_SIZE_MIN = 16  # pixels; VGG-16's four poolings leave nothing of a smaller image
BACKBONE_FILE = "vgg16-397923af.pth"  # torchvision's name of VGG-16's weights
LINEAR_FILE = "vgg.pth"  # the package's name of the metric's own weights
FIRST_LAYERS = (0, 4, 9, 16, 23)  # of the package's slices of VGG-16

ONE_AT_A_TIME = Lock()  # all threads share cuDNN's flags, and features take memory


class Lpips:
    """The metric with its weights on a device.

    Args:
        path: File of the weights: the state dict of the package's LPIPS(net="vgg"), torchvision's
            VGG-16 (BACKBONE_FILE), or a folder with the latter and optionally LINEAR_FILE.
        device: "cpu" or "cuda:0".

    Raises:
        ValueError: A file is missing or unreadable, or a tensor in it is missing or misshapen.
        ModuleNotFoundError: The package lpips is not installed.
    """

    def __init__(self, path: str | Path, device: str = "cpu"):
        try:
            import lpips
        except RuntimeError as error:  # torchvision's, beside a torch that it was not built for
            raise ValueError(f"the package lpips can't be imported: {error}") from error
        path = Path(path)
        state = read(path / BACKBONE_FILE if path.is_dir() else path)
        if (path / LINEAR_FILE).is_file():
            state |= read(path / LINEAR_FILE)
        state = {package_key(key): tensor for key, tensor in state.items()}
        with warnings.catch_warnings(action="ignore"):  # of how the package calls torchvision
            self._metric = lpips.LPIPS(net="vgg", pnet_rand=True, verbose=False)
        self._metric.requires_grad_(False)
        for key, needed in self._metric.state_dict().items():
            if key in state or key.startswith("net."):  # the package has the others
                needed.copy_(checked(state.get(key), needed.shape, f"{path}: LPIPS needs {key}"))
        self._metric.to(device)
        self.device = device

    def __call__(self, a: np.ndarray, b: np.ndarray) -> float:
        """The distance of two images, floats in [0, 1].  [H, W, 3]"""
        import torch

        a, b = as_float64(a, b)
        if a.ndim != 3 or a.shape[2] != 3:
            raise ValueError(f"LPIPS needs color images [H, W, 3], these have the shape {a.shape}")
        check_size(*a.shape[:2], "LPIPS", LPIPS_SIZE_MIN)
        a, b = (torch.from_numpy(x.transpose(2, 0, 1)[None]).float() for x in (a, b))
        # By default cuDNN rounds a convolution's inputs to 10 bits of mantissa (TF32).
        with ONE_AT_A_TIME, torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            return self._metric(a.to(self.device), b.to(self.device), normalize=True).item()


def package_key(key):
    """The package's name of a tensor: torchvision's features.10.bias is net.slice3.10.bias."""
    if match := re.fullmatch(r"features\.(\d+)\.(weight|bias)", key):
        layer = int(match[1])
        return f"net.slice{sum(layer >= first for first in FIRST_LAYERS)}.{layer}.{match[2]}"
    return key


def checked(tensor, shape, needs):
    """A tensor; ValueError, whose sentence begins with `needs`, if it is not of that shape."""
    found = "no such tensor" if tensor is None else f"one of shape {tuple(tensor.shape)}"
    if tensor is None or tensor.shape != shape:
        raise ValueError(f"{needs} of shape {tuple(shape)}, the file has {found}")
    return tensor


def read(path) -> dict:
    """A state dict, on the CPU."""
    import torch

    if not path.is_file():
        raise ValueError(
            f"there are no LPIPS weights at {path}: name torchvision's {BACKBONE_FILE}, a folder "
            f'that holds it, or one state dict of the lpips package\'s LPIPS(net="vgg")'
        )
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except OSError:
        raise
    except Exception as error:  # damaged files end in nearly any exception
        reason = type(error).__name__  # torch's own text would advise to run the file's code
        raise ValueError(
            f"{path} is not a file of torch tensors, or is damaged ({reason})"
        ) from error
    if not isinstance(state, dict):
        raise ValueError(f"{path} holds no state dict, but a {type(state).__name__}")
    return state
