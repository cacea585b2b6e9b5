"""CUDA starts in a thread while modules are imported, and Warp waits for it."""

import threading

import pytest

from deformrf.core.base import device


class Driver:
    """What is called of NVIDIA's driver; cuInit takes until it is let go."""

    def __init__(self, error=0):
        self.error, self.called, self.go_on = error, [], threading.Event()

    def cuInit(self, flags):
        self.called.append("cuInit")
        assert self.go_on.wait(10.0)
        return self.error

    def cuDeviceGet(self, found, ordinal):
        self.called.append(("cuDeviceGet", ordinal))
        return 0

    def cuDevicePrimaryCtxRetain(self, found, ordinal):
        self.called.append("cuDevicePrimaryCtxRetain")
        return 0


@pytest.fixture
def started(monkeypatch):
    """A function that begins CUDA with a driver, and what Warp's start found already called."""

    def start(driver):
        monkeypatch.setattr(device, "_starting", None)
        monkeypatch.setattr(device, "_started", False)
        monkeypatch.setattr(device, "_cuda_driver", lambda: driver)
        found = []
        monkeypatch.setattr(
            device.kernel_cache, "start", lambda _: found.append(list(driver.called))
        )
        device.begin_cuda()
        device.begin_cuda()  # once is enough
        threading.Timer(0.1, driver.go_on.set).start()
        device.start_warp()
        return found[0]

    return start


def test_warp_waits_until_cuda_has_started(started):
    assert started(Driver()) == ["cuInit", ("cuDeviceGet", 0), "cuDevicePrimaryCtxRetain"]


def test_a_driver_that_fails_is_left_to_warp(started):
    assert started(Driver(error=100)) == ["cuInit"]


def test_without_a_driver_nothing_is_started(monkeypatch):
    monkeypatch.setattr(device, "_starting", None)
    monkeypatch.setattr(device, "_cuda_driver", lambda: None)
    device.begin_cuda()
    assert device._starting is None
