// One round's samples to pixels, on a CPU: the body of shade_native in cpu.py, which fills in
// @NAMES and includes.  Some rays at a time: features and densities of all their samples, then the
// weights, then the colors of samples that weigh something, then the sums.  With one color a ray,
// h and rest directions are summed instead, and rays that have come to their ends are colored.
//
// Where `highs` has numbers, samples overlap: samples.t is where one begins, highs where it ends,
// and samples.length the factor from its density to its extinction.
#if !defined(__CUDA_ARCH__)
const auto& alive = round.alive;
const auto& samples = round.samples;
const auto& highs = round.highs;
const auto& counts = round.counts;
const auto& tables = shading.tables;
const auto& table = shading.table;
const auto& words = shading.words;
const int hashed_start = shading.hashed_start, byte_level = shading.byte_level;
const auto& networks = shading.networks;
const auto& scratch = shading.scratch;
const int level_count = shading.level_count;
const float stop = shading.stop, least_weight = shading.least_weight;
#include "layers.h"
#include "encoding.h"

// -- memory for one chunk of samples -----------------------------------------------------------
enum { CHUNK = @CHUNK, JOINED = @GEOMETRY_FEATURES + @BASIS_COUNT };
char* free_memory = reinterpret_cast<char*>(scratch.data);
auto take = [&](auto*& array, int count) {
    free_memory += -reinterpret_cast<unsigned long long>(free_memory) & 63;  // vectors' alignment
    array = reinterpret_cast<decltype(&array[0])>(free_memory);
    free_memory += count * sizeof(array[0]);
};
struct Colored { int sample, tet, ray; float weight; };
struct Run { int ray, first, count, weighed; float before, transmittance; };
Corners corners[2];
Places* places;
float* features;  // [4 level_count][CHUNK]
float *h, *joined, *one, *other;
Pair* pairs;  // what goes into a network, in pairs
float* kept;  // 1 - opacity of each sample alone; its extinction, where samples overlap
float* weights;
int *slots;
int *order;  // samples from front to back, run by run
int *active;  // samples that cover an interval; rays that get a color
Colored* colored;
Run* runs;
for (Corners& of_level : corners)
    for (int k = 0; k < 4; ++k) {
        take(of_level.entries[k], CHUNK);
        take(of_level.weights[k], CHUNK);
    }
take(places, CHUNK / LANES);
take(features, CHUNK * 4 * level_count);
take(h, CHUNK * @GEOMETRY_FEATURES);
take(kept, CHUNK);
take(weights, CHUNK);
take(joined, @BLOCK * JOINED);
take(pairs, @BLOCK * (2 * level_count + JOINED / 2));  // of either network
take(one, @BLOCK * networks.widest);
take(other, @BLOCK * networks.widest);
take(slots, CHUNK);
take(order, CHUNK);
take(active, CHUNK);
take(colored, CHUNK);
take(runs, CHUNK);

static_assert(@BLOCK % ROWS == 0 && @BLOCK % LANES == 0 && CHUNK % @BLOCK == 0, "whole blocks");
if (free_memory > reinterpret_cast<char*>(scratch.data + scratch.shape[0])) __builtin_trap();

const bool overlapping = highs.shape[0] > 0, deferred = pixels.sums.shape[0] > 0;
const int sum_count = deferred ? @GEOMETRY_FEATURES + 3 : 0;
const bool by_pairs = HAS_PAIRS && shading.in_pairs;

// -- the stages of a chunk ---------------------------------------------------------------------
auto width_of = [&](int layer) { return networks.shapes.data[5 * layer + 1]; };

