#version 330
// The edges of the boundary faces, drawn a little nearer than they are.
uniform mat4 world_to_camera;
uniform mat4 projection;
uniform float bias;
uniform bool parallel;  // rays are
in vec3 position;

void main() {
    vec3 local = (world_to_camera * vec4(position, 1)).xyz;
    vec3 away = parallel ? vec3(0, 0, -1) : normalize(local);
    gl_Position = projection * vec4(local - bias * away, 1);
}
