#version 330
#include sky.glsl
uniform vec4 lens;           // fx, fy, cx, cy
uniform mat3 world_from_optical;
uniform vec3 eye;
uniform float sea_z;
uniform vec3 sun_rgb;
uniform vec3 ambient_rgb;
uniform vec3 sea_rgb;
uniform float sea_sheen;
uniform float wave_slope;
uniform float wave_scale;
uniform float whitecaps;
uniform float glint;
uniform float fade_m;
uniform vec4 ship;           // stern x, y, cos and sin of the heading; world
uniform vec4 wake;           // half width at the stern, spread, length, opacity
uniform vec3 wake_rgb;
uniform float hull_m;
uniform float time_s;
out vec4 rgba;

float wake_at(vec2 p) {
    vec2 d = p - ship.xy;
    vec2 s = vec2(d.x * ship.z + d.y * ship.w, d.y * ship.z - d.x * ship.w);
    float ragged = texture(noise_map, s * vec2(0.004, 0.012) + offset).g - 0.5;
    float fine = texture(noise_map, s * vec2(0.012, 0.04) + offset.yx).r - 0.5;
    float astern = max(-s.x, 0.0);
    float half_m = wake.x + wake.y * astern + 30.0 * ragged * min(astern / 80.0 + 0.15, 1.0);
    float inside = smoothstep(half_m, half_m * 0.65 - 1.0, abs(s.y) + 14.0 * fine);
    float along = s.x < 0.0 ? exp(s.x / wake.z) : 0.0;
    float beside_m = wake.x * 1.15 + 6.0 + wake.y * 0.4 * (hull_m - s.x) + 14.0 * ragged + 10.0 * fine;
    float beside = smoothstep(beside_m, beside_m * 0.6, abs(s.y)) * smoothstep(-0.5 * wake.z, 0.0, s.x + 20.0 * ragged)
        * smoothstep(hull_m * 1.02, hull_m * 0.9, s.x);
    return wake.w * max(inside * along, 0.8 * beside) * (0.65 + 0.7 * (fine + 0.5));
}

vec3 sea(vec3 d, float t) {
    vec2 p = eye.xy + d.xy * t;
    vec2 q = p / wave_scale;
    vec2 drift = vec2(0.02, 0.013) * time_s;
    const mat2 TURN = mat2(0.80, 0.60, -0.60, 0.80);  // keeps the tiles of the octaves from lining up
    vec2 q1 = TURN * q;
    vec2 q2 = TURN * q1;
    vec4 broad = texture(noise_map, q2 * 0.0039 + drift * 0.2);
    vec2 slope = texture(noise_map, q * 0.06 + drift).ba
        + 0.7 * texture(noise_map, q1 * 0.0171 - drift * 0.6 + offset).ba + 0.5 * broad.ba - 1.1;
    slope *= wave_slope * (0.6 + 1.6 * broad.r);
    vec2 phase = vec2(dot(q, vec2(0.11, 0.06)) + time_s, dot(q, vec2(-0.05, 0.09)) + 0.8 * time_s) + 25.0 * broad.rg;
    slope += 0.06 * wave_slope * sin(phase) * exp(-t / 400.0);
    vec3 n = normalize(vec3(slope, -1.0));
    float fresnel = 0.02 + 0.98 * pow(1.0 - max(dot(n, -d), 0.0), 5.0);
    vec3 mirrored = reflect(d, n);
    mirrored.z = -abs(mirrored.z);
    vec3 rgb = sea_rgb * (ambient_rgb + 0.5 * sun_rgb) * (0.8 + 1.2 * (slope.x + slope.y));
    rgb = mix(rgb, sky_base(mirrored), clamp(fresnel * sea_sheen, 0.0, 1.0));
    rgb += glint * sun_rgb * pow(max(dot(mirrored, -sun), 0.0), 120.0);
    if (whitecaps > 0.0) {
        float caps = texture(noise_map, q * 0.05 + offset).r * texture(noise_map, q1 * 0.006 - offset).g;
        rgb = mix(rgb, wake_rgb, 0.8 * smoothstep(0.62 - 0.25 * whitecaps, 0.75 - 0.2 * whitecaps, caps));
    }
    if (wake.w > 0.0) rgb = mix(rgb, wake_rgb, clamp(wake_at(p), 0.0, 1.0));
    return mix(max(rgb, 0.0), horizon_rgb, 1.0 - exp(-t / fade_m));
}

void main() {
    vec2 pixel = gl_FragCoord.xy - 0.5;
    vec3 d = normalize(world_from_optical * vec3((pixel - lens.zw) / lens.xy, 1.0));
    float slant = fwidth(d.z);
    float t = (sea_z - eye.z) / max(d.z, 1e-4);
    float above = smoothstep(0.5 * slant, -0.5 * slant, d.z - 1e-4);
    // Both are computed in a band about the horizon, so that texture derivatives exist wherever one of them shows.
    vec3 rgb = vec3(0.0);
    if (d.z > -4.0 * slant) rgb += (1.0 - above) * sea(d, t);
    if (d.z < 4.0 * slant) rgb += above * sky(d);
    rgba = vec4(rgb, 1.0);
}
