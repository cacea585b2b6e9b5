#version 330
// A shaded sphere with its true depth, drawn `bias` nearer than it is: a vertex that lies
// just beneath the object's fuzzy surface is meant to be seen.
uniform vec2 depth_terms;  // window depth = a + b / z, where rays are parallel a + b z
uniform bool parallel;     // rays are
uniform float bias;
uniform float pixel_angle; // radians per pixel, where rays are parallel units
uniform float opacity;
in vec3 surface_point;
flat in vec4 sphere;
flat in vec3 sphere_tint;
out vec4 color;

const vec3 TO_LIGHT = normalize(vec3(0.35, 0.6, 0.72));

void main() {
    vec3 origin = parallel ? vec3(surface_point.xy, 0) : vec3(0);
    vec3 direction = parallel ? vec3(0, 0, -1) : normalize(surface_point);
    vec3 center = sphere.xyz - origin;
    float middle = dot(direction, center);
    float miss = length(center - middle * direction);
    float edge = pixel_angle * (parallel ? 1.0 : middle);  // width of one pixel there
    float coverage = clamp((sphere.w - miss) / edge + 0.5, 0.0, 1.0);
    if (coverage <= 0.0 || middle <= 0.0) discard;
    float half_chord = sqrt(max(sphere.w * sphere.w - miss * miss, 0.0));
    vec3 hit = origin + direction * (middle - half_chord);
    vec3 normal = normalize(hit - sphere.xyz);
    float diffuse = max(dot(normal, TO_LIGHT), 0.0);
    float shine = pow(max(dot(reflect(direction, normal), TO_LIGHT), 0.0), 32.0);
    float rim = smoothstep(0.75, 1.0, miss / sphere.w);  // a dark rim sets it off on any color
    vec3 shaded = sphere_tint * (0.42 + 0.62 * diffuse) * (1.0 - 0.45 * rim) + 0.4 * shine;
    color = vec4(shaded, opacity * coverage);
    float z = max(-hit.z - bias, 1e-4);
    gl_FragDepth = clamp(depth_terms.x + depth_terms.y * (parallel ? z : 1.0 / z), 0.0, 1.0);
}
