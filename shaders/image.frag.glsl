#version 330
// The rendered field as a full-screen image with depth.  Rows above `refined` come from the
// finer image, the rest from the coarse one.
uniform sampler2D coarse_color;
uniform sampler2D coarse_depth;  // distance t along the unit ray, inf where nothing is
uniform sampler2D fine_color;
uniform sampler2D fine_depth;
uniform float refined;           // fraction of the rows
uniform vec2 half_extent;        // tangents of half the angles of view
uniform vec2 depth_terms;        // window depth = a + b / z
in vec2 uv;
out vec4 color;

void main() {
    bool fine = uv.y < refined;
    // Filtering must not reach the rows that are not there yet.
    float last = refined - 0.5 / float(textureSize(fine_color, 0).y);
    vec2 at_fine = vec2(uv.x, min(uv.y, last));
    color = vec4(fine ? texture(fine_color, at_fine).rgb : texture(coarse_color, uv).rgb, 1);
    float t = fine ? texture(fine_depth, at_fine).r : texture(coarse_depth, uv).r;
    vec2 at = half_extent * (2.0 * uv - 1.0);
    float z = t * inversesqrt(1.0 + dot(at, at));
    gl_FragDepth = isinf(t) ? 1.0 : clamp(depth_terms.x + depth_terms.y / z, 0.0, 1.0);
}
