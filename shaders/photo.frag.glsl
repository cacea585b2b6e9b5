#version 330
// A photograph where a pinhole camera shows it, over the background where it is transparent.
uniform sampler2D photo;   // multiplied by alpha, top row first
uniform vec2 window;       // pixels
uniform vec2 axis;         // of view, in the window [pixels]
uniform vec2 scale;        // of the photograph's uv, per pixel of the window
uniform vec2 center;       // uv of the axis in the photograph
uniform float left;        // where it begins in the window at the earliest [pixels]
uniform vec3 background;
uniform float opacity;
in vec2 uv;
out vec4 color;

void main() {
    vec2 at = center + (uv * window - axis) * scale;
    if (any(lessThan(at, vec2(0))) || any(greaterThan(at, vec2(1))) || uv.x * window.x < left)
        discard;
    vec4 there = texture(photo, at);
    color = vec4(there.rgb + (1.0 - there.a) * background, opacity);
}
