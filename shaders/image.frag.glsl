#version 330
// The rendered field as a full-screen image with depth.  The image is over `background` already;
// a checkerboard takes the background's place to the part that shows through, and a ground darkens
// what is behind it.  If transparent, it is over nothing: its color is multiplied by its opacity,
// and of the ground there is the shadow alone.
//
// SMOOTH is defined where the field has fewer pixels than the window and its colors may be
// blended; without it, each of its pixels is a block.  GROUND is defined where one is seen.
//
// BUFFER is defined where the image lies in a buffer: all colors, then all depths.
#ifdef BUFFER
uniform samplerBuffer field_color, field_depth;
uniform ivec2 field_size;        // pixels
#else
uniform sampler2D field_color;   // alpha = opacity
uniform sampler2D field_depth;   // distance t along the unit ray, inf where nothing is
#endif
uniform float texel;             // its pixels' width at distance 1, or of parallel rays anywhere
uniform vec3 background;
uniform bool checkerboard;
uniform bool transparent;
uniform vec2 squares;            // how many fit into the width and the height
uniform vec2 extent;             // of the image at distance 1
uniform vec2 axis;               // uv of the axis of view
uniform bool parallel;           // rays are
uniform vec2 depth_terms;        // window depth = a + b / z, where they are parallel a + b z
uniform mat4 camera_to_world;
uniform float ground_height;     // its z
uniform vec2 ground_middle;      // x and y about which it fades out
uniform float ground_reach;
uniform float line_spacing;
uniform sampler2D ground_shadow; // how much darker it is in a square, rows along y
uniform vec2 shadow_center;
uniform float shadow_side;
in vec2 uv;
out vec4 color;

const float DARK = 0.70, LIGHT = 0.86;
const float STEEPEST = 6.0;   // a surface's rise in depth, in texels per texel, that is no edge
const float SHARPNESS = 1.3;  // of edges; 1 is as bilinear means have them
const float INF = uintBitsToFloat(0x7f800000u);

#ifdef BUFFER
ivec2 size_of_field() { return field_size; }
int place_of(ivec2 at) { return at.y * field_size.x + at.x; }
vec4 colors_at(ivec2 at) { return texelFetch(field_color, place_of(at)); }
float depth_at(ivec2 at) {
    return texelFetch(field_depth, field_size.x * field_size.y + place_of(at)).r;
}
#else
ivec2 size_of_field() { return textureSize(field_depth, 0); }
vec4 colors_at(ivec2 at) { return texelFetch(field_color, at, 0); }
float depth_at(ivec2 at) { return texelFetch(field_depth, at, 0).r; }
#endif

#ifdef SMOOTH
// The color between the four nearest texels, which are of two layers: those about as near as the
// nearest one, and what is behind them.  Within a layer, colors are bilinear means; the edge of
// the front layer lies where half of the bilinear weights are its own, and is sharpened.
vec4 filtered(out float t) {
    ivec2 last = size_of_field() - 1;
    vec2 at = uv * vec2(last + 1) - 0.5, share = fract(at);
    ivec2 low = max(ivec2(floor(at)), 0), high = min(ivec2(floor(at)) + 1, last);
    ivec2 c01 = ivec2(low.x, high.y), c10 = ivec2(high.x, low.y);
    vec4 weights = vec4(1.0 - share.x, share.x, 1.0 - share.x, share.x);
    weights *= vec4(1.0 - share.yy, share.yy);
    vec4 depths = vec4(depth_at(low), depth_at(c10), depth_at(c01), depth_at(high));
    float nearest = min(min(depths.x, depths.y), min(depths.z, depths.w));
    float behind = nearest + STEEPEST * texel * (parallel ? 1.0 : nearest);
    bvec4 in_front = lessThanEqual(depths, vec4(behind));
    vec4 of_front = weights * vec4(in_front), of_back = weights - of_front;
    mat4 colors = mat4(colors_at(low), colors_at(c10), colors_at(c01), colors_at(high));
    float sum = clamp(dot(of_front, vec4(1)), 0.0, 1.0);
    float front = clamp((sum - 0.5) * SHARPNESS + 0.5, 0.0, 1.0);
    vec4 backs = mix(depths, vec4(INF), in_front);
    t = front < 0.5 ? min(min(backs.x, backs.y), min(backs.z, backs.w))
        : isinf(nearest) ? nearest
        : dot(of_front, mix(vec4(0), depths, in_front)) / sum;
    of_front *= front / max(sum, 1e-6);
    of_back *= (1.0 - front) / max(1.0 - sum, 1e-6);
    return colors * (of_front + of_back);
}
#endif

