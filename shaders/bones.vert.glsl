#version 330
// A bone: an octahedron from head to tail, thickest at its waist; three vertices to each face.
const float WAIST = 0.15, WIDTH = 0.09;  // where a bone is thickest and how thick, in its lengths
// Corners: head, tail, and four around the waist; seen from outside, faces turn counterclockwise.
const int CORNERS[24] = int[24](
    0, 3, 2, 0, 4, 3, 0, 5, 4, 0, 2, 5, 1, 2, 3, 1, 3, 4, 1, 4, 5, 1, 5, 2
);
uniform mat4 world_to_camera;
uniform mat4 projection;
in vec3 head;
in vec3 tail;
in vec3 tint;
out vec3 facing;  // the face's normal, camera space
flat out vec3 bone_tint;

void main() {
    float span = distance(head, tail);
    vec3 axis = span > 0.0 ? (tail - head) / span : vec3(0, 0, 1);
    vec3 size = abs(axis);
    vec3 helper = size.x <= size.y && size.x <= size.z ? vec3(1, 0, 0)
        : size.y <= size.z ? vec3(0, 1, 0) : vec3(0, 0, 1);
    vec3 side = normalize(cross(axis, helper)), other = cross(axis, side);
    vec3 waist = mix(head, tail, WAIST);
    side *= WIDTH * span;
    other *= WIDTH * span;
    vec3 corners[6] = vec3[6](
        head, tail, waist + side, waist + other, waist - side, waist - other
    );
    int first = gl_VertexID - gl_VertexID % 3;
    vec3 a = corners[CORNERS[first]];
    vec3 b = corners[CORNERS[first + 1]];
    vec3 c = corners[CORNERS[first + 2]];
    facing = mat3(world_to_camera) * normalize(cross(b - a, c - a));
    bone_tint = tint;
    vec3 position = corners[CORNERS[gl_VertexID]];
    gl_Position = projection * (world_to_camera * vec4(position, 1));
}
