"""One frame of the solver on a GPU, in one launch: n substeps, every color of every substep.

A launch per color costs 1.3 µs or more, whatever it does, and a substep has about 40 of
them.  Here one kernel does the whole frame and waits at a barrier between colors instead.
What it waits with, and where it keeps the positions, depends on the mesh's size:

    block  one block of threads, positions in its shared memory, __syncthreads
    grid   as many blocks as the GPU runs at once, positions in its L2 cache, a counter

Constraints of the next color are loaded before the barrier, so that only positions are
waited for behind it.  Colors and the order within them are the same for both.

Shared memory has eight banks of 16 bytes, and eight threads that want the same one wait
for each other.  Translates of one constraint are neighbors in the order (coloring.py), so
a vertex's bank is the parity of its lattice cell: then most eights have eight banks.

The substep itself is in xpbd.py and reference.py.  Shapes: V vertices, E edges, T tets.
"""

import numpy as np
import warp as wp

from ..geometry.periodic import lattice_addresses
from .arrays import FrameArrays
from .constraints import COLLAPSED, STEP_LIMIT

wp.set_module_options({"enable_backward": False})

BLOCK_THREADS = 512
GRID_THREADS = 256
SHARED_VERTICES = 2900  # 16 bytes each; 48 KiB hold them and the offsets of colors
MOST_COLORS = 126  # of edges and tets together, plus 2
BANKS = 8

# Position and inverse mass of a vertex lie together: one load of 16 bytes.
_BLOCK = """
    __shared__ float4 shared_bodies[@SHARED_VERTICES];
    const int rank = 0, rank_bits = 0;
    const int first_vertex = threadIdx.x, vertex_end = vertex_count, vertex_step = blockDim.x;
#define SLOT(i) slots.data[i]
    auto get = [&](int i) { return shared_bodies[i]; };
    auto put = [&](int i, float4 b) { shared_bodies[i] = b; };
    auto arrive = [&]() {};
    auto wait = [&]() { __syncthreads(); };
"""

_GRID = """
    const int rank = blockIdx.x, rank_bits = 31 - __clz(gridDim.x);
    const int first_vertex = blockIdx.x * blockDim.x + threadIdx.x, vertex_end = vertex_count;
    const int vertex_step = gridDim.x * blockDim.x;
    float4* const global_bodies = reinterpret_cast<float4*>(bodies.data);
    unsigned* const counter = reinterpret_cast<unsigned*>(arrivals.data);
    unsigned goal = 0;
#define SLOT(i) (i)
    auto get = [&](int i) { return __ldcg(global_bodies + i); };
    auto put = [&](int i, float4 b) { __stcg(global_bodies + i, b); };
    // The counter only grows and gridDim.x is a power of two, so wrapping around is harmless,
    // and blocks that have arrived already don't change what the others begin with.
    if (threadIdx.x == 0) goal = __ldcg(counter) & ~(gridDim.x - 1u);
    auto arrive = [&]() {
        __syncthreads();
        if (threadIdx.x == 0) {
            goal += gridDim.x;
            asm volatile("red.add.release.gpu.u32 [%0], 1;" :: "l"(counter) : "memory");
        }
    };
    auto wait = [&]() {
        if (threadIdx.x == 0) {
            unsigned now;
            do {
                asm volatile("ld.acquire.gpu.u32 %0, [%1];" : "=r"(now) : "l"(counter) : "memory");
            } while ((int)(now - goal) < 0);
        }
        __syncthreads();
    };
"""

