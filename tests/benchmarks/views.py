"""Parts of data sets, for several benchmarks."""

from deformrf.core.training.data.datasets import Dataset, from_images


def subset(dataset: Dataset, views) -> Dataset:
    """Some of the views, by their numbers."""
    return from_images(
        [dataset.image(v) for v in views],
        dataset.poses[list(views)],
        [dataset.lenses[v] for v in views],
        [dataset.names[v] for v in views],
        dataset.split,
        dataset.missing,
        dataset.bounds,
    )
