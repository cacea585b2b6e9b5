#version 330
// A flat face of a bone, brighter towards a light beside the eye.
uniform float opacity;
in vec3 facing;
flat in vec3 bone_tint;
out vec4 color;

const vec3 TO_LIGHT = normalize(vec3(0.35, 0.6, 0.72));

void main() {
    float diffuse = max(dot(normalize(facing), TO_LIGHT), 0.0);
    color = vec4(bone_tint * (0.45 + 0.6 * diffuse), opacity);
}
