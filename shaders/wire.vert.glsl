#version 330
// The edges of the boundary faces.
uniform mat4 world_to_camera;
uniform mat4 projection;
in vec3 position;

void main() {
    gl_Position = projection * world_to_camera * vec4(position, 1);
}
