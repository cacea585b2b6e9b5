#version 330
// Temporal upsampling: a coarse picture, whose rays went through some of the image's pixels, and
// the image before, moved to where its surfaces are now, become the image.
//
// DIFFERENCE is defined for the pass before: in the coarse picture's pixels, how much they differ
// from what the image before has of them.
uniform sampler2D coarse_color;   // alpha = opacity
uniform sampler2D places;         // of the coarse picture, as core/render/motion.py has them
uniform sampler2D before_color;   // the image before
uniform sampler2D before_depth;   // distance along the ray, inf where nothing is
uniform float texel;              // the image's pixels' width at distance 1, or of parallel rays
uniform bool parallel;
#ifndef DIFFERENCE
uniform sampler2D differences;
uniform bool moved;               // whether anything has, since the image before
uniform ivec2 phase;              // the pixel of the first coarse ray
uniform ivec2 stride;             // pixels between coarse rays
#endif
layout(location = 0) out vec4 color;
#ifndef DIFFERENCE
layout(location = 1) out float depth;
#endif

const float STEEPEST = 6.0;   // a surface's rise in depth, in texels per texel, that is no edge
const float INF = uintBitsToFloat(0x7f800000u);

vec4 of_four(sampler2D image, ivec2 low, ivec2 high) {
    return vec4(texelFetch(image, low, 0).r, texelFetch(image, ivec2(high.x, low.y), 0).r,
                texelFetch(image, ivec2(low.x, high.y), 0).r, texelFetch(image, high, 0).r);
}

float slack(float t) { return STEEPEST * texel * (parallel ? 1.0 : t); }

// What the image before shows at a place, of what is at distances in a range: its share of the four
// nearest pixels, and their mean color.  The soft edges of something are of anything in front.
float found_at(vec2 place, vec2 range, out vec4 color) {
    ivec2 size = textureSize(before_depth, 0);
    bool inside = all(greaterThanEqual(place, vec2(0))) && all(lessThanEqual(place, vec2(size)));
    vec2 at = place - 0.5, share = fract(at);
    ivec2 low = clamp(ivec2(floor(at)), ivec2(0), size - 1);
    ivec2 high = clamp(ivec2(floor(at)) + 1, ivec2(0), size - 1);
    vec4 weights = vec4(1.0 - share.x, share.x, 1.0 - share.x, share.x);
    weights *= vec4(1.0 - share.yy, share.yy);
    vec4 depths = of_four(before_depth, low, high);
    mat4 colors = mat4(texelFetch(before_color, low, 0),
                       texelFetch(before_color, ivec2(high.x, low.y), 0),
                       texelFetch(before_color, ivec2(low.x, high.y), 0),
                       texelFetch(before_color, high, 0));
    vec4 opacities = vec4(colors[0].a, colors[1].a, colors[2].a, colors[3].a);
    vec4 far = vec4(isinf(depths.x), isinf(depths.y), isinf(depths.z), isinf(depths.w));
    vec4 soft = far * vec4(greaterThan(opacities, vec4(0)));
    vec4 near = vec4(lessThanEqual(depths, vec4(range.y + slack(range.y))));
    near *= vec4(greaterThanEqual(depths, vec4(range.x - slack(range.x))));
    weights *= isinf(range.y) ? far - soft : max(soft, near);
    float sum = dot(weights, vec4(1));
    color = colors * weights / max(sum, 1e-6);
    return inside ? sum : 0.0;
}

#ifdef DIFFERENCE
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 place = texelFetch(places, at, 0);
    vec4 was;
    float share = found_at(place.xy, place.zz, was);
    color = share < 0.5 ? vec4(0) : texelFetch(coarse_color, at, 0) - was;
}
#else
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(places, 0) - 1;
    vec2 at = vec2(pixel - phase) / vec2(stride), share = fract(at);
    ivec2 low = clamp(ivec2(floor(at)), ivec2(0), last);
    ivec2 high = clamp(ivec2(floor(at)) + ivec2(greaterThan(share, vec2(0))), ivec2(0), last);
    ivec2 c10 = ivec2(high.x, low.y), c01 = ivec2(low.x, high.y);
    mat4 found = mat4(texelFetch(places, low, 0), texelFetch(places, c10, 0),
                      texelFetch(places, c01, 0), texelFetch(places, high, 0));
    mat4 fresh = mat4(texelFetch(coarse_color, low, 0), texelFetch(coarse_color, c10, 0),
                      texelFetch(coarse_color, c01, 0), texelFetch(coarse_color, high, 0));
    if (share == vec2(0) && at == vec2(low)) {
        color = fresh[0];
        depth = found[0].w;
        return;
    }
    if (!moved) {
        color = texelFetch(before_color, pixel, 0);
        depth = texelFetch(before_depth, pixel, 0).r;
        return;
    }
    vec4 weights = vec4(1.0 - share.x, share.x, 1.0 - share.x, share.x);
    weights *= vec4(1.0 - share.yy, share.yy);
    mat4 by_kind = transpose(found);  // columns, rows, distances then, distances now
    vec4 depths = by_kind[3];
    float nearest = min(min(depths.x, depths.y), min(depths.z, depths.w));
    bvec4 in_front = lessThanEqual(depths, vec4(nearest + slack(nearest) * float(max(stride.x, stride.y))));
    if (isinf(nearest)) in_front = bvec4(true);
    vec4 of_front = mix(vec4(0), weights, in_front), of_back = weights - of_front;
    float front = dot(of_front, vec4(1)), back = 1.0 - front;
    // How far each coarse ray's pixel is from this one.
    vec4 dx = float(pixel.x) - vec4(phase.x + stride.x * ivec4(low.x, high.x, low.x, high.x));
    vec4 dy = float(pixel.y) - vec4(phase.y + stride.y * ivec4(low.y, low.y, high.y, high.y));
    mat4 changes = mat4(texelFetch(differences, low, 0), texelFetch(differences, c10, 0),
                        texelFetch(differences, c01, 0), texelFetch(differences, high, 0));
    for (int layer = 0; layer < 2; ++layer) {
        vec4 own = layer == 0 ? of_front : of_back;
        float sum = layer == 0 ? front : back;
        if (sum < 1e-3) continue;
        own /= sum;
        vec2 place = vec2(dot(own, by_kind[0] + dx), dot(own, by_kind[1] + dy));
        bvec4 is_own = greaterThan(own, vec4(0));
        vec4 low_then = mix(vec4(INF), by_kind[2], is_own);
        vec4 high_then = mix(vec4(0), by_kind[2], is_own);
        vec2 range = vec2(min(min(low_then.x, low_then.y), min(low_then.z, low_then.w)),
                          max(max(high_then.x, high_then.y), max(high_then.z, high_then.w)));
        vec4 was;
        if (found_at(place, range, was) < 0.5) continue;
        color = clamp(was + changes * own, 0.0, 1.0);
        depth = dot(mix(vec4(0), depths, is_own), own);
        return;
    }
    bool shows_front = front >= 0.5;
    vec4 own = shows_front ? of_front / front : of_back / back;
    color = fresh * own;
    depth = dot(mix(vec4(0), depths, greaterThan(own, vec4(0))), own);
}
#endif
