#version 330
// The rendered field as a full-screen image with depth.  Rows above `refined` come from the
// finer image, the rest from the coarse one.  The image is over `background` already; a
// checkerboard takes the background's place to the part that shows through.
uniform sampler2D coarse_color;  // alpha = opacity
uniform sampler2D coarse_depth;  // distance t along the unit ray, inf where nothing is
uniform sampler2D fine_color;
uniform sampler2D fine_depth;
uniform float refined;           // fraction of the rows
uniform vec3 background;
uniform bool checkerboard;
uniform vec2 squares;            // how many fit into the width and the height
uniform vec2 half_extent;        // tangents of half the angles of view
uniform vec2 depth_terms;        // window depth = a + b / z
in vec2 uv;
out vec4 color;

const float DARK = 0.70, LIGHT = 0.86;

void main() {
    bool fine = uv.y < refined;
    // Filtering must not reach the rows that are not there yet.
    float last = refined - 0.5 / float(textureSize(fine_color, 0).y);
    vec2 at_fine = vec2(uv.x, min(uv.y, last));
    vec4 field = fine ? texture(fine_color, at_fine) : texture(coarse_color, uv);
    color = vec4(field.rgb, 1);
    if (checkerboard) {
        ivec2 square = ivec2(uv * squares);
        float gray = (square.x + square.y) % 2 == 0 ? LIGHT : DARK;
        color.rgb += (1.0 - field.a) * (vec3(gray) - background);
    }
    float t = fine ? texture(fine_depth, at_fine).r : texture(coarse_depth, uv).r;
    vec2 at = half_extent * (2.0 * uv - 1.0);
    float z = t * inversesqrt(1.0 + dot(at, at));
    gl_FragDepth = isinf(t) ? 1.0 : clamp(depth_terms.x + depth_terms.y / z, 0.0, 1.0);
}
