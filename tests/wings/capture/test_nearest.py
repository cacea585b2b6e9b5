"""Matches of descriptors are what the definition says, ties included, wherever they are found."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from deformrf.wings.capture import comparing, nearest


def descriptors(rng, count, like=None):
    """Like SIFT's: whole numbers, of a length of 512; some near those of another photograph."""
    found = rng.gamma(0.5, size=(count, 128))
    if like is not None:
        places = rng.integers(len(like), size=count // 2)
        found[: count // 2] = like[places] * rng.uniform(0.7, 1.3, (count // 2, 128))
    found *= 512.0 / np.linalg.norm(found, axis=1, keepdims=True)
    return np.minimum(np.round(found), 255.0)


def reference(one, other):
    """All distances in float64, each row and each column sorted."""
    if not (len(one) and len(other)):
        return set()
    off = ((one[:, None] - other) ** 2).sum(-1)

    def clear(off):
        nearest = off.argmin(axis=1)
        best, second = np.sort(np.pad(off, ((0, 0), (0, 1)), constant_values=np.inf))[:, :2].T
        good = (best <= 0.49 * 512.0**2) & (25 * best < 16 * second)
        return {(i, int(nearest[i])) for i in np.flatnonzero(good).tolist()}

    return clear(off) & {(i, j) for j, i in clear(off.T)}


def found(one, other, most):
    arrays = (a.astype(np.float32) for a in (one, other))
    return set(zip(*nearest.matches_of(*arrays, most), strict=True))


def test_what_is_clearly_nearest_both_ways_matches():
    rng = np.random.default_rng()
    one = descriptors(rng, 90)
    others = [descriptors(rng, count, one) for count in (120, 1, 0, 70)]
    others[0][60:64] = others[0][:4]  # what is there twice is no match
    others[3][:5] = one[:5]
    one[5] = one[0]
    expected = [reference(one, other) for other in others]
    assert len(expected[0]) > 15 and len(expected[3]) > 10
    assert (1, 1) in expected[3] and (0, 0) not in expected[3]
    for most in (1, 999, nearest.MOST):
        assert [found(one, other, most) for other in others] == expected
    assert found(one[:0], others[0], 99) == set()


def test_products_of_the_longest_descriptors_are_exact():
    """Of twice the length of SIFT's and more: a difference of 1 in one of 128 components counts."""
    one = np.full((1, 128), 255.0)
    other = np.tile(one, (3, 1))
    other[0, :25] -= 1.0  # 25, and 16: the nearest is 4 / 5 as far, which is not enough
    other[1, :16] -= 1.0
    other[2] = 0.0
    for fewer, matches in ((0, set()), (1, {(0, 1)})):
        other[1, :fewer] = 255.0
        assert found(one, other, 99) == matches == reference(one, other)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def test_torch_finds_the_same_in_the_same_order(device, monkeypatch):
    pytest.importorskip("torch")
    rng = np.random.default_rng()
    one = descriptors(rng, 300).astype(np.uint8)
    others = [descriptors(rng, count, one).astype(np.uint8) for count in (500, 1, 0, 200)]
    others[0][60:64] = others[0][:4]
    one[5] = one[0]
    longest = np.full((3, 128), 255, np.uint8)
    longest[0, :25] = 254
    longest[1, :15] = 254
    host, torch = comparing.HostComparer(), comparing.TorchComparer(device)
    assert len(host.matches(one, others[0])) > 50
    pairs = [*((one, other) for other in others), (longest[2:], longest[:2])]
    pairs += [pair[::-1] for pair in pairs]
    expected = [host.matches(*pair) for pair in pairs]
    for pair, matches in zip(pairs, expected, strict=True):
        np.testing.assert_array_equal(torch.matches(*map(torch.place, pair)), matches)
    for at_once in (1, 3, 64):
        monkeypatch.setattr(comparing, "PAIRS_AT_ONCE", at_once)
        sides = zip(*[map(torch.place, pair) for pair in pairs], strict=True)
        assert torch.counts(*sides, None) == list(map(len, expected))
    torch.close()


def test_what_fails_on_a_gpu_is_compared_on_the_cpu(monkeypatch):
    torch = pytest.importorskip("torch")
    rng = np.random.default_rng()
    one = descriptors(rng, 90).astype(np.uint8)
    other = descriptors(rng, 120, one).astype(np.uint8)
    full = comparing.TorchComparer("cpu")
    sides = full.place(one), full.place(other)

    def fail(*_, **__):
        raise torch.OutOfMemoryError

    monkeypatch.setattr(full, "_partners", fail)
    found = full.matches(*sides)
    np.testing.assert_array_equal(found, comparing.HostComparer().matches(one, other))
    with ThreadPoolExecutor(1) as pool:
        assert full.counts(*([side] for side in sides), pool) == [len(found)]
    assert len(found) > 15
    monkeypatch.setattr(torch.Tensor, "to", fail)
    np.testing.assert_array_equal(full.place(one).numpy(), one)
    full.close()


def test_a_torch_that_cannot_use_the_gpu_leaves_all_to_the_cpu(monkeypatch):
    torch = pytest.importorskip("torch")
    usable = comparing.loaded("cpu")
    assert isinstance(usable, comparing.TorchComparer)
    usable.close()

    def fail(*_, **__):
        raise RuntimeError("CUDA error: no kernel image is available")

    with monkeypatch.context() as patch:
        patch.setattr(torch, "baddbmm", fail)
        assert isinstance(comparing.loaded("cpu"), comparing.HostComparer)
    if not torch.cuda.is_available():
        assert isinstance(comparing.loaded(), comparing.HostComparer)
    monkeypatch.setitem(sys.modules, "torch", None)  # it isn't installed
    assert isinstance(comparing.loaded(), comparing.HostComparer)


def test_torch_is_asked_only_where_a_driver_for_it_is(monkeypatch):
    monkeypatch.setattr(comparing, "has_cuda_driver", lambda: False)
    monkeypatch.setattr(comparing, "loaded", lambda: pytest.fail("torch was loaded"))
    for choice in ("auto", "cuda", "cpu"):
        assert isinstance(comparing.begin_comparer(choice).result(), comparing.HostComparer)
    monkeypatch.setattr(comparing, "has_cuda_driver", lambda: True)
    assert isinstance(comparing.begin_comparer("cpu").result(), comparing.HostComparer)
