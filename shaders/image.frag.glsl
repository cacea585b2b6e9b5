#version 330
// The rendered field as a full-screen image with depth.  The image is over `background` already;
// a checkerboard takes the background's place to the part that shows through.  If transparent, it
// is over nothing: its color is multiplied by its opacity.
uniform sampler2D field_color;   // alpha = opacity
uniform sampler2D field_depth;   // distance t along the unit ray, inf where nothing is
uniform bool smooth_colors;      // else each of the field's pixels is a block
uniform float texel;             // its width at distance 1, where rays are parallel anywhere
uniform vec3 background;
uniform bool checkerboard;
uniform bool transparent;
uniform vec2 squares;            // how many fit into the width and the height
uniform vec2 extent;             // of the image at distance 1
uniform vec2 axis;               // uv of the axis of view
uniform bool parallel;           // rays are
uniform vec2 depth_terms;        // window depth = a + b / z, where they are parallel a + b z
in vec2 uv;
out vec4 color;

const float DARK = 0.70, LIGHT = 0.86;
const float STEEPEST = 6.0;   // a surface's rise in depth, in texels per texel, that is no edge
const float SHARPNESS = 1.3;  // of edges; 1 is as bilinear means have them
const float INF = uintBitsToFloat(0x7f800000u);

vec4 colors_at(ivec2 at) { return texelFetch(field_color, at, 0); }
float depth_at(ivec2 at) { return texelFetch(field_depth, at, 0).r; }

// The color between the four nearest texels, which are of two layers: those about as near as the
// nearest one, and what is behind them.  Within a layer, colors are bilinear means; the edge of
// the front layer lies where half of the bilinear weights are its own, and is sharpened.
vec4 filtered(out float t) {
    ivec2 last = textureSize(field_depth, 0) - 1;
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

void main() {
    ivec2 block = ivec2(uv * vec2(textureSize(field_depth, 0)));
    float t = depth_at(block);
    vec4 field = smooth_colors ? filtered(t) : colors_at(block);
    color = vec4(field.rgb, 1);
    if (transparent) {
        color = vec4(max(field.rgb - (1.0 - field.a) * background, 0.0), field.a);
    } else if (checkerboard) {
        ivec2 square = ivec2(uv * squares);
        float gray = (square.x + square.y) % 2 == 0 ? LIGHT : DARK;
        color.rgb += (1.0 - field.a) * (vec3(gray) - background);
    }
    vec2 at = extent * (uv - axis);
    float z = parallel ? t : t * inversesqrt(1.0 + dot(at, at));
    float depth = depth_terms.x + depth_terms.y * (parallel ? z : 1.0 / z);
    gl_FragDepth = isinf(t) ? 1.0 : clamp(depth, 0.0, 1.0);
}
