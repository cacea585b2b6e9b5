"""Compile the kernels that are shipped, for each architecture, into assets/kernels: make kernels

    python tests/benchmarks/ship_kernels.py [--architectures 90 ...] [--output FOLDER] [--check]

Warp brings NVIDIA's compiler, so no GPU is needed.  The same sources give the same bytes.
With --check nothing is compiled: it fails if an archive is not of today's sources.
"""

import argparse
import io
import lzma
import sys
import tarfile
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import warp as wp

from deformrf.core.base.device import start_warp, thread_count
from deformrf.core.base.shipped_kernels import FOLDER, archive_path, read
from deformrf.core.deform.frame import cuda
from deformrf.core.field import grid, reach
from deformrf.core.training.data import raybank
from deformrf.core.training.run import (
    batch,
    compositing,
    peer_exchange,
    sample_limits,
    surroundings,
    training_field,
)
from deformrf.viewer.loading import kernel_modules
from deformrf.wings.rig import skinning

# Ampere for servers and for desktops, Ada, Hopper, Blackwell for desktops.
ARCHITECTURES = 80, 86, 89, 90, 120
TRAINING = (
    grid,
    reach,
    raybank,
    batch,
    compositing,
    peer_exchange,
    sample_limits,
    surroundings,
    training_field,
)


def shipped_modules() -> list:
    """The Warp modules that viewing, bones and training launch on CUDA."""
    names = {*kernel_modules("cuda:0"), *(room.__name__ for room in (skinning, *TRAINING))}
    frames = cuda.block_kernel.module, cuda.grid_kernel.module  # by the mesh's size
    return [*(wp.get_module(name) for name in sorted(names)), *frames]


def compiled(module, architecture: int, folder: Path) -> dict[str, bytes]:
    """What Warp keeps of a module, by name: the binary and its description."""
    folder = folder / f"{module.name}-{architecture}"
    wp.compile_aot_module(module, arch=architecture, module_dir=folder, use_ptx=False)
    files = sorted(path for path in folder.iterdir() if path.suffix in (".cubin", ".meta"))
    return {path.name: path.read_bytes() for path in files}


def write(path: Path, modules: dict[str, dict[str, bytes]]) -> None:
    """Write an archive of modules' files, by the modules' hashes, without times or owners."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as archive:
        for key, files in modules.items():
            for name, content in files.items():
                member = tarfile.TarInfo(f"{key}/{name}")
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))
    path.write_bytes(lzma.compress(packed.getvalue(), preset=9 | lzma.PRESET_EXTREME))


def stale(path: Path, modules) -> list[str]:
    """Names of the modules that an archive lacks as they are now."""
    shipped = read(path)
    return [module.name for module in modules if module.get_module_hash().hex() not in shipped]


def main():
    """Write an archive for each architecture, or check them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--architectures", type=int, nargs="+", default=ARCHITECTURES)
    parser.add_argument("--output", type=Path, default=FOLDER)
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    start_warp()
    options.output.mkdir(parents=True, exist_ok=True)
    modules = shipped_modules()
    paths = {n: options.output / archive_path(n).name for n in options.architectures}
    if options.check:
        for path in paths.values():
            if changed := stale(path, modules):
                sys.exit(f"{path.name} lacks {', '.join(changed)}: make kernels")
        return
    for other in set(options.output.glob("warp-*.tar.xz")) - set(paths.values()):
        if f"warp-{wp.__version__}-" not in other.name:
            other.unlink()  # of another version
    for architecture, path in paths.items():
        with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(thread_count()) as pool:
            compiling = partial(compiled, architecture=architecture, folder=Path(folder))
            files = pool.map(compiling, modules)
            keys = [module.get_module_hash().hex() for module in modules]
            contents = dict(zip(keys, files, strict=True))
        write(path, contents)
        print(f"{path}: {len(contents)} modules, {path.stat().st_size / 2**10:.0f} KiB")


if __name__ == "__main__":
    main()
