// Images from coarse pictures and the image before, on a CPU: the bodies of native functions in
// upsampling.py, which fills in @NAMES.  A vector has the four channels of a pixel.
#if !defined(__CUDA_ARCH__)
typedef float Four __attribute__((ext_vector_type(4)));
typedef unsigned char FourBytes __attribute__((ext_vector_type(4)));
typedef FourBytes LooseBytes __attribute__((aligned(1), may_alias));
typedef Four LooseFour __attribute__((aligned(4), may_alias));
const int width = before.depth.shape[1], height = before.depth.shape[0];
const float inf = __builtin_inff();
const Four background = {before.background[0], before.background[1], before.background[2], 0.0f};

auto color_of = [](const auto& colors, int at) __attribute__((always_inline)) {
    return __builtin_convertvector(*reinterpret_cast<const LooseBytes*>(colors.data + at), Four);
};
auto four_of = [](const auto& values, int at) __attribute__((always_inline)) -> Four {
    return *reinterpret_cast<const LooseFour*>(values.data + at);
};
// How much farther than t the same surface may be in the next pixel.
auto slack = [&](float t) { return @STEEPESTf * before.texel * (before.parallel ? 1.0f : t); };
// Weights of the four numbers around a place, u behind the second one (Catmull-Rom).
auto cubic = [](float u) -> Four {
    return {0.5f * u * (u * (2.0f - u) - 1.0f), 0.5f * (u * u * (3.0f * u - 5.0f) + 2.0f),
            0.5f * u * (u * (4.0f - 3.0f * u) + 1.0f), 0.5f * u * u * (u - 1.0f)};
};

// Whether the image before shows at a place what is at distances from `low` to `high`, and the
// color there.  Half of the four nearest pixels have to show it; the background does, at a surface's
// silhouette, and a silhouette's soft pixels are of anything in front.  The color is a bicubic mean,
// if all around belongs together, else a bilinear one.
auto found_at = [&](float x, float y, float low, float high, Four& color) -> bool {
    x -= 0.5f;
    y -= 0.5f;
    if (!(x >= -0.5f && y >= -0.5f && x <= width - 0.5f && y <= height - 0.5f)) return false;
    const int column = (int)(x + 1.0f) - 1, row = (int)(y + 1.0f) - 1;
    const float right = x - column, below = y - row;
    const int tops = wp::max(row, 0) * width, bottoms = wp::min(row + 1, height - 1) * width;
    const int lefts = wp::max(column, 0), rights = wp::min(column + 1, width - 1);
    const int at[4] = {tops + lefts, tops + rights, bottoms + lefts, bottoms + rights};
    const float weights[4] = {(1.0f - right) * (1.0f - below), right * (1.0f - below),
                              (1.0f - right) * below, right * below};
    const float least = low - slack(low), most = high + slack(high);
    float share = 0.0f, empty = 0.0f;
    Four sum = 0.0f;
    for (int k = 0; k < 4; ++k) {
        const float depth = before.depth.data[at[k]];
        const Four seen = color_of(before.color, at[k]);
        const bool is_near = depth < inf ? depth >= least && depth <= most : seen[3] > 0.0f;
        share += is_near ? weights[k] : 0.0f;
        empty += !(depth < inf) && seen[3] == 0.0f ? weights[k] : 0.0f;
        sum += weights[k] * seen;
    }
    const bool is_surface = high < inf;
    color = is_surface ? sum : background;
    if (!is_surface) return empty >= 0.5f;
    if (share == 0.0f || share + empty < 0.5f) return false;
    if (column < 1 || row < 1 || column > width - 3 || row > height - 3) return true;
    const Four across = cubic(right), down = cubic(below);
    sum = 0.0f;
    for (int i = 0; i < 4; ++i) {
        const int first = (row - 1 + i) * width + column - 1;
        const Four depths = four_of(before.depth, first);
        for (int j = 0; j < 4; ++j) {
            if (depths[j] < inf && !(depths[j] >= least && depths[j] <= most)) return true;
            sum += down[i] * across[j] * color_of(before.color, first + j);
        }
    }
    color = sum;
    return true;
};

//# differences
const int columns = places.shape[1];
for (int j = 0; j < columns; ++j) {
    const int at = row_of_part * columns + j;
    const Four place = four_of(places, at);
    Four was;
    const bool known = found_at(place[0], place[1], place[2], place[2], was);
    const int pixel = (corner[1] + row_of_part) * coarse.shape[1] + corner[0] + j;
    auto& found = *reinterpret_cast<LooseFour*>(differences.data + at);
    found = known ? color_of(coarse, pixel) - was : Four(inf);
}
#endif

//# cells
const int columns = places.shape[1], nx = rays.stride[0], ny = rays.stride[1];
const int image_width = image.depth.shape[1], image_height = image.depth.shape[0];
const float per_column = 1.0f / nx, per_row = 1.0f / ny;
auto put = [&](int at, Four color, float depth) __attribute__((always_inline)) {
    color = __builtin_elementwise_min(__builtin_elementwise_max(color, Four(0.0f)), Four(255.0f));
    *reinterpret_cast<LooseBytes*>(image.color.data + at) =
        __builtin_convertvector(color + 0.5f, FourBytes);
    image.depth.data[at] = color[3] < 127.5f ? inf : depth;
};

