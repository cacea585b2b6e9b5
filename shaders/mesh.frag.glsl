#version 330
// A shaded face in one color or a map's, and its edges: dark, between two light lines, so that
// they can be seen on any color.  Edges fade out where faces are as small as they are wide.
const int COUNT = 17;
uniform vec3 colors[COUNT];  // of a share of 0 .. 1
uniform vec2 shading;        // darkest, and lit from the front
uniform float opacity;       // of the faces
uniform float wire;          // opacity of the edges
in vec3 point;
in vec3 corner;
in float value;
out vec4 color;

const vec3 TO_LIGHT = normalize(vec3(0.35, 0.6, 0.72));
const float DARK_WIDTH = 1.1, LIGHT_WIDTH = 2.2;  // pixels on this side of the edge
const float SMALL = 0.12, TINY = 0.35;            // 1 / height of a face in pixels

void main() {
    // Towards the eye, as x goes to the right and y upwards.
    vec3 normal = normalize(cross(dFdx(point), dFdy(point)));
    float place = clamp(value, 0.0, 1.0) * float(COUNT - 1);
    int first = min(int(place), COUNT - 2);
    vec3 fill = mix(colors[first], colors[first + 1], place - float(first));
    fill *= mix(shading.x, shading.y, 0.5 + 0.5 * dot(normal, TO_LIGHT));

    vec3 slope = fwidth(corner);
    vec3 pixels = corner / max(slope, vec3(1e-6));
    float away = min(pixels.x, min(pixels.y, pixels.z));
    float dark = 1.0 - smoothstep(DARK_WIDTH - 0.7, DARK_WIDTH, away);
    float light = 1.0 - smoothstep(LIGHT_WIDTH - 0.9, LIGHT_WIDTH, away);
    float fades = 1.0 - smoothstep(SMALL, TINY, max(slope.x, max(slope.y, slope.z)));
    float line = wire * mix(0.25, 1.0, fades) * max(0.9 * dark, 0.4 * light);
    float alpha = line + opacity * (1.0 - line);
    vec3 sum = line * vec3(1.0 - dark) + opacity * (1.0 - line) * fill;
    color = vec4(sum / max(alpha, 1e-4), alpha);
}
