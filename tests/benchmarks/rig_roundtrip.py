"""A mesh of 10,000 tets to Blender and back: what changes on the way.

    python tests/benchmarks/rig_roundtrip.py --blender PYTHON [--spacing 0.0253] [--store]

PYTHON is a Python that imports bpy (pip install bpy).  Blender installs the add-on, imports the
mesh, binds three bones, bends and exports it (tests/support/blender_rig.py); then its file is
read here.  With --store the figures go to docs/results/rig_roundtrip.json.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from point_caches import write_cache

from deformrf.core.base.paths import ASSETS, ROOT
from deformrf.core.geometry import a15_grid, edges, extract
from deformrf.wings.rig import (
    VertexClip,
    export_mesh,
    read_blender,
    read_cache,
    rig_of,
    skinning_error,
)

SCRIPT = Path(__file__).parents[1] / "support" / "blender_rig.py"
ADDON = ASSETS / "blender" / "deformrf_rig.py"
RESULT = ROOT / "docs" / "results" / "rig_roundtrip.json"


def tall_body(spacing):
    """An ellipsoid of A15 tets, as high as the unit cube."""
    grid = a15_grid(spacing)
    middles = grid.rest_vertices[grid.tets].mean(axis=1) - 0.5
    return extract(grid, ((middles / (0.36, 0.3, 0.5)) ** 2).sum(axis=1) < 1.0)[0]


def in_blender(python, mesh_file, folder):
    own = {**os.environ, "BLENDER_USER_RESOURCES": str(folder / "blender")}
    own.pop("PYTHONPATH", None)
    command = [python, SCRIPT, ADDON, mesh_file, folder]
    subprocess.run(command, env=own, check=True, stdout=subprocess.DEVNULL)
    return json.loads((folder / "facts.json").read_text())


def measure(python, spacing):
    """Rows: what is compared, and the figure."""
    mesh = tall_body(spacing)
    rest = mesh.rest_vertices.astype(np.float32)
    noise = np.random.default_rng(1).normal(scale=0.05, size=(5, *rest.shape))
    clip = VertexClip("given", np.arange(5) / 24.0, (rest + noise).astype(np.float32))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for ending in (".pc2", ".mdd"):
            write_cache(clip, folder / f"given{ending}")
        start = time.perf_counter()
        exported = export_mesh(mesh, folder / "mesh.ply")
        export_seconds = time.perf_counter() - start
        start = time.perf_counter()
        facts = in_blender(python, exported, folder)
        blender_seconds = time.perf_counter() - start
        found = read_blender(folder / "rig.npz", mesh)
        cache = read_cache(folder / "rig.pc2", mesh.vertex_count)
        start = time.perf_counter()
        rig = rig_of(found, mesh)
        bind_seconds = time.perf_counter() - start
        rows = [
            [f"vertices in Blender, of {mesh.vertex_count}", str(facts["vertices"])],
            [f"edges in Blender, of {len(edges(mesh.tets))}", str(facts["edges"])],
            ["rest vertices that came back: largest difference", gap(found.rest_vertices, rest)],
            ["PC2 of Blender's frames: largest difference", gap(cache.vertices, posed(found))],
        ]
        for ending in ("pc2", "mdd"):
            played = np.load(folder / f"given.{ending}.npy")
            rows.append([f"our {ending.upper()} as Blender plays it", gap(played, clip.vertices)])
        for file, words in (
            ("rig", "linear skinning, bones turned and moved: ours against Blender's"),
            ("volume", "dual quaternions against Blender's Preserve Volume"),
            ("scaled", "linear skinning, a bone scaled unevenly as well"),
            ("scaled_volume", "dual quaternions, a bone scaled unevenly as well"),
        ):
            other = read_blender(folder / f"{file}.npz", mesh)
            rows.append([words, f"{skinning_error(other, other.clips[0], mesh):.1e}"])
        (kept,) = rig.clips
        pairs = zip(found.clips[0].times, found.clips[0].matrices, strict=True)
        errors = [np.abs(kept.matrices_at(rig.skeleton, t) - m).max() for t, m in pairs]
        rows.append(["bones' matrices of the imported clip", f"{max(errors):.1e}"])
        rows.append(["seconds: export, Blender's part, weights inside", ""])
        rows[-1][1] = f"{export_seconds:.2f}, {blender_seconds:.1f}, {bind_seconds:.2f}"
    return mesh, facts["blender"], rows


def posed(found):
    return found.clips[0].vertices


def gap(a, b):
    largest = float(np.abs(np.asarray(a) - np.asarray(b)).max())
    return "0 (to the bit)" if largest == 0.0 else f"{largest:.1e}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--blender", required=True, metavar="PYTHON")
    parser.add_argument("--spacing", type=float, default=0.0253)
    parser.add_argument("--store", action="store_true")
    arguments = parser.parse_args()
    mesh, version, rows = measure(arguments.blender, arguments.spacing)
    for row in rows:
        print(f"{row[0]:60} {row[1]}")
    if arguments.store:
        commit = subprocess.check_output(
            ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, text=True
        ).strip()
        result = {
            "title": "The round trip to Blender",
            "command": "python tests/benchmarks/rig_roundtrip.py --blender PYTHON --store",
            "hardware": f"two CPU cores, Blender {version}, {mesh.tet_count} tets, 12 frames",
            "date": date.today().isoformat(),
            "commit": commit,
            "columns": ["compared, model units (the mesh is 1 high)", "figure"],
            "rows": rows,
        }
        RESULT.write_text(json.dumps(result, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