// The four coarse pixels around a cell of the image's pixels, in two layers.
struct Corner {
    Four place;  // where it was, less where it is in the cell; distances along the rays, then and now
    Four color, difference;
    float doubt;  // of what the image before shows around it: 1 halves its share
};
struct Layer {
    bool has[4];      // of the corners
    float low, high;  // their distances then
};
// A mean of a layer's corners in a pixel, and the sum of their weights.
struct Mean {
    float weight, doubt;
    Four place, color, difference;
};

for (int cell = first_cell; cell < end_cell; ++cell) {
    const int left = rays.phase[0] + nx * cell, top = rays.phase[1] + ny * cell_row;
    Corner corners[4];
    float nearest = inf, opacity = 0.0f;
    for (int k = 0; k < 4; ++k) {
        const int column = wp::clamp(cell + k % 2, 0, rays.size[0] - 1);
        const int row = wp::clamp(cell_row + k / 2, 0, rays.size[1] - 1);
        const int at = (row - corner[1]) * columns + column - corner[0];
        const Four ahead = {1.0f * nx * (column - cell), 1.0f * ny * (row - cell_row), 0.0f, 0.0f};
        corners[k].place = four_of(places, at) - ahead;
        corners[k].difference = four_of(differences, at);
        corners[k].color = color_of(coarse, row * rays.size[0] + column);
        const Four size = __builtin_elementwise_abs(corners[k].difference);
        corners[k].doubt = wp::max(wp::max(size[0], size[1]), wp::max(size[2], size[3])) * @DOUBTFULf;
        if (size[0] == inf) {  // it was not seen
            corners[k].difference = 0.0f;
            corners[k].doubt = @UNSEENf;
        }
        nearest = wp::min(nearest, corners[k].place[3]);
        opacity = wp::max(opacity, corners[k].color[3]);
    }
    if (moved && opacity == 0.0f) continue;  // background, as the image is already
    const float behind = nearest + wp::max(nx, ny) * slack(nearest) * (image.texel / before.texel);
    Layer layers[2] = {{{}, inf, -inf}, {{}, inf, -inf}};  // in front, and behind it
    for (int k = 0; k < 4; ++k) {
        const Four& place = corners[k].place;
        Layer& own = layers[!(place[3] <= behind)];
        own.has[k] = true;
        own.low = wp::min(own.low, place[2]);
        own.high = wp::max(own.high, place[2]);
    }
    const bool* behind_it = layers[1].has;
    const bool one_layer = !(behind_it[0] || behind_it[1] || behind_it[2] || behind_it[3]);

    for (int y = wp::max(top, 0); y < wp::min(top + ny, image_height); ++y) {
        for (int x = wp::max(left, 0); x < wp::min(left + nx, image_width); ++x) {
            const int at = y * image_width + x;
            if (x == left && y == top && cell >= 0 && cell_row >= 0) {
                put(at, corners[0].color, corners[0].place[3]);
                continue;
            }
            if (!moved) {
                image.color.data[at] = before.color.data[at];
                image.depth.data[at] = before.depth.data[at];
                continue;
            }
            const float right = (x - left) * per_column, below = (y - top) * per_row;
            const float weights[4] = {(1.0f - right) * (1.0f - below), right * (1.0f - below),
                                      (1.0f - right) * below, right * below};
            const Four here = {1.0f * (x - left), 1.0f * (y - top), 0.0f, 0.0f};
            auto mean_of = [&](const Layer& layer) __attribute__((always_inline)) -> Mean {
                Mean mean = {0.0f, 0.0f, Four(0.0f), Four(0.0f), Four(0.0f)};
                for (int k = 0; k < 4; ++k) {
                    if (!layer.has[k] || weights[k] == 0.0f) continue;
                    mean.weight += weights[k];
                    mean.place += weights[k] * corners[k].place;
                    mean.color += weights[k] * corners[k].color;
                    mean.difference += weights[k] * corners[k].difference;
                    mean.doubt += weights[k] * corners[k].doubt;
                }
                const float scale = 1.0f / wp::max(mean.weight, 1e-6f);
                mean.place = mean.place * scale + here;
                mean.color *= scale;
                mean.difference *= scale;
                mean.doubt *= scale;
                return mean;
            };
            Four was = background;
            auto is_known = [&](const Mean& mean, float low, float high) {
                return mean.weight > 0.0f && found_at(mean.place[0], mean.place[1], low, high, was);
            };
            // Where the image before is far off, what it has between the corners is, too.
            auto corrected = [&](const Mean& mean) __attribute__((always_inline)) -> Four {
                const float trust = 1.0f / (1.0f + mean.doubt * mean.doubt);
                return mean.color + trust * (was + mean.difference - mean.color);
            };
            const Mean front = mean_of(layers[0]);
            if (is_known(front, layers[0].low, layers[0].high)) {
                put(at, corrected(front), front.place[3]);
                continue;
            }
            const Mean back = one_layer ? front : mean_of(layers[1]);
            const bool is_front = front.weight >= 0.5f;
            const Mean& mean = is_front ? front : back;
            bool known = !one_layer && is_known(back, layers[1].low, layers[1].high);
            const bool shows_back = known;
            if (!known && !one_layer && front.weight > 0.0f && back.weight > 0.0f) {
                // Layers that move alike uncover nothing: whatever was there is there.
                const Four apart = front.place - back.place;
                const bool alike = apart[0] * apart[0] + apart[1] * apart[1] < @ALIKEf * @ALIKEf;
                known = alike && is_known(mean, 0.0f, 1e30f);
            }
            if (known) {
                const Mean& found = shows_back ? back : mean;
                put(at, corrected(found), found.place[3]);
                continue;
            }
            put(at, mean.color, mean.place[3]);
        }
    }
}
#endif
