#version 330
// A sphere as a square that faces the camera; the fragment shader finds the surface.
const vec2 CORNERS[4] = vec2[4](vec2(-1, -1), vec2(1, -1), vec2(-1, 1), vec2(1, 1));
const float MARGIN = 1.3;  // the silhouette of a near sphere is larger than its radius
uniform mat4 world_to_camera;
uniform mat4 projection;
in vec3 center;
in float radius;
in vec3 tint;
out vec3 surface_point;  // camera space, on the square
flat out vec4 sphere;    // center in camera space, radius
flat out vec3 sphere_tint;

void main() {
    sphere = vec4((world_to_camera * vec4(center, 1)).xyz, radius);
    sphere_tint = tint;
    surface_point = sphere.xyz + vec3(CORNERS[gl_VertexID] * radius * MARGIN, 0);
    gl_Position = projection * vec4(surface_point, 1);
}