_FRAME = """
#if defined(__CUDA_ARCH__)
    const int vertex_count = frame.vertex_count, edge_colors = frame.edge_colors;
    @STORAGE
    const int tet_colors = has_volumes ? frame.tet_colors : 0;
    const int edge_count = frame.edge_offsets.data[edge_colors];
    const int tet_count = frame.tet_offsets.data[frame.tet_colors], tet_room = frame.tet_room;
    __shared__ int offsets[@MOST_COLORS + 2];
    for (int c = threadIdx.x; c <= edge_colors; c += blockDim.x)
        offsets[c] = frame.edge_offsets.data[c];
    for (int c = threadIdx.x; c <= tet_colors; c += blockDim.x)
        offsets[edge_colors + 1 + c] = frame.tet_offsets.data[c];
    const float* const timing = frame.timing.data;
    const float h = timing[0], decay = timing[1], limit = timing[2];
    const float gx = timing[3], gy = timing[4], gz = timing[5];
    const int2* const ends = reinterpret_cast<const int2*>(frame.edge_vertices.data);
    const int4* const corners = reinterpret_cast<const int4*>(frame.tet_vertices.data);
    int2* const edge_slot = reinterpret_cast<int2*>(edge_slots.data);
    int4* const tet_slot = reinterpret_cast<int4*>(tet_slots.data);
    float4* const edge_span = reinterpret_cast<float4*>(edge_spans.data);
    float4* const tet_span = reinterpret_cast<float4*>(tet_spans.data);
    const float* const x = reinterpret_cast<const float*>(frame.vertices.data);
    const float* const target = reinterpret_cast<const float*>(frame.targets.data);
    const float* const anchor = reinterpret_cast<const float*>(frame.anchors.data);
    float* const velocity = reinterpret_cast<float*>(frame.velocities.data);
    float* const before = reinterpret_cast<float*>(previous.data);
    float* const rest_delta = reinterpret_cast<float*>(frame.deltas.data);

    // Spans of the frame's start.
    const int worker = rank * blockDim.x + threadIdx.x, worker_count = blockDim.x << rank_bits;
    for (int k = worker; k < edge_count; k += worker_count) {
        const int2 e = ends[k];
        edge_slot[k] = make_int2(SLOT(e.x), SLOT(e.y));
        edge_span[k] = make_float4(x[3 * e.x] - x[3 * e.y], x[3 * e.x + 1] - x[3 * e.y + 1],
                                   x[3 * e.x + 2] - x[3 * e.y + 2], frame.edge_rest.data[k]);
    }
    if (tet_colors > 0)
        for (int k = worker; k < tet_count; k += worker_count) {
            const int4 q = corners[k];
            tet_slot[k] = make_int4(SLOT(q.x), SLOT(q.y), SLOT(q.z), SLOT(q.w));
            const int other[3] = {q.y, q.z, q.w};
#pragma unroll
            for (int j = 0; j < 3; ++j)
                tet_span[j * tet_room + k] = make_float4(
                    x[3 * other[j]] - x[3 * q.x], x[3 * other[j] + 1] - x[3 * q.x + 1],
                    x[3 * other[j] + 2] - x[3 * q.x + 2],
                    j == 0 ? frame.tet_rest.data[k]
                           : j == 1 ? frame.tet_regularization.data[k] : 0.0f);
        }

    auto predict = [&](int i, int substep, float dx, float dy, float dz, float w,
                       float vx, float vy, float vz) {
        if (w > 0.0f) {
            before[3 * i] = dx; before[3 * i + 1] = dy; before[3 * i + 2] = dz;
            vx = decay * vx + h * gx; vy = decay * vy + h * gy; vz = decay * vz + h * gz;
            const float squared = vx * vx + vy * vy + vz * vz;
            if (squared > limit * limit) {
                const float less = limit / sqrtf(squared);
                vx *= less; vy *= less; vz *= less;
            }
            dx += h * vx; dy += h * vy; dz += h * vz;
        } else {
            const float part = (substep + 1.0f) / substep_count;
            dx = part * (target[3 * i] - x[3 * i]);
            dy = part * (target[3 * i + 1] - x[3 * i + 1]);
            dz = part * (target[3 * i + 2] - x[3 * i + 2]);
        }
        put(SLOT(i), make_float4(dx, dy, dz, w));
    };

    auto project_edge = [&](int k, int2 e, float4 span, float a) {
        float4 p = get(e.x), q = get(e.y);
        const float w = p.w + q.w;
        if (w <= 0.0f) return;
        float ux = span.x + (p.x - q.x), uy = span.y + (p.y - q.y), uz = span.z + (p.z - q.z);
        const float squared = ux * ux + uy * uy + uz * uz;
        const float rest = span.w;
        float inverse_length = rsqrtf(squared);
        float length = squared * inverse_length;
        length += 0.5f * inverse_length * (squared - length * length);
        float along = __fdividef(rest - length, w + a) * inverse_length;
        if (!(squared > @COLLAPSED * @COLLAPSED * rest * rest)) {  // it has no direction of its own
            unsigned bits = (unsigned(frame.edge_ids.data[k]) + 1u) * 2654435761u;
            bits ^= bits >> 16;
            bits *= 2246822519u;
            bits ^= bits >> 13;
            uz = (bits & 0xFFFFu) / 32768.0f - 1.0f;
            const float angle = (bits >> 16) * (6.2831853f / 65536.0f);
            const float ring = sqrtf(fmaxf(1.0f - uz * uz, 0.0f));
            ux = ring * cosf(angle);
            uy = ring * sinf(angle);
            along = rest / (w + a);
        }
        const float mp = p.w * along, mq = q.w * along;
        p.x += mp * ux; p.y += mp * uy; p.z += mp * uz;
        q.x -= mq * ux; q.y -= mq * uy; q.z -= mq * uz;
        put(e.x, p);
        put(e.y, q);
    };

    auto project_tet = [&](int4 t, float4 s1, float4 s2, float4 s3) {
        float4 p0 = get(t.x), p1 = get(t.y), p2 = get(t.z), p3 = get(t.w);
        if (p0.w + p1.w + p2.w + p3.w <= 0.0f) return;
        const float ax = s1.x + (p1.x - p0.x), ay = s1.y + (p1.y - p0.y), az = s1.z + (p1.z - p0.z);
        const float bx = s2.x + (p2.x - p0.x), by = s2.y + (p2.y - p0.y), bz = s2.z + (p2.z - p0.z);
        const float cx = s3.x + (p3.x - p0.x), cy = s3.y + (p3.y - p0.y), cz = s3.z + (p3.z - p0.z);
        const float g1x = by * cz - bz * cy, g1y = bz * cx - bx * cz, g1z = bx * cy - by * cx;
        const float g2x = cy * az - cz * ay, g2y = cz * ax - cx * az, g2z = cx * ay - cy * ax;
        const float g3x = ay * bz - az * by, g3y = az * bx - ax * bz, g3z = ax * by - ay * bx;
        const float g0x = -(g1x + g2x + g3x), g0y = -(g1y + g2y + g3y), g0z = -(g1z + g2z + g3z);
        const float n0 = g0x * g0x + g0y * g0y + g0z * g0z;
        const float n1 = g1x * g1x + g1y * g1y + g1z * g1z;
        const float n2 = g2x * g2x + g2y * g2y + g2z * g2z;
        const float n3 = g3x * g3x + g3y * g3y + g3z * g3z;
        const float rest = s1.w, a = s2.w;
        const float weighted = p0.w * n0 + p1.w * n1 + p2.w * n2 + p3.w * n3;
        float multiplier = __fdividef(rest - (ax * g1x + ay * g1y + az * g1z), weighted + a);
        const float largest = fmaxf(fmaxf(p0.w * p0.w * n0, p1.w * p1.w * n1),
                                    fmaxf(p2.w * p2.w * n2, p3.w * p3.w * n3));
        const float longest = fabsf(multiplier) * sqrtf(largest);
        // Cubed, so that only the few that are too long pay for a cube root.
        if (longest * longest * longest > @STEP_LIMIT * @STEP_LIMIT * @STEP_LIMIT * rest)
            multiplier *= @STEP_LIMIT * cbrtf(rest) / longest;
        float m = multiplier * p0.w;
        p0.x += m * g0x; p0.y += m * g0y; p0.z += m * g0z;
        m = multiplier * p1.w;
        p1.x += m * g1x; p1.y += m * g1y; p1.z += m * g1z;
        m = multiplier * p2.w;
        p2.x += m * g2x; p2.y += m * g2y; p2.z += m * g2z;
        m = multiplier * p3.w;
        p3.x += m * g3x; p3.y += m * g3y; p3.z += m * g3z;
        put(t.x, p0);
        put(t.y, p1);
        put(t.z, p2);
        put(t.w, p3);
    };

    for (int i = first_vertex; i < vertex_end; i += vertex_step)
        predict(i, 0, rest_delta[3 * i], rest_delta[3 * i + 1], rest_delta[3 * i + 2],
                frame.inverse_masses.data[i],
                velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]);
    __syncthreads();  // offsets
    arrive();
    wait();

    int2 e;
    float4 span;
    float a;
    int4 t;
    float4 s1, s2, s3;
    auto load_edge = [&](int k) {
        e = __ldcg(edge_slot + k);
        span = __ldcg(edge_span + k);
        a = __ldcg(frame.edge_regularization.data + k);
    };
    auto load_tet = [&](int k) {
        t = __ldcg(tet_slot + k);
        s1 = __ldcg(tet_span + k);
        s2 = __ldcg(tet_span + tet_room + k);
        s3 = __ldcg(tet_span + 2 * tet_room + k);
    };
    // Every block takes one part of each color; neighbors in the mesh are mostly in one part.
    int k, end;
    auto begin = [&](int c) {
        const int size = offsets[c + 1] - offsets[c];
        const int part = (size + (1 << rank_bits) - 1) >> rank_bits;
        k = offsets[c] + rank * part + threadIdx.x;
        end = min(offsets[c] + (rank + 1) * part, offsets[c + 1]);
    };
    auto begin_edges = [&](int c) {
        begin(c);
        if (k < end) load_edge(k);
    };
    auto begin_tets = [&](int c) {
        begin(edge_colors + 1 + c);
        if (k < end) load_tet(k);
    };
    if (edge_colors > 0) begin_edges(0);
    for (int substep = 0; substep < substep_count; ++substep) {
        for (int c = 0; c < edge_colors; ++c) {
            while (k < end) {
                project_edge(k, e, span, a);
                k += blockDim.x;
                if (k < end) load_edge(k);
            }
            arrive();
            if (c + 1 < edge_colors) begin_edges(c + 1);
            else if (tet_colors > 0) begin_tets(0);
            wait();
        }
        for (int c = 0; c < tet_colors; ++c) {
            while (k < end) {
                project_tet(t, s1, s2, s3);
                k += blockDim.x;
                if (k < end) load_tet(k);
            }
            arrive();
            if (c + 1 < tet_colors) begin_tets(c + 1);
            wait();
        }
        const bool over = substep + 1 == substep_count;
        const float part = (substep + 1.0f) / substep_count;
        for (int i = first_vertex; i < vertex_end; i += vertex_step) {
            float4 b = get(SLOT(i));
            float vx = 0.0f, vy = 0.0f, vz = 0.0f;
            if (b.w > 0.0f) {
                const float px = before[3 * i], py = before[3 * i + 1], pz = before[3 * i + 2];
                if (has_springs) {
                    const float a = frame.springs.data[i][0];
                    if (a >= 0.0f) {
                        float u[3], squared = 0.0f;
                        const float d[3] = {b.x, b.y, b.z};
                        for (int j = 0; j < 3; ++j) {
                            const float from = anchor[3 * i + j];
                            const float way = part * (target[3 * i + j] - from);
                            u[j] = ((from - x[3 * i + j]) + way) - d[j];
                            squared += u[j] * u[j];
                        }
                        const float most = frame.springs.data[i][1];
                        const float along
                            = fminf(b.w / (b.w + a), most * rsqrtf(fmaxf(squared, 1e-30f)));
                        b.x += along * u[0]; b.y += along * u[1]; b.z += along * u[2];
                    }
                }
                if (has_ground) {
                    const float push = (timing[6] - x[3 * i + 2]) - b.z;
                    if (push > 0.0f) {
                        b.z += push;
                        const float sx = b.x - px, sy = b.y - py;
                        const float slid = sqrtf(sx * sx + sy * sy);
                        const float held = fminf(1.0f, timing[7] * push / fmaxf(slid, 1e-30f));
                        b.x -= held * sx; b.y -= held * sy;
                    }
                }
                vx = (b.x - px) / h; vy = (b.y - py) / h; vz = (b.z - pz) / h;
            }
            if (!over) {
                predict(i, substep + 1, b.x, b.y, b.z, b.w, vx, vy, vz);
                continue;
            }
            velocity[3 * i] = vx; velocity[3 * i + 1] = vy; velocity[3 * i + 2] = vz;
            const float moved = sqrtf(b.x * b.x + b.y * b.y + b.z * b.z);
            float* const place = reinterpret_cast<float*>(frame.vertices.data) + 3 * i;
            const float d[3] = {b.x, b.y, b.z};
            for (int j = 0; j < 3; ++j) {
                const float start = place[j];
                place[j] = b.w > 0.0f ? start + d[j] : target[3 * i + j];
                // What the addition rounded away isn't lost.
                rest_delta[3 * i + j] = b.w > 0.0f ? (start - place[j]) + d[j] : 0.0f;
                const_cast<float*>(anchor)[3 * i + j] = target[3 * i + j];
            }
            if (moved > frame.motion.data[0])  // a plain read spares most threads the atomic
                atomicMax(reinterpret_cast<int*>(frame.motion.data), __float_as_int(moved));
        }
        if (!over) {
            arrive();
            if (edge_colors > 0) begin_edges(0);
            wait();
        }
    }
#endif
"""


