// The boundary faces' crossings with the rays of their rectangles, on a CPU: the body of
// raster_native in raster.py, which fills in @NAMES.  A lane has a ray; its neighbors have the
// pixels beside it.  `crossing_of` and `meets_edge` in entries.py are the same ray by ray.
#if !defined(__CUDA_ARCH__)
#include "lanes.h"
const auto& entries = rays.entries;
const int last_ray = ray_count - 1, rays_in_memory = rays.tet.shape[0];
const Lanes zero = 0.0f;

// Numbers of rays side by side: three of the origin, three of the direction.
const int stride = ray_count + LANES;
for (int k = 0; k < 3; ++k)
    for (int ray = 0; ray < ray_count; ++ray) {
        by_component.data[k * stride + ray] = rays.origins.data[ray][k];
        by_component.data[(3 + k) * stride + ray] = rays.directions.data[ray][k];
    }
auto of_rays = [&](int number, int ray) -> Lanes {
    return *reinterpret_cast<const LooseLanes*>(by_component.data + number * stride + ray);
};

struct Vector { Lanes at[3]; };
auto dot = [](const Vector& u, const Vector& v) {
    return u.at[0] * v.at[0] + u.at[1] * v.at[1] + u.at[2] * v.at[2];
};
auto cross = [](const Vector& u, const Vector& v) -> Vector {
    return {u.at[1] * v.at[2] - u.at[2] * v.at[1], u.at[2] * v.at[0] - u.at[0] * v.at[2],
            u.at[0] * v.at[1] - u.at[1] * v.at[0]};
};
auto minus = [](const Vector& u, const Vector& v) -> Vector {
    return {u.at[0] - v.at[0], u.at[1] - v.at[1], u.at[2] - v.at[2]};
};

// A face's crossings with the rays from one on, as many of a vector's as `count` says.
auto cross_face = [&](int face, const auto& corners, int ray, int count) {
    const Vector d = {of_rays(3, ray), of_rays(4, ray), of_rays(5, ray)};
    Vector from[3];  // a ray's origin to the corners
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) from[i].at[k] = corners[i][k] - of_rays(k, ray);
    const Lanes u = dot(d, cross(from[2], from[1])), v = dot(d, cross(from[0], from[2]));
    const Lanes w = dot(d, cross(from[1], from[0]));
    const Lanes low = smaller(smaller(u, v), w), high = larger(larger(u, v), w);
    Lanes square = zero;
    for (const Vector& corner : from) square = larger(square, dot(corner, corner));
    const Lanes gap = @SLACK * square;
    Ints lanes;
    for (int lane = 0; lane < LANES; ++lane) lanes[lane] = lane;
    const Ints there = lanes < count;
    const Ints edges = there & (((low >= -gap) & (low <= gap)) | ((high >= -gap) & (high <= gap)));
    Ints crossed = there & ((low >= zero) | (high <= zero)) & (u + v + w != zero);
    each(edges, [&](int lane) { exits.data[ray + lane] = @MAX_TETS; });  // no ray has as many
    if (bits_of(crossed) == 0) return;
    const Vector normal = cross(minus(from[1], from[0]), minus(from[2], from[0]));
    const Lanes along = dot(normal, d), t = dot(normal, from[0]) / along;
    crossed = crossed & (t >= zero);
    each(crossed, [&](int lane) {
        const int r = ray + lane;
        if (!(along[lane] < 0.0f) == (facing > 0.0f)) {
            exits.data[r] += 1;
            return;
        }
        // Sorted in among those that the ray has, if there is room.
        const int count = entries.count.data[r]++;
        if (count >= @MOST_ENTRIES) return;
        int place = count;
        for (; place > 0 && entries.t.data[(place - 1) * rays_in_memory + r] > t[lane]; --place) {
            const int to = place * rays_in_memory + r, before = to - rays_in_memory;
            entries.t.data[to] = entries.t.data[before];
            entries.tet.data[to] = entries.tet.data[before];
        }
        entries.t.data[place * rays_in_memory + r] = t[lane];
        entries.tet.data[place * rays_in_memory + r] = geometry.boundary_tets.data[face];
    });
};

for (int face = 0; face < rectangles.shape[0]; ++face) {
    const auto& box = rectangles.data[face];  // first column and row, and those after the last
    const auto& ids = geometry.faces.data[face];
    const auto* const vertices = geometry.vertices.data;
    const wp::vec3 corners[3] = {vertices[ids[0]], vertices[ids[1]], vertices[ids[2]]};
    const int first_row = wp::max(box[1], first_pixel / width);
    const int row_end = wp::min(box[3], (first_pixel + last_ray) / width + 1);
    for (int row = first_row; row < row_end; ++row) {
        const int first = wp::max(row * width + box[0] - first_pixel, 0);
        const int end = wp::min(row * width + box[2] - first_pixel, ray_count);
        for (int ray = first; ray < end; ray += LANES) cross_face(face, corners, ray, end - ray);
    }
}
#endif
