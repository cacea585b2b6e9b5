#version 330
// A face of a bone, three vertices of its own.
uniform mat4 world_to_camera;
uniform mat4 projection;
in vec3 position;
in vec3 normal;
in vec3 tint;
out vec3 facing;  // the normal, camera space
flat out vec3 bone_tint;

void main() {
    facing = mat3(world_to_camera) * normal;
    bone_tint = tint;
    gl_Position = projection * (world_to_camera * vec4(position, 1));
}