def _kernel(storage):
    """The kernel with one kind of storage."""
    snippet = _FRAME
    for name, value in {
        "STORAGE": storage,
        "SHARED_VERTICES": SHARED_VERTICES,
        "MOST_COLORS": MOST_COLORS,
        "COLLAPSED": f"{COLLAPSED}f",
        "STEP_LIMIT": f"{STEP_LIMIT}f",
    }.items():
        snippet = snippet.replace(f"@{name}", str(value))

    @wp.func_native(snippet)
    def frame_native(
        frame: FrameArrays,
        slots: wp.array(dtype=int),
        bodies: wp.array(dtype=wp.vec4),
        previous: wp.array(dtype=wp.vec3),
        edge_slots: wp.array(dtype=wp.vec2i),
        edge_spans: wp.array(dtype=wp.vec4),
        tet_slots: wp.array(dtype=wp.vec4i),
        tet_spans: wp.array(dtype=wp.vec4),
        arrivals: wp.array(dtype=int),
        substep_count: int,
        has_volumes: int,
        has_springs: int,
        has_ground: int,
    ): ...

    @wp.kernel(module="unique", grid_stride=False, enable_backward=False)
    def frame_kernel(
        frame: FrameArrays,
        slots: wp.array(dtype=int),  # [V] where a block keeps each vertex
        bodies: wp.array(dtype=wp.vec4),  # [V] deltas and inverse masses, of a grid
        previous: wp.array(dtype=wp.vec3),  # [V] deltas at the substep's start
        edge_slots: wp.array(dtype=wp.vec2i),  # [edge_room]
        edge_spans: wp.array(dtype=wp.vec4),  # [edge_room] of the frame's start, and L
        tet_slots: wp.array(dtype=wp.vec4i),  # [tet_room]
        tet_spans: wp.array(dtype=wp.vec4),  # [3 tet_room] and 6 V0, a, 0
        arrivals: wp.array(dtype=int),  # [1] at barriers
        substep_count: int,
        has_volumes: int,
        has_springs: int,
        has_ground: int,
    ):
        frame_native(
            frame,
            slots,
            bodies,
            previous,
            edge_slots,
            edge_spans,
            tet_slots,
            tet_spans,
            arrivals,
            substep_count,
            has_volumes,
            has_springs,
            has_ground,
        )

    return frame_kernel


