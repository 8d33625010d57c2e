#version 330
#include light.glsl
uniform sampler2D noise_map;
uniform mat3 world_from_ship;
uniform vec3 horizon_rgb;
uniform float haze_m;        // distance that takes the light to 1/e; the ship itself is drawn in clear air
in vec3 at;
in vec3 facing;
in vec3 albedo;
in vec3 spot;
in float axial_m;
out vec4 rgba;

void main() {
    vec3 n = world_from_ship * normalize(facing);
    float streak = texture(noise_map, vec2(at.x + at.y, at.z * 0.3) * 0.03).r;
    vec3 rgb = albedo * irradiance(n, sunlit(spot)) * (0.75 + 0.5 * streak);
    rgba = vec4(mix(horizon_rgb, rgb, exp(-axial_m / haze_m)), 1.0);
}