auto find_densities = [&](int count) {
    const int width = width_of(networks.density_count - 1);
    for (int first = 0; first < count; first += @BLOCK) {
        const int rows = count - first < @BLOCK ? count - first : @BLOCK;
        const Inputs x = {features + first, 1, CHUNK};
        const int in = 4 * level_count;
        if (by_pairs) pair_columns(x.data, CHUNK, rows, in, pairs, @BLOCK);
        const PairInputs x_pairs = {pairs, 1, @BLOCK};
        const float* const y = by_pairs
            ? apply_network(0, networks.density_count, rows, x_pairs, in, one, other)
            : apply_network(0, networks.density_count, rows, x, in, one, other);
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

// A component of the rest direction, Qᵀd.
auto turned = [&](int ray, int tet, int k) {
    const auto& d = rays.directions.data[ray];
    const auto& q = shading.rotations.data[tet];
    return q.data[0][k] * d[0] + q.data[1][k] * d[1] + q.data[2][k] * d[2];
};

// The 16 spherical harmonics of a direction, as spherical_harmonics in core/definition/networks.py.
auto put_basis = [&](float* y, float x, float v, float z) {
    for (int k = 0; k < @BASIS_COUNT; ++k) y[k] = 0.0f;
    y[0] = 0.28209479177387814f;
    if (!shading.has_directions) return;
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

// What the samples of a ray weigh, to where it ends.
auto weigh = [&](Run& run) {
    const int ray = run.ray;
    float transmittance = run.before, depth = 0.0f;
    int i = run.first;
    for (; i < run.first + run.count && transmittance >= stop; ++i) {
        const int slot = slots[i];
        const float next = transmittance * kept[i], weight = transmittance - next;
        depth += weight * samples.t.data[slot];
        if (transmittance >= 0.5f && next < 0.5f) pixels.tet.data[ray] = samples.tet.data[slot];
        order[i] = i;
        weights[i] = weight;
        transmittance = next;
    }
    run.weighed = i - run.first;
    pixels.depth.data[ray] += depth;
    run.transmittance = transmittance;
};

// The same where samples overlap: on each interval between two of their ends, the media of all
// that cover it add up (line 4 of the definition).
auto weigh_overlapping = [&](Run& run) {
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
    float transmittance = run.before, depth = 0.0f, t = 0.0f;
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
    run.weighed = run.count;
    pixels.depth.data[ray] += depth;
    run.transmittance = transmittance;
};

// The samples of a ray that need a color, and the color's weight: that of the samples before that
// weigh too little, too.  Returns the number of all chosen ones.
auto choose = [&](const Run& run, int colored_count) {
    const int ray = run.ray, first_colored = colored_count;
    float pending = 0.0f;
    int last = run.first;
    for (int k = 0; k < run.weighed; ++k) {
        const int i = order[run.first + k];
        if (weights[i] > 0.0f) last = i;
        pending += weights[i];
        if (pending > least_weight) {
            colored[colored_count++] = {i, samples.tet.data[slots[i]], ray, pending};
            pending = 0.0f;
        }
    }
    // What is left counts for the last color, or for those so far, or is colored.
    const float so_far = 1.0f - run.before;
    if (pending > 0.0f && colored_count > first_colored)
        colored[colored_count - 1].weight += pending;
    else if (pending > 0.0f && pending < 0.25f * least_weight * so_far)  // it adds up over rounds
        pixels.color.data[ray] = wp::mul(pixels.color.data[ray], 1.0f + pending / so_far);
    else if (pending > 0.0f)
        colored[colored_count++] = {last, samples.tet.data[slots[last]], ray, pending};
    return colored_count;
};

// What the color network gives for the first rows of `joined`.
auto apply_color = [&](int rows) {
    const int first_layer = networks.density_count, layer_count = networks.color_count;
    if (!by_pairs)
        return apply_network(first_layer, layer_count, rows, Inputs{joined, JOINED, 1}, JOINED, one,
                             other);
    pair_up(joined, rows * JOINED, pairs);
    const PairInputs x = {pairs, JOINED / 2, 1};
    return apply_network(first_layer, layer_count, rows, x, JOINED, one, other);
};

auto add_colors = [&](int count) {
    const int width = width_of(networks.density_count + networks.color_count - 1);
    for (int first = 0; first < count; first += @BLOCK) {
        const int rows = count - first < @BLOCK ? count - first : @BLOCK;
        for (int r = 0; r < rows; ++r) {
            const Colored& c = colored[first + r];
            float* const x = joined + r * JOINED;
            for (int k = 0; k < @GEOMETRY_FEATURES; ++k)
                x[k] = h[c.sample * @GEOMETRY_FEATURES + k];
            put_basis(x + @GEOMETRY_FEATURES, turned(c.ray, c.tet, 0), turned(c.ray, c.tet, 1),
                      turned(c.ray, c.tet, 2));
        }
        const float* const y = apply_color(rows);
        for (int r = 0; r < rows; ++r) {
            const Colored& c = colored[first + r];
            Entry color = *reinterpret_cast<const Entry*>(y + r * width);
            color = c.weight / (1.0f + exp_of(-color));
            for (int k = 0; k < 3; ++k) pixels.color.data[c.ray][k] += color[k];
        }
    }
};

// -- one color a ray ---------------------------------------------------------------------------
// The sums of a ray: h and the rest direction, with the samples' weights.
typedef float Features __attribute__((ext_vector_type(@GEOMETRY_FEATURES)));
auto add_up = [&](const Run& run) {
    auto& sums = pixels.sums.data[run.ray];
    Features total = 0.0f;
    int tet = -1;
    float in_tet = 0.0f;  // weight of the samples so far
    auto leave_tet = [&]() {
        for (int j = 0; j < 3 && in_tet > 0.0f; ++j)
            sums[@GEOMETRY_FEATURES + j] += in_tet * turned(run.ray, tet, j);
    };
    for (int k = 0; k < run.weighed; ++k) {
        const int i = order[run.first + k], next = samples.tet.data[slots[i]];
        if (next != tet) {
            leave_tet();
            tet = next;
            in_tet = 0.0f;
        }
        in_tet += weights[i];
        total = multiply_add(Features(weights[i]), reinterpret_cast<const Features*>(h)[i], total);
    }
    leave_tet();
    for (int j = 0; j < @GEOMETRY_FEATURES; ++j) sums[j] += total[j];
};

// The colors of rays that have come to their ends, from the means.
auto color_rays = [&](const int* ended, int count) {
    const int width = width_of(networks.density_count + networks.color_count - 1);
    for (int first = 0; first < count; first += @BLOCK) {
        const int rows = count - first < @BLOCK ? count - first : @BLOCK;
        for (int r = 0; r < rows; ++r) {
            const int ray = ended[first + r];
            const auto& sums = pixels.sums.data[ray];
            const float opacity = 1.0f - pixels.transmittance.data[ray];
            float* const x = joined + r * JOINED;
            for (int k = 0; k < @GEOMETRY_FEATURES; ++k)
                x[k] = sums[k] / (opacity > @SMALLEST ? opacity : @SMALLEST);
            const float d[3] = {sums[@GEOMETRY_FEATURES], sums[@GEOMETRY_FEATURES + 1],
                                sums[@GEOMETRY_FEATURES + 2]};
            const float length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
            const float scale = 1.0f / (length > @SMALLEST ? length : @SMALLEST);
            put_basis(x + @GEOMETRY_FEATURES, scale * d[0], scale * d[1], scale * d[2]);
        }
        const float* const y = apply_color(rows);
        for (int r = 0; r < rows; ++r) {
            const int ray = ended[first + r];
            Entry color = *reinterpret_cast<const Entry*>(y + r * width);
            color = (1.0f - pixels.transmittance.data[ray]) / (1.0f + exp_of(-color));
            for (int k = 0; k < 3; ++k) pixels.color.data[ray][k] = color[k];
        }
    }
};

// -- the chunks --------------------------------------------------------------------------------
int left_count = left_before, run_count = 0, count = 0;
auto finish_chunk = [&]() {
    if (count > 0) {
        encode(slots, count, level_count, places, corners, features, CHUNK);
        find_densities(count);
    }
    if (shading.extinctions.shape[0] > 0)
        for (int i = 0; i < count; ++i) shading.extinctions.data[slots[i]] = kept[i];
    if (pixels.color.shape[0] == 0) {  // nothing else is wanted
        run_count = count = 0;
        return;
    }
    int colored_count = 0, ended_count = 0;
    for (int i = 0; i < run_count; ++i) {
        Run& run = runs[i];
        run.before = pixels.transmittance.data[run.ray];
        if (overlapping)
            weigh_overlapping(run);
        else
            weigh(run);
        if (deferred)
            add_up(run);
        else
            colored_count = choose(run, colored_count);
    }
    add_colors(colored_count);
    for (int i = 0; i < run_count; ++i) {
        const int ray = runs[i].ray;
        float transmittance = runs[i].transmittance;
        const bool dark = transmittance < stop;
        if (dark && shading.closing) {
            const float scale = 1.0f / (1.0f - transmittance);
            for (int k = 0; k < sum_count; ++k) pixels.sums.data[ray][k] *= scale;
            pixels.color.data[ray] = wp::mul(pixels.color.data[ray], scale);
            pixels.depth.data[ray] *= scale;
            transmittance = 0.0f;
        }
        pixels.transmittance.data[ray] = transmittance;
        pixels.sample_count.data[ray] += runs[i].count;
        if (!dark && rays.tet.data[ray] > -2)
            alive.data[left_count++] = ray;  // compacted: at or before the place that is read
        else if (deferred && transmittance < 1.0f)
            active[ended_count++] = ray;
    }
    color_rays(active, ended_count);
    run_count = count = 0;
};

for (int i = 0; i < round.ray_count; ++i) {
    const int ray_count = counts.data[i];
    if (run_count == CHUNK || count + ray_count > CHUNK) finish_chunk();
    runs[run_count++] = {alive.data[round.first + i], count, ray_count, 0, 0.0f, 0.0f};
    for (int k = 0; k < ray_count; ++k) slots[count++] = i * round.slot_count + k;
}
finish_chunk();
totals.data[0] = left_count;
#endif
