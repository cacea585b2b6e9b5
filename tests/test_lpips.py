import re
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby
from threading import Barrier, get_ident

import numpy as np
import pytest

from deformrf.core.training import lpips
from deformrf.core.training.lpips import Lpips, LpipsError

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
    whole["scaling_layer.shift"] = np.zeros((1, 3, 1, 1), np.float32)
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
def metric(paths):
    return Lpips(paths[0])


@pytest.fixture
def small_states():
    """State dicts of the right shapes; every tensor repeats one number, so files are small."""
    import torch

    convolutions, inputs = {}, 3
    for layers, width in zip(STAGES, WIDTHS, strict=True):
        for layer in layers:
            convolutions[layer] = np.empty((width, inputs, 3, 3)), np.empty(width)
            inputs = width
    states = state_dicts((convolutions, [np.empty(width) for width in WIDTHS]))
    return [{k: torch.zeros(()).expand(v.shape) for k, v in state.items()} for state in states]


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
def test_it_matches_the_definition(shape, weights, paths, device):
    a, b = images(1, shape)
    parts = lpips_reference(a, b, weights)
    assert (parts > 0.01 * parts.sum()).all()  # none could be wrong unseen
    assert Lpips(paths[0], device)(a, b) == pytest.approx(parts.sum(), rel=1e-5)


def test_both_layouts_of_the_weights_give_the_same_number(paths, metric):
    a, b = images(3)
    assert Lpips(paths[1])(a, b) == metric(a, b) > 0.0


def test_equal_images_have_no_distance(metric):
    a, _ = images(4)
    assert metric(a, a.copy()) == 0.0
    black = np.zeros((16, 16, 3))
    assert metric(black, black) == 0.0


def test_features_that_are_all_zero_have_no_distance(small_states, tmp_path):
    import torch

    torch.save(small_states[0], tmp_path / "zeros.pth")
    assert Lpips(tmp_path / "zeros.pth")(*images(5)) == 0.0


def test_it_is_symmetric(metric):
    a, b = images(6)
    assert metric(a, b) == metric(b, a)


def test_threads_compute_one_distance_after_the_other(metric, monkeypatch):
    """cuDNN's flags, which a distance changes and puts back, are those of the process."""
    order, compute = [], lpips.features

    def features(*arguments, **keywords):
        order.append(get_ident())
        time.sleep(0.002)  # another thread's turn
        return compute(*arguments, **keywords)

    monkeypatch.setattr(lpips, "features", features)
    start = Barrier(3)

    def distance(seed):
        start.wait()
        return metric(*images(seed))

    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(distance, range(3)))
    assert len(list(groupby(order))) == len(set(order)) == 3


def test_single_precision_images_are_taken(metric):
    a, b = images(7)
    assert metric(np.float32(a), np.float32(b)) == pytest.approx(metric(a, b), rel=1e-5)


def test_wrong_images_are_named(metric):
    a, b = images(8)
    with pytest.raises(ValueError, match="at least 16x16 pixels, these have 20x15"):
        metric(a[:15], b[:15])
    with pytest.raises(ValueError, match=r"\[H, W, 3\], these have the shape \(24, 20\)"):
        metric(a[..., 0], b[..., 0])
    with pytest.raises(ValueError, match=r"\(24, 20, 3\) and \(24, 19, 3\)"):
        metric(a, b[:, 1:])
    with pytest.raises(ValueError, match="not uint8"):
        metric(*np.zeros((2, 16, 16, 3), np.uint8))


@pytest.mark.parametrize(
    "index, name, key, shape",
    [
        (0, "one.pth", "net.slice1.0.weight", (64, 3, 3, 3)),
        (0, "one.pth", "net.slice5.28.bias", (512,)),
        (0, "one.pth", "lin4.model.1.weight", (1, 512, 1, 1)),
        (1, "vgg16-397923af.pth", "features.10.weight", (256, 128, 3, 3)),
        (2, "vgg.pth", "lin0.model.1.weight", (1, 64, 1, 1)),
    ],
)
def test_tensors_that_are_missing_or_misshapen_are_named(
    index, name, key, shape, small_states, tmp_path
):
    import torch

    state = small_states[index]
    files = ("one.pth", "vgg16-397923af.pth", "vgg.pth")
    for i in (0,) if index == 0 else (1, 2):
        torch.save(small_states[i], tmp_path / files[i])
    path = tmp_path / name if index == 0 else tmp_path
    Lpips(path)

    sentence = f"{name}: LPIPS needs {key} of shape {shape}, the file has "
    state[key] = torch.zeros((7, *shape[1:]))
    torch.save(state, tmp_path / name)
    with pytest.raises(LpipsError, match=re.escape(sentence + f"one of shape {(7, *shape[1:])}")):
        Lpips(path)
    del state[key]
    torch.save(state, tmp_path / name)
    with pytest.raises(LpipsError, match=re.escape(sentence + "no such tensor")):
        Lpips(path)


def test_files_that_are_missing_are_named(small_states, tmp_path):
    import torch

    with pytest.raises(LpipsError, match=r"no LPIPS weights at .*none\.pth"):
        Lpips(tmp_path / "none.pth")
    with pytest.raises(LpipsError, match=r"no LPIPS weights at .*vgg16-397923af\.pth"):
        Lpips(tmp_path)
    torch.save(small_states[1], tmp_path / "vgg16-397923af.pth")
    with pytest.raises(LpipsError, match=re.escape("vgg.pth: name one state dict")):
        Lpips(tmp_path)


def test_files_that_hold_something_else_are_named(tmp_path):
    import torch

    path = tmp_path / "weights.pth"
    for contents in (b"", b"no weights, but some text\n", b"PK\x03\x04"):
        path.write_bytes(contents)
        with pytest.raises(LpipsError, match=r"weights\.pth is not a file of torch tensors"):
            Lpips(path)
    torch.save(torch.nn.ReLU(), path)  # a whole module: code, which is not run
    with pytest.raises(LpipsError, match=r"not a file of torch tensors.*\(UnpicklingError\)"):
        Lpips(path)
    torch.save([torch.zeros(3)], path)
    with pytest.raises(LpipsError, match="holds no state dict, but a list"):
        Lpips(path)
