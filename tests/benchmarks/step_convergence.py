"""How the image converges as the march step Δ shrinks: errors, order and a plot.

    python tests/benchmarks/step_convergence.py [--model M] [--device cpu|cuda:0] [--size 100]
        [--out docs/figures/step_convergence.png]

RMS and mean difference of color (0..1, over white) to the image with Δ/64, at rest and
twisted, of conformance mode with Δ·f; order is log2 e(f)/e(f/2).  Three images a pose:

    conformance           rays end at T < 10⁻³, somewhere between 0 and 10⁻³: a floor
    stop at 10⁻⁶          the same without that floor
    and without the mask  occupied tets are so as a whole: no density switches on within a
                          piece (a foggier image, as nothing trained those sub-tets)

The image with Δ/64 has an error too, so the last order is off: order 1 reads 0.9 if errors
have random signs and 1.6 if they have one sign, order 2 reads 2.0 to 2.3.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from deformrf.core.base import paths
from deformrf.core.base.device import start_warp
from deformrf.core.field import modelfile
from deformrf.core.render import Renderer, RenderOptions, camera_rays, from_field_of_view, look_at

FACTORS = 2.0 ** np.arange(1, -6, -1)  # of Δ
FINEST = 1 / 64
CHUNK_RAYS = 1024  # bounds the memory where a ray has thousands of samples
ALL_OCCUPIED = np.uint64(2**64 - 1)


@dataclass(frozen=True)
class PatientOptions(RenderOptions):
    """Rays go on for as long as a float32 image can tell."""

    @property
    def stop(self) -> float:
        return 1e-6


def twisted(vertices):
    """By 1.2 radians per unit of height around the middle of the model's cube.  [V, 3]"""
    angle = 1.2 * (vertices[:, 2] - 0.5)
    x, y = vertices[:, 0] - 0.5, vertices[:, 1] - 0.5
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([0.5 + c * x - s * y, 0.5 + s * x + c * y, vertices[:, 2]])


def colors(renderer, view, options):
    """The image over white, as floats.  [H·W, 3]"""
    origins, directions = camera_rays(view)
    parts = [slice(a, a + CHUNK_RAYS) for a in range(0, len(origins), CHUNK_RAYS)]
    return np.concatenate(
        [renderer.render_rays(origins[p], directions[p], options)[0] for p in parts]
    ).astype(float)


def errors(renderer, view, options):
    """RMS and mean difference to the finest image, for each factor.  [2, factors]"""
    finest = colors(renderer, view, replace(options, step_factor=FINEST))
    images = (colors(renderer, view, replace(options, step_factor=f)) for f in FACTORS)
    differences = [np.abs(image - finest) for image in images]
    return np.array([[np.sqrt(np.mean(d**2)) for d in differences], np.mean(differences, (1, 2))])


def measure(field, device, view):
    """Errors, by pose and by name of the image."""
    open_field = replace(field, occupancy=np.where(field.occupancy, ALL_OCCUPIED, np.uint64(0)))
    rows = {
        "conformance": (field, RenderOptions(conformance=True)),
        "stop at 10⁻⁶": (field, PatientOptions(conformance=True)),
        "and without the mask": (open_field, PatientOptions(conformance=True)),
    }
    rest = field.mesh.rest_vertices
    for pose, vertices in (("rest", rest), ("twisted", twisted(rest))):
        for name, (shown, options) in rows.items():
            renderer = Renderer(shown, device)
            renderer.set_vertices(vertices)
            yield (pose, name), errors(renderer, view, options)


def draw(curves, path):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    names = list(dict.fromkeys(name for _, name in curves))
    for (pose, name), values in curves.items():
        style = {"rest": "o-", "twisted": "s--"}[pose]
        axes.loglog(FACTORS, values, style, color=f"C{names.index(name)}", label=f"{pose}, {name}")
    first = max(values[0] for values in curves.values())
    for order in (1, 2):
        axes.loglog(FACTORS, 1.6 * first * (FACTORS / 2) ** order, "k:", linewidth=0.8)
        axes.annotate(f"order {order}", (FACTORS[3], 1.9 * first * (FACTORS[3] / 2) ** order))
    axes.set(xlabel="step / Δ", ylabel="RMS difference to Δ/64")
    axes.set_ylim(0.5 * min(values.min() for values in curves.values()), None)
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=90)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", default=paths.DEFAULT_MODEL)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--size", type=int, default=100)
    parser.add_argument("--out")
    arguments = parser.parse_args()
    start_warp()
    field = modelfile.load(arguments.model)
    eye = 0.5 + 1.344 * np.array([0.7, 0.57, 0.43])
    view = from_field_of_view(look_at(eye, (0.5,) * 3), 0.691, arguments.size, arguments.size)
    print(f"{'':32}" + "".join(f"{f'Δ·{f:g}':>10}" for f in FACTORS))
    curves = {}
    for key, (rms, mean) in measure(field, arguments.device, view):
        curves[key] = rms
        print(", ".join(key))
        for name, values in (("RMS", rms), ("mean", mean)):
            print(f"{'  ' + name:32}" + "".join(f"{e:10.2e}" for e in values))
            orders = np.log2(values[:-1] / values[1:])
            print(f"{'  order':42}" + "".join(f"{o:10.2f}" for o in orders), flush=True)
    if arguments.out:
        draw(curves, arguments.out)


if __name__ == "__main__":
    main()