block_kernel = _kernel(_BLOCK)
grid_kernel = _kernel(_GRID)


class CudaFrame:
    """Runs frames of one solver on a GPU."""

    def __init__(self, frame: FrameArrays, rest_vertices, device):
        """Take the arrays to work on, and where vertices are at rest.  [V, 3]"""
        if frame.edge_colors + frame.tet_colors > MOST_COLORS:
            raise ValueError(
                f"constraints have {frame.edge_colors} + {frame.tet_colors} colors; "
                f"the solver takes {MOST_COLORS} on a GPU: some vertex has too many edges or tets"
            )
        self._frame, self._device = frame, device
        slots = bank_slots(rest_vertices)
        self._in_block = slots.max() < SHARED_VERTICES

        def scratch(count, dtype):
            return wp.zeros(count, dtype=dtype, device=device)

        self._scratch = (
            wp.array(slots.astype(np.int32), device=device),
            scratch(1 if self._in_block else frame.vertex_count, wp.vec4),
            scratch(frame.vertex_count, wp.vec3),
            scratch(frame.edge_room, wp.vec2i),
            scratch(frame.edge_room, wp.vec4),
            scratch(frame.tet_room, wp.vec4i),
            scratch(3 * frame.tet_room, wp.vec4),
            scratch(1, int),
        )
        self._launches = {}

    def run(self, substep_count: int, volumes: bool, springs: bool, ground: bool) -> None:
        """One frame; what isn't needed isn't done."""
        key = substep_count, volumes, springs, ground
        if key not in self._launches:
            threads = BLOCK_THREADS if self._in_block else GRID_THREADS
            # A power of two, all of which run at once: they wait for each other.
            blocks = 1 if self._in_block else 2 ** int(np.log2(self._device.sm_count))
            self._launches[key] = wp.launch(
                block_kernel if self._in_block else grid_kernel,
                blocks * threads,
                [self._frame, *self._scratch, *map(int, key)],
                device=self._device,
                block_dim=threads,
                record_cmd=True,
            )
        self._launches[key].launch()


def bank_slots(rest_vertices):
    """Where a block keeps each vertex, so that neighboring threads find different banks.

    Args:
        rest_vertices: [V, 3]

    Returns:
        Slots, each once; a few are empty.  [V] int
    """
    count = len(rest_vertices)
    found = lattice_addresses(rest_vertices)
    if found is None:
        return np.arange(count)
    lattice, addresses, _ = found
    bank = (addresses // lattice.cell_edge % 2) @ (1, 2, 4)
    order = np.argsort(bank, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(bank, minlength=BANKS))])
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count) - starts[bank[order]]
    slots = BANKS * rank + bank
    return slots if slots.max() < SHARED_VERTICES or count > SHARED_VERTICES else np.arange(count)
