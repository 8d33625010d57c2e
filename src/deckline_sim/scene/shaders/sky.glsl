// Sky radiance of a unit direction (NED). Shared by the sky, the sea's mirror and the wet deck. Needs light.glsl.
uniform sampler2D noise_map;
uniform vec3 horizon_rgb;
uniform vec3 zenith_rgb;
uniform float sky_curve;     // small: the horizon's colour keeps to a narrow band
uniform vec3 cloud_rgb;
uniform float cloud_shade;   // how much darker their undersides are
uniform float cloud_cover;
uniform float cloud_scale;
uniform float cloud_soft;
uniform float sun_glow;
uniform vec3 glow_rgb;
uniform float sun_disc;
uniform vec2 offset;
const float LAYER = 0.09;    // lowers the clouds towards the horizon, as the Earth's curvature does
const float NOISE_TEXELS = 512.0;

vec3 sky_base(vec3 d) {
    float up = max(-d.z, 0.0);
    vec3 rgb = mix(horizon_rgb, zenith_rgb, up * (1.0 + sky_curve) / (up + sky_curve));
    float to_sun = max(dot(d, -sun), 0.0);
    float to_sun4 = to_sun * to_sun * to_sun * to_sun;
    return rgb + sun_glow * (0.35 * to_sun4 / (1.0 + 8.0 * up) + 1.2 * pow(to_sun, 90.0)) * glow_rgb;
}

vec3 sky(vec3 d, float pixel_rad) {
    float up = max(-d.z, 0.0);
    vec3 rgb = sky_base(d) + sun_disc * smoothstep(0.99998, 0.99999, dot(d, -sun)) * sun_rgb;
    if (cloud_cover <= 0.0) return rgb;
    vec2 at = d.xy / (up + LAYER) * cloud_scale + offset;
    float lod = log2(NOISE_TEXELS * cloud_scale * pixel_rad / ((up + LAYER) * sqrt(up + LAYER)) + 1e-6);
    float broad = textureLod(noise_map, at, lod).b;
    float fine = textureLod(noise_map, at * 4.3, lod + 2.1).g;
    float n = 0.8 * broad + 0.2 * fine;
    float toward = textureLod(noise_map, at - 0.02 * sun.xy, lod).b;
    float edge = 0.85 - 0.7 * cloud_cover;
    float cloud = smoothstep(edge - cloud_soft, edge + cloud_soft, n);
    float lit = clamp(1.0 - cloud_shade * (0.3 + 3.0 * min(n - edge, 0.2) + 4.0 * (toward - broad)), 0.2, 1.15);
    float thin = smoothstep(0.0, 0.1, up);  // far clouds melt into the horizon
    return mix(rgb, mix(sky_base(d), cloud_rgb * lit, 0.35 + 0.65 * thin), cloud * (0.25 + 0.75 * thin));
}
