#version 330
// A triangle that covers the image; uv has its origin at the top left corner.
const vec2 CORNERS[3] = vec2[3](vec2(-1, -1), vec2(3, -1), vec2(-1, 3));
out vec2 uv;

void main() {
    vec2 corner = CORNERS[gl_VertexID];
    uv = 0.5 + 0.5 * vec2(corner.x, -corner.y);
    gl_Position = vec4(corner, 0, 1);
}
