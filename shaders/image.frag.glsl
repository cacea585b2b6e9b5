#version 330
// The rendered field as a full-screen image with depth.  The image is over `background` already;
// a checkerboard takes the background's place to the part that shows through.  If transparent, it
// is over nothing: its color is multiplied by its opacity.
uniform sampler2D field_color;   // alpha = opacity
uniform sampler2D field_depth;   // distance t along the unit ray, inf where nothing is
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

void main() {
    vec4 field = texture(field_color, uv);
    color = vec4(field.rgb, 1);
    if (transparent) {
        color = vec4(max(field.rgb - (1.0 - field.a) * background, 0.0), field.a);
    } else if (checkerboard) {
        ivec2 square = ivec2(uv * squares);
        float gray = (square.x + square.y) % 2 == 0 ? LIGHT : DARK;
        color.rgb += (1.0 - field.a) * (vec3(gray) - background);
    }
    float t = texture(field_depth, uv).r;
    vec2 at = extent * (uv - axis);
    float z = parallel ? t : t * inversesqrt(1.0 + dot(at, at));
    float depth = depth_terms.x + depth_terms.y * (parallel ? z : 1.0 / z);
    gl_FragDepth = isinf(t) ? 1.0 : clamp(depth, 0.0, 1.0);
}
