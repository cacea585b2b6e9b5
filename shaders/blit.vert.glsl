#version 330
// A triangle that covers the window; uv as OpenGL stores textures.
const vec2 CORNERS[3] = vec2[3](vec2(-1, -1), vec2(3, -1), vec2(-1, 3));
out vec2 uv;

void main() {
    uv = 0.5 + 0.5 * CORNERS[gl_VertexID];
    gl_Position = vec4(CORNERS[gl_VertexID], 0, 1);
}
