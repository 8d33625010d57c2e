// Sky colour of a unit direction (NED). Shared by the sky, the sea's mirror and the wet deck.
uniform sampler2D noise_map;
uniform vec3 sun;          // from the sun to the ground
uniform vec3 horizon_rgb;
uniform vec3 zenith_rgb;
uniform vec3 cloud_rgb;
uniform float cloud_cover;
uniform float cloud_scale;
uniform float sun_glow;
uniform vec2 offset;

vec3 sky_base(vec3 d) {
    float up = max(-d.z, 0.0);
    vec3 rgb = mix(horizon_rgb, zenith_rgb, sqrt(up));
    float to_sun = max(dot(d, -sun), 0.0);
    return rgb + sun_glow * (0.3 * pow(to_sun, 8.0) + 0.6 * pow(to_sun, 200.0)) * vec3(1.0, 0.95, 0.85);
}

vec3 sky(vec3 d) {
    float up = max(-d.z, 0.0);
    vec2 at = d.xy / (up + 0.12) * cloud_scale + offset;
    float n = 0.65 * texture(noise_map, at).r + 0.35 * texture(noise_map, at * 4.3).g;
    float cloud = smoothstep(0.75 - 0.6 * cloud_cover, 0.95 - 0.45 * cloud_cover, n) * smoothstep(0.0, 0.15, up);
    return mix(sky_base(d), cloud_rgb * (0.75 + 0.5 * n), cloud * 0.85);
}
