#version 330
// A face of the mesh's boundary, three vertices of its own, drawn `bias` nearer than it is.
uniform mat4 world_to_camera;
uniform mat4 projection;
uniform float bias;
uniform bool parallel;  // rays are
in vec3 position;
in float share;
out vec3 point;    // camera space
out vec3 corner;   // barycentric in the face
out float value;

void main() {
    point = (world_to_camera * vec4(position, 1)).xyz;
    corner = vec3(gl_VertexID % 3 == 0, gl_VertexID % 3 == 1, gl_VertexID % 3 == 2);
    value = share;
    vec3 away = parallel ? vec3(0, 0, -1) : normalize(point);
    gl_Position = projection * vec4(point - bias * away, 1);
}
