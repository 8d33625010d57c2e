#version 330
uniform sampler2D noise_map;
uniform mat3 world_from_ship;
uniform vec3 sun;
uniform vec3 sun_rgb;
uniform vec3 ambient_rgb;
in vec3 at;
in vec3 facing;
in vec3 albedo;
out vec4 rgba;

void main() {
    vec3 n = world_from_ship * normalize(facing);
    float sky_part = 0.5 - 0.5 * n.z;
    vec3 light = ambient_rgb * (0.35 + 0.55 * sky_part) + sun_rgb * max(dot(n, -sun), 0.0) * 0.8;
    float streak = texture(noise_map, vec2(at.x + at.y, at.z * 0.3) * 0.03).r;
    rgba = vec4(albedo * light * (0.85 + 0.3 * streak), 1.0);
}
