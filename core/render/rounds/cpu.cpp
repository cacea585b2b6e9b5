// One round's samples to pixels, on a CPU: the body of shade_native in cpu.py, which fills in
// @NAMES and includes.  Some rays at a time: features and densities of all their samples, then the
// weights, then the colors of samples that weigh something, then the sums.
//
// Where `highs` has numbers, samples overlap: samples.t is where one begins, highs where it ends,
// and samples.length the factor from its density to its extinction.
#if !defined(__CUDA_ARCH__)
const auto& tables = shading.tables;
const auto& table = shading.table;
const auto& networks = shading.networks;
const auto& scratch = shading.scratch;
const int level_count = shading.level_count;
const float stop = shading.stop, least_weight = shading.least_weight;
#include "layers.h"
#include "encoding.h"

// -- memory for one chunk of samples -----------------------------------------------------------
enum { CHUNK = @CHUNK, JOINED = @GEOMETRY_FEATURES + @BASIS_COUNT };
char* free_memory = reinterpret_cast<char*>(scratch.data);
auto take = [&](auto*& room, int count) {
    free_memory += -reinterpret_cast<unsigned long long>(free_memory) & 63;  // vectors' alignment
    room = reinterpret_cast<decltype(&room[0])>(free_memory);
    free_memory += count * sizeof(room[0]);
};
struct Colored { int sample, tet, ray; float weight; };
struct Run { int ray, first, count, first_colored; float transmittance; };
const int stride = 4 * level_count;
Corners corners[2];
Places* places;
float *features, *h, *joined, *one, *other;
float* kept;  // 1 - opacity of each sample alone; its extinction, where samples overlap
float* weights;  // of samples that overlap
int *slots, *order, *active;
Colored* colored;
Run* runs;
for (Corners& of_level : corners)
    for (int k = 0; k < 4; ++k) {
        take(of_level.entries[k], CHUNK);
        take(of_level.weights[k], CHUNK);
    }
take(places, CHUNK / LANES);
take(features, CHUNK * stride);
take(h, CHUNK * @GEOMETRY_FEATURES);
take(kept, CHUNK);
take(weights, CHUNK);
take(joined, @BLOCK * JOINED);
take(one, @BLOCK * networks.widest);
take(other, @BLOCK * networks.widest);
take(slots, CHUNK);
take(order, CHUNK);
take(active, CHUNK);
take(colored, CHUNK);
take(runs, CHUNK);

static_assert(@BLOCK % ROWS == 0 && CHUNK % @BLOCK == 0 && CHUNK % LANES == 0, "whole blocks");
if (free_memory > reinterpret_cast<char*>(scratch.data + scratch.shape[0])) __builtin_trap();

const bool overlapping = highs.shape[0] > 0;

// -- the stages of a chunk ---------------------------------------------------------------------
auto width_of = [&](int layer) { return networks.shapes.data[4 * layer + 1]; };

auto find_densities = [&](int count) {
    const int width = width_of(networks.density_count - 1);
    for (int first = 0; first < count; first += @BLOCK) {
        const int rows = count - first < @BLOCK ? count - first : @BLOCK;
        const float* const x = features + first * stride;
        const float* const y =
            apply_network(0, networks.density_count, rows, x, stride, stride, one, other);
        for (int r = 0; r < rows; ++r) {
            for (int k = 0; k < @GEOMETRY_FEATURES; ++k)
                h[(first + r) * @GEOMETRY_FEATURES + k] = y[r * width + k];
            kept[first + r] = smaller(y[r * width], @MAX_LOG_SIGMA);
        }
    }
    for (int first = 0; first < count; first += LANES) {
        Lanes lengths;
        for (int lane = 0; lane < LANES; ++lane)
            lengths[lane] = first + lane < count ? samples.length.data[slots[first + lane]] : 0.0f;
        Lanes& of_group = *reinterpret_cast<Lanes*>(kept + first);
        of_group = exp_of(of_group) * lengths;
        if (!overlapping) of_group = exp_of(-of_group);
    }
};

