"""Point caches as other programs write them: the formats that wings/rig/caches.py reads."""

import numpy as np

from deformrf.wings.rig.caches import MDD_HEADER, PC2_HEADER, PC2_MAGIC


def write_cache(clip, path):
    """Write a VertexClip by the path's ending, .pc2 (at 24 frames a second), .mdd or .npz."""
    samples, count = clip.vertices.shape[:2]
    if path.suffix == ".npz":
        np.savez(path, times=clip.times, vertices=clip.vertices)
        return path
    if path.suffix == ".pc2":
        step = 24.0 * np.diff(clip.times).mean() if samples > 1 else 1.0
        header, kind = PC2_HEADER.pack(PC2_MAGIC, 1, count, 0.0, step, samples), "<f4"
    else:
        header = MDD_HEADER.pack(samples, count) + clip.times.astype(">f4").tobytes()
        kind = ">f4"
    path.write_bytes(header + clip.vertices.astype(kind).tobytes())
    return path
