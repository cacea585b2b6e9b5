"""Find what may touch within a frame, with boxes of clusters, leaves, faces and tets.

The box of a cluster contains its vertices now and after a frame at their velocities, plus a
margin.  A cluster is touched if its box overlaps that of a partner.  Only touched clusters get the
boxes of their leaves, faces and tets, so a frame in which nothing touches takes little time.

Shapes: V vertices, G clusters, L leaves, S samples, F faces, T tets.
"""

import warp as wp

from ..arrays import VertexArrays

wp.set_module_options({"enable_backward": False})

FAR = 1e30
OUT, ASLEEP, AWAKE = 0, 1, 2  # left out; collides with what is awake; collides


@wp.struct
class ContactShape:
    """What stays the same: clusters.Clusters and surface.Surface on the device."""

    rest: wp.array(dtype=wp.vec3)  # [V]
    vertices: wp.array(dtype=int)
    vertex_offsets: wp.array(dtype=int)  # [G + 1]
    partners: wp.array2d(dtype=int)  # [G, G] 1 for clusters that may collide
    tets: wp.array(dtype=wp.vec4i)  # [T] by leaf
    tet_offsets: wp.array(dtype=int)  # [L + 1]
    leaf_offsets: wp.array(dtype=int)  # [G + 1]
    leaf_clusters: wp.array(dtype=int)  # [L]
    exits: wp.array2d(dtype=int)  # [T, EXITS] faces
    faces: wp.array(dtype=wp.vec3i)  # [F] by leaf
    opposite: wp.array(dtype=int)  # [F]
    bevels: wp.array(dtype=wp.vec3)  # [F]
    rims: wp.array(dtype=wp.vec3)  # [F]
    tops: wp.array(dtype=wp.vec3)  # [F]
    face_offsets: wp.array(dtype=int)  # [L + 1]
    ends: wp.array(dtype=wp.vec2i)  # [S]
    shares: wp.array(dtype=float)  # [S]
    sample_clusters: wp.array(dtype=int)  # [S]


@wp.func
def way_of(state: VertexArrays, i: int, dt: float):
    """How far vertex i will move within the frame, as far as is known."""
    if state.inverse_masses[i] > 0.0:
        return dt * state.velocities[i]
    return state.targets[i] - state.vertices[i]


def lane_count(device) -> int:
    """Threads that share a cluster: on CUDA those of a warp."""
    return 32 if device.is_cuda else 1


# Frames in which nothing touches pay for the next two.  On a CPU they are written for a compiler
# that finds vectors, on CUDA the lanes of a warp share the work.
@wp.func_native("""
    const float* const x = reinterpret_cast<const float*>(state.vertices.data);
    const float* const v = reinterpret_cast<const float*>(state.velocities.data);
    float lower[3] = {1e30f, 1e30f, 1e30f}, upper[3] = {-1e30f, -1e30f, -1e30f};
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x & 31, lanes = 32;
#else
    const int lane = 0, lanes = 1;
#endif
    for (int k = shape.vertex_offsets.data[g] + lane; k < shape.vertex_offsets.data[g + 1];
         k += lanes)
        for (int j = 0; j < 3; ++j) {
            const int i = 3 * shape.vertices.data[k] + j;
            const float now = x[i], later = now + dt * v[i];
            const float low = now < later ? now : later, high = now < later ? later : now;
            lower[j] = low < lower[j] ? low : lower[j];
            upper[j] = high > upper[j] ? high : upper[j];
        }
#if defined(__CUDA_ARCH__)
    for (int j = 0; j < 3; ++j)
        for (int other = 16; other > 0; other /= 2) {
            lower[j] = fminf(lower[j], __shfl_xor_sync(0xffffffffu, lower[j], other));
            upper[j] = fmaxf(upper[j], __shfl_xor_sync(0xffffffffu, upper[j], other));
        }
    if (lane > 0) return;
#endif
    for (int j = 0; j < 3; ++j) {
        boxes.data[j * boxes.shape[1] + g] = lower[j] - margin;
        boxes.data[(j + 3) * boxes.shape[1] + g] = upper[j] + margin;
    }
""")
def make_box(
    shape: ContactShape,
    state: VertexArrays,
    dt: float,
    margin: float,
    boxes: wp.array2d(dtype=float),
    g: int,
): ...


