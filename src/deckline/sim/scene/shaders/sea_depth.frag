#version 330
uniform vec4 lens;
uniform mat3 world_from_optical;
uniform vec3 eye;
uniform float sea_z;
out float depth_m;

void main() {
    vec2 pixel = gl_FragCoord.xy - 0.5;
    vec3 ray = world_from_optical * vec3((pixel - lens.zw) / lens.xy, 1.0);
    depth_m = ray.z > 1e-7 ? (sea_z - eye.z) / ray.z : -1.0;
}