// The 16 spherical harmonics of a direction, as spherical_harmonics in networks/reference.py.
auto put_basis = [&](float* y, int ray, int tet) {
    for (int k = 0; k < @BASIS_COUNT; ++k) y[k] = 0.0f;
    y[0] = 0.28209479177387814f;
    if (!shading.has_directions) return;
    const auto& d = rays.directions.data[ray];
    const auto& q = shading.rotations.data[tet];
    float turned[3];
    for (int k = 0; k < 3; ++k)
        turned[k] = q.data[0][k] * d[0] + q.data[1][k] * d[1] + q.data[2][k] * d[2];
    const float x = turned[0], v = turned[1], z = turned[2];
    const float xx = x * x, vv = v * v, zz = z * z;
    y[1] = -0.4886025119029199f * v;
    y[2] = 0.4886025119029199f * z;
    y[3] = -0.4886025119029199f * x;
    y[4] = 1.0925484305920792f * x * v;
    y[5] = -1.0925484305920792f * v * z;
    y[6] = 0.31539156525252005f * (3.0f * zz - 1.0f);
    y[7] = -1.0925484305920792f * x * z;
    y[8] = 0.5462742152960396f * (xx - vv);
    y[9] = -0.5900435899266435f * v * (3.0f * xx - vv);
    y[10] = 2.890611442640554f * x * v * z;
    y[11] = -0.4570457994644658f * v * (5.0f * zz - 1.0f);
    y[12] = 0.3731763325901154f * z * (5.0f * zz - 3.0f);
    y[13] = -0.4570457994644658f * x * (5.0f * zz - 1.0f);
    y[14] = 1.445305721320277f * z * (xx - vv);
    y[15] = -0.5900435899266435f * x * (xx - 3.0f * vv);
};

// What weighs too little behind the last color of a run: it counts for that one, or it is colored.
auto settle = [&](const Run& run, int colored_count, float pending, float before, int last) {
    const int ray = run.ray;
    if (pending > 0.0f && colored_count > run.first_colored)
        colored[colored_count - 1].weight += pending;
    else if (pending > 0.0f && pending < 0.25f * least_weight * before)  // it adds up over rounds
        pixels.color.data[ray] = wp::mul(pixels.color.data[ray], 1.0f + pending / before);
    else if (pending > 0.0f)
        colored[colored_count++] = {last, samples.tet.data[slots[last]], ray, pending};
    return colored_count;
};

// The samples of a ray that need a color, and the color's weight: that of the samples before that
// weigh too little, too.  Returns the number of all chosen ones.
auto weigh = [&](Run& run, int colored_count) {
    const int ray = run.ray;
    float transmittance = pixels.transmittance.data[ray], depth = 0.0f, pending = 0.0f;
    const float before = 1.0f - transmittance;
    run.first_colored = colored_count;
    int end = run.first;
    for (; end < run.first + run.count && transmittance >= stop; ++end) {
        const int slot = slots[end];
        const float next = transmittance * kept[end], weight = transmittance - next;
        depth += weight * samples.t.data[slot];
        if (transmittance >= 0.5f && next < 0.5f) pixels.tet.data[ray] = samples.tet.data[slot];
        pending += weight;
        transmittance = next;
        if (pending > least_weight) {
            colored[colored_count++] = {end, samples.tet.data[slot], ray, pending};
            pending = 0.0f;
        }
    }
    colored_count = settle(run, colored_count, pending, before, end - 1);
    pixels.depth.data[ray] += depth;
    run.transmittance = transmittance;
    return colored_count;
};

