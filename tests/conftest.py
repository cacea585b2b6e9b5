"""What tests share: one hook that skips by marker, devices, and the optional development data."""

from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"  # beside the checkout, if at all


def cuda_is_available():
    import warp as wp  # late: most tests of most files need no Warp

    return wp.is_cuda_available()


def pytest_collection_modifyitems(items):
    """Skip what is marked gpu where there is no CUDA device: the only place that decides it."""
    gpu_items = [item for item in items if item.get_closest_marker("gpu")]
    if gpu_items and not cuda_is_available():
        for item in gpu_items:
            item.add_marker(pytest.mark.skip(reason="needs a CUDA device"))


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request):
    """Each device in turn, by Warp's name; the CUDA one skips itself."""
    return request.param


@pytest.fixture
def shared_data():
    """Path of a development data set by name; the test is skipped where it isn't."""

    def folder(name):
        if not (DATA / name).is_dir():
            pytest.skip(f"needs the development data set {name} in {DATA}")
        return DATA / name

    return folder
