"""Random use of a scene: edits that a test lists, with frames of random lengths between them."""


def use(scene, random, edits, count, most_frames):
    """Make `count` edits, each drawn from functions without arguments.

    Args:
        most_frames: Frames behind an edit, exclusive.
    """
    for _ in range(count):
        edits[random.integers(len(edits))]()
        for _ in range(random.integers(most_frames)):
            scene.advance(float(random.uniform(0.0, 0.15)))