#ifdef GROUND
const float PLANE = 0.05, LINE = 0.16;  // how much they differ from what is behind them
const float FINE = 0.35;                // of the lines' spacing, a pixel's width where they end

float shadow_at(vec2 place) {
    vec2 at = (place - shadow_center) / shadow_side;
    return max(abs(at.x), abs(at.y)) < 0.5 ? texture(ground_shadow, at + 0.5).r : 0.0;
}

// What the ground puts over what is behind it: a color, and how much of it.
vec4 ink_at(vec2 place) {
    float fades = 1.0 - smoothstep(0.3, 1.0, distance(place, ground_middle) / ground_reach);
    vec2 cell = place / line_spacing, width = max(fwidth(cell), vec2(1e-6));  // of a pixel
    vec2 away = abs(fract(cell + 0.5) - 0.5) / width;
    vec2 lines = (1.0 - smoothstep(0.2, 1.2, away)) * (1.0 - smoothstep(0.2 * FINE, FINE, width));
    float dark = dot(background, vec3(0.3, 0.6, 0.1)) > 0.4 ? 0.0 : 1.0;
    return vec4(vec3(dark), fades * mix(PLANE, LINE, max(lines.x, lines.y)));
}
#endif

void main() {
    ivec2 block = ivec2(uv * vec2(size_of_field()));
    float t = depth_at(block);
    vec4 field = colors_at(block);
#ifdef SMOOTH
    field = filtered(t);
#endif
    vec2 at = extent * (uv - axis);
    vec3 behind = background;
    if (checkerboard) {
        ivec2 square = ivec2(uv * squares);
        behind = vec3((square.x + square.y) % 2 == 0 ? LIGHT : DARK);
    }
    float shadow = 0.0;
#ifdef GROUND
    vec3 local = parallel ? vec3(0, 0, -1) : normalize(vec3(at.x, -at.y, -1));
    vec4 start = parallel ? vec4(at.x, -at.y, 0, 1) : vec4(0, 0, 0, 1);
    vec3 origin = (camera_to_world * start).xyz, direction = mat3(camera_to_world) * local;
    float ground_t = (ground_height - origin.z) / min(direction.z, -1e-6);
    bool on_ground = direction.z < -1e-6 && ground_t > 0.0;  // seen from above
    vec2 place = origin.xy + direction.xy * (on_ground ? ground_t : 0.0);
    vec4 ink = ink_at(place);
    if (on_ground) {
        behind = mix(behind, ink.rgb, ink.a);
        shadow = shadow_at(place);
        behind *= 1.0 - shadow;
    }
#endif
    color = vec4(field.rgb + (1.0 - field.a) * (behind - background), 1);
#ifdef GROUND
    if (on_ground && ground_t < t && !isinf(t)) {
        color.rgb = mix(color.rgb, ink.rgb, ink.a) * (1.0 - shadow);
    }
#endif
    if (transparent) {
        color = vec4(max(field.rgb - (1.0 - field.a) * background, 0.0), field.a);
        color.a += (1.0 - field.a) * shadow;
    }
    float z = parallel ? t : t * inversesqrt(1.0 + dot(at, at));
    float depth = depth_terms.x + depth_terms.y * (parallel ? z : 1.0 / z);
    gl_FragDepth = isinf(t) ? 1.0 : clamp(depth, 0.0, 1.0);
}
