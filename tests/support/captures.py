"""Photographs that a test makes: a textured table and a box on it, by cameras that are known."""

import numpy as np
from PIL import Image

WIDTH, HEIGHT, FOCAL = 240, 180, 210.0
TEXTURE = 512  # pixels along a side


def texture(rng):
    """Blobs of all sizes, which SIFT finds from everywhere.  [TEXTURE, TEXTURE, 3] uint8"""
    total = np.zeros((TEXTURE, TEXTURE, 3))
    for cells in (16, 32, 64, 128):
        noise = rng.integers(0, 256, (cells, cells, 3)).astype(np.uint8)
        image = Image.fromarray(noise).resize((TEXTURE, TEXTURE), Image.Resampling.BICUBIC)
        total += np.asarray(image, float) - 127.5
    return np.clip(total / 2.0 + 127.5, 0, 255).astype(np.uint8)


def quads(center=(0.0, 0.0, 0.0)):
    """A table top and the sides of a box on it: of each the corner and two edges.  [3] each"""
    x, y, z = np.eye(3)
    center = np.asarray(center, float)
    faces = [(-2 * x - 2 * y, 4 * x, 4 * y)]
    low = -0.6 * x - 0.4 * y
    faces += [(low + 0.8 * z, 1.2 * x, 0.8 * y)]
    faces += [(low, 1.2 * x, 0.8 * z), (low + 0.8 * y, 1.2 * x, 0.8 * z)]
    faces += [(low, 0.8 * y, 0.8 * z), (low + 1.2 * x, 0.8 * y, 0.8 * z)]
    return [(corner + center, u, v) for corner, u, v in faces]


def look(position, target=(0.0, 0.0, 0.3)):
    """Camera to world, OpenGL's axes, z up.  [4, 4]"""
    back = np.asarray(position, float) - target
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return pose


def circle(count, radius=3.2, height=1.6, begin=0.0, end=2 * np.pi):
    """Poses around the origin at two heights in turns.  [count, 4, 4]"""
    angles = np.linspace(begin, end, count, endpoint=False)
    return np.array(
        [
            look((radius * np.cos(a), radius * np.sin(a), height + 0.7 * (i % 2)))
            for i, a in enumerate(angles)
        ]
    )


def photograph(pose, faces, textures):
    """Ray cast one image.  [HEIGHT, WIDTH, 3] uint8"""
    # Two samples along each side of a pixel.
    columns, rows = np.meshgrid(np.arange(2 * WIDTH) / 2 + 0.25, np.arange(2 * HEIGHT) / 2 + 0.25)
    rays = np.stack(
        [(columns - WIDTH / 2) / FOCAL, -(rows - HEIGHT / 2) / FOCAL, -np.ones_like(rows)], axis=-1
    )
    directions = (rays @ pose[:3, :3].T).reshape(-1, 3)
    nearest = np.full(len(directions), np.inf)
    colors = np.full((len(directions), 3), 128.0)
    for (corner, u, v), image in zip(faces, textures, strict=True):
        normal = np.cross(u, v)
        with np.errstate(all="ignore"):
            depth = (corner - pose[:3, 3]) @ normal / (directions @ normal)
            place = pose[:3, 3] + depth[:, None] * directions - corner
            s, t = place @ u / (u @ u), place @ v / (v @ v)
            hit = (depth > 0) & (depth < nearest) & (s >= 0) & (s < 1) & (t >= 0) & (t < 1)
        nearest[hit] = depth[hit]
        # As many texels along a unit of length on all faces.
        x = (s[hit] * np.linalg.norm(u) * TEXTURE / 4).astype(int) % TEXTURE
        y = (t[hit] * np.linalg.norm(v) * TEXTURE / 4).astype(int) % TEXTURE
        colors[hit] = image[y, x]
    fine = colors.reshape(HEIGHT, 2, WIDTH, 2, 3)
    return fine.mean(axis=(1, 3)).round().astype(np.uint8)


def write_capture(folder, poses, rng, ending=".jpg", center=(0.0, 0.0, 0.0), first=0):
    """Photographs of one scene in a folder, named 000.jpg and so on."""
    faces = quads(center)
    write_photos(folder, poses, faces, [texture(rng) for _ in faces], ending, first)


def write_twins(folder, poses, rng):
    """Photographs of two boxes that look alike, and of a sheet of paper beside them."""
    one, other = (quads(center)[1:] for center in ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    textures = 2 * [texture(rng) for _ in one]
    sheet = np.array([(-0.8, -3.0, 0.0), (1.6, 0.0, 0.0), (0.0, 1.6, 0.0)])
    write_photos(folder, poses, [*one, *other, sheet], [*textures, texture(rng)])


def write_photos(folder, poses, faces, textures, ending=".jpg", first=0):
    folder.mkdir(exist_ok=True, parents=True)
    for number, pose in enumerate(poses, start=first):
        image = Image.fromarray(photograph(pose, faces, textures))
        image.save(folder / f"{number:03d}{ending}", quality=92)


def similarity_errors(found, truth):
    """Of poses after the best similarity: center errors over the spread, rotations [degrees]."""
    x, y = found[:, :3, 3], truth[:, :3, 3]
    mx, my = x.mean(0), y.mean(0)
    u, s, vt = np.linalg.svd((y - my).T @ (x - mx))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    turn = u * signs @ vt
    scale = (s * signs).sum() / ((x - mx) ** 2).sum()
    off = np.linalg.norm(scale * (x - mx) @ turn.T + my - y, axis=1)
    spread = np.sqrt(((y - my) ** 2).sum(axis=1).mean())
    relative = np.swapaxes(turn @ found[:, :3, :3], 1, 2) @ truth[:, :3, :3]
    cosines = (np.trace(relative, axis1=1, axis2=2) - 1) / 2
    return off / spread, np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def turn_about_z(angle):
    """[3, 3]"""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def write_turntable(folder, angles, heights, rng):
    """Photographs of a box that turns on a table, by a camera that stands still at each height.

    Returns:
        Where the cameras are, seen from the box, and where the box is in each photograph.
        [n, 4, 4], [n, HEIGHT, WIDTH] bool
    """
    faces = quads()
    table, textures = [faces[0]], [texture(rng) for _ in faces]
    wall = (np.array([-3.0, 3.0, -1.0]), np.array([6.0, 0.0, 0.0]), np.array([0.0, 0.0, 4.0]))
    behind, papers = [wall, *table], [texture(rng), textures[0]]
    poses, masks = [], []
    folder.mkdir(exist_ok=True, parents=True)
    for height in heights:
        pose = look((0.0, -3.2, height))
        empty = photograph(pose, behind, papers)
        for angle in angles:
            turn = turn_about_z(angle)
            box = [(turn @ corner, turn @ u, turn @ v) for corner, u, v in faces[1:]]
            image = photograph(pose, behind + box, papers + textures[1:])
            masks.append((image != empty).any(axis=-1))
            Image.fromarray(image).save(folder / f"{len(poses):03d}.jpg", quality=92)
            seen = np.eye(4)
            seen[:3] = turn.T @ pose[:3]
            poses.append(seen)
    return np.array(poses), np.array(masks)
