#version 330
uniform vec4 lens;
uniform mat3 world_from_optical;
uniform vec3 eye;
uniform float sea_z;
uniform float label;  // of the surface, from 1; 0: measure its depth
out float value;

void main() {
    vec2 pixel = gl_FragCoord.xy - 0.5;
    vec3 ray = world_from_optical * vec3((pixel - lens.zw) / lens.xy, 1.0);
    value = ray.z > 1e-7 ? (label > 0.0 ? label : (sea_z - eye.z) / ray.z) : -1.0;
}
