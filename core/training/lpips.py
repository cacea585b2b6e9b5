"""LPIPS, how different two images look to a VGG-16 network: 0 for equal images, less is closer.

LPIPS = Σₛ mean over y, x of Σc wₛ[c] (âₛ[y, x, c] − b̂ₛ[y, x, c])²

    aₛ   features of image a after the last ReLU of stage s = 1..5 of VGG-16:
         relu1_2, relu2_2, relu3_3, relu4_3, relu5_3             [H / 2ˢ⁻¹, W / 2ˢ⁻¹, WIDTHS]
    âₛ   aₛ / (‖aₛ‖ + ε), of unit length over the channels, ε = 10⁻¹⁰
    wₛ   the metric's own weights, kept non-negative when they were trained

The network sees (2 p − 1 − SHIFT) / SCALE of each pixel p in [0, 1].

Source: Zhang, Isola, Efros, Shechtman and Wang, The Unreasonable Effectiveness of Deep Features
as a Perceptual Metric, 2018, in version 0.1 of the authors' package `lpips` with net="vgg".

No weights come with this program: the user names files with the published ones.  They were not
at hand when this was written, so it was tested against the definition (a NumPy float64 reference
with random weights), and published values were not reproduced with it.

Shapes: images [H, W, 3], floats in [0, 1]; inside, features [1, C, H, W] float32.
"""

from pathlib import Path
from threading import Lock

from .metrics import as_float64

WIDTHS = (64, 128, 256, 512, 512)  # channels of each stage
COUNTS = (2, 2, 3, 3, 3)  # 3×3 convolutions of each stage; a max pooling parts the stages
SHIFT = (-0.030, -0.088, -0.188)  # ImageNet's mean and deviation, for values in [−1, 1]
SCALE = (0.458, 0.448, 0.450)
EPSILON = 1e-10
SIZE_MIN = 2 ** (len(WIDTHS) - 1)  # pixels; the poolings leave nothing of a smaller image

BACKBONE_FILE = "vgg16-397923af.pth"  # torchvision's name
LINEAR_FILE = "vgg.pth"  # the name in the package lpips, of wₛ alone
LINEAR_SHAPES = {f"lin{s}.model.1.weight": (1, width, 1, 1) for s, width in enumerate(WIDTHS)}

ONE_AT_A_TIME = Lock()  # cuDNN's flags are those of all threads, and features take memory


class LpipsError(ValueError):
    """Weights of LPIPS that can't be read, in one sentence for the user."""


class Lpips:
    """The metric with its weights on a device.

    Args:
        path: Either one file, the state dict of the package's LPIPS(net="vgg"), or a folder
            with BACKBONE_FILE and LINEAR_FILE.
        device: "cpu" or "cuda:0".

    Raises:
        LpipsError: A file is missing or unreadable, or a tensor in it is missing or misshapen.
    """

    def __init__(self, path, device="cpu"):
        path = Path(path)
        if path.is_dir():
            backbone = backbone_shapes("features.{layer}")
            tensors = read(path / BACKBONE_FILE, backbone)
            tensors |= read(path / LINEAR_FILE, LINEAR_SHAPES)
        else:
            backbone = backbone_shapes("net.slice{stage}.{layer}")
            tensors = read(path, backbone | LINEAR_SHAPES)
        tensors = {key: tensor.to(device).float() for key, tensor in tensors.items()}
        parts = iter([tensors[key] for key in backbone])
        self.stages = [[(next(parts), next(parts)) for _ in range(count)] for count in COUNTS]
        self.linear = [tensors[key] for key in LINEAR_SHAPES]
        self.device = device

    def __call__(self, a, b) -> float:
        """The distance of two images."""
        import torch

        a, b = as_float64(a, b)
        if a.ndim != 3 or a.shape[2] != 3:
            raise ValueError(f"LPIPS needs color images [H, W, 3], these have the shape {a.shape}")
        check_size(*a.shape[:2])
        distance = 0.0
        # By default cuDNN rounds a convolution's inputs to 10 bits of mantissa (TF32).
        with (
            ONE_AT_A_TIME,
            torch.inference_mode(),
            torch.backends.cudnn.flags(enabled=True, allow_tf32=False),
        ):
            # One after the other, not as a batch: equal images then have equal features.
            a, b = (network_input(image, self.device) for image in (a, b))
            for s, (convolutions, weights) in enumerate(zip(self.stages, self.linear, strict=True)):
                a, b = (features(x, convolutions, pooled=s > 0) for x in (a, b))
                difference = (unit(a) - unit(b)) ** 2
                distance += torch.nn.functional.conv2d(difference, weights).mean().item()
        return distance


def network_input(image, device):
    """What VGG-16 sees of an image.  [H, W, 3] float64 -> [1, 3, H, W]"""
    import torch

    scaled = (2.0 * image - 1.0 - SHIFT) / SCALE
    return torch.from_numpy(scaled.transpose(2, 0, 1)[None]).to(device, torch.float32)


def features(x, convolutions, pooled):
    """One stage of the network; all but the first halve the resolution before."""
    import torch.nn.functional as F

    if pooled:
        x = F.max_pool2d(x, 2)
    for weights, bias in convolutions:
        x = F.conv2d(x, weights, bias, padding=1).relu_()
    return x


def unit(x):
    """Features at unit length over the channels; those that are all zero stay so."""
    return x / (x.square().sum(dim=1, keepdim=True).sqrt() + EPSILON)


def check_size(height, width):
    """Raise ValueError if nothing of an image is left in the last stage."""
    if min(height, width) < SIZE_MIN:
        raise ValueError(
            f"LPIPS needs images of at least {SIZE_MIN}x{SIZE_MIN} pixels, "
            f"these have {width}x{height}"
        )


def backbone_shapes(name):
    """Shape of each tensor of VGG-16's convolutions by key, weights and bias in turn.

    Args:
        name: A convolution's name with {stage}, from 1, and {layer}: VGG-16's layers are
            counted from 0, each convolution, ReLU and pooling being one.
    """
    shapes, layer, inputs = {}, 0, 3
    for stage, (width, count) in enumerate(zip(WIDTHS, COUNTS, strict=True), start=1):
        for _ in range(count):
            key = name.format(stage=stage, layer=layer)
            shapes |= {f"{key}.weight": (width, inputs, 3, 3), f"{key}.bias": (width,)}
            inputs = width
            layer += 2  # itself and its ReLU
        layer += 1  # the pooling
    return shapes


def read(path, shapes):
    """The named tensors of a state dict, with their shapes checked; others are left out."""
    import torch

    if not path.is_file():
        raise LpipsError(
            f"there are no LPIPS weights at {path}: name one state dict of the lpips package's "
            f'LPIPS(net="vgg"), or a folder with {BACKBONE_FILE} and {LINEAR_FILE}'
        )
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except OSError:
        raise
    except Exception as error:  # damaged files end in nearly anything, AssertionError too
        reason = type(error).__name__  # torch's own text would advise to run the file's code
        raise LpipsError(
            f"{path} is not a file of torch tensors, or is damaged ({reason})"
        ) from error
    if not isinstance(state, dict):
        raise LpipsError(f"{path} holds no state dict, but a {type(state).__name__}")
    for key, shape in shapes.items():
        found = tuple(state[key].shape) if isinstance(state.get(key), torch.Tensor) else None
        if found != shape:
            found = "no such tensor" if found is None else f"one of shape {found}"
            raise LpipsError(f"{path}: LPIPS needs {key} of shape {shape}, the file has {found}")
    return {key: state[key] for key in shapes}