@wp.func_native("""
    const int count = boxes.shape[1];
    const float* const box = boxes.data;
    const int* const may = shape.partners.data + g * count;
    const float x0 = box[g], x1 = box[3 * count + g], y0 = box[count + g];
    const float y1 = box[4 * count + g], z0 = box[2 * count + g], z1 = box[5 * count + g];
    const int mood = moods.data[g];
    auto larger = [](float a, float b) { return a > b ? a : b; };
    // How far apart the boxes are in one of the directions; far if they may not collide.
    auto gap = [&](int i) {
        const float x = larger(box[i] - x1, x0 - box[3 * count + i]);
        const float y = larger(box[count + i] - y1, y0 - box[4 * count + i]);
        const float z = larger(box[2 * count + i] - z1, z0 - box[5 * count + i]);
        const bool counts = may[i] != 0 & moods.data[i] + mood > awake;
        return counts ? larger(x, larger(y, z)) : 1e30f;
    };
    float nearest = 1e30f;
    int found = 0;
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x & 31;
    for (int first = 0; first < count; first += 32) {
        const int i = first + lane;
        const float away = i < count ? gap(i) : 1e30f;
        nearest = fminf(nearest, away);
        const unsigned lanes = __ballot_sync(0xffffffffu, away <= 0.0f);
        if (away <= 0.0f)
            overlaps.data[g * count + found + __popc(lanes & ((1u << lane) - 1u))] = i;
        found += __popc(lanes);
    }
    for (int other = 16; other > 0; other /= 2)
        nearest = fminf(nearest, __shfl_xor_sync(0xffffffffu, nearest, other));
    if (lane > 0) return;
#else
    for (int i = 0; i < count; ++i) {
        const float away = gap(i);
        nearest = away < nearest ? away : nearest;
    }
    for (int i = 0; nearest <= 0.0f && i < count; ++i)
        if (gap(i) <= 0.0f) overlaps.data[g * count + found++] = i;
#endif
    touched.data[g] = found;
    const float steps = nearest / step;
    const int most = 1000000000;
    touched.data[count + g] = most;
    if (steps < 1e9f) touched.data[count + g] = steps;
""")
def find_overlaps(
    shape: ContactShape,
    moods: wp.array(dtype=int),
    boxes: wp.array2d(dtype=float),
    step: float,
    touched: wp.array(dtype=int),
    overlaps: wp.array2d(dtype=int),
    awake: int,
    g: int,
): ...


@wp.kernel(grid_stride=False)
def box_kernel(
    shape: ContactShape,
    state: VertexArrays,
    dt: float,
    margin: float,
    lanes: int,  # lane_count
    boxes: wp.array2d(dtype=float),  # [6, G] out: lower x, y, z, upper x, y, z
):
    make_box(shape, state, dt, margin, boxes, wp.tid() // lanes)


@wp.kernel(grid_stride=False)
def touch_kernel(
    shape: ContactShape,
    moods: wp.array(dtype=int),  # [G] OUT, ASLEEP or AWAKE
    boxes: wp.array2d(dtype=float),  # [6, G]
    lanes: int,  # lane_count
    step: float,  # a unit of length [m]
    touched: wp.array(dtype=int),  # [2 G] out: how many partners each overlaps; steps to others
    overlaps: wp.array2d(dtype=int),  # [G, G] out: the first so many of a row are these partners
):
    find_overlaps(shape, moods, boxes, step, touched, overlaps, AWAKE, wp.tid() // lanes)


@wp.func
def overlap(lower: wp.vec3, upper: wp.vec3, boxes: wp.array2d(dtype=wp.vec3), g: int):
    """Whether a box overlaps that of a leaf, a face or a tet."""
    low = boxes[g, 0]
    high = boxes[g, 1]
    return (
        low[0] <= upper[0]
        and lower[0] <= high[0]
        and low[1] <= upper[1]
        and lower[1] <= high[1]
        and low[2] <= upper[2]
        and lower[2] <= high[2]
    )


@wp.kernel(grid_stride=False)
def small_box_kernel(
    shape: ContactShape,
    state: VertexArrays,
    touched: wp.array(dtype=int),  # [G]
    dt: float,
    margin: float,
    leaf_boxes: wp.array2d(dtype=wp.vec3),  # [L, 2] out, as those of clusters
    face_boxes: wp.array2d(dtype=wp.vec3),  # [F, 2] out, the same
    tet_boxes: wp.array2d(dtype=wp.vec3),  # [T, 2] out, of tets where they are now
):
    leaf = wp.tid()
    if touched[shape.leaf_clusters[leaf]] == 0:
        return
    lowest = wp.vec3(FAR)
    highest = wp.vec3(-FAR)
    for face in range(shape.face_offsets[leaf], shape.face_offsets[leaf + 1]):
        lower = wp.vec3(FAR)
        upper = wp.vec3(-FAR)
        for i in range(3):
            x = state.vertices[shape.faces[face][i]]
            later = x + way_of(state, shape.faces[face][i], dt)
            lower = wp.min(lower, wp.min(x, later))
            upper = wp.max(upper, wp.max(x, later))
        lower -= wp.vec3(margin)
        upper += wp.vec3(margin)
        face_boxes[face, 0] = lower
        face_boxes[face, 1] = upper
        lowest = wp.min(lowest, lower)
        highest = wp.max(highest, upper)
    for tet in range(shape.tet_offsets[leaf], shape.tet_offsets[leaf + 1]):
        lower = wp.vec3(FAR)
        upper = wp.vec3(-FAR)
        for i in range(4):
            x = state.vertices[shape.tets[tet][i]]
            lower = wp.min(lower, x)
            upper = wp.max(upper, x)
        tet_boxes[tet, 0] = lower
        tet_boxes[tet, 1] = upper
        lowest = wp.min(lowest, lower)
        highest = wp.max(highest, upper)
    leaf_boxes[leaf, 0] = lowest
    leaf_boxes[leaf, 1] = highest