// The same where samples overlap: on each interval between two of their ends, the media of all
// that cover it add up (line 4 of the definition).
auto weigh_overlapping = [&](Run& run, int colored_count) {
    const int ray = run.ray, end = run.first + run.count;
    auto low = [&](int i) { return samples.t.data[slots[i]]; };
    auto high = [&](int i) { return highs.data[slots[i]]; };
    int* const sorted = order + run.first;
    for (int i = run.first; i < end; ++i) {
        weights[i] = 0.0f;
        int at = i - run.first;
        for (; at > 0 && low(sorted[at - 1]) > low(i); --at) sorted[at] = sorted[at - 1];
        sorted[at] = i;
    }
    float transmittance = pixels.transmittance.data[ray], depth = 0.0f, t = 0.0f;
    const float before = 1.0f - transmittance;
    int next = 0, active_count = 0;
    while ((next < run.count || active_count > 0) && transmittance >= stop) {
        float to = next < run.count ? low(sorted[next]) : @FAR, kappa = 0.0f;
        for (int k = 0; k < active_count; ++k) {
            to = smaller(to, high(active[k]));
            kappa += kept[active[k]];
        }
        if (kappa > 0.0f && to > t) {
            const float after = transmittance * wp::exp(-kappa * (to - t));
            const float weight = transmittance - after;
            depth += weight * 0.5f * (t + to);
            if (transmittance >= 0.5f && after < 0.5f)
                pixels.tet.data[ray] = samples.tet.data[slots[active[0]]];
            for (int k = 0; k < active_count; ++k)
                weights[active[k]] += weight * kept[active[k]] / kappa;
            transmittance = after;
        }
        t = to;
        for (int k = active_count - 1; k >= 0; --k)
            if (high(active[k]) <= t) active[k] = active[--active_count];
        for (; next < run.count && low(sorted[next]) <= t; ++next)
            if (high(sorted[next]) > t) active[active_count++] = sorted[next];
    }
    float pending = 0.0f;
    int last = run.first;
    run.first_colored = colored_count;
    for (int k = 0; k < run.count; ++k) {
        const int i = sorted[k];
        if (weights[i] > 0.0f) last = i;
        pending += weights[i];
        if (pending > least_weight) {
            colored[colored_count++] = {i, samples.tet.data[slots[i]], ray, pending};
            pending = 0.0f;
        }
    }
    colored_count = settle(run, colored_count, pending, before, last);
    pixels.depth.data[ray] += depth;
    run.transmittance = transmittance;
    return colored_count;
};

auto add_colors = [&](int count) {
    const int first_layer = networks.density_count, layer_count = networks.color_count;
    const int width = width_of(first_layer + layer_count - 1);
    for (int first = 0; first < count; first += @BLOCK) {
        const int rows = count - first < @BLOCK ? count - first : @BLOCK;
        for (int r = 0; r < rows; ++r) {
            const Colored& c = colored[first + r];
            float* const x = joined + r * JOINED;
            for (int k = 0; k < @GEOMETRY_FEATURES; ++k)
                x[k] = h[c.sample * @GEOMETRY_FEATURES + k];
            put_basis(x + @GEOMETRY_FEATURES, c.ray, c.tet);
        }
        const float* const y =
            apply_network(first_layer, layer_count, rows, joined, JOINED, JOINED, one, other);
        for (int r = 0; r < rows; ++r) {
            const Colored& c = colored[first + r];
            Entry color = *reinterpret_cast<const Entry*>(y + r * width);
            color = c.weight / (1.0f + exp_of(-color));
            for (int k = 0; k < 3; ++k) pixels.color.data[c.ray][k] += color[k];
        }
    }
};

// -- the chunks --------------------------------------------------------------------------------
int left_count = left_before, run_count = 0, count = 0;
auto finish_chunk = [&]() {
    if (count > 0) {
        encode(slots, count, level_count, places, corners, features, stride);
        find_densities(count);
    }
    int colored_count = 0;
    for (int i = 0; i < run_count; ++i)
        colored_count = overlapping ? weigh_overlapping(runs[i], colored_count)
                                    : weigh(runs[i], colored_count);
    add_colors(colored_count);
    for (int i = 0; i < run_count; ++i) {
        const int ray = runs[i].ray;
        float transmittance = runs[i].transmittance;
        const bool ended = transmittance < stop;
        if (ended && shading.closing) {
            const float scale = 1.0f / (1.0f - transmittance);
            pixels.color.data[ray] = wp::mul(pixels.color.data[ray], scale);
            pixels.depth.data[ray] *= scale;
            transmittance = 0.0f;
        }
        pixels.transmittance.data[ray] = transmittance;
        pixels.sample_count.data[ray] += runs[i].count;
        if (!ended && rays.tet.data[ray] > -2) still_alive.data[left_count++] = ray;
    }
    run_count = count = 0;
};

for (int i = 0; i < alive_count; ++i) {
    const int ray_count = counts.data[i];
    if (run_count == CHUNK || count + ray_count > CHUNK) finish_chunk();
    runs[run_count++] = {alive.data[first_alive + i], count, ray_count, 0, 0.0f};
    for (int k = 0; k < ray_count; ++k) slots[count++] = i * slot_count + k;
}
finish_chunk();
still_alive_count.data[0] = left_count;
#endif
