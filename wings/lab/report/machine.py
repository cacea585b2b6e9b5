"""Which machine, versions and command a report comes from: what its times depend on.

Nothing in it says whose machine it is: no host, no user, no folder.
"""

import hashlib
import os
import platform
import shlex
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated

import warp as wp

from ....core.base.device import thread_count
from ....core.base.paths import ROOT, program_version
from .contents import Section, Table

PACKAGES = ("numpy", "warp-lang", "torch", "scipy", "pillow")
DIGITS = 16
CPU_NAMES = Path("/proc/cpuinfo")
GIB = 2**30


@dataclass(frozen=True)
class Fact:
    """Something about the machine, and its value in words."""

    what: Annotated[str, "what"]
    value: Annotated[str, "value"]


def section(device, command: str, model: Path) -> Section:
    """The machine as it is now.

    Args:
        device: The measured one, "cpu" or "cuda:0".
        command: Folders in it are left out.
        model: A file, which a hash identifies.
    """
    device = wp.get_device(device)
    facts = _cpu() | (_gpu(device) if device.is_cuda else {}) | _software()
    facts["command"] = without_folders(command)
    facts["source, SHA-256"] = digest(sources(ROOT / "core", ROOT / "wings" / "lab"))
    facts["model, SHA-256"] = digest([model])
    where = f"{facts['CPU']}, usable cores: {facts['usable cores']}"
    if device.is_cuda:
        where = f"{device.name} beside {where}"
    rows = [Fact(what, value) for what, value in facts.items()]
    return Section(
        key="machine",
        title="Machine",
        findings=[f"{where}; deformrf {facts['deformrf']} with Warp {facts['warp-lang']}."],
        tables=[Table("machine", "What this report was measured on and with.", rows)],
        values={"device": device.alias},
    )


def sources(*folders: Path) -> list[Path]:
    """The files of a program, in an order that is the same everywhere."""
    files = [path for folder in folders for path in folder.rglob("*")]
    return sorted(path for path in files if path.suffix in (".py", ".cpp", ".cu", ".h"))


def digest(files) -> str:
    """The beginning of a hash of files' contents, one after the other."""
    whole = hashlib.sha256()
    for file in files:
        whole.update(file.read_bytes())
    return whole.hexdigest()[:DIGITS]


def without_folders(command: str) -> str:
    """A command, as shlex.join writes it, with paths cut to their names."""
    words = []
    for word in shlex.split(command):
        # In an option "=" precedes a value; any other one belongs to a path.
        option, equals, value = word.partition("=") if word.startswith("-") else ("", "", word)
        words.append(f"{option}{equals}{Path(value).name or value}")  # "." has no name
    return shlex.join(words)


def _cpu() -> dict[str, str]:
    facts = {"CPU": _cpu_name(), "usable cores": str(thread_count())}
    with suppress(AttributeError, OSError):  # not everywhere
        loads = os.getloadavg()
        facts["load over 1, 5 and 15 min"] = ", ".join(f"{load:.2f}" for load in loads)
    return facts


def _cpu_name() -> str:
    if CPU_NAMES.exists():
        for line in CPU_NAMES.read_text(encoding="utf-8").splitlines():
            key, _, name = line.partition(":")
            if key.strip() == "model name":
                return name.strip()
    return platform.processor() or platform.machine()


def _gpu(device) -> dict[str, str]:
    driver, toolkit = wp.get_cuda_driver_version(), wp.get_cuda_toolkit_version()
    return {
        "GPU": device.name,
        "GPU memory": f"{device.total_memory / GIB:.0f} GiB",
        "CUDA": "driver {}.{}, Warp {}.{}".format(*driver, *toolkit),
    }


def _software() -> dict[str, str]:
    release = ".".join(platform.release().split(".")[:2])
    return {
        "system": f"{platform.system()} {release}, {platform.machine()}",
        "Python": platform.python_version(),
        "deformrf": program_version(),
        **{name: _version(name) for name in PACKAGES},
    }


def _version(package) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:  # a report needs no torch
        return "not installed"
